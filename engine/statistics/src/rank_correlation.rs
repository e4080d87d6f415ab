//! Spearman's rank correlation of paired values, and its interval.
//!
//! Spearman 1904, "The proof and measurement of association between two things". Equal values share the mean of their
//! ranks; the correlation is Pearson's of the ranks. The interval comes from a bootstrap over the pairs, percentiles of
//! 10 000 resamples (Efron and Tibshirani 1993, chapter 13). Its indices come from the stream `["statistics", "rank
//! correlation"]`, which is opened again, so that it is a function of the pairs alone.

use super::{Interval, bootstrap::below, estimators::quantile};
use contract::random::stream;

const RESAMPLES: usize = 10_000;

/// The correlation of the pairs' ranks, within -1 and 1; `None` below two pairs, or if all values of one side are
/// equal.
#[must_use]
pub fn rank_correlation(pairs: &[(f64, f64)]) -> Option<f64> {
    let (one, other): (Vec<f64>, Vec<f64>) = pairs.iter().copied().unzip();
    let (one, other) = (ranks(&one), ranks(&other));
    #[allow(clippy::cast_precision_loss, reason = "a number of pairs is far below 2^52")]
    let mean = (pairs.len() as f64 + 1.0) / 2.0;
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - mean) * (b - mean)).sum::<f64>();
    let scale = (product(&one, &one) * product(&other, &other)).sqrt();
    (scale > 0.0).then(|| product(&one, &other) / scale)
}

/// The 95 % interval of [`rank_correlation`]; `None` below three pairs, or if that has no value.
#[must_use]
pub fn rank_correlation_interval(pairs: &[(f64, f64)]) -> Option<Interval> {
    if pairs.len() < 3 || rank_correlation(pairs).is_none() {
        return None;
    }
    let mut rng = stream(&["statistics", "rank correlation"]);
    // A resample that repeats a single pair has no correlation, and is left out.
    let resampled: Vec<f64> = (0..RESAMPLES)
        .filter_map(|_| {
            let drawn: Vec<(f64, f64)> = (0..pairs.len())
                .map(|_| pairs[below(pairs.len(), &mut rng)])
                .collect();
            rank_correlation(&drawn)
        })
        .collect();
    Some(Interval {
        low: quantile(&resampled, 0.025),
        high: quantile(&resampled, 0.975),
        level: 0.95,
    })
}

/// The rank of each value, from 1; equal ones share the mean of theirs.
fn ranks(values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|one, other| values[*one].total_cmp(&values[*other]));
    let mut ranks = vec![0.0; values.len()];
    let mut first = 0;
    while first < order.len() {
        let equal = order[first..]
            .iter()
            .take_while(|at| values[**at] == values[order[first]])
            .count()
            .max(1);
        #[allow(clippy::cast_precision_loss, reason = "a number of values is far below 2^52")]
        let rank = first as f64 + (equal as f64 + 1.0) / 2.0;
        order[first..first + equal]
            .iter()
            .for_each(|at| ranks[*at] = rank);
        first += equal;
    }
    ranks
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_values_share_the_mean_of_their_ranks() {
        assert_eq!(ranks(&[3.0, 1.0, 3.0, 9.0]), [2.5, 1.0, 2.5, 4.0]);
        assert_eq!(ranks(&[0.0, -0.0]), [1.5, 1.5]);
    }

    /// By hand: differences of ranks 1, 1, 0 give 1 - 6 * 2 / (3 * 8); with ties, the value of `scipy.stats.spearmanr`.
    #[test]
    fn correlations_by_hand() {
        let close = |found: Option<f64>, expected: f64| {
            assert!((found.unwrap() - expected).abs() < 1e-12, "{found:?}");
        };
        close(rank_correlation(&[(1.0, 2.0), (2.0, 1.0), (3.0, 3.0)]), 0.5);
        close(rank_correlation(&[(1.0, 5.0), (2.0, 4.0), (9.0, -1.0)]), -1.0);
        close(
            rank_correlation(&[(1.0, 1.0), (2.0, 3.0), (2.0, 2.0), (4.0, 4.0), (5.0, 3.0)]),
            0.763_157_894_736_842,
        );
        assert_eq!(rank_correlation(&[(1.0, 2.0), (1.0, 3.0)]), None);
        assert_eq!(rank_correlation(&[(1.0, 2.0)]), None);
    }

    #[test]
    fn intervals_hold_what_they_should_and_do_not_depend_on_the_scale() {
        let noisy = |at: usize| {
            let x = at as f64;
            (x, x + 12.0 * (x * 12.9898).sin())
        };
        let pairs: Vec<(f64, f64)> = (0..40).map(noisy).collect();
        let found = rank_correlation(&pairs).unwrap();
        let interval = rank_correlation_interval(&pairs).unwrap();
        assert!(
            interval.low < found && found < interval.high && interval.high <= 1.0,
            "{interval:?} {found}"
        );
        // About 2 / sqrt(40) each way for small correlations, less for large ones.
        assert!(interval.high - interval.low < 0.6);
        let scaled: Vec<(f64, f64)> = pairs.iter().map(|(x, y)| (x.exp2(), 3.0 * y - 7.0)).collect();
        assert_eq!(rank_correlation_interval(&scaled), Some(interval));
        assert_eq!(rank_correlation_interval(&pairs[..2]), None);
    }
}
