//! Uniform, normal and gamma numbers from a stream of 64-bit words.
//!
//! | draw | words | number |
//! |---|---|---|
//! | [`uniform`] | one, `w` | `(floor(w / 2^12) + 1/2) / 2^52`: strictly between 0 and 1, exact |
//! | [`normal`] | one, `w` | the quantile of the normal distribution at `uniform(w)` |
//! | [`log_gamma`] | two for each try, one more for a shape below one | ln x of `x ~ Gamma(shape, 1)` |
//!
//! The quantile is algorithm AS 241 (M. J. Wichura, Applied Statistics 37, 1988, routine PPND16), whose relative
//! error is about 1e-16 (up to 5.6 units in the last place found here at 80,000 words, rounding included). It is at most 8.2 in size: `uniform` has no
//! number nearer to 0 than 2^-53.
//!
//! The gamma draw is the algorithm of G. Marsaglia and W. W. Tsang (ACM TOMS 26, 2000) without their quick first
//! test. With `d = shape - 1/3` and `c = 1 / sqrt(9 d)` each try takes a normal number `z` from a word. Where `t = 1 +
//! c z` is not positive, the next try begins. Otherwise it takes `u` from a further word, and `x = d t^3` is the draw if
//! `ln u < z^2 / 2 + d (1 - t^3 + 3 ln t)`. For a shape below one the draw for `shape + 1` comes first, then a word, and
//! `ln x` is the sum of that draw's logarithm and `ln u / shape`. Everything is in `ln x`, because for small shapes
//! most draws are below the smallest `f64`: at shape 0.01 half of them are below 1e-30.

use crate::double::{NAN, ln, polynomial};

/// A stream of 64-bit words.
pub trait Words {
    /// The next word.
    fn word(&mut self) -> u64;
}

impl<F: FnMut() -> u64> Words for F {
    fn word(&mut self) -> u64 {
        self()
    }
}

/// Numerator and denominator of the quantile by `0.180625 - (p - 1/2)^2` for `|p - 1/2| <= 0.425`, lowest power first.
const CENTRE: [[f64; 8]; 2] = [
    [
        3.387132872796366608,
        133.14166789178437745,
        1971.5909503065514427,
        13731.693765509461125,
        45921.953931549871457,
        67265.770927008700853,
        33430.575583588128105,
        2509.0809287301226727,
    ],
    [
        1.0,
        42.313330701600911252,
        687.1870074920579083,
        5394.1960214247511077,
        21213.794301586595867,
        39307.89580009271061,
        28729.085735721942674,
        5226.495278852854561,
    ],
];

/// The same by `s - 1.6` with `s = sqrt(-ln p)` up to 5, `p` being the smaller of the two tails' probabilities.
const FLANK: [[f64; 8]; 2] = [
    [
        1.42343711074968357734,
        4.6303378461565452959,
        5.7694972214606914055,
        3.64784832476320460504,
        1.27045825245236838258,
        0.24178072517745061177,
        0.0227238449892691845833,
        0.000774545014278341407640,
    ],
    [
        1.0,
        2.05319162663775882187,
        1.6763848301838038494,
        0.68976733498510000455,
        0.14810397642748007459,
        0.0151986665636164571966,
        0.000547593808499534494600,
        0.00000000105075007164441684324,
    ],
];

/// The same by `s - 5` above.
const TAIL: [[f64; 8]; 2] = [
    [
        6.6579046435011037772,
        5.4637849111641143699,
        1.7848265399172913358,
        0.29656057182850489123,
        0.026532189526576123093,
        0.0012426609473880784386,
        0.0000271155556874348757815,
        0.000000201033439929228813265,
    ],
    [
        1.0,
        0.59983220655588793769,
        0.13692988092273580531,
        0.0148753612908506148525,
        0.00078686913114561325910,
        0.0000184631831751005468180,
        0.000000142151175831644588870,
        0.00000000000000204426310338993978564,
    ],
];

/// A number strictly between 0 and 1 from one word.
#[must_use]
pub fn uniform(word: u64) -> f64 {
    const SPACING: f64 = 1.0 / (1_u64 << 52) as f64;
    ((word >> 12) as f64 + 0.5) * SPACING
}

/// A standard normal number from one word, which rises with the word.
#[must_use]
pub fn normal(word: u64) -> f64 {
    let probability = uniform(word);
    let q = probability - 0.5;
    if q.abs() <= 0.425 {
        return q * quotient(&CENTRE, 0.180_625 - q * q);
    }
    let tail = if q < 0.0 { probability } else { 1.0 - probability };
    let s = (-ln(tail)).sqrt();
    let size = if s <= 5.0 {
        quotient(&FLANK, s - 1.6)
    } else {
        quotient(&TAIL, s - 5.0)
    };
    if q < 0.0 { -size } else { size }
}

fn quotient([numerator, denominator]: &[[f64; 8]; 2], x: f64) -> f64 {
    polynomial(numerator, x) / polynomial(denominator, x)
}

/// `ln x` of `x ~ Gamma(shape, 1)`, for a finite `shape > 0`; [`NAN`] without a word taken for any other.
pub fn log_gamma(shape: f64, words: &mut impl Words) -> f64 {
    if !(shape > 0.0 && shape < f64::INFINITY) {
        return NAN;
    }
    if shape < 1.0 {
        let above = log_gamma_from_one(shape + 1.0, words);
        above + ln(uniform(words.word())) / shape
    } else {
        log_gamma_from_one(shape, words)
    }
}

/// [`log_gamma`] for `shape >= 1`.
fn log_gamma_from_one(shape: f64, words: &mut impl Words) -> f64 {
    let d = shape - 1.0 / 3.0;
    let c = 1.0 / (9.0 * d).sqrt();
    loop {
        let z = normal(words.word());
        let t = 1.0 + c * z;
        if t <= 0.0 {
            continue;
        }
        let log_cube = 3.0 * ln(t);
        let bound = 0.5 * z * z + d * (1.0 - t * t * t + log_cube);
        if ln(uniform(words.word())) < bound {
            return ln(d) + log_cube;
        }
    }
}
