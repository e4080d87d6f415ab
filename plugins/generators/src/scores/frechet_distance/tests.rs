//! Distances compared with SciPy and mpmath, and properties of every distance.

use super::*;
use nalgebra::DVector;
use proptest::prelude::*;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

#[derive(Deserialize)]
struct Case {
    name: String,
    features: usize,
    first: Vec<f32>,
    second: Vec<f32>,
    mean: Vec<f64>,
    covariance: Vec<f64>,
    exact: f64,
    sqrtm: f64,
    sqrtm_tolerance: f64,
}

fn cases() -> Vec<Case> {
    let text = include_str!("../../../../../tests/fixtures/generators/frechet_distance.json");
    serde_json::from_str(text).unwrap()
}

fn distance(first: &Moments, second: &Moments) -> f64 {
    frechet_distance(first, second).unwrap().distance
}

/// Approximately normal features, each with a spread of its own.
fn draw(n_images: usize, n_features: usize, seed: u64) -> Vec<f32> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut feature = |at: usize| {
        let sum: f32 = (0..4).map(|_| rng.random::<f32>() - 0.5).sum();
        sum * (1.0 + (at % n_features) as f32 / n_features as f32)
    };
    (0..n_images * n_features).map(&mut feature).collect()
}

fn drawn(n_images: usize, n_features: usize, seed: u64) -> Moments {
    Moments::of(&draw(n_images, n_features, seed), n_features).unwrap()
}

#[test]
fn distances_are_those_of_other_programs() {
    assert_eq!(cases().len(), 8);
    for case in cases() {
        let [first, second] = [&case.first, &case.second].map(|set| Moments::of(set, case.features).unwrap());
        let here = distance(&first, &second);
        let scale = first.trace() + second.trace();
        assert!(
            (here - case.exact).abs() < 1e-12 * scale,
            "{}: {here} {}",
            case.name,
            case.exact
        );
        // A general square root of a singular matrix loses digits there.
        let apart = (here - case.sqrtm).abs() / scale;
        assert!(
            apart < case.sqrtm_tolerance,
            "{}: {here} {}",
            case.name,
            case.sqrtm
        );
    }
}

#[test]
fn moments_are_those_of_numpy() {
    for case in cases() {
        let moments = Moments::of(&case.first, case.features).unwrap();
        let largest = case
            .covariance
            .iter()
            .fold(0.0, |most: f64, entry| most.max(entry.abs()));
        for (here, there) in moments.mean.iter().zip(&case.mean) {
            assert!(
                (here - there).abs() < 1e-14 * (1.0 + there.abs()),
                "{}: {here} {there}",
                case.name
            );
        }
        assert_eq!(moments.covariance.len(), case.covariance.len());
        for (here, there) in moments.covariance.iter().zip(&case.covariance) {
            assert!(
                (here - there).abs() < 1e-14 * largest,
                "{}: {here} {there}",
                case.name
            );
        }
    }
}

#[test]
fn batches_end_anywhere_with_the_same_bits() {
    let features = draw(37, 5, 1);
    let whole = Moments::of(&features, 5).unwrap();
    for batch in [1, 4, 36] {
        let mut sums = MomentSums::new(5);
        features
            .chunks(batch * 5)
            .for_each(|part| sums.add(part).unwrap());
        assert_eq!(sums.moments().unwrap(), whole);
    }
}

#[test]
fn moments_far_from_zero_lose_no_digits() {
    let features = draw(50, 3, 2);
    // 4096 and steps of 2^-10 are exact together in f32.
    let stepped: Vec<f32> = features.iter().map(|x| (x * 1024.0).round() / 1024.0).collect();
    let far: Vec<f32> = stepped.iter().map(|x| x + 4096.0).collect();
    let [near, far] = [&stepped, &far].map(|set| Moments::of(set, 3).unwrap());
    for (near, far) in near.covariance.iter().zip(&far.covariance) {
        assert!((near - far).abs() < 1e-11, "{near} {far}");
    }
}

#[test]
fn one_dimension_is_as_by_hand() {
    let moments = |mean: f64, sd: f64| Moments {
        count: 100,
        mean: vec![mean],
        covariance: vec![sd * sd],
    };
    let found = frechet_distance(&moments(1.0, 3.0), &moments(-1.0, 0.5)).unwrap();
    assert!((found.of_means - 4.0).abs() < 1e-14 && (found.of_covariances - 6.25).abs() < 1e-14);
    assert!((found.distance - 10.25).abs() < 1e-14);
    // Without any spread only the means remain.
    assert_eq!(distance(&moments(1.0, 0.0), &moments(-1.0, 0.0)), 4.0);
}

#[test]
fn a_small_variance_is_not_taken_for_rounding() {
    let moments = |variance: f64| Moments {
        count: 100,
        mean: vec![0.0; 2],
        covariance: vec![1.0, 0.0, 0.0, variance],
    };
    // (2 - 1e-7)^2 along the second axis.
    let found = distance(&moments(4.0), &moments(1e-14));
    assert!((found - (2.0 - 1e-7) * (2.0 - 1e-7)).abs() < 1e-14, "{found}");
}

#[test]
fn a_covariance_that_is_none_shows() {
    let indefinite = Moments {
        count: 9,
        mean: vec![0.0; 2],
        covariance: vec![1.0, 2.0, 2.0, 1.0],
    };
    let found = frechet_distance(&indefinite, &indefinite).unwrap();
    // Eigenvalues 3 and -1.
    assert!((found.lowest_eigenvalue + 1.0 / 3.0).abs() < 1e-12, "{found:?}");
    let proper = frechet_distance(&drawn(3, 8, 1), &drawn(4, 8, 2)).unwrap();
    assert!(proper.lowest_eigenvalue > -1e-14, "{proper:?}");
}

