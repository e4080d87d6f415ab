//! Convolutions that keep height and width, and deconvolutions, with bias.
//!
//! | symbol | here | shape |
//! |---|---|---|
//! | x | image | `[batch height width, inputs]` |
//! | W | weight | `[k k inputs, outputs]`, k the side of the kernel |
//! | b | bias | `[1, outputs]` |
//! | y | output | `[batch height width, outputs]` |
//!
//! Backward, from the gradient `dy`: `dx` is the convolution of `dy` with the kernel turned by half a circle
//! and its channels exchanged, `dW` the sum over pixels of shifted `x` times `dy`, `db` the sum of `dy`. Only
//! needed gradients are computed. A PyTorch weight `[outputs, inputs, k, k]` is one here after
//! `permute(2, 3, 1, 0)`.
//!
//! A deconvolution with a kernel of 2x2 and stride 2 makes a square of four pixels of each. The squares do not overlap:
//! one product multiplies each pixel with `W` `[inputs, 2 2 outputs]`, and its four parts are moved to their pixels.
//! A PyTorch weight `[inputs, outputs, 2, 2]` is one here after `permute(0, 2, 3, 1)`.

use super::Image;
use super::direct_convolution::{Sizes, convolve, pack, pack_turned, weight_gradient};
use plan::{Backward, Expression, Extension, Graph, Shape, Value};
use std::sync::Arc;

impl<'e> Image<'e> {
    /// Convolution with `weight` `[side side inputs, outputs]`, zeros around the image, plus `bias` `[1, outputs]`.
    ///
    /// # Panics
    /// Where the shapes do not fit, or the side is even.
    #[must_use]
    pub fn convolve(self, side: usize, weight: Expression<'e>, bias: Expression<'e>) -> Self {
        assert!(side % 2 == 1, "a kernel of {side} x {side} has no centre");
        let sizes = Sizes {
            n_images: self.n_images(),
            height: self.height,
            width: self.width,
            n_inputs: self.n_channels(),
            n_outputs: bias.n_columns(),
            kernel: [side; 2],
            stride: 1,
            padding: [side / 2; 2],
        };
        let operands = [self.pixels, weight, bias];
        self.with(
            weight
                .equations()
                .apply(Convolution::new(Part::Output, sizes), &operands),
        )
    }

    /// Deconvolution with `weight` `[inputs, 2 2 outputs]`, plus `bias` `[1, outputs]`.
    ///
    /// # Panics
    /// Where the shapes do not fit.
    #[must_use]
    pub fn deconvolve_2x2(self, weight: Expression<'e>, bias: Expression<'e>) -> Self {
        let equations = weight.equations();
        let parts = self.convolve(1, weight, equations.join(&[bias; 4]));
        let squares = Squares {
            width: self.width,
            run: 2 * bias.n_columns(),
            is_transposed: false,
        };
        let pixels = equations.apply(squares, &[parts.pixels]);
        Image::new(pixels, [2 * self.height, 2 * self.width])
    }
}

/// The result of a convolution, or one of its gradients.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Part {
    /// `y` of x, W and b.
    Output,
    /// `dx` of W and dy.
    OfImage,
    /// `dW` of x and dy.
    OfWeight,
}

/// One pass over the images.
#[derive(Debug, Clone)]
struct Convolution {
    part: Part,
    sizes: Sizes,
    /// Places of pixels in the frames of a group.
    starts: Arc<[usize]>,
}

impl Convolution {
    fn new(part: Part, sizes: Sizes) -> Self {
        Self {
            part,
            sizes,
            starts: sizes.starts().into(),
        }
    }
}

impl Extension for Convolution {
    fn name(&self) -> String {
        let [height, width] = self.sizes.kernel;
        let of = match self.part {
            Part::Output => "",
            Part::OfImage => " gradient in the image",
            Part::OfWeight => " gradient in the weight",
        };
        format!("Convolution {height}x{width}{of}")
    }

