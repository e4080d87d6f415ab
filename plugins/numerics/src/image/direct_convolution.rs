//! The loops of a convolution that keeps height and width, with a kernel of 1x1 or 3x3.
//!
//! | symbol | here | shape |
//! |---|---|---|
//! | x | `image` | `[images, height, width, inputs]` |
//! | W | `weight` | `[k, k, inputs, outputs]`, k the side of the kernel |
//! | b | `bias` | `[outputs]` |
//! | y | result of [`convolve`] | `[images, height, width, outputs]` |
//!
//! `y = b + sum over rows ky, columns kx and inputs i of x W`, outside of the image `x = 0`. For channels that
//! come last the sum over `kx` and `i` is one over neighbouring numbers, a *run*: `k` runs of `k * inputs`
//! numbers for each pixel. Images are copied into frames of zeros first, so that no pixel is a special case.
//!
//! A tile of several pixels by 16 or 32 outputs is summed in registers. Weights are laid out in panels of so
//! many outputs, filled up with zeros; a tile that reaches beyond the last pixel repeats it. One output is
//! always the same chain of fused multiplications and additions, beginning with its bias, in the order of the
//! weights: no size of tile or register reaches the result. The gradient in a weight is one chain per group of
//! images in the order of their pixels, and groups have a size that depends on that of the images.

mod weight_gradient;

use pulp::{Simd, WithSimd};
use weight_gradient::WeightGradient;

/// Narrow width of a panel of outputs; whole registers of every processor divide it.
const PANEL: usize = 16;
/// Number of pixels that justify the start of a loop.
const PIXELS_OF_A_GROUP: usize = 128;

/// Sizes of a convolution.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sizes {
    pub n_images: usize,
    pub height: usize,
    pub width: usize,
    pub n_inputs: usize,
    pub n_outputs: usize,
    /// Side of the kernel: 1 or 3.
    pub side: usize,
}

impl Sizes {
    fn n_pixels(&self) -> usize {
        self.height * self.width
    }

    /// Length of one run.
    fn run(&self) -> usize {
        self.side * self.n_inputs
    }

    /// Length of one row of a frame.
    fn frame_row(&self) -> usize {
        (self.width + self.side - 1) * self.n_inputs
    }

    fn frame(&self) -> usize {
        (self.height + self.side - 1) * self.frame_row()
    }

    fn n_weights(&self) -> usize {
        self.side * self.run() * self.n_outputs
    }

    /// Sizes of the convolution of gradients back to the inputs.
    fn reversed(self) -> Self {
        Self {
            n_inputs: self.n_outputs,
            n_outputs: self.n_inputs,
            ..self
        }
    }

    fn images_of_a_group(&self) -> usize {
        (PIXELS_OF_A_GROUP / self.n_pixels().max(1)).max(1)
    }
}

/// Output `y` from `x`, `W` and an optional `b`.
pub(super) fn convolve(image: &[f32], weight: &[f32], bias: Option<&[f32]>, sizes: Sizes) -> Vec<f32> {
    pulp::Arch::new().dispatch(ConvolutionPass {
        image,
        panels: panels(weight, bias, &sizes),
        sizes,
    })
}

/// Gradient in `x` from `W` and the gradient in `y`.
pub(super) fn image_gradient(weight: &[f32], upstream: &[f32], sizes: Sizes) -> Vec<f32> {
    convolve(upstream, &turned(weight, &sizes), None, sizes.reversed())
}

/// Gradient in `W` from `x` and the gradient in `y`.
pub(super) fn weight_gradient(image: &[f32], upstream: &[f32], sizes: Sizes) -> Vec<f32> {
    pulp::Arch::new().dispatch(WeightGradient {
        image,
        upstream,
        sizes,
    })
}

/// Kernel turned by half a circle, `[k, k, outputs, inputs]`.
fn turned(weight: &[f32], sizes: &Sizes) -> Vec<f32> {
    let (n_inputs, n_outputs) = (sizes.n_inputs, sizes.n_outputs);
    let mut turned = vec![0.0; weight.len()];
    let of_taps = n_inputs * n_outputs;
    for (to, from) in turned
        .chunks_exact_mut(of_taps)
        .rev()
        .zip(weight.chunks_exact(of_taps))
    {
        for (input, row) in from.chunks_exact(n_outputs).enumerate() {
            row.iter()
                .enumerate()
                .for_each(|(output, w)| to[output * n_inputs + input] = *w);
        }
    }
    turned
}

