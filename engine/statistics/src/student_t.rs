//! Student's t distribution: cumulative probability and quantile for any positive degrees of freedom, including
//! fractional ones.
//!
//! With `x = v / (v + t^2)` the upper tail is half the regularised incomplete beta function `I_x(v / 2, 1 / 2)` (DLMF
//! 8.17), evaluated by its continued fraction (DLMF 8.17.22) with the modified Lentz algorithm. The relative error,
//! including the tails, is below 1e-12 up to a thousand degrees of freedom and grows in proportion to them (1e-11 at
//! 250 000), because of the cancellation in the fraction's first denominators.
//!
//! | equation   | here                 |
//! |------------|----------------------|
//! | v          | `degrees_of_freedom` |
//! | a, b       | `a`, `b`: the two parameters of the beta function |

use std::f64::consts::PI;

/// Probability of a value of at most `t`; NaN unless `degrees_of_freedom > 0`.
#[must_use]
pub fn cdf(t: f64, degrees_of_freedom: f64) -> f64 {
    let tail = upper_tail(t.abs(), degrees_of_freedom);
    if t < 0.0 { tail } else { 1.0 - tail }
}

/// The `t` with `cdf(t) = probability`; infinite at 0 and 1, NaN outside, and NaN unless `degrees_of_freedom > 0`.
#[must_use]
pub fn quantile(probability: f64, degrees_of_freedom: f64) -> f64 {
    if !(0.0..=1.0).contains(&probability) || degrees_of_freedom <= 0.0 || degrees_of_freedom.is_nan() {
        return f64::NAN;
    }
    let tail = probability.min(1.0 - probability);
    let size = match tail {
        0.0 => f64::INFINITY,
        0.5 => 0.0,
        _ => upper_quantile(tail, degrees_of_freedom),
    };
    if probability < 0.5 { -size } else { size }
}

/// The positive `t` whose upper tail is `tail` (below one half): bracketed by doubling, then Newton's method
/// kept inside the bracket by bisection.
fn upper_quantile(tail: f64, degrees_of_freedom: f64) -> f64 {
    let mut high = 1.0;
    while upper_tail(high, degrees_of_freedom) > tail {
        high *= 2.0;
    }
    let mut low = if high > 1.0 { high / 2.0 } else { 0.0 };
    let mut t = f64::midpoint(low, high);
    // Sixty halvings alone exhaust the digits of a float.
    for _ in 0..60 {
        let excess = upper_tail(t, degrees_of_freedom) - tail;
        if excess > 0.0 {
            low = t;
        } else {
            high = t;
        }
        let newton = t + excess / density(t, degrees_of_freedom);
        let next = if newton > low && newton < high {
            newton
        } else {
            f64::midpoint(low, high)
        };
        if (next - t).abs() <= 2.0 * f64::EPSILON * t {
            return next;
        }
        t = next;
    }
    t
}

/// Probability density at `t`.
fn density(t: f64, degrees_of_freedom: f64) -> f64 {
    let v = degrees_of_freedom;
    gamma_ratio(v / 2.0) / (v * PI).sqrt() * (-(v + 1.0) / 2.0 * (t * t / v).ln_1p()).exp()
}

/// Probability of a value above `t >= 0`.
fn upper_tail(t: f64, degrees_of_freedom: f64) -> f64 {
    let v = degrees_of_freedom;
    if v.is_nan() || v <= 0.0 || t.is_nan() {
        return f64::NAN;
    }
    let a = v / 2.0;
    let square = t * t / v;
    // Both stay correct if the square is 0 or overflows.
    let (x, one_minus_x) = (1.0 / (1.0 + square), 1.0 / (1.0 + 1.0 / square));
    // x^a (1 - x)^b / B(a, b) with b = 1/2 and B(a, 1/2) = sqrt(pi) / gamma_ratio(a).
    let front = (-a * square.ln_1p()).exp() * one_minus_x.sqrt() * gamma_ratio(a) / PI.sqrt();
    if x < (a + 1.0) / (a + 2.5) {
        0.5 * front * beta_fraction(a, 0.5, x) / a
    } else {
        0.5 - front * beta_fraction(0.5, a, one_minus_x)
    }
}

