//! Changes of the height and width of images.
//!
//! Centres of pixels lie at halves: pixel `o` of `n` resized ones lies at `p = (o + 1/2) m / n - 1/2` of `m`
//! pixels (PyTorch's `align_corners=False`), but not before the first one. Bilinear resizing mixes the two
//! neighbours of `p` in each direction; it does not smooth when it shrinks an image. All operations are
//! linear, so the backward passes are their transposed sums.

use super::operation::{Operation, PlainTensor, host, of_one, shape};
use super::{column_sums, widest};
use burn::Tensor;
use std::sync::Arc;

/// Enlarges every pixel of `image` `[batch, height, width, channels]` to a square of `factor * factor`.
///
/// # Panics
/// Where `factor` is 0 or the tensor is not `f32`.
#[must_use]
pub fn enlarge_nearest(image: Tensor<4>, factor: usize) -> Tensor<4> {
    assert!(factor > 0, "an image cannot be enlarged by 0");
    of_one(image, Arc::new(NearestEnlargement { factor }))
}

/// Resizes `image` `[batch, height, width, channels]` to `[height, width]` by bilinear interpolation; either
/// side may grow or shrink.
///
/// # Panics
/// Where a side is 0 or the tensor is not `f32`.
#[must_use]
pub fn resize_bilinear(image: Tensor<4>, [height, width]: [usize; 2]) -> Tensor<4> {
    let [_, from_height, from_width, _] = image.dims();
    assert!(
        height.min(width).min(from_height).min(from_width) > 0,
        "a side of {from_height} x {from_width} to {height} x {width} is 0"
    );
    let operation = BilinearResize {
        from: [from_height, from_width],
        rows: neighbours(from_height, height),
        columns: neighbours(from_width, width),
    };
    of_one(image, Arc::new(operation))
}

/// Mean of each square of 2x2 pixels of `image` `[batch, height, width, channels]`.
///
/// # Panics
/// Where height or width is odd, or the tensor is not `f32`.
#[must_use]
pub fn average_pool(image: Tensor<4>) -> Tensor<4> {
    let [_, height, width, _] = image.dims();
    assert!(
        height % 2 == 0 && width % 2 == 0,
        "{height} x {width} pixels are no squares of 2x2"
    );
    of_one(image, Arc::new(AveragePool))
}

/// Sum over the pixels of each channel of `image` `[batch, height, width, channels]`: `[batch, 1, 1,
/// channels]`.
///
/// # Panics
/// Where a dimension is 0 or the tensor is not `f32`.
#[must_use]
pub fn sum_pixels(image: Tensor<4>) -> Tensor<4> {
    let [_, height, width, _] = image.dims();
    of_one(
        image,
        Arc::new(PixelSum {
            from: [height, width],
        }),
    )
}

#[derive(Debug)]
struct NearestEnlargement {
    factor: usize,
}

impl Operation for NearestEnlargement {
    fn forward(&self, inputs: Vec<PlainTensor>) -> (PlainTensor, Vec<PlainTensor>) {
        let [n_images, height, width, n_channels] = shape(&inputs[0]);
        let (factor, x) = (self.factor, inputs[0].storage::<f32>());
        let wide = width * factor * n_channels;
        let mut y = vec![0.0; x.len() * factor * factor];
        let rows = x
            .chunks_exact(width * n_channels)
            .zip(y.chunks_exact_mut(factor * wide));
        for (x, y) in rows {
            let (first, others) = y.split_at_mut(wide);
            for (pixel, copies) in x
                .chunks_exact(n_channels)
                .zip(first.chunks_exact_mut(factor * n_channels))
            {
                copies
                    .chunks_exact_mut(n_channels)
                    .for_each(|copy| copy.copy_from_slice(pixel));
            }
            others
                .chunks_exact_mut(wide)
                .for_each(|row| row.copy_from_slice(first));
        }
        (
            host(y, [n_images, height * factor, width * factor, n_channels]),
            Vec::new(),
        )
    }

