//! The Dirichlet distribution in `f64`: draws, density, entropy, Kullback-Leibler divergence and their
//! gradients.
//!
//! | here | equation |
//! |---|---|
//! | `concentration` | alpha, all positive; A is its sum |
//! | `log_action` | ln a, a point of the simplex of `n` coordinates |
//!
//! `ln pi(a) = ln Gamma(A) - sum ln Gamma(alpha_i) + sum (alpha_i - 1) ln a_i` (thesis, equation 3.12), a
//! density with respect to the first `n - 1` coordinates. Points are passed as logarithms: with
//! concentrations below one, coordinates far below the smallest float are ordinary, and the density needs
//! their logarithms.

use arithmetic::double::exp;
use rand::RngCore;

use crate::gamma::{log_gamma_slope, sample_log_gamma};
use crate::special::{digamma, ln_gamma, log_sum_exp, trigamma};

/// Smallest logarithm of a coordinate of a draw. Its exponential, 1.6e-38, is still a normal `f32`.
///
/// A coordinate below it is set to it and then counts as a constant: its derivative with respect to the concentration
/// is zero. With concentrations of at least one a draw reaches this floor with a probability below 1e-37.
pub const LOG_ACTION_FLOOR: f64 = -87.0;

/// A draw with the derivative for its reparameterised gradient.
#[derive(Debug, Clone, PartialEq)]
pub struct Draw {
    /// `ln a` `[n]`, floored at [`LOG_ACTION_FLOOR`].
    pub log_action: Vec<f64>,
    /// `d ln g_i / d alpha_i` `[n]` of the gamma draws behind it (`a = g / sum g`), at fixed quantile; zero
    /// at the floor.
    pub slope: Vec<f64>,
}

impl Draw {
    /// Action `a`, the point of the simplex `[n]`.
    #[must_use]
    pub fn action(&self) -> Vec<f64> {
        self.log_action.iter().map(|log| exp(*log)).collect()
    }

    /// Gradient with respect to the concentration `[n]` of a function whose gradient with respect to `ln a` is
    /// `upstream` `[n]`.
    ///
    /// `d ln a_i / d alpha_j = (delta_ij - a_j) slope_j`. PyTorch moves a draw along its Beta marginals
    /// instead: another path with the same mean gradient, so the two agree in expectation only.
    #[must_use]
    pub fn gradient(&self, upstream: &[f64]) -> Vec<f64> {
        let total: f64 = upstream.iter().sum();
        let through = |((log, slope), direct): ((&f64, &f64), &f64)| slope * (direct - exp(*log) * total);
        self.log_action
            .iter()
            .zip(&self.slope)
            .zip(upstream)
            .map(through)
            .collect()
    }
}

/// Draws `ln a` of `a ~ Dirichlet(concentration)`: `ln a = ln g - ln sum g` with `g_i ~ Gamma(alpha_i, 1)`.
///
/// All coordinates are NaN if a concentration is not positive and finite.
pub fn sample(concentration: &[f64], rng: &mut impl RngCore) -> Vec<f64> {
    let log_gammas: Vec<f64> = concentration
        .iter()
        .map(|&shape| sample_log_gamma(shape, rng))
        .collect();
    let log_sum = log_sum_exp(&log_gammas);
    // `max` would turn a NaN into the floor.
    let floored = |log: f64| {
        if log < LOG_ACTION_FLOOR {
            LOG_ACTION_FLOOR
        } else {
            log
        }
    };
    log_gammas.iter().map(|log| floored(log - log_sum)).collect()
}

/// Draws the point that [`sample`] draws from the same stream, with the derivative of the draw (implicit
/// reparameterisation).
///
/// All coordinates are NaN if a concentration is not positive and finite.
pub fn sample_with_gradient(concentration: &[f64], rng: &mut impl RngCore) -> Draw {
    let log_gammas: Vec<f64> = concentration
        .iter()
        .map(|&shape| sample_log_gamma(shape, rng))
        .collect();
    draw_of(concentration, &log_gammas)
}

/// Draw from the logarithms of its gamma draws, by normalisation.
fn draw_of(concentration: &[f64], log_gammas: &[f64]) -> Draw {
    let log_sum = log_sum_exp(log_gammas);
    let coordinate = |(&shape, &log_gamma): (&f64, &f64)| {
        let log_action = log_gamma - log_sum;
        if log_action < LOG_ACTION_FLOOR {
            (LOG_ACTION_FLOOR, 0.0)
        } else {
            (log_action, log_gamma_slope(shape, log_gamma))
        }
    };
    let (log_action, slope) = concentration.iter().zip(log_gammas).map(coordinate).unzip();
    Draw { log_action, slope }
}

/// `ln B(alpha) = sum ln Gamma(alpha_i) - ln Gamma(A)` (thesis, equation 3.11).
#[must_use]
pub fn log_beta(concentration: &[f64]) -> f64 {
    concentration.iter().map(|&alpha| ln_gamma(alpha)).sum::<f64>() - ln_gamma(concentration.iter().sum())
}

