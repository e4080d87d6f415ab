//! Special functions in `f64`: ln Gamma of a positive number, its first two derivatives, the regularised
//! incomplete gamma function, and the logarithm of a sum of exponentials.
//!
//! For `1e-3 <= x <= 1e6` the first three are within 1e-14 of the exact value, relative to the larger of the
//! value and one (digamma crosses zero near 1.46; ln Gamma keeps its relative accuracy at its zeros 1 and 2
//! too). For `x <= 0` and NaN they return NaN: no distribution of this crate has such a parameter, and the
//! reflection to negative arguments is left out.
//!
//! Method: the asymptotic series in `1/x` from 10 upwards (Abramowitz and Stegun 6.1.40, 6.3.18, 6.4.12),
//! reached from below by the recurrence; around 1 and 2 ln Gamma uses its Taylor series (A&S 6.1.33), because
//! there the recurrence would cancel.

use std::f64::consts::PI;

/// Argument from which the asymptotic series, cut after the last coefficient below, are exact to the last bit.
const ASYMPTOTIC_FROM: f64 = 10.0;

/// Constant `1 - gamma`, where gamma is Euler's constant.
const ONE_MINUS_EULER: f64 = 0.42278433509846713;

/// `(-1)^k (zeta(k) - 1) / k` for `k = 2, 3, ...`: ln Gamma(2 + z) less its linear term, as a power series in
/// `z`.
const LN_GAMMA_AT_TWO: [f64; 29] = [
    0.3224670334241132,
    -0.0673523010531981,
    0.020580808427784546,
    -0.007385551028673986,
    0.0028905103307415234,
    -0.001192753911703261,
    0.0005096695247430425,
    -0.00022315475845357939,
    9.945751278180853e-05,
    -4.492623673813314e-05,
    2.050721277567069e-05,
    -9.439488275268397e-06,
    4.374866789907488e-06,
    -2.039215753801366e-06,
    9.55141213040742e-07,
    -4.492469198764566e-07,
    2.1207184805554665e-07,
    -1.0043224823968099e-07,
    4.7698101693639804e-08,
    -2.2711094608943164e-08,
    1.0838659214896955e-08,
    -5.183475041970047e-09,
    2.4836745438024785e-09,
    -1.1921401405860912e-09,
    5.731367241678862e-10,
    -2.7595228851242334e-10,
    1.330476437424449e-10,
    -6.4229645638381e-11,
    3.1044247747322276e-11,
];

/// Coefficients of `1/x, 1/x^3, ...` in Stirling's series of ln Gamma: `B_2k / (2k (2k - 1))`.
const STIRLING: [f64; 8] = [
    1.0 / 12.0,
    -1.0 / 360.0,
    1.0 / 1260.0,
    -1.0 / 1680.0,
    1.0 / 1188.0,
    -691.0 / 360_360.0,
    1.0 / 156.0,
    -3617.0 / 122_400.0,
];

/// Coefficients of `1/x^2, 1/x^4, ...` in the series of `ln x - 1/(2x) - digamma(x)`: `B_2k / 2k`.
const DIGAMMA: [f64; 8] = [
    1.0 / 12.0,
    -1.0 / 120.0,
    1.0 / 252.0,
    -1.0 / 240.0,
    1.0 / 132.0,
    -691.0 / 32_760.0,
    1.0 / 12.0,
    -3617.0 / 8160.0,
];

/// Coefficients of `1/x^3, 1/x^5, ...` in the series of trigamma: the Bernoulli numbers `B_2k`.
const TRIGAMMA: [f64; 9] = [
    1.0 / 6.0,
    -1.0 / 30.0,
    1.0 / 42.0,
    -1.0 / 30.0,
    5.0 / 66.0,
    -691.0 / 2730.0,
    7.0 / 6.0,
    -3617.0 / 510.0,
    43_867.0 / 798.0,
];

/// Logarithm of the sum of exponentials, without overflow.
pub(crate) fn log_sum_exp(values: &[f64]) -> f64 {
    let largest = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    largest
        + values
            .iter()
            .map(|value| (value - largest).exp())
            .sum::<f64>()
            .ln()
}

