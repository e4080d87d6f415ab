//! The inception score: whether each image is of one class, and all images together of all classes.
//!
//! T. Salimans et al. 2016, "Improved techniques for training GANs", arXiv:1606.03498, section 4, with the splits of
//! the code that was published with it.
//!
//! | paper | here | shape |
//! |---|---|---|
//! | p(y given x) | `probabilities` | `[images, classes]` |
//! | p(y) | mean of the probabilities of a split | `[classes]` |
//! | exp(E KL(p(y given x), p(y))) | the score of a split | scalar |

use super::ScoreError;
use arithmetic::double::{exp, ln};

/// Mean and spread of the score over splits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InceptionScore {
    /// Mean over splits, 1 to the number of classes.
    pub mean: f64,
    /// Standard deviation over splits, of the splits as a population (`numpy.std`): 0 for one split.
    pub sd: f64,
}

/// The score of images in `n_splits` consecutive runs; split `k` begins at `k images / n_splits`, rounded down.
///
/// `probabilities` is `[images, classes]`, rows adding up to 1 within 1e-4. Classes of probability 0 add nothing to
/// a divergence.
///
/// # Errors
/// [`ScoreError::TooFewImages`] where a split would have none, [`ScoreError::NoProbabilities`].
///
/// # Panics
/// Where `probabilities` is no whole number of rows, or there are no classes or no splits.
pub fn inception_score(
    probabilities: &[f64],
    n_classes: usize,
    n_splits: usize,
) -> Result<InceptionScore, ScoreError> {
    assert!(
        n_classes > 0 && n_splits > 0,
        "{n_classes} classes in {n_splits} splits"
    );
    assert!(
        probabilities.len().is_multiple_of(n_classes),
        "{} probabilities of {n_classes} classes",
        probabilities.len()
    );
    let n_images = probabilities.len() / n_classes;
    if n_images < n_splits {
        return Err(ScoreError::TooFewImages {
            found: n_images,
            needed: n_splits,
        });
    }
    check(probabilities, n_classes)?;
    let start = |split: usize| split * n_images / n_splits * n_classes;
    let scores: Vec<f64> = (0..n_splits)
        .map(|split| score_of_split(&probabilities[start(split)..start(split + 1)], n_classes))
        .collect();
    let mean = mean(&scores);
    let squares: Vec<f64> = scores.iter().map(|score| (score - mean).powi(2)).collect();
    Ok(InceptionScore {
        mean,
        sd: self::mean(&squares).sqrt(),
    })
}

/// Softmax of each row of `logits` `[images, classes]`, in double precision.
///
/// # Panics
/// Where `logits` is no whole number of rows, or there are no classes.
#[must_use]
pub fn class_probabilities(logits: &[f32], n_classes: usize) -> Vec<f64> {
    assert!(
        n_classes > 0 && logits.len().is_multiple_of(n_classes),
        "{} logits of {n_classes} classes",
        logits.len()
    );
    logits.chunks_exact(n_classes).flat_map(softmax).collect()
}

fn softmax(logits: &[f32]) -> Vec<f64> {
    let greatest = logits.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    // The greatest is subtracted first, since large logits would overflow.
    let above = logits.iter().map(|logit| f64::from(*logit) - f64::from(greatest));
    let mut parts: Vec<f64> = above.map(exp).collect();
    let sum: f64 = parts.iter().sum();
    parts.iter_mut().for_each(|part| *part /= sum);
    parts
}

fn check(probabilities: &[f64], n_classes: usize) -> Result<(), ScoreError> {
    for (image, row) in probabilities.chunks_exact(n_classes).enumerate() {
        let sum: f64 = row.iter().sum();
        let negative = row.iter().any(|probability| *probability < 0.0);
        // Written so that NaN is refused.
        let is_one = (sum - 1.0).abs() <= 1e-4;
        if negative || !is_one {
            return Err(ScoreError::NoProbabilities { image, sum });
        }
    }
    Ok(())
}

/// exp of the mean divergence between each row and the mean row.
fn score_of_split(probabilities: &[f64], n_classes: usize) -> f64 {
    let rows = probabilities.chunks_exact(n_classes);
    let n_images = rows.len() as f64;
    let mut marginal = vec![0.0; n_classes];
    for row in rows.clone() {
        marginal.iter_mut().zip(row).for_each(|(sum, p)| *sum += p);
    }
    marginal.iter_mut().for_each(|sum| *sum /= n_images);
    let divergences: Vec<f64> = rows.map(|row| divergence(row, &marginal)).collect();
    exp(mean(&divergences))
}

