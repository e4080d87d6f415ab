//! Diagonal Gaussian distributions in `f64`, plain, squashed by tanh, and mapped to the simplex by softmax.
//!
//! | here | equation |
//! |---|---|
//! | `mean`, `log_sd` | mu, ln sigma, each `[n]` |
//! | `candidate` | x, the point before tanh or softmax |
//! | `log_action` | ln a, a = softmax(x) |
//!
//! **Gaussian-softmax.** Softmax forgets a common shift of its argument, so a whole line of candidates `x + c 1` gives
//! one action. Common reinforcement learning code uses the density of the candidate, `ln N(x; mu, sigma)`, as the
//! density of the action. The thesis calls the policy gradient that is estimated this way biased (section 3.4.1): the
//! density of the action is the candidate's integrated over `c` (equation 3.5), the true gradient contains its
//! logarithm (3.6), and the usual estimator (3.7) does not. Two remarks complete the printed argument:
//! - Equation 3.5 leaves out the factor `1 / prod a_i`, the Jacobian of `(a_1, ..., a_(n-1), c) -> x`; it
//!   does not depend on the parameters, so gradients are as printed. [`softmax_log_density`] includes it and
//!   integrates to one.
//! - `ln N(x) = ln pi(a) + ln p(c | a) + sum ln a_i`, and the score of `p(c | a)` has mean zero for each `a`. - A
//!   critic of the action alone therefore leaves the mean of estimator (3.7) correct and adds variance. The difference
//!   is in the entropy that a maximum-entropy algorithm rewards: that of the candidate includes the shift `c`, which no
//!   environment observes.

use rand::RngCore;

use crate::special::log_sum_exp;
use arithmetic::double::{exp, ln, ln_1p};
use arithmetic::draws;

/// `ln(2 pi) / 2`.
pub const HALF_LN_TWO_PI: f64 = 0.9189385332046728;

/// Draws a uniform number strictly between 0 and 1, a multiple of 2^-53, from one 64-bit word.
pub fn standard_uniform(rng: &mut impl RngCore) -> f64 {
    draws::uniform(rng.next_u64())
}

/// Draws a standard normal number, the quantile of a uniform one, from one 64-bit word.
pub fn standard_normal(rng: &mut impl RngCore) -> f64 {
    draws::normal(rng.next_u64())
}

/// Draws `x = mean + exp(log_sd) noise` `[n]`.
pub fn sample(mean: &[f64], log_sd: &[f64], rng: &mut impl RngCore) -> Vec<f64> {
    mean.iter()
        .zip(log_sd)
        .map(|(mean, log_sd)| mean + exp(*log_sd) * standard_normal(rng))
        .collect()
}

/// Log density `ln N(x; mean, diag exp(2 log_sd))`.
#[must_use]
pub fn log_density(mean: &[f64], log_sd: &[f64], x: &[f64]) -> f64 {
    let coordinate = |((mean, log_sd), x): ((&f64, &f64), &f64)| {
        let standardised = (x - mean) * exp(-log_sd);
        -0.5 * standardised * standardised - log_sd - HALF_LN_TWO_PI
    };
    mean.iter().zip(log_sd).zip(x).map(coordinate).sum()
}

/// Differential entropy `sum (ln sigma_i + ln(2 pi e) / 2)`.
#[must_use]
pub fn entropy(log_sd: &[f64]) -> f64 {
    log_sd.iter().map(|log_sd| log_sd + HALF_LN_TWO_PI + 0.5).sum()
}

/// Divergence `KL(N(p) || N(q))` of two diagonal Gaussians, each given as `(mean, log_sd)`.
#[must_use]
pub fn kl_divergence(p: (&[f64], &[f64]), q: (&[f64], &[f64])) -> f64 {
    let coordinate = |((p_mean, p_log_sd), (q_mean, q_log_sd)): ((&f64, &f64), (&f64, &f64))| {
        let distance = (p_mean - q_mean) * exp(-q_log_sd);
        let log_ratio = p_log_sd - q_log_sd;
        0.5 * (exp(2.0 * log_ratio) + distance * distance - 1.0) - log_ratio
    };
    p.0.iter().zip(p.1).zip(q.0.iter().zip(q.1)).map(coordinate).sum()
}