/// `ln pi(a)` (thesis, equation 3.12).
#[must_use]
pub fn log_density(concentration: &[f64], log_action: &[f64]) -> f64 {
    let kernel: f64 = concentration
        .iter()
        .zip(log_action)
        .map(|(alpha, log)| (alpha - 1.0) * log)
        .sum();
    kernel - log_beta(concentration)
}

/// Gradient of [`log_density`] with respect to the concentration `[n]`: `digamma(A) - digamma(alpha_i) + ln a_i`
/// (thesis, equation 3.13).
#[must_use]
pub fn log_density_gradient(concentration: &[f64], log_action: &[f64]) -> Vec<f64> {
    let total = digamma(concentration.iter().sum());
    concentration
        .iter()
        .zip(log_action)
        .map(|(&alpha, log)| total - digamma(alpha) + log)
        .collect()
}

/// Differential entropy `ln B(alpha) + (A - n) digamma(A) - sum (alpha_i - 1) digamma(alpha_i)`.
#[must_use]
pub fn entropy(concentration: &[f64]) -> f64 {
    let excess: f64 = concentration.iter().map(|alpha| alpha - 1.0).sum();
    let own: f64 = concentration
        .iter()
        .map(|&alpha| (alpha - 1.0) * digamma(alpha))
        .sum();
    log_beta(concentration) + excess * digamma(concentration.iter().sum()) - own
}

/// The gradient of [`entropy`] with respect to the concentration `[n]`: `(A - n) trigamma(A) - (alpha_i - 1)
/// trigamma(alpha_i)`.
#[must_use]
pub fn entropy_gradient(concentration: &[f64]) -> Vec<f64> {
    let excess: f64 = concentration.iter().map(|alpha| alpha - 1.0).sum();
    let total = excess * trigamma(concentration.iter().sum());
    concentration
        .iter()
        .map(|&alpha| total - (alpha - 1.0) * trigamma(alpha))
        .collect()
}

/// `KL(Dir(p) || Dir(q)) = ln B(q) - ln B(p) + sum (p_i - q_i) (digamma(p_i) - digamma(P))`.
#[must_use]
pub fn kl_divergence(p: &[f64], q: &[f64]) -> f64 {
    let total = digamma(p.iter().sum());
    let difference: f64 = p
        .iter()
        .zip(q)
        .map(|(&p, q)| (p - q) * (digamma(p) - total))
        .sum();
    log_beta(q) - log_beta(p) + difference
}