#[test]
fn fewer_images_are_further_from_the_truth() {
    // Both sets follow one distribution, so infinitely many images would give 0.
    let reference = drawn(20_000, 16, 1);
    let mean_of = |n_images: usize| {
        (2..12)
            .map(|seed| distance(&reference, &drawn(n_images, 16, seed)))
            .sum::<f64>()
            / 10.0
    };
    let [few, some, many] = [8, 64, 512].map(mean_of);
    assert!(few > 5.0 * some && some > 5.0 * many, "{few} {some} {many}");
}

#[test]
fn features_without_a_distance_are_refused() {
    let two = drawn(9, 2, 1);
    let error = frechet_distance(&two, &drawn(9, 3, 1)).unwrap_err();
    assert_eq!(error, ScoreError::Shapes { first: 2, second: 3 });
    let mut damaged = two.clone();
    damaged.covariance[1] = f64::NAN;
    assert_eq!(
        frechet_distance(&two, &damaged),
        Err(ScoreError::Moments { features: 2 })
    );
    assert_eq!(
        frechet_distance(&damaged, &two),
        Err(ScoreError::Moments { features: 2 })
    );
    damaged.covariance.pop();
    assert!(matches!(
        frechet_distance(&damaged, &two),
        Err(ScoreError::Shapes { .. })
    ));
    damaged = two.clone();
    damaged.covariance = vec![1e308, 0.0, 0.0, 1e308];
    assert_eq!(
        frechet_distance(&damaged, &damaged),
        Err(ScoreError::Moments { features: 2 })
    );
    damaged = two.clone();
    damaged.mean[0] = f64::NAN;
    assert_eq!(
        frechet_distance(&damaged, &two),
        Err(ScoreError::Moments { features: 2 })
    );
}

#[test]
fn images_without_numbers_are_refused_by_their_place() {
    let mut sums = MomentSums::new(2);
    sums.add(&[1.0, 2.0]).unwrap();
    assert_eq!(
        sums.moments(),
        Err(ScoreError::TooFewImages { found: 1, needed: 2 })
    );
    let error = sums.add(&[3.0, 4.0, 5.0, f32::INFINITY]).unwrap_err();
    assert_eq!(error.to_string(), "feature 1 of image 2 (the first is 0) is inf");
    assert_eq!(sums.moments().unwrap().mean, [2.0, 3.0]);
}

#[test]
fn moments_come_back_from_json_to_the_bit() {
    let moments = drawn(7, 3, 4);
    let back: Moments = serde_json::from_str(&serde_json::to_string(&moments).unwrap()).unwrap();
    assert_eq!(back, moments);
}

/// Moments of the features after the reflection `1 - 2 v v^T / |v|^2`.
fn reflected(moments: &Moments, v: &[f64]) -> Moments {
    let n = v.len();
    let v = DVector::from_column_slice(v);
    let reflection = DMatrix::identity(n, n) - &v * v.transpose() * (2.0 / v.norm_squared());
    let covariance = &reflection * DMatrix::from_row_slice(n, n, &moments.covariance) * &reflection;
    Moments {
        count: moments.count,
        mean: (&reflection * DVector::from_column_slice(&moments.mean))
            .as_slice()
            .to_vec(),
        covariance: covariance.as_slice().to_vec(),
    }
}

proptest! {
    #[test]
    fn a_distance_is_symmetric_and_not_negative(
        (few, many, n_features) in (2usize..12, 2usize..30, 1usize..9),
        seed: u64,
    ) {
        let (first, second) = (drawn(few, n_features, seed), drawn(many, n_features, seed ^ 1));
        let (there, back) = (distance(&first, &second), distance(&second, &first));
        prop_assert!(there >= 0.0);
        prop_assert!((there - back).abs() < 1e-12 * (first.trace() + second.trace()), "{there} {back}");
    }

    #[test]
    fn a_set_is_at_no_distance_from_itself(n_images in 2usize..20, n_features in 1usize..12, seed: u64) {
        let moments = drawn(n_images, n_features, seed);
        let found = frechet_distance(&moments, &moments).unwrap();
        prop_assert!(found.of_covariances.abs() < 1e-12 * moments.trace(), "{found:?}");
        prop_assert_eq!(found.of_means, 0.0);
    }

    #[test]
    fn a_shift_adds_its_square(n_images in 2usize..20, shift in prop::collection::vec(-3f64..3.0, 5), seed: u64) {
        let moments = drawn(n_images, 5, seed);
        let mut shifted = moments.clone();
        shifted.mean.iter_mut().zip(&shift).for_each(|(mean, by)| *mean += by);
        let square: f64 = shift.iter().map(|by| by * by).sum();
        prop_assert!((distance(&moments, &shifted) - square).abs() < 1e-12 * (moments.trace() + square));
    }

    #[test]
    fn axes_are_irrelevant(v in prop::collection::vec(0.1f64..1.0, 6), seed: u64) {
        let (first, second) = (drawn(5, 6, seed), drawn(40, 6, seed ^ 1));
        let here = distance(&first, &second);
        let there = distance(&reflected(&first, &v), &reflected(&second, &v));
        prop_assert!((here - there).abs() < 1e-11 * (first.trace() + second.trace()), "{here} {there}");
    }
}