/// `ln(1 - tanh(x)^2) = 2 (ln 2 - x - ln(1 + exp(-2 x)))`, finite for any `x` for which `tanh(x)` rounds to one.
#[must_use]
pub fn log_tanh_derivative(x: f64) -> f64 {
    // The function is even, and the exponential of -2 |x| cannot overflow.
    2.0 * (std::f64::consts::LN_2 - x.abs() - ln_1p(exp(-2.0 * x.abs())))
}

/// Log density of `tanh(candidate)` on the cube `(-1, 1)^n`, given the candidate.
#[must_use]
pub fn squashed_log_density(mean: &[f64], log_sd: &[f64], candidate: &[f64]) -> f64 {
    log_density(mean, log_sd, candidate) - candidate.iter().map(|&x| log_tanh_derivative(x)).sum::<f64>()
}

/// `ln softmax(candidate)` `[n]` (thesis, equation 3.3).
#[must_use]
pub fn log_softmax(candidate: &[f64]) -> Vec<f64> {
    let log_sum = log_sum_exp(candidate);
    candidate.iter().map(|x| x - log_sum).collect()
}

/// True log density of `softmax(x)`, `x ~ N(mean, sigma)`, on the simplex with respect to its first `n - 1`
/// coordinates.
///
/// The integral of equation 3.5 in closed form: with `w_i = 1 / sigma_i^2`, `W = sum w_i`, `r_i = ln a_i -
/// mu_i` and the weighted mean `r = sum w_i r_i / W`, the exponent is Gaussian in `c` with precision `W`
/// around `-r`, so `ln pi(a) = -(n - 1) ln(2 pi) / 2 - sum ln sigma_i - ln(W) / 2 - sum w_i (r_i - r)^2 / 2 -
/// sum ln a_i`.
#[must_use]
pub fn softmax_log_density(mean: &[f64], log_sd: &[f64], log_action: &[f64]) -> f64 {
    let weights: Vec<f64> = log_sd.iter().map(|log_sd| exp(-2.0 * log_sd)).collect();
    let residuals: Vec<f64> = log_action
        .iter()
        .zip(mean)
        .map(|(log, mean)| log - mean)
        .collect();
    let total: f64 = weights.iter().sum();
    let centre = weights
        .iter()
        .zip(&residuals)
        .map(|(weight, residual)| weight * residual)
        .sum::<f64>()
        / total;
    let spread: f64 = weights
        .iter()
        .zip(&residuals)
        .map(|(weight, residual)| weight * (residual - centre) * (residual - centre))
        .sum();
    let constants = (mean.len() as f64 - 1.0) * HALF_LN_TWO_PI + log_sd.iter().sum::<f64>() + 0.5 * ln(total);
    -constants - 0.5 * spread - log_action.iter().sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn noise_is_standard_normal() {
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let n = 100_000;
        let mut moments = [0.0; 4];
        for _ in 0..n {
            let z = standard_normal(&mut rng);
            moments
                .iter_mut()
                .zip(1..)
                .for_each(|(moment, power)| *moment += z.powi(power) / f64::from(n));
        }
        for (moment, (want, sd)) in moments.iter().zip([
            (0.0, 1.0),
            (1.0, 2_f64.sqrt()),
            (0.0, 15_f64.sqrt()),
            (3.0, 96_f64.sqrt()),
        ]) {
            assert!(
                (moment - want).abs() < 4.0 * sd / f64::from(n).sqrt(),
                "{moments:?}"
            );
        }
    }

    #[test]
    fn density_at_hand_worked_points() {
        // The point is one standard deviation away in one coordinate, at the mean in the other.
        let got = log_density(&[1.0, -2.0], &[2_f64.ln(), 0.0], &[3.0, -2.0]);
        assert!((got - (-0.5 - 2_f64.ln() - 2.0 * HALF_LN_TWO_PI)).abs() < 1e-15);
        assert!((entropy(&[0.0]) - 1.4189385332046727).abs() < 1e-15);
        assert_eq!(kl_divergence((&[1.0], &[0.3]), (&[1.0], &[0.3])), 0.0);
        assert!((kl_divergence((&[1.0], &[0.0]), (&[0.0], &[0.0])) - 0.5).abs() < 1e-15);
    }

    #[test]
    fn squashing_is_stable_far_out() {
        for x in [-0.7_f64, 0.0, 0.3, 2.0] {
            assert!((log_tanh_derivative(x) - (1.0 - x.tanh().powi(2)).ln()).abs() < 1e-13);
        }
        assert!((log_tanh_derivative(400.0) - (4_f64.ln() - 800.0)).abs() < 1e-12);
        assert_eq!(log_tanh_derivative(-400.0), log_tanh_derivative(400.0));
    }

    #[test]
    fn squashed_density_integrates_to_one() {
        let steps = 20_000;
        let cell = 2.0 / f64::from(steps);
        let density = |i: i32| {
            let action = -1.0 + (f64::from(i) + 0.5) * cell;
            squashed_log_density(&[0.4], &[-0.5], &[action.atanh()]).exp()
        };
        assert!(((0..steps).map(density).sum::<f64>() * cell - 1.0).abs() < 1e-6);
    }

    #[test]
    fn softmax_density_integrates_to_one() {
        let steps = 400;
        let cell = 1.0 / f64::from(steps);
        let mut integral = 0.0;
        for i in 0..steps {
            for j in 0..steps {
                let (first, second) = ((f64::from(i) + 0.5) * cell, (f64::from(j) + 0.5) * cell);
                if first + second < 1.0 {
                    let log_action = [
                        first.ln(),
                        second.ln(),
                        (1.0 - first - second).max(cell * 0.25).ln(),
                    ];
                    integral += softmax_log_density(&[0.3, -0.2, 0.5], &[-0.6, -0.4, -0.9], &log_action)
                        .exp()
                        * cell
                        * cell;
                }
            }
        }
        assert!((integral - 1.0).abs() < 1e-4, "{integral}");
    }

    #[test]
    fn softmax_density_is_the_integral_over_the_shift() {
        let (mean, log_sd, candidate) = ([0.3, -0.2, 0.5], [-0.6, 0.1, -0.9], [1.0, 0.2, -0.4]);
        let (log_action, cell) = (log_softmax(&candidate), 1e-3);
        let shifted = |i: i32| {
            let x: Vec<f64> = log_action.iter().map(|log| log + f64::from(i) * cell).collect();
            log_density(&mean, &log_sd, &x).exp() * cell
        };
        let integral = (-15_000..15_000).map(shifted).sum::<f64>() / log_action.iter().sum::<f64>().exp();
        assert!((softmax_log_density(&mean, &log_sd, &log_action) - integral.ln()).abs() < 1e-9);
    }

    proptest! {
        #[test]
        fn candidate_density_factors_into_action_and_shift(
            values in prop::collection::vec(-2.0..2.0_f64, 12)
        ) {
            let (mean, log_sd, candidate) = (&values[..4], &values[4..8], &values[8..]);
            let (log_action, shift) = (log_softmax(candidate), log_sum_exp(candidate));
            let weights: Vec<f64> = log_sd.iter().map(|log_sd| (-2.0 * log_sd).exp()).collect();
            let total: f64 = weights.iter().sum();
            let centre = (0..4).map(|i| weights[i] * (mean[i] - log_action[i])).sum::<f64>() / total;
            let of_shift = log_density(&[centre], &[-0.5 * total.ln()], &[shift]);
            let factors = softmax_log_density(mean, log_sd,
                &log_action) + of_shift + log_action.iter().sum::<f64>();
            let whole = log_density(mean, log_sd, candidate);
            prop_assert!((whole - factors).abs() < 1e-9 * whole.abs().max(1.0));
        }
    }
}
