//! The loops of a convolution.
//!
//! | symbol | here | shape |
//! |---|---|---|
//! | x | `image` | `[images, height, width, inputs]` |
//! | W | `weight` | `[k, l, inputs, outputs]`, k and l the height and width of the kernel |
//! | b | `bias` | `[outputs]` |
//! | y | result of [`convolve`] | `[images, rows, columns, outputs]` |
//!
//! `y = b + sum over rows ky, columns kx and inputs i of x W`, outside of the image `x = 0`. For channels that
//! come last the sum over `kx` and `i` is one over neighbouring numbers, a *run*: `k` runs of `l * inputs`
//! numbers for each pixel. Images are copied into frames of zeros first, so that no pixel is a special case.
//!
//! A tile of several pixels by 16 or 32 outputs is summed in registers. Weights are laid out in panels of so
//! many outputs, filled up with zeros; a tile that reaches beyond the last pixel repeats it. One output is
//! always the same chain of fused multiplications and additions, beginning with its bias, in the order of the
//! weights: no size of tile or register reaches the result. The gradient in a weight is one chain per group of
//! images in the order of their pixels, and groups have a size that depends on that of the images.

mod weight_gradient;

use pulp::{Simd, WithSimd};

pub use weight_gradient::weight_gradient;

/// Narrow width of a panel of outputs; whole registers of every processor divide it.
const PANEL: usize = 16;
/// Number of pixels that justify the start of a loop.
const PIXELS_OF_A_GROUP: usize = 128;

/// Sizes of a convolution.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sizes {
    /// Number of images.
    pub n_images: usize,
    /// Height of an image, pixels.
    pub height: usize,
    /// Width of an image, pixels.
    pub width: usize,
    /// Channels of an image.
    pub n_inputs: usize,
    /// Channels of the result.
    pub n_outputs: usize,
    /// Height and width of the kernel.
    pub kernel: [usize; 2],
    /// Distance of the kernel's places in both directions.
    pub stride: usize,
    /// Rows of zeros above and below an image, columns of zeros left and right of it.
    pub padding: [usize; 2],
}

impl Sizes {
    /// Height and width of the result.
    #[must_use]
    pub fn result(&self) -> [usize; 2] {
        let side = |side: usize, at: usize| (side + 2 * self.padding[at] - self.kernel[at]) / self.stride + 1;
        [side(self.height, 0), side(self.width, 1)]
    }

    /// Pixels of the results of all images.
    #[must_use]
    pub fn n_result_pixels(&self) -> usize {
        let [height, width] = self.result();
        self.n_images * height * width
    }

    /// Pixels of all images.
    #[must_use]
    pub fn n_pixels(&self) -> usize {
        self.n_images * self.height * self.width
    }

    /// Weights of one output.
    #[must_use]
    pub fn n_taps(&self) -> usize {
        self.kernel[0] * self.run()
    }

    /// Whether the result has the size of the image, so that its gradient in the image is a convolution too.
    #[must_use]
    pub fn keeps_size(&self) -> bool {
        self.stride == 1
            && self.padding == self.kernel.map(|side| side / 2)
            && self.kernel.iter().all(|side| side % 2 == 1)
    }

    /// Sizes of the convolution of gradients back to the inputs, where the result has the size of the image.
    #[must_use]
    pub fn reversed(self) -> Self {
        Self {
            n_inputs: self.n_outputs,
            n_outputs: self.n_inputs,
            ..self
        }
    }

    /// Length of one run.
    fn run(&self) -> usize {
        self.kernel[1] * self.n_inputs
    }

    /// Length of one row of a frame.
    fn frame_row(&self) -> usize {
        (self.width + 2 * self.padding[1]) * self.n_inputs
    }

    fn frame(&self) -> usize {
        (self.height + 2 * self.padding[0]) * self.frame_row()
    }