    fn shape(&self, operands: &[Shape]) -> Option<Shape> {
        let sizes = self.sizes;
        let output = [sizes.n_result_pixels(), sizes.n_outputs];
        let (image, weight) = (
            [sizes.n_pixels(), sizes.n_inputs],
            [sizes.n_taps(), sizes.n_outputs],
        );
        match (self.part, operands) {
            (Part::Output, [x, w, b]) => {
                let fits = *x == image && *w == weight && *b == [1, sizes.n_outputs];
                fits.then_some(output)
            }
            // The gradient is a convolution of reversed sizes.
            (Part::OfImage, [w, dy]) => {
                let reversed = sizes.reversed();
                let fits = *w == [reversed.n_taps(), reversed.n_outputs] && *dy == image;
                fits.then_some(output)
            }
            (Part::OfWeight, [x, dy]) => (*x == image && *dy == output).then_some(weight),
            _ => None,
        }
    }

    fn flops(&self, _: &[Shape], _: Shape) -> u64 {
        let sizes = self.sizes;
        2 * (sizes.n_taps() * sizes.n_outputs * sizes.n_result_pixels()) as u64
    }

    fn compute(&self, operands: &[&[f32]], result: &mut [f32], memory: &mut Vec<f32>) {
        let (sizes, starts) = (&self.sizes, &self.starts);
        if self.part == Part::OfWeight {
            return weight_gradient(operands[0], operands[1], sizes, starts, result, memory);
        }
        memory.clear();
        memory.resize(sizes.panels() + sizes.frames(), 0.0);
        let (panels, frames) = memory.split_at_mut(sizes.panels());
        let image = if self.part == Part::Output {
            pack(operands[1], operands[2], sizes, panels);
            operands[0]
        } else {
            pack_turned(operands[0], sizes, panels);
            operands[1]
        };
        convolve(image, panels, sizes, starts, result, frames);
    }

    fn gradients(&self, graph: &mut Graph, backward: &Backward<'_>) -> Vec<Option<Value>> {
        let Backward {
            operands,
            upstream,
            is_needed,
            ..
        } = *backward;
        if self.part != Part::Output || !self.sizes.keeps_size() {
            return vec![None; operands.len()];
        }
        let of_image = Self::new(Part::OfImage, self.sizes.reversed());
        let of_weight = Self {
            part: Part::OfWeight,
            ..self.clone()
        };
        vec![
            is_needed[0].then(|| graph.apply(of_image, &[operands[1], upstream])),
            is_needed[1].then(|| graph.apply(of_weight, &[operands[0], upstream])),
            is_needed[2].then(|| graph.sum_rows(upstream)),
        ]
    }
}

/// Four parts `[pixels, 2 2 channels]` of each pixel as a square of 2x2 pixels, or back.
#[derive(Debug, Clone, Copy)]
struct Squares {
    /// Width of the images of which the parts are.
    width: usize,
    /// Length of two neighbouring pixels of a square.
    run: usize,
    is_transposed: bool,
}

impl Extension for Squares {
    fn name(&self) -> String {
        let back = if self.is_transposed { " back" } else { "" };
        format!("Squares{back}")
    }

    fn shape(&self, operands: &[Shape]) -> Option<Shape> {
        let [[rows, columns]] = operands else { return None };
        let fits = rows.is_multiple_of(self.width);
        if self.is_transposed {
            (fits && *columns == self.run / 2).then_some([rows / 4, 2 * self.run])
        } else {
            (fits && *columns == 2 * self.run).then_some([4 * rows, self.run / 2])
        }
    }

    fn flops(&self, _: &[Shape], _: Shape) -> u64 {
        0
    }

    fn compute(&self, operands: &[&[f32]], result: &mut [f32], _: &mut Vec<f32>) {
        let (x, run) = (operands[0], self.run);
        // Both parts of a line of pixels hold the upper pixels of its squares, then the lower ones.
        for line in 0..x.len() / (2 * self.width * run) {
            for (at, ky) in (0..self.width).flat_map(|at| [(at, 0), (at, 1)]) {
                let part = ((line * self.width + at) * 2 + ky) * run;
                let square = ((line * 2 + ky) * self.width + at) * run;
                let [from, to] = if self.is_transposed {
                    [square, part]
                } else {
                    [part, square]
                };
                result[to..to + run].copy_from_slice(&x[from..from + run]);
            }
        }
    }

    fn gradients(&self, graph: &mut Graph, backward: &Backward<'_>) -> Vec<Option<Value>> {
        let back = Self {
            is_transposed: !self.is_transposed,
            ..*self
        };
        vec![Some(graph.apply(back, &[backward.upstream]))]
    }
}