/// Weights and biases of 16 or 32 neighbouring outputs.
struct Panel {
    first: usize,
    width: usize,
    /// Weights `[weights of one output, width]`.
    weights: Vec<f32>,
    bias: Vec<f32>,
}

fn panels(weight: &[f32], bias: Option<&[f32]>, sizes: &Sizes) -> Vec<Panel> {
    let n_outputs = sizes.n_outputs;
    widths(n_outputs)
        .map(|(first, width)| {
            let filled = width.min(n_outputs - first);
            let mut weights = vec![0.0; weight.len() / n_outputs * width];
            for (to, from) in weights
                .chunks_exact_mut(width)
                .zip(weight.chunks_exact(n_outputs))
            {
                to[..filled].copy_from_slice(&from[first..first + filled]);
            }
            let mut padded = vec![0.0; width];
            if let Some(bias) = bias {
                padded[..filled].copy_from_slice(&bias[first..first + filled]);
            }
            Panel {
                first,
                width,
                weights,
                bias: padded,
            }
        })
        .collect()
}

/// First output and width of each panel: twice the narrow width while more outputs than that remain.
fn widths(n_outputs: usize) -> impl Iterator<Item = (usize, usize)> {
    let wide = move |first: usize| {
        if n_outputs - first > PANEL {
            2 * PANEL
        } else {
            PANEL
        }
    };
    std::iter::successors(Some((0, wide(0))), move |(first, width)| {
        let next = first + width;
        (next < n_outputs).then(|| (next, wide(next)))
    })
}

/// Images of a group, in frames of zeros where the kernel is larger than a pixel.
fn framed<'a>(group: &'a [f32], sizes: &Sizes, frames: &'a mut Vec<f32>) -> &'a [f32] {
    if sizes.side == 1 {
        return group;
    }
    let (row, frame_row, border) = (sizes.width * sizes.n_inputs, sizes.frame_row(), sizes.n_inputs);
    // Borders stay zero from group to group.
    frames.resize(
        group.len() / row.max(1) / sizes.height.max(1) * sizes.frame(),
        0.0,
    );
    for (image, frame) in group
        .chunks_exact(sizes.height * row)
        .zip(frames.chunks_exact_mut(sizes.frame()))
    {
        for (from, to) in image
            .chunks_exact(row)
            .zip(frame[frame_row..].chunks_exact_mut(frame_row))
        {
            to[border..border + row].copy_from_slice(from);
        }
    }
    frames
}

/// Start of the first run of each pixel in `n_images` frames.
fn starts(n_images: usize, sizes: &Sizes) -> Vec<usize> {
    let place = |image, y, x| image * sizes.frame() + y * sizes.frame_row() + x * sizes.n_inputs;
    (0..n_images)
        .flat_map(|image| (0..sizes.height).map(move |y| (image, y)))
        .flat_map(|(image, y)| (0..sizes.width).map(move |x| place(image, y, x)))
        .collect()
}

#[inline(always)]
fn load<S: Simd>(_: S, numbers: &[f32]) -> S::f32s {
    bytemuck::pod_read_unaligned(bytemuck::cast_slice::<f32, u8>(&numbers[..S::F32_LANES]))
}

#[inline(always)]
fn store<S: Simd>(_: S, vector: S::f32s, numbers: &mut [f32]) {
    bytemuck::cast_slice_mut::<f32, u8>(&mut numbers[..S::F32_LANES])
        .copy_from_slice(bytemuck::bytes_of(&vector));
}

struct ConvolutionPass<'a> {
    image: &'a [f32],
    panels: Vec<Panel>,
    sizes: Sizes,
}

impl WithSimd for ConvolutionPass<'_> {
    type Output = Vec<f32>;

    /// Chooses the largest tiles that the registers hold.
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Vec<f32> {
        match S::F32_LANES {
            16 => self.run::<S, 8, 2>(simd),
            8 => self.run::<S, 6, 2>(simd),
            _ => self.run::<S, 4, 4>(simd),
        }
    }
}

