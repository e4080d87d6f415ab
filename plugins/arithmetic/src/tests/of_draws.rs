//! Tests of draws.

use super::*;

const N: u64 = 200_000;

/// Kolmogorov-Smirnov distance of draws from a distribution function, times the root of their number. By
/// chance it is above 1.95 once in a thousand.
fn distance(mut draws: Vec<f64>, distribution: impl Fn(f64) -> f64) -> f64 {
    draws.sort_by(f64::total_cmp);
    let n = draws.len() as f64;
    let steps = draws.iter().zip(0..).map(|(draw, rank)| {
        let probability = distribution(*draw);
        let below = f64::from(rank) / n;
        (probability - below)
            .abs()
            .max((probability - below - 1.0 / n).abs())
    });
    steps.fold(0.0, f64::max) * n.sqrt()
}

/// Distribution function `P(shape, x)`, by its series.
fn gamma_distribution(shape: f64, x: f64) -> f64 {
    let (mut term, mut sum, mut argument) = (1.0 / shape, 1.0 / shape, shape);
    while term > 1e-17 * sum || argument < x {
        argument += 1.0;
        term *= x / argument;
        sum += term;
    }
    sum * (shape * x.ln() - x - gamma::ln_gamma(shape)).exp()
}

#[test]
fn uniform_numbers_by_hand() {
    assert_eq!(uniform(0), 1.0 / 9_007_199_254_740_992.0);
    assert_eq!(uniform(u64::MAX), 1.0 - 1.0 / 9_007_199_254_740_992.0);
    assert_eq!(uniform(1 << 63), 0.5 + 1.0 / 9_007_199_254_740_992.0);
}

#[test]
fn normal_numbers_are_normal() {
    let draws: Vec<f64> = (0..N).map(|i| normal(mix(i))).collect();
    // Phi(x) from the incomplete gamma function of x^2 / 2.
    let phi = |x: f64| 0.5 + 0.5 * gamma_distribution(0.5, 0.5 * x * x).copysign(x);
    assert!(distance(draws, phi) < 1.95);
}

#[test]
fn normal_numbers_rise_with_the_word_and_are_symmetric() {
    let words = (0..=1000).map(|i| u64::MAX / 1000 * i);
    let draws: Vec<f64> = words.clone().map(normal).collect();
    assert!(draws.is_sorted());
    for word in words {
        assert_eq!(normal(word), -normal(!word));
    }
    assert!((normal(0) + 8.209_536_151_601_387).abs() < 1e-14, "{}", normal(0));
}

#[test]
fn gamma_draws_follow_the_distribution_function() {
    for shape in [0.05, 0.3, 1.0, 2.5, 40.0] {
        let mut stream = Stream::new(77);
        let draws: Vec<f64> = (0..N / 4).map(|_| log_gamma(shape, &mut stream)).collect();
        let distribution = |log: f64| {
            // For small x, P(shape, x) = x^shape / Gamma(shape + 1).
            let small = (shape * log - gamma::ln_gamma(shape + 1.0)).exp();
            if log < -40.0 {
                small
            } else {
                gamma_distribution(shape, log.exp())
            }
        };
        let distance = distance(draws, distribution);
        assert!(distance < 1.95, "shape {shape}: {distance}");
    }
}

#[test]
fn gamma_draws_take_words_as_stated() {
    let mut taken = 0;
    let mut words = || {
        taken += 1;
        1 << 63
    };
    // The normal number is next to zero and the uniform one next to a half, so that the first try succeeds.
    let draw = log_gamma(4.0 / 3.0, &mut words);
    assert!(draw.abs() < 1e-14);
    let below = log_gamma(1.0 / 3.0, &mut words);
    assert!((below - 3.0 * 0.5_f64.ln()).abs() < 1e-14);
    for shape in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(log_gamma(shape, &mut words).is_nan());
    }
    assert_eq!(taken, 5);
}

#[test]
fn tiny_shapes_have_finite_logarithms() {
    let mut stream = Stream::new(3);
    let draws: Vec<f64> = (0..1000).map(|_| log_gamma(1e-3, &mut stream)).collect();
    let mean = draws.iter().sum::<f64>() / 1000.0;
    // The standard deviation of ln x is 1000.
    assert!((mean - gamma::digamma(1e-3)).abs() < 4.0 * 1000.0 / 1000_f64.sqrt());
}

#[test]
fn the_slope_of_a_draw_of_zero_is_that_of_the_power_law() {
    // For x -> 0, P = x^shape / Gamma(shape + 1).
    for (shape, log_draw) in [(0.01, -5000.0), (0.3, -1e6), (2.5, -800.0)] {
        let expected = (gamma::digamma(shape + 1.0) - log_draw) / shape;
        let slope = gamma_slope::log_gamma_slope(shape, log_draw);
        assert!((slope / expected - 1.0).abs() < 1e-14, "shape {shape}: {slope}");
    }
    assert_eq!(
        gamma_slope::log_gamma_slope(1e-40, f64::NEG_INFINITY),
        f64::INFINITY
    );
}