/// `Gamma(x + 1/2) / Gamma(x)` for `x > 0`: the recurrence up to 64, then the asymptotic series in `1 / x`
/// (DLMF 5.11.13), whose first omitted term is below 1e-16 there. It avoids the cancellation of two large
/// logarithms.
fn gamma_ratio(x: f64) -> f64 {
    const SERIES: [f64; 7] = [
        1.0,
        -1.0 / 8.0,
        1.0 / 128.0,
        5.0 / 1024.0,
        -21.0 / 32768.0,
        -399.0 / 262_144.0,
        869.0 / 4_194_304.0,
    ];
    let (mut x, mut factor) = (x, 1.0);
    while x < 64.0 {
        factor *= x / (x + 0.5);
        x += 1.0;
    }
    factor
        * x.sqrt()
        * SERIES
            .iter()
            .rev()
            .fold(0.0, |sum, coefficient| sum / x + coefficient)
}

/// The continued fraction of the incomplete beta function, DLMF 8.17.22, for `x < (a + 1) / (a + b + 2)`.
fn beta_fraction(a: f64, b: f64, x: f64) -> f64 {
    let (mut c, mut d) = (1.0, 1.0 / away_from_zero(1.0 - (a + b) * x / (a + 1.0)));
    let mut fraction = d;
    // It needs about sqrt(max(a, b)) terms.
    for m in (1..100_000).map(f64::from) {
        let even = m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m));
        let odd = -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0));
        let mut step = 1.0;
        for term in [even, odd] {
            d = 1.0 / away_from_zero(1.0 + term * d);
            c = away_from_zero(1.0 + term / c);
            step = c * d;
            fraction *= step;
        }
        if (step - 1.0).abs() < f64::EPSILON {
            break;
        }
    }
    fraction
}

/// Lentz's guard against a denominator of zero.
fn away_from_zero(value: f64) -> f64 {
    if value.abs() < 1e-300 { 1e-300 } else { value }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{numbers, reference};
    use proptest::prelude::*;

    fn assert_relative(left: f64, right: f64, tolerance: f64, what: &[f64]) {
        assert!(
            (left - right).abs() <= tolerance * right.abs(),
            "{left} is not {right} at {what:?}"
        );
    }

    fn tolerance(degrees_of_freedom: f64) -> f64 {
        if degrees_of_freedom < 1e3 { 1e-12 } else { 1e-11 }
    }

    #[test]
    fn the_distribution_agrees_with_scipy() {
        for case in reference()["student_t"]["cdf"]
            .as_array()
            .unwrap()
            .iter()
            .map(numbers)
        {
            assert_relative(cdf(case[1], case[0]), case[2], tolerance(case[0]), &case);
        }
    }

    #[test]
    fn quantiles_agree_with_scipy() {
        for case in reference()["student_t"]["quantile"]
            .as_array()
            .unwrap()
            .iter()
            .map(numbers)
        {
            assert_relative(quantile(case[1], case[0]), case[2], tolerance(case[0]), &case);
        }
    }

    /// Closed forms for one and two degrees of freedom.
    #[test]
    fn closed_forms() {
        for t in [-50.0, -1.0, -1e-3, 0.0, 0.2, 3.0, 1e4_f64] {
            assert!((cdf(t, 1.0) - (0.5 + t.atan() / PI)).abs() < 1e-14);
            assert!((cdf(t, 2.0) - (0.5 + t / (2.0 * (2.0 + t * t).sqrt()))).abs() < 1e-14);
        }
        assert_relative(quantile(0.75, 1.0), 1.0, 1e-13, &[]);
    }

    #[test]
    fn ends_and_nonsense() {
        assert_eq!(
            (quantile(0.0, 4.0), quantile(1.0, 4.0)),
            (f64::NEG_INFINITY, f64::INFINITY)
        );
        assert_eq!(
            (
                quantile(0.5, 4.0),
                cdf(f64::INFINITY, 3.0),
                cdf(f64::NEG_INFINITY, 3.0)
            ),
            (0.0, 1.0, 0.0)
        );
        assert!(quantile(1.5, 4.0).is_nan() && quantile(0.4, 0.0).is_nan() && cdf(1.0, -1.0).is_nan());
    }

    proptest! {
        #[test]
        fn quantile_inverts_the_distribution(probability in 1e-6..0.999_999,
            degrees_of_freedom in 0.3..5000.0) {
            let there = cdf(quantile(probability, degrees_of_freedom), degrees_of_freedom);
            prop_assert!((there - probability).abs() < 1e-12, "{there}");
        }
    }
}