    fn images_of_a_group(&self) -> usize {
        (PIXELS_OF_A_GROUP / (self.height * self.width).max(1)).clamp(1, self.n_images.max(1))
    }

    /// Length of the frames of a group; 0 where images are read without frames.
    #[must_use]
    pub fn frames(&self) -> usize {
        if self.padding == [0, 0] {
            0
        } else {
            self.images_of_a_group() * self.frame()
        }
    }

    /// Length of the panels of a weight with its bias.
    #[must_use]
    pub fn panels(&self) -> usize {
        (self.n_taps() + 1) * self.n_outputs.next_multiple_of(PANEL)
    }

    /// Start of the first run of each pixel of a group of images.
    #[must_use]
    pub fn starts(&self) -> Vec<usize> {
        let ([height, width], stride) = (self.result(), self.stride);
        let place = |image, y, x| image * self.frame() + stride * (y * self.frame_row() + x * self.n_inputs);
        (0..self.images_of_a_group())
            .flat_map(|image| (0..height).map(move |y| (image, y)))
            .flat_map(|(image, y)| (0..width).map(move |x| place(image, y, x)))
            .collect()
    }
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

/// First output of each panel with the panel, a row of biases and a row for each tap.
fn panels_of<'a>(panels: &'a [f32], sizes: &Sizes) -> impl Iterator<Item = (usize, usize, &'a [f32])> {
    let rows = sizes.n_taps() + 1;
    widths(sizes.n_outputs).map(move |(first, width)| (first, width, &panels[first * rows..][..width * rows]))
}

/// Lays out a weight `[taps, outputs]` and a bias in [`Sizes::panels`] numbers, which are 0 before.
pub fn pack(weight: &[f32], bias: &[f32], sizes: &Sizes, panels: &mut [f32]) {
    let (n_outputs, rows) = (sizes.n_outputs, sizes.n_taps() + 1);
    for (first, width) in widths(n_outputs) {
        let filled = width.min(n_outputs - first);
        let panel = panels[first * rows..][..width * rows].chunks_exact_mut(width);
        let rows = std::iter::once(bias).chain(weight.chunks_exact(n_outputs));
        for (to, from) in panel.zip(rows) {
            to[..filled].copy_from_slice(&from[first..first + filled]);
        }
    }
}

/// Lays out the kernel of the gradient in the image, without biases: that of a weight `[taps, inputs, outputs]` turned
/// by half a circle, with exchanged channels. `sizes` are those of the gradient.
pub fn pack_turned(weight: &[f32], sizes: &Sizes, panels: &mut [f32]) {
    // Inputs of the gradient are outputs of the weight.
    let (n_inputs, n_outputs, rows) = (sizes.n_inputs, sizes.n_outputs, sizes.n_taps() + 1);
    for (first, width) in widths(n_outputs) {
        let panel = &mut panels[first * rows..][width..width * rows];
        let taps = weight.chunks_exact(n_inputs * n_outputs).rev();
        for (to, from) in panel.chunks_exact_mut(n_inputs * width).zip(taps) {
            let outputs = from.chunks_exact(n_inputs).skip(first).take(width).enumerate();
            for (output, row) in outputs {
                let column = to.iter_mut().skip(output).step_by(width);
                column.zip(row).for_each(|(to, from)| *to = *from);
            }
        }
    }
}

/// Output `y` from `x` and panels of `W` and `b`. `starts` are [`Sizes::starts`]; `frames` are [`Sizes::frames`] zeros.
///
/// # Panics
/// Where lengths do not fit.
pub fn convolve(
    image: &[f32],
    panels: &[f32],
    sizes: &Sizes,
    starts: &[usize],
    output: &mut [f32],
    frames: &mut [f32],
) {
    pulp::Arch::new().dispatch(ConvolutionPass {
        image,
        panels,
        sizes: *sizes,
        starts,
        output,
        frames,
    });
}

