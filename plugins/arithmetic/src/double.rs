//! Elementary functions of `f64`: exp, exp_m1, ln, ln_1p, tanh.
//!
//! | function | largest error found, units in the last place |
//! |---|---|
//! | [`exp`] | 0.81 |
//! | [`exp_m1`] | 1.40 |
//! | [`ln`] | 0.77 |
//! | [`ln_1p`] | 0.79 |
//! | [`tanh`] | 2.49 |
//!
//! Errors are measured against values with 40 digits, at 59,000 to 99,000 arguments each (`fixtures/values.py`): spread
//! evenly over their logarithms, over the range with finite results, and densely around zeros. A denormal result is
//! rounded once more. Infinities, signed zeros and arguments outside the domain have the mathematical limit as their
//! result; a NaN gives [`NAN`].
//!
//! Uses only plain operations of `f64`. The methods are those of [`crate::single`] with two differences: exp carries
//! the rounding error of its reduced argument, and `ln(1 + f) = f - f^2 / 2 + s (f^2 / 2 + R(s^2))` with `s = f / (2 +
//! f)` (the form of the C library of BSD, K. C. Ng 1993), `R` from the series of the area tangent. The polynomials are
//! interpolations at Chebyshev nodes computed with 60 digits.

/// The NaN of every function of `f64` in this crate.
pub const NAN: f64 = f64::from_bits(0x7ff8_0000_0000_0000);

/// Constant `1.5 2^52`: adding it to a number below 2^51 rounds the number to an integer, held in the lowest
/// bits of the sum.
pub(crate) const ROUNDING: f64 = 6_755_399_441_055_744.0;

/// The first 41 bits of ln 2; a product with an integer below 2^12 is exact.
pub(crate) const LN_2_HIGH: f64 = 0.693_147_180_559_663;
/// Remainder of ln 2 beyond [`LN_2_HIGH`].
pub(crate) const LN_2_LOW: f64 = 2.823_529_056_303_157_7e-13;

/// `(e^r - 1 - r) / r^2` for `|r| <= ln 2 / 2`, lowest power first; relative error of `e^r` below 2^-61.
const EXP: [f64; 11] = [
    0.5,
    0.1666666666666667,
    0.04166666666666667,
    0.008333333333326136,
    0.0013888888888883748,
    0.00019841269874820627,
    2.4801587325547743e-05,
    2.7557255400206422e-06,
    2.75572736431103e-07,
    2.5105217004720745e-08,
    2.0914686968086876e-09,
];

/// `(2 artanh s - 2 s) / s^3` in powers of `s^2` for `s^2 <= 0.02945`; relative error of the logarithm below 2^-60.
const LN: [f64; 8] = [
    0.6666666666666666,
    0.4000000000000088,
    0.28571428570801954,
    0.22222222392089008,
    0.18181795600060793,
    0.15386241881938595,
    0.13268714792348096,
    0.1308723619665962,
];

/// Exponential function `e^x`.
#[must_use]
pub fn exp(x: f64) -> f64 {
    let (rest, n) = exp_parts(held(x, -746.0, 710.0), 0.0);
    known(x, scaled(1.0 + rest, n))
}

/// Exponential function minus one, `e^x - 1`.
#[must_use]
pub fn exp_m1(x: f64) -> f64 {
    let (rest, n) = exp_parts(held(x, -40.0, 710.0), 0.0);
    let value = if n == 0 {
        // Zero keeps its sign.
        if x == 0.0 { x } else { rest }
    } else if n > 53 {
        scaled(1.0 + rest, n)
    } else {
        let power = power_of_two(n);
        rest * power + (power - 1.0)
    };
    known(x, value)
}

/// Natural logarithm.
#[must_use]
pub fn ln(x: f64) -> f64 {
    if !(x > 0.0 && x < f64::INFINITY) {
        return logarithm_outside(x);
    }
    let (k, f) = split(x);
    ln_parts(k as f64, f, 0.0)
}

