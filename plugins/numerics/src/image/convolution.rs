//! Convolution that keeps height and width, with bias, as one autodiff operation.
//!
//! | symbol | here | shape |
//! |---|---|---|
//! | x | image | `[batch, height, width, inputs]` |
//! | W | weight | `[3, 3, inputs, outputs]`, or `[inputs, outputs]` for a kernel of 1x1 |
//! | b | bias | `[outputs]` |
//! | y | output | `[batch, height, width, outputs]` |
//!
//! Backward, from the gradient `dy`: `dx` is the convolution of `dy` with the kernel turned by half a circle
//! and its channels exchanged, `dW` the sum over pixels of shifted `x` times `dy`, `db` the sum of `dy`. Only
//! the gradients of tracked parents are computed. A PyTorch weight `[outputs, inputs, 3, 3]` is one here
//! after `permute(2, 3, 1, 0)`.

use super::column_sums;
use super::direct_convolution::{Sizes, convolve, image_gradient, weight_gradient};
use super::operation::{Operation, PlainTensor, host, of_three, shape};
use burn::Tensor;
use std::sync::Arc;

/// Convolution of `image` `[batch, height, width, inputs]` with `weight` `[3, 3, inputs, outputs]`, zeros
/// around the image, plus `bias` `[outputs]`.
///
/// # Panics
/// Where the shapes do not fit, one of them is 0, or a tensor is not `f32`.
#[must_use]
pub fn convolve_3x3(image: Tensor<4>, weight: Tensor<4>, bias: Tensor<1>) -> Tensor<4> {
    let ([.., n_inputs], [n_outputs]) = (image.dims(), bias.dims());
    assert_eq!(
        weight.dims(),
        [3, 3, n_inputs, n_outputs],
        "weights from {n_inputs} to {n_outputs} channels"
    );
    of_three(image, weight, bias, Arc::new(Convolution { side: 3 }))
}

/// Product of every pixel of `image` `[batch, height, width, inputs]` with `weight` `[inputs, outputs]`, plus
/// `bias` `[outputs]`.
///
/// # Panics
/// Where the shapes do not fit, one of them is 0, or a tensor is not `f32`.
#[must_use]
pub fn convolve_1x1(image: Tensor<4>, weight: Tensor<2>, bias: Tensor<1>) -> Tensor<4> {
    let ([.., n_inputs], [n_outputs]) = (image.dims(), bias.dims());
    assert_eq!(
        weight.dims(),
        [n_inputs, n_outputs],
        "weights from {n_inputs} to {n_outputs} channels"
    );
    of_three(image, weight, bias, Arc::new(Convolution { side: 1 }))
}

/// A convolution with a square kernel.
#[derive(Debug)]
struct Convolution {
    side: usize,
}

impl Convolution {
    fn sizes(&self, [n_images, height, width, n_inputs]: [usize; 4], n_outputs: usize) -> Sizes {
        Sizes {
            n_images,
            height,
            width,
            n_inputs,
            n_outputs,
            side: self.side,
        }
    }
}

impl Operation for Convolution {
    fn forward(&self, inputs: Vec<PlainTensor>) -> (PlainTensor, Vec<PlainTensor>) {
        let [image, weight, bias] = &inputs[..] else {
            unreachable!("a convolution has an image, a weight and a bias")
        };
        let bias = bias.storage::<f32>();
        let sizes = self.sizes(shape(image), bias.len());
        let output = convolve(image.storage(), weight.storage(), Some(bias), sizes);
        let output = host(output, [sizes.n_images, sizes.height, sizes.width, bias.len()]);
        (output, inputs[..2].to_vec())
    }

    fn backward(
        &self,
        kept: &[PlainTensor],
        upstream: &PlainTensor,
        wanted: &[bool],
    ) -> Vec<Option<PlainTensor>> {
        let (image, weight, dy) = (&kept[0], &kept[1], upstream.storage::<f32>());
        let sizes = self.sizes(shape(image), shape(upstream)[3]);
        vec![
            wanted[0].then(|| host(image_gradient(weight.storage(), dy, sizes), shape(image))),
            wanted[1].then(|| {
                let gradient = weight_gradient(image.storage(), dy, sizes);
                PlainTensor::from_data(burn::tensor::TensorData::new(
                    gradient,
                    weight.layout().shape().clone(),
                ))
            }),
            wanted[2].then(|| host(column_sums(dy, sizes.n_outputs), [sizes.n_outputs])),
        ]
    }
}