/// Images of a group, in frames whose borders are zeros where the kernel reaches beyond an image.
fn framed<'a>(group: &'a [f32], sizes: &Sizes, frames: &'a mut [f32]) -> &'a [f32] {
    if frames.is_empty() {
        return group;
    }
    let row = sizes.width * sizes.n_inputs;
    let (frame_row, border) = (sizes.frame_row(), sizes.padding[1] * sizes.n_inputs);
    let images = group.chunks_exact(sizes.height * row);
    for (image, frame) in images.zip(frames.chunks_exact_mut(sizes.frame())) {
        let lines = frame[sizes.padding[0] * frame_row..].chunks_exact_mut(frame_row);
        for (from, to) in image.chunks_exact(row).zip(lines) {
            to[border..border + row].copy_from_slice(from);
        }
    }
    frames
}

#[inline(always)]
fn load<S: Simd>(_: S, numbers: &[f32]) -> S::f32s {
    S::as_simd_f32s(&numbers[..S::F32_LANES]).0[0]
}

#[inline(always)]
fn store<S: Simd>(_: S, vector: S::f32s, numbers: &mut [f32]) {
    S::as_mut_simd_f32s(&mut numbers[..S::F32_LANES]).0[0] = vector;
}

struct ConvolutionPass<'a> {
    image: &'a [f32],
    panels: &'a [f32],
    sizes: Sizes,
    starts: &'a [usize],
    output: &'a mut [f32],
    frames: &'a mut [f32],
}

impl WithSimd for ConvolutionPass<'_> {
    type Output = ();

    /// Chooses the largest tiles that the registers hold.
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
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
    fn run<S: Simd, const P: usize, const R: usize>(self, simd: S) {
        let sizes = self.sizes;
        let (in_group, [height, width]) = (sizes.images_of_a_group(), sizes.result());
        let groups = self
            .image
            .chunks(in_group * sizes.height * sizes.width * sizes.n_inputs);
        let outputs = self
            .output
            .chunks_mut(in_group * height * width * sizes.n_outputs);
        for (group, output) in groups.zip(outputs) {
            let at = &self.starts[..output.len() / sizes.n_outputs];
            let frames = framed(group, &sizes, self.frames);
            for (first, width, panel) in panels_of(self.panels, &sizes) {
                let half = S::F32_LANES * R > width;
                for column in (0..width).step_by(if half { width } else { S::F32_LANES * R }) {
                    for (tile, output) in at.chunks(P).zip(output.chunks_mut(P * sizes.n_outputs)) {
                        let tile = Tile {
                            frames,
                            at: tile,
                            panel,
                            width,
                            column,
                            first: first + column,
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
    }
}

/// A block of pixels by outputs of a panel.
struct Tile<'a> {
    frames: &'a [f32],
    at: &'a [usize],
    panel: &'a [f32],
    width: usize,
    /// First column in the panel, and its output.
    column: usize,
    first: usize,
    sizes: Sizes,
}

impl Tile<'_> {
    #[inline(always)]
    fn sum<S: Simd, const P: usize, const R: usize>(self, simd: S, output: &mut [f32]) {
        let (run, width) = (self.sizes.run(), self.width);
        let (bias, weights) = self.panel.split_at(width);
        let start: [S::f32s; R] =
            std::array::from_fn(|r| load(simd, &bias[self.column + r * S::F32_LANES..]));
        let mut sums = [start; P];
        for (ky, weights) in weights.chunks_exact(run * width).enumerate() {
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
                        sums[p][r] = simd.mul_add_f32s(x, row[r], sums[p][r]);
                    }
                }
            }
        }
        let n_outputs = self.sizes.n_outputs;
        // The bounds are constant, so that the sums stay in registers.
        for (p, sums) in sums.into_iter().enumerate() {
            if p < self.at.len() {
                let output = &mut output[p * n_outputs..][..n_outputs];
                for (r, sum) in sums.into_iter().enumerate() {
                    store_within(simd, sum, output, self.first + r * S::F32_LANES);
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
