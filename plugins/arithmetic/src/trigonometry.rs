//! Sine and cosine of `f64`, in radians.
//!
//! | function | largest error found, units in the last place |
//! |---|---|
//! | [`sin`] | 0.76 |
//! | [`cos`] | 0.74 |
//!
//! Errors are measured against values with 40 digits, at 140,000 arguments each: over the whole range of `f64`, densely
//! below 1000, and next to multiples of pi/2. Infinities give [`NAN`].
//!
//! The argument is reduced to `|r| <= pi/4` with twice the digits of `f64`: below 1024 by subtracting a multiple of
//! pi/2 in three parts (Cody and Waite 1980), from there on by the product with the bits of 2/pi that matter, in
//! integers (Payne and Hanek 1983). Then polynomials of degree 13 and 14, in the form of the C library of BSD (K. C. Ng
//! 1993), with coefficients by interpolation at Chebyshev nodes computed with 60 digits.

use crate::double::{NAN, ROUNDING, polynomial};

/// Start of the reduction in integers; smaller arguments are reduced by parts.
const LARGE: f64 = 1024.0;

/// pi/2 in three parts, the first two of 43 bits: a product with an integer below 2^10 is exact.
const HALF_PI: [f64; 3] = [1.5707963267948344, 6.223372171896261e-14, 3.5215598651832e-27];

/// pi/2 as a sum of two numbers.
pub(crate) const HALF_PI_HIGH: f64 = std::f64::consts::FRAC_PI_2;
const HALF_PI_LOW: f64 = 6.123233995736766e-17;

const TWO_TO_MINUS_53: f64 = 1.110_223_024_625_156_5e-16;

/// 64 bits of zero, then the bits of 2/pi after the point.
const TWO_OVER_PI: [u64; 21] = [
    0x0000000000000000,
    0xa2f9836e4e441529,
    0xfc2757d1f534ddc0,
    0xdb6295993c439041,
    0xfe5163abdebbc561,
    0xb7246e3a424dd2e0,
    0x06492eea09d1921c,
    0xfe1deb1cb129a73e,
    0xe88235f52ebb4484,
    0xe99c7026b45f7e41,
    0x3991d639835339f4,
    0x9c845f8bbdf9283b,
    0x1ff897ffde05980f,
    0xef2f118b5a0a6d1f,
    0x6d367ecf27cb09b7,
    0x4f463f669e5fea2d,
    0x7527bac7ebe5f17b,
    0x3d0739f78a5292ea,
    0x6bfb5fb11f8d5d08,
    0x56033046fc7b6bab,
    0xf0cfbc209af4361d,
];

/// `(sin r - r) / r^3` in powers of `r^2` for `|r| <= pi/4`; relative error of the sine below 2^-57.
const SIN: [f64; 7] = [
    -0.16666666666666666,
    0.008333333333333331,
    -0.00019841269841265063,
    2.7557319219337312e-06,
    -2.5052106231802837e-08,
    1.6058531516797758e-10,
    -7.586691094197958e-13,
];

/// `(cos r - 1 + r^2 / 2) / r^4` in powers of `r^2` for `|r| <= pi/4`; error of the cosine below 2^-59.
const COS: [f64; 6] = [
    0.041666666666666664,
    -0.0013888888888887398,
    2.480158729876456e-05,
    -2.7557317271145144e-07,
    2.087614614655861e-09,
    -1.1382623647474604e-11,
];

/// Sine of `x` in radians.
#[must_use]
pub fn sin(x: f64) -> f64 {
    quarter_turned(x, 0)
}

/// Cosine of `x` in radians.
#[must_use]
pub fn cos(x: f64) -> f64 {
    quarter_turned(x, 1)
}

/// Sine `sin(x + turns pi/2)`.
fn quarter_turned(x: f64, turns: u64) -> f64 {
    if !x.is_finite() {
        return NAN;
    }
    let (quadrant, high, low) = if x.abs() < LARGE {
        reduced_by_parts(x)
    } else {
        reduced_in_integers(x)
    };
    let quadrant = quadrant.wrapping_add(turns);
    let value = if quadrant & 1 == 0 {
        sin_inside(high, low)
    } else {
        cos_inside(high, low)
    };
    if quadrant & 2 == 0 { value } else { -value }
}

/// Sine `sin(high + low)` for `|high| <= pi/4`.
fn sin_inside(high: f64, low: f64) -> f64 {
    if high == 0.0 {
        return high;
    }
    let z = high * high;
    let cube = z * high;
    let [first, rest @ ..] = &SIN;
    let series = polynomial(rest, z);
    high - ((z * (0.5 * low - cube * series) - low) - cube * first)
}

/// Cosine `cos(high + low)` for `|high| <= pi/4`.
fn cos_inside(high: f64, low: f64) -> f64 {
    let z = high * high;
    let half = 0.5 * z;
    let near = 1.0 - half;
    near + (((1.0 - near) - half) + (z * (z * polynomial(&COS, z)) - high * low))
}

