//! The Gamma(shape, 1) distribution in log space: a sampler and the exact derivative of a draw with respect to its
//! shape.
//!
//! Everything is in `ln x`, because for small shapes most draws are below the smallest `f64`: at shape 0.01
//! half of them are below 1e-30 and one in a thousand is below 1e-300.
//!
//! | here | equation |
//! |---|---|
//! | `shape` | alpha |
//! | `log_draw` | ln x |
//! | returned slope | d ln x / d alpha at a fixed probability P(alpha, x) |
//!
//! Sources: G. Marsaglia and W. W. Tsang, "A simple method for generating gamma variables", ACM TOMS 26
//! (2000), and M. Figurnov, S. Mohamed and A. Mnih, "Implicit reparameterization gradients", NeurIPS 2018:
//! `dx/dalpha = -(dP/dalpha) / p(x)`.

use rand::RngCore;

use arithmetic::draws;
pub use arithmetic::gamma_slope::log_gamma_slope;

/// Draws `ln x` of `x ~ Gamma(shape, 1)`, for any finite `shape > 0`; NaN otherwise, so that a diverged
/// network is detected.
///
/// Below one, the draw of `shape + 1` is multiplied by `u^(1 / shape)`, here as a sum of logarithms, which cannot
/// underflow.
pub fn sample_log_gamma(shape: f64, rng: &mut impl RngCore) -> f64 {
    draws::log_gamma(shape, &mut || rng.next_u64())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::special::{digamma, lower_incomplete_gamma};
    use arithmetic::gamma_slope::{LARGE_SHAPE, slope_by_expansion, slope_by_fraction, slope_by_series};
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    const EXACT: &str = include_str!("../../../tests/fixtures/special/gamma.csv");
    const PEERS: &str = include_str!("../../../tests/fixtures/dirichlet/gamma_grad.csv");

    fn rows(text: &str) -> Vec<Vec<f64>> {
        csv::Reader::from_reader(text.as_bytes())
            .deserialize()
            .map(Result::unwrap)
            .collect()
    }

    #[test]
    fn slope_matches_high_precision_values() {
        for row in rows(EXACT) {
            let (shape, draw, want) = (row[0], row[1], row[2]);
            let got = log_gamma_slope(shape, draw.ln());
            let tolerance = if shape > LARGE_SHAPE { 1e-7 } else { 1e-10 };
            assert!(
                (got / want - 1.0).abs() < tolerance,
                "shape {shape}, draw {draw}: {got}, not {want}"
            );
        }
    }

    #[test]
    fn slope_matches_differences_of_the_quantile_function() {
        for row in rows(PEERS) {
            let (shape, draw, want) = (row[0], row[1], row[4]);
            let got = draw * log_gamma_slope(shape, draw.ln());
            // Below 1e-15 the differences themselves are wrong by up to 2e-5; PyTorch's series is exact
            // there.
            let (want, tolerance) = if draw < 1e-15 {
                (row[3], 1e-12)
            } else {
                (want, 1e-6)
            };
            assert!(
                (got / want - 1.0).abs() < tolerance,
                "shape {shape}, draw {draw}: {got}, not {want}"
            );
        }
    }

    #[test]
    fn slope_is_continuous_where_the_method_changes() {
        for shape in [0.01_f64, 0.5, 3.0, 70.0, 5000.0, 9e5] {
            let edge = shape + 2.5 * shape.sqrt() + 2.0;
            let [below, above] =
                [slope_by_series, slope_by_fraction].map(|slope| slope(shape, edge, edge.ln()));
            assert!(
                (below / above - 1.0).abs() < 1e-9,
                "shape {shape}: {below} and {above}"
            );
        }
        for deviation in [-6.0, -2.0, 0.0, 1.0, 6.0] {
            let draw = LARGE_SHAPE + deviation * LARGE_SHAPE.sqrt();
            let (exact, expansion) = (
                log_gamma_slope(LARGE_SHAPE, draw.ln()),
                slope_by_expansion(LARGE_SHAPE, draw),
            );
            assert!(
                (expansion / exact - 1.0).abs() < 1e-7,
                "deviation {deviation}: {exact} and {expansion}"
            );
        }
    }

    #[test]
    fn slope_survives_draws_below_the_smallest_float() {
        // For x -> 0, P = x^shape / Gamma(shape + 1), so d ln x / d shape = (digamma(shape + 1) - ln x) /
        // shape.
        let (shape, log_draw) = (0.01, -5000.0);
        let want = (digamma(1.01) - log_draw) / shape;
        assert!((log_gamma_slope(shape, log_draw) / want - 1.0).abs() < 1e-14);
    }

    /// Kolmogorov-Smirnov distance of `n` draws from the distribution function.
    fn distance(shape: f64, n: u32) -> f64 {
        let mut rng = ChaCha8Rng::seed_from_u64(11);
        let mut draws: Vec<f64> = (0..n).map(|_| sample_log_gamma(shape, &mut rng)).collect();
        draws.sort_by(f64::total_cmp);
        let count = f64::from(n);
        let steps = draws.iter().zip(1..).map(|(log_draw, rank)| {
            let probability = lower_incomplete_gamma(shape, log_draw.exp());
            (probability - f64::from(rank) / count)
                .abs()
                .max((probability - f64::from(rank - 1) / count).abs())
        });
        steps.fold(0.0, f64::max)
    }

    #[test]
    fn draws_follow_the_distribution_function() {
        for shape in [0.3, 0.9, 1.0, 2.5, 40.0, 1000.0] {
            // By chance the distance is above 1.95 / sqrt(n) once in a thousand.
            assert!(
                distance(shape, 20_000) < 1.95 / 20_000_f64.sqrt(),
                "shape {shape}"
            );
        }
    }

    #[test]
    fn outside_the_domain_is_not_a_number() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        for shape in [0.0, -2.0, f64::NAN] {
            assert!(sample_log_gamma(shape, &mut rng).is_nan() && log_gamma_slope(shape, 0.5).is_nan());
        }
        assert!(
            sample_log_gamma(f64::INFINITY, &mut rng).is_nan() && log_gamma_slope(1.0, f64::NAN).is_nan()
        );
    }

    #[test]
    fn tiny_shapes_draw_finite_logarithms() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let draws: Vec<f64> = (0..1000).map(|_| sample_log_gamma(1e-3, &mut rng)).collect();
        assert!(draws.iter().all(|draw| draw.is_finite()));
        // E ln x = digamma(shape) = -1000.6 and its standard deviation is 1000.
        let mean = draws.iter().sum::<f64>() / 1000.0;
        assert!(
            (mean - digamma(1e-3)).abs() < 4.0 * 1000.0 / 1000_f64.sqrt(),
            "{mean}"
        );
    }
}