/// Logarithm `ln(1 + x)`.
#[must_use]
pub fn ln_1p(x: f64) -> f64 {
    if !(x > -1.0 && x < f64::INFINITY) || x == 0.0 {
        return if x == 0.0 { x } else { logarithm_outside(1.0 + x) };
    }
    let sum = 1.0 + x;
    let lost = if x < 1.0 { x - (sum - 1.0) } else { 1.0 - (sum - x) };
    let (k, f) = split(sum);
    if k == 0 {
        ln_parts(0.0, x, 0.0)
    } else {
        ln_parts(k as f64, f, lost / sum)
    }
}

/// Hyperbolic tangent.
#[must_use]
pub fn tanh(x: f64) -> f64 {
    let below = exp_m1(-2.0 * x.abs());
    known(x, (-below / (2.0 + below)).copysign(x))
}

/// `(e^r - 1, n)` with `e^(x + low) = 2^n e^r`, for `|x| <= 746` and a small `low`.
pub(crate) fn exp_parts(x: f64, low: f64) -> (f64, i32) {
    let shifted = x * std::f64::consts::LOG2_E + ROUNDING;
    let n = shifted - ROUNDING;
    let (high, low) = (x - n * LN_2_HIGH, n * LN_2_LOW - low);
    let r = high - low;
    let lost = (high - r) - low;
    #[allow(clippy::cast_possible_truncation, reason = "below 1100 by the bound on x")]
    let whole = shifted.to_bits().wrapping_sub(ROUNDING.to_bits()).cast_signed() as i32;
    (r + (r * r * polynomial(&EXP, r) + lost), whole)
}

/// `y 2^n` in two steps, so that a denormal result is rounded once and 2^1024 is not needed.
pub(crate) fn scaled(y: f64, n: i32) -> f64 {
    let half = n >> 1;
    y * power_of_two(half) * power_of_two(n.wrapping_sub(half))
}

/// Power `2^n`, for `-1022 <= n <= 1023`.
fn power_of_two(n: i32) -> f64 {
    f64::from_bits(i64::from(n).wrapping_add(1023).cast_unsigned() << 52)
}

/// Sum `k ln 2 + ln(1 + f) + correction`.
fn ln_parts(k: f64, f: f64, correction: f64) -> f64 {
    let s = f / (2.0 + f);
    let (z, half) = (s * s, 0.5 * f * f);
    let series = s * (half + z * polynomial(&LN, z));
    k * LN_2_HIGH - ((half - (series + (k * LN_2_LOW + correction))) - f)
}

/// `(k, f)` with `x = 2^k (1 + f)` and `1 + f` between the roots of 1/2 and 2, for a positive finite `x`.
pub(crate) fn split(x: f64) -> (i64, f64) {
    /// Bits of the square root of 1/2.
    const ROOT: u64 = 0x3fe6_a09e_667f_3bcd;
    /// 2^54, which makes denormals normal.
    const SCALE: f64 = 18_014_398_509_481_984.0;
    let (x, below) = if x < f64::MIN_POSITIVE {
        (x * SCALE, 54)
    } else {
        (x, 0)
    };
    let bits = x.to_bits().wrapping_add(1.0f64.to_bits() - ROOT);
    let k = (bits >> 52).cast_signed() - 1023 - below;
    (k, f64::from_bits((bits & 0x000f_ffff_ffff_ffff) + ROOT) - 1.0)
}

/// Logarithm of zero, of infinity, and of numbers outside the domain.
fn logarithm_outside(x: f64) -> f64 {
    if x == 0.0 {
        f64::NEG_INFINITY
    } else if x == f64::INFINITY {
        x
    } else {
        NAN
    }
}

/// `x` clamped to two limits; a NaN stays one.
fn held(x: f64, low: f64, high: f64) -> f64 {
    let x = if x < low { low } else { x };
    if x > high { high } else { x }
}

/// `y`, or [`NAN`] if `x` is a NaN.
fn known(x: f64, y: f64) -> f64 {
    if x.is_nan() { NAN } else { y }
}

/// Polynomial `c[0] + c[1] x + ...` by Horner's rule, from the last coefficient on.
#[inline(always)]
pub(crate) fn polynomial<const N: usize>(coefficients: &[f64; N], x: f64) -> f64 {
    let mut sum = coefficients[N - 1];
    for c in coefficients[..N - 1].iter().rev() {
        sum = sum * x + c;
    }
    sum
}
