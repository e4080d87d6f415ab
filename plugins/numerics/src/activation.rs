//! Activations of a layer, entry by entry, with their slopes.
//!
//! The slope is taken from the output `y` alone: `y > 0 ? 1 : s` for rectifiers and `1 - y^2` for the
//! tangent. Every loop is free of branches and of calls into a C library, so it is vectorised and gives the
//! same bits on every machine.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Slope of the leaky rectifier below zero (Maas et al. 2013).
pub const LEAKY_SLOPE: f64 = 0.01;

/// Activation after a hidden layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Activation {
    /// `max(x, 0)`.
    #[default]
    Relu,
    /// `x` above zero, `0.01 x` below.
    LeakyRelu,
    /// Hyperbolic tangent.
    Tanh,
}

impl Activation {
    /// Gain of the weights at which a layer's output has the variance of its input.
    #[must_use]
    pub fn gain(self) -> f64 {
        match self {
            Activation::Relu => std::f64::consts::SQRT_2,
            Activation::LeakyRelu => (2.0 / (1.0 + LEAKY_SLOPE * LEAKY_SLOPE)).sqrt(),
            Activation::Tanh => 5.0 / 3.0,
        }
    }

    /// Replaces each entry by the activation of it.
    pub(crate) fn apply(self, entries: &mut [f32]) {
        match self {
            Activation::Relu => entries.iter_mut().for_each(|z| *z = rectified(*z, 0.0)),
            Activation::LeakyRelu => entries.iter_mut().for_each(|z| *z = rectified(*z, LEAKY)),
            Activation::Tanh => arithmetic::slices::tanh(entries),
        }
    }

    /// Replaces one row `z` by `f(z + bias)`.
    pub(crate) fn forward(self, row: &mut [f32], bias: &[f32]) {
        let pairs = row.iter_mut().zip(bias);
        match self {
            Activation::Relu => pairs.for_each(|(z, b)| *z = rectified(*z + b, 0.0)),
            Activation::LeakyRelu => pairs.for_each(|(z, b)| *z = rectified(*z + b, LEAKY)),
            Activation::Tanh => pairs.for_each(|(z, b)| *z = tanh(*z + b)),
        }
    }

    /// Multiplies the gradient in the output `y` by the slope.
    pub(crate) fn backward(self, y: &[f32], gradient: &mut [f32]) {
        let pairs = gradient.iter_mut().zip(y);
        match self {
            Activation::Relu => pairs.for_each(|(g, y)| *g *= slope(*y, 0.0)),
            Activation::LeakyRelu => pairs.for_each(|(g, y)| *g *= slope(*y, LEAKY)),
            Activation::Tanh => pairs.for_each(|(g, y)| *g *= 1.0 - y * y),
        }
    }
}

/// [`LEAKY_SLOPE`] in the precision of networks.
#[allow(clippy::cast_possible_truncation, reason = "networks compute in f32")]
pub(crate) const LEAKY: f32 = LEAKY_SLOPE as f32;

/// Rectifier with slope `below` for negative numbers; the comparison keeps a NaN.
fn rectified(x: f32, below: f32) -> f32 {
    if x <= 0.0 { below * x } else { x }
}

fn slope(y: f32, below: f32) -> f32 {
    if y > 0.0 { 1.0 } else { below }
}

