//! Rectifier and hyperbolic tangent of every number of an image.
//!
//! The slopes are computed from the output: `1` where it is positive, and `1 - y^2`. The tangent is that of
//! [`crate::activation`], which is the same on every machine.

use super::operation::{Operation, PlainTensor, host, of_one, shape};
use super::widest;
use crate::activation;
use burn::Tensor;
use std::sync::Arc;

/// Rectifier `max(x, 0)` of an image `[batch, height, width, channels]`.
#[must_use]
pub fn relu(image: Tensor<4>) -> Tensor<4> {
    of_one(image, Arc::new(Pointwise::Relu))
}

/// Hyperbolic tangent of an image `[batch, height, width, channels]`.
#[must_use]
pub fn tanh(image: Tensor<4>) -> Tensor<4> {
    of_one(image, Arc::new(Pointwise::Tanh))
}

#[derive(Debug, Clone, Copy)]
enum Pointwise {
    Relu,
    Tanh,
}

/// Rectifier `max(x, 0)`; a NaN stays one.
#[inline(always)]
pub(super) fn rectified(x: f32) -> f32 {
    if x <= 0.0 { 0.0 } else { x }
}

/// Input gradient `dx` of the rectifier from `y` and `dy`.
#[inline(always)]
pub(super) fn rectified_gradient(output: &[f32], upstream: &[f32]) -> Vec<f32> {
    let pairs = output.iter().zip(upstream);
    pairs.map(|(y, dy)| if *y > 0.0 { *dy } else { 0.0 }).collect()
}

impl Operation for Pointwise {
    fn forward(&self, inputs: Vec<PlainTensor>) -> (PlainTensor, Vec<PlainTensor>) {
        let x = inputs[0].storage::<f32>();
        let y: Vec<f32> = match self {
            Pointwise::Relu => widest(
                #[inline(always)]
                || x.iter().map(|x| rectified(*x)).collect(),
            ),
            Pointwise::Tanh => x.iter().map(|x| activation::tanh(*x)).collect(),
        };
        let output = host(y, shape(&inputs[0]));
        (output.clone(), vec![output])
    }

    fn backward(&self, kept: &[PlainTensor], upstream: &PlainTensor, _: &[bool]) -> Vec<Option<PlainTensor>> {
        let (y, dy) = (kept[0].storage::<f32>(), upstream.storage::<f32>());
        let dx = match self {
            Pointwise::Relu => widest(
                #[inline(always)]
                || rectified_gradient(y, dy),
            ),
            Pointwise::Tanh => y.iter().zip(dy).map(|(y, dy)| dy * (1.0 - y * y)).collect(),
        };
        vec![Some(host(dx, shape(upstream)))]
    }
}