    fn backward(&self, _: &[PlainTensor], upstream: &PlainTensor, _: &[bool]) -> Vec<Option<PlainTensor>> {
        let [n_images, height, width, n_channels] = shape(upstream);
        let (factor, dy) = (self.factor, upstream.storage::<f32>());
        let (height, narrow) = (height / factor, width / factor * n_channels);
        let mut dx = vec![0.0; dy.len() / (factor * factor)];
        widest(
            #[inline(always)]
            || {
                let rows = dx
                    .chunks_exact_mut(narrow)
                    .zip(dy.chunks_exact(factor * factor * narrow));
                for (dx, dy) in rows {
                    for row in dy.chunks_exact(factor * narrow) {
                        let copies = row.chunks_exact(factor * n_channels);
                        for (dx, copies) in dx.chunks_exact_mut(n_channels).zip(copies) {
                            copies.chunks_exact(n_channels).for_each(|copy| add(dx, copy));
                        }
                    }
                }
            },
        );
        vec![Some(host(dx, [n_images, height, width / factor, n_channels]))]
    }
}

#[inline(always)]
fn add(sums: &mut [f32], other: &[f32]) {
    sums.iter_mut().zip(other).for_each(|(sum, other)| *sum += other);
}

#[inline(always)]
fn add_scaled(sums: &mut [f32], factor: f32, other: &[f32]) {
    sums.iter_mut()
        .zip(other)
        .for_each(|(sum, other)| *sum += factor * other);
}

/// Interpolates `near + share (far - near)`.
#[inline(always)]
fn mix(mixed: &mut [f32], near: &[f32], far: &[f32], share: f32) {
    let pairs = near.iter().zip(far);
    mixed
        .iter_mut()
        .zip(pairs)
        .for_each(|(mixed, (near, far))| *mixed = near + share * (far - near));
}

/// Two pixels that one resized pixel mixes, and the share of the second.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Neighbours {
    near: usize,
    far: usize,
    share: f32,
}

#[allow(
    clippy::cast_precision_loss,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a side has far fewer than 2^24 pixels, and a position is not negative"
)]
fn neighbours(from: usize, to: usize) -> Vec<Neighbours> {
    let step = from as f32 / to as f32;
    (0..to)
        .map(|o| {
            let position = ((o as f32 + 0.5) * step - 0.5).max(0.0);
            let near = (position as usize).min(from - 1);
            Neighbours {
                near,
                far: (near + 1).min(from - 1),
                share: position - near as f32,
            }
        })
        .collect()
}

#[derive(Debug)]
struct BilinearResize {
    /// Height and width of the input.
    from: [usize; 2],
    rows: Vec<Neighbours>,
    columns: Vec<Neighbours>,
}

impl BilinearResize {
    /// Lengths of a row and of an image with `n_channels`, for input and output.
    fn lengths(&self, n_channels: usize) -> [(usize, usize); 2] {
        let (before, after) = (self.from[1] * n_channels, self.columns.len() * n_channels);
        [(before, before * self.from[0]), (after, after * self.rows.len())]
    }
}

impl Operation for BilinearResize {
    fn forward(&self, inputs: Vec<PlainTensor>) -> (PlainTensor, Vec<PlainTensor>) {
        let ([n_images, .., n_channels], x) = (shape(&inputs[0]), inputs[0].storage::<f32>());
        let [(row, image), (new_row, new_image)] = self.lengths(n_channels);
        let mut y = vec![0.0; n_images * new_image];
        widest(
            #[inline(always)]
            || {
                let mut line = vec![0.0; row];
                for (x, y) in x.chunks_exact(image).zip(y.chunks_exact_mut(new_image)) {
                    for (y, at) in y.chunks_exact_mut(new_row).zip(&self.rows) {
                        mix(
                            &mut line,
                            &x[at.near * row..][..row],
                            &x[at.far * row..][..row],
                            at.share,
                        );
                        for (y, at) in y.chunks_exact_mut(n_channels).zip(&self.columns) {
                            let pixel = |at: usize| &line[at * n_channels..][..n_channels];
                            mix(y, pixel(at.near), pixel(at.far), at.share);
                        }
                    }
                }
            },
        );
        (
            host(y, [n_images, self.rows.len(), self.columns.len(), n_channels]),
            Vec::new(),
        )
    }