/// The gradients of [`kl_divergence`] with respect to `p` and `q`, each `[n]`: `(p_i - q_i) trigamma(p_i) - (P - Q)
/// trigamma(P)` and `digamma(P) - digamma(p_i) + digamma(q_i) - digamma(Q)`.
#[must_use]
pub fn kl_divergence_gradients(p: &[f64], q: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let (p_sum, q_sum): (f64, f64) = (p.iter().sum(), q.iter().sum());
    let common = (p_sum - q_sum) * trigamma(p_sum);
    let constant = digamma(p_sum) - digamma(q_sum);
    let in_p = p
        .iter()
        .zip(q)
        .map(|(&p, q)| (p - q) * trigamma(p) - common)
        .collect();
    let in_q = p
        .iter()
        .zip(q)
        .map(|(&p, &q)| constant - digamma(p) + digamma(q))
        .collect();
    (in_p, in_q)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use std::collections::HashMap;

    const REFERENCE: &str = include_str!("../../../tests/fixtures/dirichlet/dirichlet.csv");

    fn cases() -> Vec<HashMap<String, Vec<f64>>> {
        let numbers = |cell: &str| cell.split(' ').map(|number| number.parse().unwrap()).collect();
        let mut reader = csv::Reader::from_reader(REFERENCE.as_bytes());
        let rows = reader.deserialize().map(Result::unwrap);
        rows.map(|row: HashMap<String, String>| {
            row.into_iter()
                .map(|(name, cell)| (name, numbers(&cell)))
                .collect()
        })
        .collect()
    }

    fn logs(values: &[f64]) -> Vec<f64> {
        values.iter().map(|value| value.ln()).collect()
    }

    /// Asserts that each relative difference is below `tolerance`.
    fn assert_close(name: &str, got: &[f64], want: &[f64], tolerance: f64) {
        assert_eq!(got.len(), want.len());
        for (got, want) in got.iter().zip(want) {
            assert!(
                (got - want).abs() <= tolerance * want.abs(),
                "{name}: {got}, not {want}"
            );
        }
    }

    fn numeric_gradient(function: impl Fn(&[f64]) -> f64, at: &[f64]) -> Vec<f64> {
        let step = |index: usize, size: f64| {
            let mut moved = at.to_vec();
            moved[index] += size;
            function(&moved)
        };
        (0..at.len())
            .map(|i| (step(i, 1e-5 * at[i]) - step(i, -1e-5 * at[i])) / (2e-5 * at[i]))
            .collect()
    }

    #[test]
    fn match_reference_values() {
        for case in cases() {
            let (alpha, log_action) = (&case["alpha"], logs(&case["x"]));
            assert_close(
                "log density",
                &[log_density(alpha, &log_action)],
                &case["log_prob"],
                1e-9,
            );
            assert_close(
                "its gradient",
                &log_density_gradient(alpha, &log_action),
                &case["dlogprob_dalpha"],
                1e-9,
            );
            assert_close("entropy", &[entropy(alpha)], &case["entropy"], 1e-9);
            // PyTorch's trigamma is exact to 7e-9; the other column has all digits.
            assert_close(
                "its gradient",
                &entropy_gradient(alpha),
                &case["dentropy_dalpha"],
                1e-8,
            );
            assert_close(
                "its gradient",
                &entropy_gradient(alpha),
                &case["dentropy_dalpha_mpmath"],
                1e-12,
            );
            assert_close(
                "divergence",
                &[kl_divergence(alpha, &case["alpha_q"])],
                &case["kl_p_q"],
                1e-9,
            );
        }
    }

    #[test]
    fn divergence_gradients_match_differences() {
        let (p, q) = ([0.7, 3.0, 12.0], [1.5, 2.0, 0.4]);
        let (in_p, in_q) = kl_divergence_gradients(&p, &q);
        assert_close(
            "in p",
            &in_p,
            &numeric_gradient(|p| kl_divergence(p, &q), &p),
            1e-8,
        );
        assert_close(
            "in q",
            &in_q,
            &numeric_gradient(|q| kl_divergence(&p, q), &q),
            1e-8,
        );
        assert!(kl_divergence(&p, &p).abs() < 1e-14);
    }

    #[test]
    fn draws_have_the_moments_of_the_distribution() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let (alpha, n) = ([0.4, 2.0, 5.6], 40_000);
        let (mut mean, mut log_mean) = ([0.0; 3], [0.0; 3]);
        for _ in 0..n {
            for (i, log) in sample(&alpha, &mut rng).into_iter().enumerate() {
                mean[i] += log.exp() / f64::from(n);
                log_mean[i] += log / f64::from(n);
            }
        }
        for i in 0..3 {
            let (share, log_sd) = (alpha[i] / 8.0, (trigamma(alpha[i]) - trigamma(8.0)).sqrt());
            let error = (share * (1.0 - share) / 9.0 / f64::from(n)).sqrt();
            assert!((mean[i] - share).abs() < 4.0 * error, "{mean:?}");
            assert!(
                (log_mean[i] - digamma(alpha[i]) + digamma(8.0)).abs() < 4.0 * log_sd / f64::from(n).sqrt(),
                "{log_mean:?}"
            );
        }
    }

    #[test]
    fn both_samplers_draw_the_same_points() {
        let alpha = [0.2, 1.0, 30.0];
        let (mut one, mut two) = (ChaCha8Rng::seed_from_u64(3), ChaCha8Rng::seed_from_u64(3));
        for _ in 0..50 {
            let draw = sample_with_gradient(&alpha, &mut two);
            assert_eq!(sample(&alpha, &mut one), draw.log_action);
            assert!((draw.action().iter().sum::<f64>() - 1.0).abs() < 1e-14);
        }
    }

    #[test]
    fn a_coordinate_at_the_floor_is_a_constant() {
        let draw = draw_of(&[0.01, 2.0], &[-500.0, 0.3]);
        assert_eq!((draw.log_action[0], draw.slope[0]), (LOG_ACTION_FLOOR, 0.0));
        assert_eq!(draw.gradient(&[1.0, 0.0])[0], 0.0);
        assert!(LOG_ACTION_FLOOR.exp() as f32 >= f32::MIN_POSITIVE);
    }

    #[test]
    fn a_diverged_concentration_shows_as_not_a_number() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let alpha = [1.0, f64::NAN];
        assert!(sample(&alpha, &mut rng).iter().all(|log| log.is_nan()));
        let draw = sample_with_gradient(&alpha, &mut rng);
        assert!(draw.log_action.iter().all(|log| log.is_nan()) && draw.slope[1].is_nan());
        assert!(log_density(&alpha, &[-0.7, -0.7]).is_nan() && entropy(&alpha).is_nan());
    }

    /// `E[f(a)]` depends on alpha; the mean of the pathwise gradient must be its derivative.
    #[test]
    fn pathwise_gradient_is_unbiased() {
        let (alpha, n) = ([0.6, 3.0, 1.4], 200_000);
        let mut rng = ChaCha8Rng::seed_from_u64(9);
        let mut mean = [0.0; 3];
        for _ in 0..n {
            // f = a_0, so df / d ln a = (a_0, 0, 0).
            let draw = sample_with_gradient(&alpha, &mut rng);
            let gradient = draw.gradient(&[draw.log_action[0].exp(), 0.0, 0.0]);
            mean.iter_mut()
                .zip(gradient)
                .for_each(|(mean, part)| *mean += part / f64::from(n));
        }
        // E a_0 = alpha_0 / A with A = 5.
        let exact = [4.4 / 25.0, -0.6 / 25.0, -0.6 / 25.0];
        mean.iter()
            .zip(exact)
            .for_each(|(mean, exact)| assert!((mean - exact).abs() < 1e-3, "{mean}, not {exact}"));
    }
}