impl ConvolutionPass<'_> {
    /// Computes tiles of `P` pixels by at most `R` registers.
    #[inline(always)]
    fn run<S: Simd, const P: usize, const R: usize>(self, simd: S) -> Vec<f32> {
        let sizes = self.sizes;
        let in_group = sizes.images_of_a_group();
        let mut output = vec![0.0; sizes.n_images * sizes.n_pixels() * sizes.n_outputs];
        let (mut frames, mut at) = (Vec::new(), Vec::new());
        let groups = self
            .image
            .chunks(in_group * sizes.n_pixels() * sizes.n_inputs)
            .zip(output.chunks_mut(in_group * sizes.n_pixels() * sizes.n_outputs));
        for (group, output) in groups {
            let n_pixels = output.len() / sizes.n_outputs;
            if at.len() != n_pixels {
                at = starts(n_pixels / sizes.n_pixels(), &sizes);
            }
            let frames = framed(group, &sizes, &mut frames);
            for panel in &self.panels {
                let half = S::F32_LANES * R > panel.width;
                for column in (0..panel.width).step_by(if half { panel.width } else { S::F32_LANES * R }) {
                    for (tile, output) in at.chunks(P).zip(output.chunks_mut(P * sizes.n_outputs)) {
                        let tile = Tile {
                            frames,
                            at: tile,
                            panel,
                            column,
                            sizes,
                        };
                        // A narrow panel is one register of the widest processors.
                        if half {
                            tile.sum::<S, P, 1>(simd, output);
                        } else {
                            tile.sum::<S, P, R>(simd, output);
                        }
                    }
                }
            }
        }
        output
    }
}

/// A block of pixels by outputs of a panel.
struct Tile<'a> {
    frames: &'a [f32],
    at: &'a [usize],
    panel: &'a Panel,
    column: usize,
    sizes: Sizes,
}

impl Tile<'_> {
    #[inline(always)]
    fn sum<S: Simd, const P: usize, const R: usize>(self, simd: S, output: &mut [f32]) {
        let (run, width) = (self.sizes.run(), self.panel.width);
        let start: [S::f32s; R] =
            std::array::from_fn(|r| load(simd, &self.panel.bias[self.column + r * S::F32_LANES..]));
        let mut sums = [start; P];
        for (ky, weights) in self.panel.weights.chunks_exact(run * width).enumerate() {
            let pixels: [&[f32]; P] = std::array::from_fn(|p| {
                let at = self.at[p.min(self.at.len() - 1)] + ky * self.sizes.frame_row();
                &self.frames[at..][..run]
            });
            for (k, row) in (0..run).zip(weights.chunks_exact(width)) {
                let row: [S::f32s; R] =
                    std::array::from_fn(|r| load(simd, &row[self.column + r * S::F32_LANES..]));
                for p in 0..P {
                    let x = simd.splat_f32s(pixels[p][k]);
                    for r in 0..R {
                        sums[p][r] = simd.mul_add_e_f32s(x, row[r], sums[p][r]);
                    }
                }
            }
        }
        let (first, n_outputs) = (self.panel.first + self.column, self.sizes.n_outputs);
        // The bounds are constant, so that the sums stay in registers.
        for (p, sums) in sums.into_iter().enumerate() {
            if p < self.at.len() {
                let output = &mut output[p * n_outputs..][..n_outputs];
                for (r, sum) in sums.into_iter().enumerate() {
                    store_within(simd, sum, output, first + r * S::F32_LANES);
                }
            }
        }
    }
}

/// Stores the part of a vector from output `first` on that lies within a row.
#[inline(always)]
fn store_within<S: Simd>(simd: S, vector: S::f32s, row: &mut [f32], first: usize) {
    if first + S::F32_LANES <= row.len() {
        store(simd, vector, &mut row[first..]);
    } else if first < row.len() {
        let (mut whole, left) = ([0.0; PANEL], row.len() - first);
        store(simd, vector, &mut whole);
        row[first..].copy_from_slice(&whole[..left]);
    }
}

#[cfg(test)]
mod tests;
