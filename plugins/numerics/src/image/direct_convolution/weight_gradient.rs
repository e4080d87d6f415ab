//! Gradient in the weights of a convolution: sums over pixels of neighbouring inputs times the gradient in
//! the outputs.
//!
//! A block of several weights of one run by 16 or 32 outputs is summed in registers over the pixels of a
//! group of images, then added to the sums of the earlier groups.

use super::{PANEL, Sizes, framed, load, starts, store, widths};
use pulp::{Simd, WithSimd};

/// Pass over `x` and the gradient in `y`.
pub(super) struct WeightGradient<'a> {
    pub image: &'a [f32],
    pub upstream: &'a [f32],
    pub sizes: Sizes,
}

impl WithSimd for WeightGradient<'_> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Vec<f32> {
        let (n_outputs, width) = (self.sizes.n_outputs, self.sizes.n_outputs.next_multiple_of(PANEL));
        if width == n_outputs {
            return self.run(simd, self.upstream, width);
        }
        let sums = self.run(simd, &rows_of(self.upstream, n_outputs, width), width);
        rows_of(&sums, width, n_outputs)
    }
}

/// Rows of another width, padded with zeros or cut.
fn rows_of(rows: &[f32], from: usize, to: usize) -> Vec<f32> {
    let (common, mut other) = (from.min(to), vec![0.0; rows.len() / from * to]);
    for (to, from) in other.chunks_exact_mut(to).zip(rows.chunks_exact(from)) {
        to[..common].copy_from_slice(&from[..common]);
    }
    other
}

impl WeightGradient<'_> {
    /// Gradient for rows of `width` outputs.
    #[inline(always)]
    fn run<S: Simd>(&self, simd: S, upstream: &[f32], width: usize) -> Vec<f32> {
        let sizes = self.sizes;
        let in_group = sizes.images_of_a_group();
        let mut sums = vec![0.0; sizes.n_weights() / sizes.n_outputs * width];
        let (mut frames, mut at) = (Vec::new(), Vec::new());
        let groups = self
            .image
            .chunks(in_group * sizes.n_pixels() * sizes.n_inputs)
            .zip(upstream.chunks(in_group * sizes.n_pixels() * width));
        for (group, upstream) in groups {
            let n_pixels = upstream.len() / width;
            if at.len() != n_pixels {
                at = starts(n_pixels / sizes.n_pixels(), &sizes);
            }
            let group = Group {
                frames: framed(group, &sizes, &mut frames),
                at: &at,
                upstream,
                width,
            };
            for column in widths(width) {
                for (ky, sums) in sums.chunks_exact_mut(sizes.run() * width).enumerate() {
                    group.add(simd, ky * sizes.frame_row(), column, sums);
                }
            }
        }
        sums
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
                    block[sums][r] = simd.mul_add_e_f32s(x, dy[r], block[sums][r]);
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