/// Logarithm of the gamma function, for `x > 0`.
#[must_use]
pub fn ln_gamma(x: f64) -> f64 {
    if x.is_nan() || x <= 0.0 {
        f64::NAN
    } else if x >= ASYMPTOTIC_FROM {
        let inverse = 1.0 / x;
        (x - 0.5) * (x.ln() - 1.0)
            + 0.5 * ((2.0 * PI).ln() - 1.0)
            + inverse * polynomial(&STIRLING, inverse * inverse)
    } else if x < 0.5 {
        ln_gamma_near_one(x) - x.ln()
    } else if x <= 1.5 {
        ln_gamma_near_one(x - 1.0)
    } else {
        let (mut argument, mut factor) = (x, 1.0);
        while argument > 2.5 {
            argument -= 1.0;
            factor *= argument;
        }
        ln_gamma_above_two(argument - 2.0) + factor.ln()
    }
}

/// `ln Gamma(1 + z)` for `|z| <= 0.5`.
fn ln_gamma_near_one(z: f64) -> f64 {
    ln_gamma_above_two(z) - z.ln_1p()
}

/// `ln Gamma(2 + z)` for `|z| <= 0.5`.
fn ln_gamma_above_two(z: f64) -> f64 {
    z * (ONE_MINUS_EULER + z * polynomial(&LN_GAMMA_AT_TWO, z))
}

/// Derivative of ln Gamma, for `x > 0`.
#[must_use]
pub fn digamma(x: f64) -> f64 {
    if x.is_nan() || x <= 0.0 {
        return f64::NAN;
    }
    let (mut argument, mut below) = (x, 0.0);
    while argument < ASYMPTOTIC_FROM {
        below += 1.0 / argument;
        argument += 1.0;
    }
    let inverse = 1.0 / argument;
    let square = inverse * inverse;
    argument.ln() - 0.5 * inverse - square * polynomial(&DIGAMMA, square) - below
}

/// Second derivative of ln Gamma, for `x > 0`.
#[must_use]
pub fn trigamma(x: f64) -> f64 {
    if x.is_nan() || x <= 0.0 {
        return f64::NAN;
    }
    let (mut argument, mut below) = (x, 0.0);
    while argument < ASYMPTOTIC_FROM {
        below += 1.0 / (argument * argument);
        argument += 1.0;
    }
    let inverse = 1.0 / argument;
    let square = inverse * inverse;
    inverse + square * (0.5 + inverse * polynomial(&TRIGAMMA, square)) + below
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
    let front = (shape * x.ln() - x - ln_gamma(shape)).exp();
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

/// Whether `x` is so far above `shape` that [`upper_fraction`] has converged.
pub(crate) fn is_upper_tail(shape: f64, x: f64) -> bool {
    x > shape + 2.5 * shape.sqrt() + 2.0
}

/// Continued fraction `F = Gamma(shape, x) / (x^shape exp(-x))` of the upper incomplete gamma function (A&S
/// 6.5.31 in its even form) and its derivative in `shape`.
///
/// Evaluated from the tail at a fixed depth, which is exact to 1e-13 where [`is_upper_tail`] holds, for any
/// shape.
pub(crate) fn upper_fraction(shape: f64, x: f64) -> (f64, f64) {
    const DEPTH: u32 = 64;
    let (mut tail, mut tail_slope) = (0.0, 0.0);
    for level in (1..=DEPTH).rev().map(f64::from) {
        let inverse = 1.0 / (x + 2.0 * level + 1.0 - shape - tail);
        let numerator = level * (level - shape);
        tail = numerator * inverse;
        tail_slope = (tail * (1.0 + tail_slope) - level) * inverse;
    }
    let fraction = 1.0 / (x + 1.0 - shape - tail);
    (fraction, fraction * fraction * (1.0 + tail_slope))
}

/// Polynomial `coefficients[0] + coefficients[1] y + ...` by Horner's rule.
fn polynomial(coefficients: &[f64], y: f64) -> f64 {
    coefficients
        .iter()
        .rev()
        .fold(0.0, |sum, coefficient| sum * y + coefficient)
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
