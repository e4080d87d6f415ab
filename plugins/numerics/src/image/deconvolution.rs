//! Deconvolution with a kernel of 2x2 and stride 2: every pixel becomes a square of four.
//!
//! | symbol | here | shape |
//! |---|---|---|
//! | x | image | `[batch, height, width, inputs]` |
//! | W | weight | `[inputs, 2, 2, outputs]` |
//! | b | bias | `[outputs]` |
//! | y | output | `[batch, 2 height, 2 width, outputs]` |
//!
//! The squares do not overlap. One product multiplies each pixel with `W` as `[inputs, 4 outputs]`, and its
//! four parts are then moved to their pixels. A PyTorch weight `[inputs, outputs, 2, 2]` is one here after
//! `permute(0, 2, 3, 1)`.

use super::column_sums;
use super::direct_convolution::{Sizes, convolve, image_gradient, weight_gradient};
use super::operation::{Operation, PlainTensor, host, of_three, shape};
use burn::Tensor;
use std::sync::Arc;

/// Deconvolution of `image` `[batch, height, width, inputs]` with `weight` `[inputs, 2, 2, outputs]`, plus
/// `bias` `[outputs]`.
///
/// # Panics
/// Where the shapes do not fit, one of them is 0, or a tensor is not `f32`.
#[must_use]
pub fn deconvolve_2x2(image: Tensor<4>, weight: Tensor<4>, bias: Tensor<1>) -> Tensor<4> {
    let ([.., n_inputs], [n_outputs]) = (image.dims(), bias.dims());
    assert_eq!(
        weight.dims(),
        [n_inputs, 2, 2, n_outputs],
        "weights from {n_inputs} to {n_outputs} channels"
    );
    of_three(image, weight, bias, Arc::new(Deconvolution))
}

#[derive(Debug)]
struct Deconvolution;

/// Sizes of the product with all four parts of the kernel.
fn product([n_images, height, width, n_inputs]: [usize; 4], n_outputs: usize) -> Sizes {
    Sizes {
        n_images,
        height,
        width,
        n_inputs,
        n_outputs: 4 * n_outputs,
        side: 1,
    }
}

/// Calls `place` with each run of two neighbouring output pixels: its start in the product and its start in
/// the output. A run has `2 * n_outputs` numbers.
fn for_each_run(sizes: &Sizes, mut place: impl FnMut(usize, usize)) {
    let run = sizes.n_outputs / 2;
    for row in 0..sizes.n_images * sizes.height {
        for x in 0..sizes.width {
            for ky in 0..2 {
                let within = (row * sizes.width + x) * 2 + ky;
                place(within * run, ((row * 2 + ky) * sizes.width + x) * run);
            }
        }
    }
}

impl Operation for Deconvolution {
    fn forward(&self, inputs: Vec<PlainTensor>) -> (PlainTensor, Vec<PlainTensor>) {
        let [image, weight, bias] = &inputs[..] else {
            unreachable!("a deconvolution has an image, a weight and a bias")
        };
        let bias = bias.storage::<f32>();
        let sizes = product(shape(image), bias.len());
        let parts = convolve(image.storage(), weight.storage(), Some(&bias.repeat(4)), sizes);
        let (mut output, run) = (vec![0.0; parts.len()], 2 * bias.len());
        for_each_run(&sizes, |from, to| {
            output[to..to + run].copy_from_slice(&parts[from..from + run]);
        });
        let output = host(
            output,
            [sizes.n_images, 2 * sizes.height, 2 * sizes.width, bias.len()],
        );
        (output, inputs[..2].to_vec())
    }

    fn backward(
        &self,
        kept: &[PlainTensor],
        upstream: &PlainTensor,
        wanted: &[bool],
    ) -> Vec<Option<PlainTensor>> {
        let (image, weight, n_outputs) = (&kept[0], &kept[1], shape(upstream)[3]);
        let (sizes, dy) = (product(shape(image), n_outputs), upstream.storage::<f32>());
        let (mut parts, run) = (vec![0.0; dy.len()], 2 * n_outputs);
        for_each_run(&sizes, |to, from| {
            parts[to..to + run].copy_from_slice(&dy[from..from + run]);
        });
        vec![
            wanted[0].then(|| host(image_gradient(weight.storage(), &parts, sizes), shape(image))),
            wanted[1].then(|| {
                host(
                    weight_gradient(image.storage(), &parts, sizes),
                    [sizes.n_inputs, 2, 2, n_outputs],
                )
            }),
            wanted[2].then(|| host(column_sums(dy, n_outputs), [n_outputs])),
        ]
    }
}