/// KL(p, q), where 0 ln 0 is 0.
fn divergence(p: &[f64], q: &[f64]) -> f64 {
    let terms = p.iter().zip(q).filter(|(p, _)| **p > 0.0);
    terms.map(|(p, q)| p * (ln(*p) - ln(*q))).sum()
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use serde::Deserialize;

    #[derive(Deserialize)]
    struct Case {
        classes: usize,
        splits: usize,
        probabilities: Vec<f64>,
        mean: f64,
        sd: f64,
    }

    #[test]
    fn scores_are_those_of_scipy() {
        let text = include_str!("../../../../tests/fixtures/generators/inception_score.json");
        let cases: Vec<Case> = serde_json::from_str(text).unwrap();
        assert_eq!(cases.len(), 4);
        for case in cases {
            let score = inception_score(&case.probabilities, case.classes, case.splits).unwrap();
            assert!((score.mean - case.mean).abs() < 1e-12, "{score:?} {}", case.mean);
            assert!((score.sd - case.sd).abs() < 1e-12, "{score:?} {}", case.sd);
        }
    }

    #[test]
    fn sure_predictions_of_all_classes_score_their_number() {
        let identity = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        let score = inception_score(&identity, 3, 1).unwrap();
        assert!((score.mean - 3.0).abs() < 1e-12 && score.sd == 0.0, "{score:?}");
        // With one image per split, each split has one class only.
        assert_eq!(inception_score(&identity, 3, 3).unwrap().mean, 1.0);
    }

    #[test]
    fn logits_become_probabilities() {
        let probabilities = class_probabilities(&[0.0, 0.0, 1000.0, 1000.0 + 2f32.ln()], 2);
        for (here, expected) in probabilities.iter().zip([0.5, 0.5, 1.0 / 3.0, 2.0 / 3.0]) {
            // 1000 + ln 2 is rounded to 3e-5 in f32.
            assert!((here - expected).abs() < 1e-5, "{probabilities:?}");
        }
    }

    #[test]
    fn invalid_probabilities_are_refused_with_their_image() {
        let score = |row: [f64; 2]| inception_score(&[0.5, 0.5, row[0], row[1]], 2, 1);
        assert!(score([0.25, 0.75]).is_ok());
        for row in [[1.1, -0.1], [0.5, 0.4], [f64::NAN, 0.5], [f64::INFINITY, 0.0]] {
            let error = score(row).unwrap_err();
            assert!(
                matches!(error, ScoreError::NoProbabilities { image: 1, .. }),
                "{error}"
            );
        }
        let logits = class_probabilities(&[f32::NAN, 0.0], 2);
        assert!(inception_score(&logits, 2, 1).is_err());
    }

    #[test]
    fn fewer_images_than_splits_are_refused() {
        let error = inception_score(&[0.5, 0.5], 2, 2).unwrap_err();
        assert_eq!(error.to_string(), "found 1 images; expected 2 or more");
        assert!(inception_score(&[], 2, 1).is_err());
    }

    proptest! {
        #[test]
        fn a_score_is_between_1_and_the_number_of_classes(
            logits in prop::collection::vec(-9f32..9.0, 5 * 12),
            n_splits in 1usize..6,
        ) {
            let score = inception_score(&class_probabilities(&logits, 5), 5, n_splits).unwrap();
            prop_assert!(score.mean > 1.0 - 1e-12 && score.mean < 5.0 + 1e-12, "{score:?}");
        }

        #[test]
        fn equal_predictions_score_1(row in prop::collection::vec(-9f32..9.0, 6), n_images in 1usize..30) {
            let score = inception_score(&class_probabilities(&row.repeat(n_images), 6), 6, 1).unwrap();
            prop_assert!((score.mean - 1.0).abs() < 1e-12, "{score:?}");
        }

        #[test]
        fn the_order_of_classes_is_irrelevant(logits in prop::collection::vec(-9f32..9.0, 4 * 8)) {
            let turned: Vec<f32> = logits.chunks_exact(4).flat_map(|row| row.iter().rev().copied()).collect();
            let score = |logits: &[f32]| inception_score(&class_probabilities(logits, 4), 4, 2).unwrap().mean;
            prop_assert!((score(&logits) - score(&turned)).abs() < 1e-12);
        }
    }
}
