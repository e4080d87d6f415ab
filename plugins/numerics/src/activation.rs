//! Activations of a layer, entry by entry.

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
    /// Gain of the weights with which a layer's output has the variance of its input.
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
}

/// [`LEAKY_SLOPE`] in the precision of networks.
#[allow(clippy::cast_possible_truncation, reason = "networks compute in f32")]
pub(crate) const LEAKY: f32 = LEAKY_SLOPE as f32;

/// Rectifier with slope `below` for negative numbers; the comparison keeps a NaN.
fn rectified(x: f32, below: f32) -> f32 {
    if x <= 0.0 { below * x } else { x }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_by_hand() {
        for (activation, y) in [
            (Activation::Relu, [0.0, 0.0, 3.0]),
            (Activation::LeakyRelu, [-0.02, 0.0, 3.0]),
            (Activation::Tanh, [-0.964_027_6, 0.0, 0.995_054_8]),
        ] {
            let mut row = [-2.0, 0.0, 3.0];
            activation.apply(&mut row);
            assert!(row.iter().zip(y).all(|(x, y)| (x - y).abs() < 1e-6), "{row:?}");
        }
    }

    #[test]
    fn a_nan_stays_one() {
        for activation in [Activation::Relu, Activation::LeakyRelu, Activation::Tanh] {
            let mut row = [f32::NAN];
            activation.apply(&mut row);
            assert!(row[0].is_nan(), "{activation:?}");
        }
    }
}
