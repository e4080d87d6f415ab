//! Special functions in `f64`: ln Gamma of a positive number, its first two derivatives, the regularised
//! incomplete gamma function, and the logarithm of a sum of exponentials.
//!
//! For `1e-3 <= x <= 1e6` the first three are within 1e-14 of the exact value, relative to the larger of the
//! value and one. For `x <= 0` and NaN they return NaN.

use arithmetic::double::{exp, ln};
pub use arithmetic::gamma::{digamma, ln_gamma, trigamma};
use arithmetic::gamma_slope::{is_upper_tail, upper_fraction};

/// Logarithm of the sum of exponentials, without overflow.
pub(crate) fn log_sum_exp(values: &[f64]) -> f64 {
    let largest = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    largest + ln(values.iter().map(|value| exp(value - largest)).sum())
}

/// Regularised lower incomplete gamma function `P(shape, x)`: the distribution function of a Gamma(shape, 1)
/// variable.
///
/// `shape > 0` and `x >= 0`, otherwise NaN. The cost of one value grows with the square root of `shape`.
#[must_use]
pub fn lower_incomplete_gamma(shape: f64, x: f64) -> f64 {
    if !(shape > 0.0 && x >= 0.0) {
        return f64::NAN;
    }
    if x == 0.0 || x == f64::INFINITY {
        return f64::from(x > 0.0);
    }
    let front = exp(shape * ln(x) - x - ln_gamma(shape));
    if is_upper_tail(shape, x) {
        1.0 - front * upper_fraction(shape, x).0
    } else {
        front * lower_series(shape, x)
    }
}

/// Series `sum over n of x^n / (shape (shape + 1) ... (shape + n))`.
fn lower_series(shape: f64, x: f64) -> f64 {
    let (mut term, mut sum, mut argument) = (1.0 / shape, 1.0 / shape, shape);
    while term > f64::EPSILON * 0.1 * sum || argument < x {
        argument += 1.0;
        term *= x / argument;
        sum += term;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const VALUES: &str = include_str!("../../../tests/fixtures/special/special.csv");
    const GAMMA: &str = include_str!("../../../tests/fixtures/special/gamma.csv");

    fn rows<const N: usize>(text: &str) -> Vec<[f64; N]> {
        csv::Reader::from_reader(text.as_bytes())
            .deserialize()
            .map(|row| row_of(row.unwrap()))
            .collect()
    }

    fn row_of<const N: usize>(row: Vec<f64>) -> [f64; N] {
        row.try_into().unwrap()
    }

    fn check(name: &str, function: fn(f64) -> f64, column: usize) {
        for row in rows::<4>(VALUES) {
            let (got, want) = (function(row[0]), row[column]);
            assert!(
                (got - want).abs() <= 1e-14 * want.abs().max(0.1),
                "{name}({}) = {got}, not {want}",
                row[0]
            );
        }
    }

    #[test]
    fn match_high_precision_values() {
        check("ln_gamma", ln_gamma, 1);
        check("digamma", digamma, 2);
        check("trigamma", trigamma, 3);
    }

    #[test]
    fn ln_gamma_is_relatively_exact_at_its_zeros() {
        assert_eq!(ln_gamma(1.0), 0.0);
        assert_eq!(ln_gamma(2.0), 0.0);
        for row in rows::<4>(VALUES).iter().filter(|row| row[1] != 0.0) {
            assert!(
                (ln_gamma(row[0]) / row[1] - 1.0).abs() < 1e-14,
                "ln_gamma({})",
                row[0]
            );
        }
    }

    #[test]
    fn distribution_function_matches_high_precision_values() {
        for [shape, x, _, probability] in rows::<4>(GAMMA) {
            // exp(shape ln x - x - ln Gamma) loses digits in proportion to the size of the terms in its
            // exponent.
            let got = lower_incomplete_gamma(shape, x);
            let tolerance = 1e-14 * (1.0 + shape * x.ln().abs());
            assert!(
                (got - probability).abs() <= tolerance * probability,
                "P({shape}, {x}) = {got}, not {probability}"
            );
        }
    }

    #[test]
    fn outside_the_domain_is_not_a_number() {
        for x in [0.0, -1.5, f64::NAN] {
            assert!(ln_gamma(x).is_nan() && digamma(x).is_nan() && trigamma(x).is_nan());
        }
        assert!(lower_incomplete_gamma(-1.0, 1.0).is_nan() && lower_incomplete_gamma(1.0, -1.0).is_nan());
        assert_eq!(
            (ln_gamma(f64::INFINITY), trigamma(f64::INFINITY)),
            (f64::INFINITY, 0.0)
        );
        assert_eq!(
            (
                lower_incomplete_gamma(2.0, 0.0),
                lower_incomplete_gamma(2.0, f64::INFINITY)
            ),
            (0.0, 1.0)
        );
    }

    proptest! {
        #[test]
        fn obey_the_recurrences(exponent in -3.0..6.0_f64) {
            let x = 10_f64.powf(exponent);
            let close = |a: f64, b: f64, scale: f64| (a - b).abs() <= 1e-14 * scale.max(1.0);
            prop_assert!(close(ln_gamma(x + 1.0), ln_gamma(x) + x.ln(), ln_gamma(x).abs()));
            prop_assert!(close(digamma(x + 1.0), digamma(x) + 1.0 / x, 1.0 / x + x.ln().abs()));
            prop_assert!(close(trigamma(x + 1.0), trigamma(x) - 1.0 / (x * x), trigamma(x)));
        }
    }
}