/// Hyperbolic tangent with an error below 2 units in the last place (1.6 found over all `f32`).
///
/// `1 - 2 / (e^(2 |x|) + 1)`, and below 0.625, where that cancels, `|x| + |x|^3 P(x^2)` with the polynomial
/// of Cephes 2.2 (Moshier 1992, `tanhf`). The exponential is `2^n 2^f` with `n` the nearest integer of `t = 2
/// |x| / ln 2`.
pub(crate) fn tanh(x: f32) -> f32 {
    /// From here on the tangent is 1 in `f32`.
    const LARGEST: f32 = 9.1;
    /// Constant `1.5 2^23`: adding it rounds a number to an integer, held in the lowest bits of the sum.
    const ROUNDING: f32 = 12_582_912.0;
    let magnitude = x.abs();
    // The comparison is false for a NaN, which thus stays one.
    let magnitude = if magnitude > LARGEST { LARGEST } else { magnitude };
    let t = magnitude * (2.0 * std::f32::consts::LOG2_E);
    let rounded = t + ROUNDING;
    let two_to_n = f32::from_bits((rounded.to_bits() << 23).wrapping_add(1.0f32.to_bits()));
    let exponential = two_to_n * polynomial(POWER_OF_TWO, t - (rounded - ROUNDING));
    let square = magnitude * magnitude;
    let small = magnitude + magnitude * (square * polynomial(SMALL_TANH, square));
    let large = 1.0 - 2.0 / (exponential + 1.0);
    (if magnitude < 0.625 { small } else { large }).copysign(x)
}

/// `(tanh x - x) / x^3` in powers of `x^2`, highest first.
const SMALL_TANH: [f32; 5] = [
    -5.704_988_7e-3,
    2.063_908_8e-2,
    -5.373_971_6e-2,
    1.333_144_2e-1,
    -3.333_328e-1,
];

/// `2^f` for `|f| <= 1/2`, highest power first: its interpolation at Chebyshev nodes, relative error 3e-9.
const POWER_OF_TWO: [f32; 7] = [
    1.546_973_2e-4,
    1.340_043_2e-3,
    9.618_025e-3,
    5.550_327e-2,
    2.402_265e-1,
    6.931_472e-1,
    1.0,
];

fn polynomial<const N: usize>(coefficients: [f32; N], x: f32) -> f32 {
    coefficients.into_iter().fold(0.0, |sum, c| sum * x + c)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Error in units in the last place of the exact value.
    fn error_in_ulps(x: f32) -> f64 {
        let exact = f64::from(x).tanh();
        #[allow(
            clippy::cast_possible_truncation,
            reason = "the spacing of f32 around the value"
        )]
        let below = f32::from_bits((exact as f32).abs().to_bits() - 1);
        let unit = f64::from(f32::from_bits(below.to_bits() + 1) - below);
        (f64::from(tanh(x)) - exact).abs() / unit
    }

    #[test]
    fn the_tangent_is_within_two_units_in_the_last_place() {
        let range = 1e-20f32.to_bits()..12.0f32.to_bits();
        let worst = range
            .step_by(257)
            .map(|bits| error_in_ulps(f32::from_bits(bits)))
            .fold(0.0, f64::max);
        assert!((0.5..2.0).contains(&worst), "{worst}");
    }

    #[test]
    fn the_tangent_is_odd_and_keeps_a_nan() {
        for x in [1e-30, 0.3, 0.624_999, 0.625, 2.0, 9.1, 1e30, f32::INFINITY] {
            assert_eq!(tanh(-x), -tanh(x));
        }
        assert_eq!((tanh(f32::INFINITY), tanh(9.2), tanh(0.0)), (1.0, 1.0, 0.0));
        assert!(tanh(f32::NAN).is_nan());
    }

    #[test]
    fn values_and_slopes_by_hand() {
        for (activation, y, slopes) in [
            (Activation::Relu, [0.0, 0.0, 3.0], [0.0, 0.0, 2.0]),
            (Activation::LeakyRelu, [-0.02, 0.0, 3.0], [0.02, 0.02, 2.0]),
        ] {
            let (mut row, mut gradient) = ([-2.5, -0.5, 2.5], [2.0; 3]);
            activation.forward(&mut row, &[0.5; 3]);
            activation.backward(&row, &mut gradient);
            assert_eq!((row, gradient), (y, slopes));
        }
    }

    #[test]
    fn a_nan_stays_one() {
        for activation in [Activation::Relu, Activation::LeakyRelu, Activation::Tanh] {
            let mut row = [f32::NAN];
            activation.forward(&mut row, &[0.0]);
            assert!(row[0].is_nan(), "{activation:?}");
        }
    }
}
