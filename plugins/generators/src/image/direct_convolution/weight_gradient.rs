//! Gradient in the weights of a convolution: sums over pixels of neighbouring inputs times the gradient in
//! the outputs.
//!
//! A block of several weights of one run by 16 or 32 outputs is summed in registers over the pixels of a
//! group of images, then added to the sums of the earlier groups.

use super::{PANEL, Sizes, framed, load, store, widths};
use pulp::{Simd, WithSimd};

/// Gradient in `W` from `x` and the gradient in `y`. `starts` are [`Sizes::starts`]; `memory` is for intermediate
/// numbers.
///
/// # Panics
/// Where lengths do not fit.
pub fn weight_gradient(
    image: &[f32],
    upstream: &[f32],
    sizes: &Sizes,
    starts: &[usize],
    gradient: &mut [f32],
    memory: &mut Vec<f32>,
) {
    let (n_outputs, width) = (sizes.n_outputs, sizes.n_outputs.next_multiple_of(PANEL));
    let pass = |upstream: &[f32], sums: &mut [f32], frames: &mut [f32]| {
        pulp::Arch::new().dispatch(WeightGradient {
            image,
            upstream,
            sizes: *sizes,
            starts,
            width,
            sums,
            frames,
        });
    };
    memory.clear();
    if width == n_outputs {
        memory.resize(sizes.frames(), 0.0);
        return pass(upstream, gradient, memory);
    }
    // Rows are filled up with zeros to whole panels.
    let [n_upstream, n_sums] = [sizes.n_result_pixels(), sizes.n_taps()].map(|rows| rows * width);
    memory.resize(n_upstream + n_sums + sizes.frames(), 0.0);
    let (filled, rest) = memory.split_at_mut(n_upstream);
    let (sums, frames) = rest.split_at_mut(n_sums);
    for (to, from) in filled
        .chunks_exact_mut(width)
        .zip(upstream.chunks_exact(n_outputs))
    {
        to[..n_outputs].copy_from_slice(from);
    }
    pass(filled, sums, frames);
    for (to, from) in gradient.chunks_exact_mut(n_outputs).zip(sums.chunks_exact(width)) {
        to.copy_from_slice(&from[..n_outputs]);
    }
}

/// Pass over `x` and the gradient in `y`, for rows of `width` outputs.
pub(super) struct WeightGradient<'a> {
    pub image: &'a [f32],
    pub upstream: &'a [f32],
    pub sizes: Sizes,
    pub starts: &'a [usize],
    pub width: usize,
    pub sums: &'a mut [f32],
    pub frames: &'a mut [f32],
}

impl WithSimd for WeightGradient<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let (sizes, width) = (self.sizes, self.width);
        let (in_group, [height, columns]) = (sizes.images_of_a_group(), sizes.result());
        let groups = self
            .image
            .chunks(in_group * sizes.height * sizes.width * sizes.n_inputs);
        let upstream = self.upstream.chunks(in_group * height * columns * width);
        self.sums.fill(0.0);
        for (group, upstream) in groups.zip(upstream) {
            let group = Group {
                frames: framed(group, &sizes, self.frames),
                at: &self.starts[..upstream.len() / width],
                upstream,
                width,
            };
            for column in widths(width) {
                let runs = self.sums.chunks_exact_mut(sizes.run() * width);
                for (ky, sums) in runs.enumerate() {
                    group.add(simd, ky * sizes.frame_row(), column, sums);
                }
            }
        }
    }
}

/// Framed images and the gradients in their outputs.
struct Group<'a> {
    frames: &'a [f32],
    at: &'a [usize],
    upstream: &'a [f32],
    width: usize,
}

impl Group<'_> {
    /// Adds the gradient of all weights of one run, in blocks as large as the registers hold.
    #[inline(always)]
    fn add<S: Simd>(&self, simd: S, shift: usize, (first, width): (usize, usize), sums: &mut [f32]) {
        let (n_weights, two) = (sums.len() / self.width, 2 * S::F32_LANES);
        for column in (first..first + width).step_by(two.min(width)) {
            let mut k = 0;
            while k < n_weights {
                let (left, one) = (n_weights - k, two > width);
                k += match (S::F32_LANES, left) {
                    (16, 16..) if one => self.block::<S, 16, 1>(simd, [shift, k, column], sums),
                    (16, 8..) if one => self.block::<S, 8, 1>(simd, [shift, k, column], sums),
                    (16, 8..) => self.block::<S, 8, 2>(simd, [shift, k, column], sums),
                    (_, 4..) if one => self.block::<S, 4, 1>(simd, [shift, k, column], sums),
                    (_, 4..) => self.block::<S, 4, 2>(simd, [shift, k, column], sums),
                    _ if one => self.block::<S, 1, 1>(simd, [shift, k, column], sums),
                    _ => self.block::<S, 1, 2>(simd, [shift, k, column], sums),
                };
            }
        }
    }

    /// Adds the gradient of `K` weights by `R` registers of outputs; returns `K`.
    #[inline(always)]
    fn block<S: Simd, const K: usize, const R: usize>(
        &self,
        simd: S,
        [shift, k, column]: [usize; 3],
        sums: &mut [f32],
    ) -> usize {
        let mut block = [[simd.splat_f32s(0.0); R]; K];
        for (at, upstream) in self.at.iter().zip(self.upstream.chunks_exact(self.width)) {
            let dy: [S::f32s; R] =
                std::array::from_fn(|r| load(simd, &upstream[column + r * S::F32_LANES..]));
            let x = &self.frames[at + shift + k..][..K];
            // The bounds are constant, so that the sums stay in registers.
            for (sums, x) in (0..K).zip(x) {
                let x = simd.splat_f32s(*x);
                for r in 0..R {
                    block[sums][r] = simd.mul_add_f32s(x, dy[r], block[sums][r]);
                }
            }
        }
        let rows = &mut sums[k * self.width..][..K * self.width];
        for (at, block) in block.into_iter().enumerate() {
            for (r, sum) in block.into_iter().enumerate() {
                let place = &mut rows[at * self.width + column + r * S::F32_LANES..];
                store(simd, simd.add_f32s(load(simd, place), sum), place);
            }
        }
        K
    }
}
