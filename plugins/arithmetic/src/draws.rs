//! Uniform, normal and gamma numbers from a stream of 64-bit words.
//!
//! | draw | words | number |
//! |---|---|---|
//! | [`uniform`] | one, `w` | `(floor(w / 2^12) + 1/2) / 2^52`: strictly between 0 and 1, exact |
//! | [`normal`] | one, `w` | the quantile of the normal distribution at `uniform(w)` |
//! | [`log_gamma`] | two for each try, one more for a shape below one | ln x of `x ~ Gamma(shape, 1)` |
//!
//! The quantile is that of [`crate::normal`]. Its size is at most 8.2, since `uniform` has no number nearer to 0 than
//! 2^-53.
//!
//! The gamma draw is the algorithm of G. Marsaglia and W. W. Tsang (ACM TOMS 26, 2000) without their quick first test.
//! With `d = shape - 1/3` and `c = 1 / sqrt(9 d)` each try takes a normal number `z` from a word. If `t = 1 + c z` is
//! not positive, the next try begins. Otherwise it takes `u` from a further word, and `x = d t^3` is the draw if `ln u
//! < z^2 / 2 + d (1 - t^3 + 3 ln t)`. For a shape below one the draw for `shape + 1` comes first, then a word, and `ln
//! x` is the sum of that draw's logarithm and `ln u / shape`. Everything is in `ln x`, because for small shapes most
//! draws are below the smallest `f64`: at shape 0.01 half of them are below 1e-30.

use crate::double::{NAN, ln};
use crate::normal::quantile;

/// A stream of random 64-bit words.
pub trait WordStream {
    /// Next word of the stream.
    fn word(&mut self) -> u64;
}

impl<F: FnMut() -> u64> WordStream for F {
    fn word(&mut self) -> u64 {
        self()
    }
}

/// The odd number nearest to 2^64 divided by the golden ratio.
pub const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

/// The last three lines of SplitMix64 (Steele, Lea and Flood 2014): a permutation of the 64-bit words.
#[inline(always)]
#[must_use]
pub fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// SplitMix64: `mix(state)` of a state that rises by [`GOLDEN`] before each word.
#[derive(Debug, Clone)]
pub struct Stream {
    state: u64,
}

impl Stream {
    /// Creates the stream of one counter.
    #[must_use]
    pub fn new(counter: u64) -> Self {
        Self { state: mix(counter) }
    }
}

impl WordStream for Stream {
    fn word(&mut self) -> u64 {
        self.state = self.state.wrapping_add(GOLDEN);
        mix(self.state)
    }
}

/// Uniform number strictly between 0 and 1 from one word.
#[must_use]
pub fn uniform(word: u64) -> f64 {
    const SPACING: f64 = 1.0 / (1_u64 << 52) as f64;
    ((word >> 12) as f64 + 0.5) * SPACING
}

/// Standard normal number from one word; it increases with the word.
#[must_use]
pub fn normal(word: u64) -> f64 {
    quantile(uniform(word))
}

/// `ln x` of `x ~ Gamma(shape, 1)`, for a finite `shape > 0`. Any other shape gives [`NAN`] and takes no
/// word.
pub fn log_gamma(shape: f64, words: &mut impl WordStream) -> f64 {
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
fn log_gamma_from_one(shape: f64, words: &mut impl WordStream) -> f64 {
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