/// `(n, high, low)` with `x = n pi/2 + high + low`, for `|x| < 1024`.
fn reduced_by_parts(x: f64) -> (u64, f64, f64) {
    let shifted = x * std::f64::consts::FRAC_2_PI + ROUNDING;
    let quadrant = shifted.to_bits().wrapping_sub(ROUNDING.to_bits());
    let n = shifted - ROUNDING;
    if n == 0.0 {
        // A zero keeps its sign.
        return (0, x, 0.0);
    }
    // This difference and the product in the next line are exact; then the sum of two numbers with its
    // rounding error (Knuth).
    let first = x - n * HALF_PI[0];
    let second = n * HALF_PI[1];
    let (sum, lost) = two_sum(first, -second);
    let tail = lost - n * HALF_PI[2];
    let high = sum + tail;
    (quadrant, high, (sum - high) + tail)
}

/// Reduction as in [`reduced_by_parts`], for any finite `|x| >= 1024`.
fn reduced_in_integers(x: f64) -> (u64, f64, f64) {
    let bits = x.abs().to_bits();
    let mantissa = (bits & 0x000f_ffff_ffff_ffff) | 0x0010_0000_0000_0000;
    // |x| = mantissa 2^e with e = (bits >> 52) - 1075. Bits of 2/pi whose product with |x| is a multiple of 4 are
    // left out; the first that counts has the weight 2 after the shift by e. The product uses 192 of them.
    let start = (bits >> 52) - 1013;
    let word = |at: u64| {
        let (index, shift) = ((start / 64 + at) as usize, start % 64);
        // The shift takes two steps, since a shift by 64 is not defined.
        (TWO_OVER_PI[index] << shift) | (TWO_OVER_PI[index + 1] >> 1 >> (63 - shift))
    };
    // The product modulo 4, in units of 2^-190.
    let [high, middle, low] = [word(0), word(1), word(2)];
    let low_product = u128::from(mantissa) * u128::from(low);
    let middle_product = u128::from(mantissa) * u128::from(middle) + (low_product >> 64);
    let [low, middle] = [low_product as u64, middle_product as u64];
    let high = mantissa
        .wrapping_mul(high)
        .wrapping_add((middle_product >> 64) as u64);
    // Integer part, and the fraction; from one half on, the negative distance to the next integer.
    let is_above = high >> 61 & 1 == 1;
    let quadrant = (high >> 62).wrapping_add(u64::from(is_above));
    let mut digits = [high << 2 | middle >> 62, middle << 2 | low >> 62, low << 2];
    if is_above {
        let carry = digits.map(|word| u64::from(word == 0));
        digits = [
            (!digits[0]).wrapping_add(carry[1] & carry[2]),
            (!digits[1]).wrapping_add(carry[2]),
            digits[2].wrapping_neg(),
        ];
    }
    // The leading 106 digits as a sum of two numbers. No f64 is so close to a multiple of pi/2 that both of the first
    // words are zero.
    let mut shift = 0;
    if digits[0] == 0 {
        digits = [digits[1], digits[2], 0];
        shift = 64;
    }
    let zeros = digits[0].leading_zeros();
    let [first, second] = [0, 1].map(|at| (digits[at] << zeros) | (digits[at + 1] >> 1 >> (63 - zeros)));
    let unit = f64::from_bits(u64::from(1023 - 53 - shift - zeros) << 52);
    let turns_high = (first >> 11) as f64 * unit;
    let turns_low = ((first & 0x7ff) << 42 | second >> 22) as f64 * (unit * TWO_TO_MINUS_53);
    let (product, lost) = two_product(turns_high, HALF_PI_HIGH);
    let tail = lost + (turns_high * HALF_PI_LOW + turns_low * HALF_PI_HIGH);
    let sum = product + tail;
    let rest = (product - sum) + tail;
    let is_negative = is_above != (x < 0.0);
    let quadrant = if x < 0.0 {
        quadrant.wrapping_neg()
    } else {
        quadrant
    };
    if is_negative {
        (quadrant, -sum, -rest)
    } else {
        (quadrant, sum, rest)
    }
}

/// Product of two numbers with its rounding error, to a relative 2^-106 of the product. `b` must be of moderate size,
/// so that no partial product leaves the range.
pub(crate) fn two_product(a: f64, b: f64) -> (f64, f64) {
    let upper = |x: f64| f64::from_bits(x.to_bits() & !0x07ff_ffff);
    let (a_high, b_high) = (upper(a), upper(b));
    let (a_low, b_low) = (a - a_high, b - b_high);
    let product = a * b;
    let lost = ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low;
    (product, lost)
}

/// Sum of two numbers with its rounding error.
pub(crate) fn two_sum(a: f64, b: f64) -> (f64, f64) {
    let sum = a + b;
    let of_b = sum - a;
    (sum, (a - (sum - of_b)) + (b - of_b))
}