    fn backward(&self, _: &[PlainTensor], upstream: &PlainTensor, _: &[bool]) -> Vec<Option<PlainTensor>> {
        let ([n_images, .., n_channels], dy) = (shape(upstream), upstream.storage::<f32>());
        let [(row, image), (new_row, new_image)] = self.lengths(n_channels);
        let mut dx = vec![0.0; n_images * image];
        widest(
            #[inline(always)]
            || {
                let mut line = vec![0.0; row];
                for (dx, dy) in dx.chunks_exact_mut(image).zip(dy.chunks_exact(new_image)) {
                    for (dy, at) in dy.chunks_exact(new_row).zip(&self.rows) {
                        line.fill(0.0);
                        for (dy, at) in dy.chunks_exact(n_channels).zip(&self.columns) {
                            add_scaled(
                                &mut line[at.near * n_channels..][..n_channels],
                                1.0 - at.share,
                                dy,
                            );
                            add_scaled(&mut line[at.far * n_channels..][..n_channels], at.share, dy);
                        }
                        add_scaled(&mut dx[at.near * row..][..row], 1.0 - at.share, &line);
                        add_scaled(&mut dx[at.far * row..][..row], at.share, &line);
                    }
                }
            },
        );
        vec![Some(host(dx, [n_images, self.from[0], self.from[1], n_channels]))]
    }
}

#[derive(Debug)]
struct AveragePool;

impl Operation for AveragePool {
    fn forward(&self, inputs: Vec<PlainTensor>) -> (PlainTensor, Vec<PlainTensor>) {
        let ([n_images, height, width, n_channels], x) = (shape(&inputs[0]), inputs[0].storage::<f32>());
        let row = width * n_channels;
        let mut y = vec![0.0; x.len() / 4];
        widest(
            #[inline(always)]
            || {
                for (x, y) in x.chunks_exact(2 * row).zip(y.chunks_exact_mut(row / 2)) {
                    let (upper, lower) = x.split_at(row);
                    let pairs = upper
                        .chunks_exact(2 * n_channels)
                        .zip(lower.chunks_exact(2 * n_channels));
                    for (y, (upper, lower)) in y.chunks_exact_mut(n_channels).zip(pairs) {
                        let (a, b) = upper.split_at(n_channels);
                        let (c, d) = lower.split_at(n_channels);
                        let squares = a.iter().zip(b).zip(c.iter().zip(d));
                        y.iter_mut()
                            .zip(squares)
                            .for_each(|(y, ((a, b), (c, d)))| *y = 0.25 * (a + b + c + d));
                    }
                }
            },
        );
        (host(y, [n_images, height / 2, width / 2, n_channels]), Vec::new())
    }

    fn backward(&self, _: &[PlainTensor], upstream: &PlainTensor, _: &[bool]) -> Vec<Option<PlainTensor>> {
        let ([n_images, height, width, n_channels], dy) = (shape(upstream), upstream.storage::<f32>());
        let row = 2 * width * n_channels;
        let mut dx = vec![0.0; dy.len() * 4];
        widest(
            #[inline(always)]
            || {
                for (dx, dy) in dx.chunks_exact_mut(2 * row).zip(dy.chunks_exact(row / 2)) {
                    for dx in dx.chunks_exact_mut(row) {
                        for (pair, dy) in dx
                            .chunks_exact_mut(2 * n_channels)
                            .zip(dy.chunks_exact(n_channels))
                        {
                            for dx in pair.chunks_exact_mut(n_channels) {
                                dx.iter_mut().zip(dy).for_each(|(dx, dy)| *dx = 0.25 * dy);
                            }
                        }
                    }
                }
            },
        );
        vec![Some(host(dx, [n_images, 2 * height, 2 * width, n_channels]))]
    }
}

#[derive(Debug)]
struct PixelSum {
    /// Height and width of the input.
    from: [usize; 2],
}

impl Operation for PixelSum {
    fn forward(&self, inputs: Vec<PlainTensor>) -> (PlainTensor, Vec<PlainTensor>) {
        let ([n_images, height, width, n_channels], x) = (shape(&inputs[0]), inputs[0].storage::<f32>());
        let images = x.chunks_exact(height * width * n_channels);
        let sums = images.flat_map(|image| column_sums(image, n_channels)).collect();
        (host(sums, [n_images, 1, 1, n_channels]), Vec::new())
    }

    fn backward(&self, _: &[PlainTensor], upstream: &PlainTensor, _: &[bool]) -> Vec<Option<PlainTensor>> {
        let ([n_images, .., n_channels], [height, width]) = (shape(upstream), self.from);
        let rows = upstream.storage::<f32>().chunks_exact(n_channels);
        let dx = rows.flat_map(|dy| dy.repeat(height * width)).collect();
        vec![Some(host(dx, [n_images, height, width, n_channels]))]
    }
}
