//! Powers of `f64` with real exponents ([`pow`]) and integer exponents ([`powi`]).
//!
//! Largest error found of [`pow`]: 0.82 units in the last place, against values with 40 digits at 78,000 arguments:
//! bases over the whole range, exponents with a finite power, and bases next to one. Special cases are those of IEEE
//! 754 (`pow`): anything to the power zero and one to any power are one; a negative base has integer powers only. A NaN
//! is [`NAN`].
//!
//! Uses plain operations of `f64`. The logarithm is a sum of two numbers with a relative error of 2^-65: `x = 2^k m`,
//! `J` the integer nearest to `64 / m`, `ln x = k ln 2 + ln(64 / J) + ln(1 + r)` with `r = m J / 64 - 1` exact, below
//! 1/89, and `ln(1 + r)` by its series up to `r^9`. The table has `ln(64 / J)` with 106 bits. The product with the
//! exponent keeps both parts, which are passed to exp.

use crate::double::{LN_2_HIGH, LN_2_LOW, NAN, ROUNDING, exp_parts, polynomial, scaled, split};
use crate::trigonometry::{two_product, two_sum};

/// Constant 2^64: from this exponent on every power of a number other than one is zero or infinite.
const LARGEST: f64 = 18_446_744_073_709_551_616.0;

/// `ln(1 + r) = r - r^2 / 2 + r^3 (1/3 - r/4 + ...)`: the series in brackets.
const SERIES: [f64; 7] = [1.0 / 3.0, -0.25, 0.2, -1.0 / 6.0, 1.0 / 7.0, -0.125, 1.0 / 9.0];

/// `ln(64 / J)` as a sum of two numbers, for `J = 45, 46, ... 91`.
const TABLE: [[f64; 2]; 47] = [
    [0.3522205935893521, 5.7233316949182485e-18],
    [0.33024168687057687, -1.0828321637483858e-17],
    [0.3087354816496133, -1.6199186085148102e-17],
    [0.2876820724517809, 2.607160616442564e-17],
    [0.26706278524904525, -7.32891532732017e-18],
    [0.24686007793152578, 1.361743371748368e-17],
    [0.22705745063534608, 9.551415762738488e-18],
    [0.2076393647782445, 1.2053243216686129e-17],
    [0.18859116980755003, -7.432164219196925e-18],
    [0.16989903679539747, -4.868008764439071e-19],
    [0.15154989812720093, 5.1669593684615594e-18],
    [0.13353139262452263, -3.664457663660085e-18],
    [0.1158318155251217, 4.338484369808096e-18],
    [0.09844007281325252, -4.439009633675136e-18],
    [0.0813456394539524, 5.07707635593117e-18],
    [0.06453852113757118, -6.470486661692933e-18],
    [0.048009219186360606, 1.4390903347292205e-18],
    [0.0317486983145803, 3.0382263084680858e-18],
    [0.015748356968139168, 1.0021578630528974e-18],
    [0.0, 0.0],
    [-0.015504186535965254, 3.278321022892429e-19],
    [-0.030771658666753687, -1.0431732029005968e-18],
    [-0.0458095360312942, -1.902959866474257e-18],
    [-0.06062462181643484, -2.6424025938726934e-18],
    [-0.07522342123758753, 5.930604196293241e-18],
    [-0.08961215868968714, 5.4268129336647135e-18],
    [-0.10379679368164356, -5.47772415726659e-18],
    [-0.11778303565638346, 1.1971685747593677e-18],
    [-0.13157635778871926, -1.1123000879729588e-17],
    [-0.1451820098444979, -8.242418783022475e-18],
    [-0.15860503017663857, -1.1257003872182592e-17],
    [-0.17185025692665923, 6.0224538210113705e-18],
    [-0.184922338494012, -3.0236614153574064e-18],
    [-0.19782574332991987, -1.2821194372980142e-17],
    [-0.21056476910734964, 4.249405314729895e-18],
    [-0.22314355131420976, 9.091270597324799e-18],
    [-0.2355660713127669, 2.3943371495187355e-18],
    [-0.24783616390458127, 1.2432209578702523e-17],
    [-0.25995752443692605, -2.069806938978935e-17],
    [-0.27193371548364176, -7.83319637697442e-19],
    [-0.2837681731306446, 2.032665581126656e-17],
    [-0.2954642128938359, 2.16461086040599e-17],
    [-0.3070250352949119, 1.2319916200101964e-17],
    [-0.3184537311185346, -2.7114779367326236e-17],
    [-0.329753286372468, -2.122020616196946e-18],
    [-0.3409265869705932, -1.7467136443544747e-17],
    [-0.3519764231571782, 1.2953893030191963e-17],
];

/// Power `x^y`.
#[must_use]
pub fn pow(x: f64, y: f64) -> f64 {
    if y == 0.0 || x == 1.0 {
        return 1.0;
    }
    if x.is_nan() || y.is_nan() {
        return NAN;
    }
    let magnitude = x.abs();
    let parity = Parity::of(y);
    let sign = if x.is_sign_negative() && parity == Parity::Odd {
        -1.0
    } else {
        1.0
    };
    if magnitude == 1.0 && y.is_infinite() {
        return 1.0;
    }
    if magnitude == 0.0 || magnitude.is_infinite() || y.is_infinite() {
        let grows = (magnitude > 1.0) == (y > 0.0);
        return sign * if grows { f64::INFINITY } else { 0.0 };
    }
    if x < 0.0 && parity == Parity::NonInteger {
        return NAN;
    }
    let y = if y > LARGEST { LARGEST } else { y };
    let y = if y < -LARGEST { -LARGEST } else { y };
    let (high, low) = logarithm(magnitude);
    let (product, lost) = two_product(high, y);
    let low = lost + y * low;
    if product > 710.0 {
        return sign * f64::INFINITY;
    }
    if product < -746.0 {
        return sign * 0.0;
    }
    let (rest, n) = exp_parts(product, low);
    sign * scaled(1.0 + rest, n)
}

/// Power `x^n` of an integer. For `n >= 0` it is the product of the factors `x^(2^i)` for the set bits `i` of
/// `n`, from the lowest on, each factor the square of the one before; for `n < 0` it is one divided by that.
#[must_use]
pub fn powi(x: f64, n: i32) -> f64 {
    let (mut bits, mut factor, mut product) = (n.unsigned_abs(), x, 1.0);
    while bits != 0 {
        if bits & 1 == 1 {
            product *= factor;
        }
        factor *= factor;
        bits >>= 1;
    }
    let power = if n < 0 { 1.0 / product } else { product };
    if power.is_nan() { NAN } else { power }
}

/// Parity of an integer, or the fact that a number is no integer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Parity {
    NonInteger,
    Even,
    Odd,
}

impl Parity {
    fn of(y: f64) -> Self {
        let magnitude = y.abs();
        // From 2^53 on all numbers are even.
        if magnitude >= 9_007_199_254_740_992.0 {
            return Parity::Even;
        }
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "below 2^53 and positive"
        )]
        let integer = magnitude as u64;
        if integer as f64 != magnitude {
            Parity::NonInteger
        } else if integer & 1 == 1 {
            Parity::Odd
        } else {
            Parity::Even
        }
    }
}

/// Logarithm of a positive finite number, as a sum of two numbers.
fn logarithm(x: f64) -> (f64, f64) {
    let (k, f) = split(x);
    let m = 1.0 + f;
    let shifted = 64.0 / m + ROUNDING;
    let j = shifted - ROUNDING;
    let scale = j * (1.0 / 64.0);
    // Both products are exact: the parts have 26 and 27 bits, the scale 7.
    let upper = f64::from_bits(m.to_bits() & !0x07ff_ffff);
    let (r, r_low) = two_sum(upper * scale - 1.0, (m - upper) * scale);
    let (square, square_low) = two_product(r, r);
    let series = square * r * polynomial(&SERIES, r);
    let [table, table_low] = TABLE[(shifted.to_bits() - ROUNDING.to_bits() - 45) as usize];
    let k = k as f64;
    let (sum, lost_1) = two_sum(k * LN_2_HIGH, table);
    let (sum, lost_2) = two_sum(sum, r);
    let (sum, lost_3) = two_sum(sum, -0.5 * square);
    // The large terms are added last.
    let tail = table_low + k * LN_2_LOW + (r_low - (0.5 * square_low + r * r_low));
    let tail = series + (tail + ((lost_1 + lost_2) + lost_3));
    let high = sum + tail;
    (high, (sum - high) + tail)
}
