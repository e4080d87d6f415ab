//! Changes of the height and width of images.
//!
//! Centres of pixels lie at halves: pixel `o` of `n` resized ones lies at `p = (o + 1/2) m / n - 1/2` of `m`
//! pixels (PyTorch's `align_corners=False`), but not before the first one. Bilinear resizing mixes the two
//! neighbours of `p` in each direction; it does not smooth when it shrinks an image. All operations are
//! linear, so the backward passes are their transposed sums.

use super::Image;
use arithmetic::slices::widest;
use plan::{Backward, Extension, Graph, Shape, Value};
use std::sync::Arc;

impl Image<'_> {
    /// Enlarges every pixel to a square of `factor * factor`.
    ///
    /// # Panics
    /// Where `factor` is 0.
    #[must_use]
    pub fn enlarge_nearest(self, factor: usize) -> Self {
        assert!(factor > 0, "an image cannot be enlarged by 0");
        let to = [factor * self.height, factor * self.width];
        self.resized(to, Method::Nearest { factor })
    }

    /// Resizes to `[height, width]` by bilinear interpolation; either side may grow or shrink.
    ///
    /// # Panics
    /// Where a side is 0.
    #[must_use]
    pub fn resize_bilinear(self, to: [usize; 2]) -> Self {
        self.resized(
            to,
            Method::Bilinear(Arc::new(Bilinear::new([self.height, self.width], to))),
        )
    }

    /// Mean of each square of 2x2 pixels.
    ///
    /// # Panics
    /// Where height or width is odd.
    #[must_use]
    pub fn average_pool(self) -> Self {
        let [height, width] = [self.height, self.width];
        assert!(
            height % 2 == 0 && width % 2 == 0,
            "{height} x {width} pixels are no squares of 2x2"
        );
        self.resized([height / 2, width / 2], Method::Pool)
    }

    fn resized(self, to: [usize; 2], method: Method) -> Self {
        let resize = Resize {
            from: [self.height, self.width],
            to,
            n_channels: self.n_channels(),
            method,
            is_transposed: false,
        };
        Image::new(self.pixels.equations().apply(resize, &[self.pixels]), to)
    }
}

/// Bilinear interpolation of images `[batch, height, width, channels]` between two sizes.
#[must_use]
pub fn bilinear(images: &[f32], n_channels: usize, from: [usize; 2], to: [usize; 2]) -> Vec<f32> {
    let n_images = images.len() / (from[0] * from[1] * n_channels);
    let mut resized = vec![0.0; n_images * to[0] * to[1] * n_channels];
    Bilinear::new(from, to).forward(images, &mut resized, n_channels, &mut Vec::new());
    resized
}

#[derive(Debug, Clone)]
enum Method {
    /// Copies of each pixel.
    Nearest {
        factor: usize,
    },
    Bilinear(Arc<Bilinear>),
    /// Means of 2x2 pixels.
    Pool,
}

/// A change of size, or its transposed sum.
#[derive(Debug, Clone)]
struct Resize {
    /// Height and width before and after, not transposed.
    from: [usize; 2],
    to: [usize; 2],
    n_channels: usize,
    method: Method,
    is_transposed: bool,
}

impl Extension for Resize {
    fn name(&self) -> String {
        let (Self { from, to, .. }, back) = (self, if self.is_transposed { " back" } else { "" });
        let method = match self.method {
            Method::Nearest { .. } => "nearest",
            Method::Bilinear(_) => "bilinear",
            Method::Pool => "mean",
        };
        format!("Resize {method} {from:?} to {to:?}{back}")
    }

    fn shape(&self, operands: &[Shape]) -> Option<Shape> {
        let [[rows, columns]] = operands else { return None };
        let [from, to] = [self.from, self.to].map(|[height, width]| height * width);
        let (from, to) = if self.is_transposed {
            (to, from)
        } else {
            (from, to)
        };
        (rows.is_multiple_of(from) && *columns == self.n_channels).then_some([rows / from * to, *columns])
    }

    fn flops(&self, operands: &[Shape], result: Shape) -> u64 {
        let (more, each) = match self.method {
            Method::Nearest { .. } if !self.is_transposed => return 0,
            Method::Nearest { .. } => (operands[0], 1),
            Method::Bilinear(_) => (if self.is_transposed { operands[0] } else { result }, 6),
            Method::Pool => (if self.is_transposed { result } else { operands[0] }, 1),
        };
        each * (more[0] * more[1]) as u64
    }

    fn compute(&self, operands: &[&[f32]], result: &mut [f32], memory: &mut Vec<f32>) {
        let (x, n_channels) = (operands[0], self.n_channels);
        let row = self.from[1] * n_channels;
        match (&self.method, self.is_transposed) {
            (Method::Nearest { factor }, false) => enlarge(x, result, row, n_channels, *factor),
            (Method::Nearest { factor }, true) => gather(x, result, row, n_channels, *factor),
            (Method::Bilinear(bilinear), false) => bilinear.forward(x, result, n_channels, memory),
            (Method::Bilinear(bilinear), true) => bilinear.backward(x, result, n_channels, memory),
            (Method::Pool, false) => pool(x, result, row, n_channels),
            (Method::Pool, true) => unpool(x, result, row, n_channels),
        }
    }

    fn gradients(&self, graph: &mut Graph, backward: &Backward<'_>) -> Vec<Option<Value>> {
        let back = Self {
            is_transposed: !self.is_transposed,
            ..self.clone()
        };
        vec![Some(graph.apply(back, &[backward.upstream]))]
    }
}

/// Each pixel of rows of `row` numbers as a square of `factor * factor`.
fn enlarge(x: &[f32], y: &mut [f32], row: usize, n_channels: usize, factor: usize) {
    let wide = row * factor;
    for (x, y) in x.chunks_exact(row).zip(y.chunks_exact_mut(factor * wide)) {
        let (first, others) = y.split_at_mut(wide);
        let pixels = x.chunks_exact(n_channels);
        for (pixel, copies) in pixels.zip(first.chunks_exact_mut(factor * n_channels)) {
            copies
                .chunks_exact_mut(n_channels)
                .for_each(|copy| copy.copy_from_slice(pixel));
        }
        others
            .chunks_exact_mut(wide)
            .for_each(|row| row.copy_from_slice(first));
    }
}

/// Sums of the squares of [`enlarge`].
fn gather(dy: &[f32], dx: &mut [f32], row: usize, n_channels: usize, factor: usize) {
    dx.fill(0.0);
    widest(
        #[inline(always)]
        || {
            for (dx, dy) in dx
                .chunks_exact_mut(row)
                .zip(dy.chunks_exact(factor * factor * row))
            {
                for line in dy.chunks_exact(factor * row) {
                    let copies = line.chunks_exact(factor * n_channels);
                    for (dx, copies) in dx.chunks_exact_mut(n_channels).zip(copies) {
                        copies.chunks_exact(n_channels).for_each(|copy| add(dx, copy));
                    }
                }
            }
        },
    );
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
struct Bilinear {
    /// Height and width before.
    from: [usize; 2],
    rows: Vec<Neighbours>,
    columns: Vec<Neighbours>,
}

impl Bilinear {
    fn new(from: [usize; 2], to: [usize; 2]) -> Self {
        assert!(
            from.iter().chain(&to).all(|side| *side > 0),
            "a side of {from:?} to {to:?} is 0"
        );
        Self {
            from,
            rows: neighbours(from[0], to[0]),
            columns: neighbours(from[1], to[1]),
        }
    }

    /// Lengths of a row and of an image with `n_channels`, before and after.
    fn lengths(&self, n_channels: usize) -> [(usize, usize); 2] {
        let (before, after) = (self.from[1] * n_channels, self.columns.len() * n_channels);
        [(before, before * self.from[0]), (after, after * self.rows.len())]
    }

    /// `line` is for one row.
    fn forward(&self, x: &[f32], y: &mut [f32], n_channels: usize, line: &mut Vec<f32>) {
        let [(row, image), (new_row, new_image)] = self.lengths(n_channels);
        line.resize(row, 0.0);
        let line = &mut line[..row];
        widest(
            #[inline(always)]
            || {
                for (x, y) in x.chunks_exact(image).zip(y.chunks_exact_mut(new_image)) {
                    for (y, at) in y.chunks_exact_mut(new_row).zip(&self.rows) {
                        let row_at = |at: usize| &x[at * row..][..row];
                        mix(line, row_at(at.near), row_at(at.far), at.share);
                        for (y, at) in y.chunks_exact_mut(n_channels).zip(&self.columns) {
                            let pixel = |at: usize| &line[at * n_channels..][..n_channels];
                            mix(y, pixel(at.near), pixel(at.far), at.share);
                        }
                    }
                }
            },
        );
    }

    /// `line` is for one row.
    fn backward(&self, dy: &[f32], dx: &mut [f32], n_channels: usize, line: &mut Vec<f32>) {
        let [(row, image), (new_row, new_image)] = self.lengths(n_channels);
        dx.fill(0.0);
        line.resize(row, 0.0);
        let line = &mut line[..row];
        widest(
            #[inline(always)]
            || {
                for (dx, dy) in dx.chunks_exact_mut(image).zip(dy.chunks_exact(new_image)) {
                    for (dy, at) in dy.chunks_exact(new_row).zip(&self.rows) {
                        line.fill(0.0);
                        for (dy, at) in dy.chunks_exact(n_channels).zip(&self.columns) {
                            let near = &mut line[at.near * n_channels..][..n_channels];
                            add_scaled(near, 1.0 - at.share, dy);
                            add_scaled(&mut line[at.far * n_channels..][..n_channels], at.share, dy);
                        }
                        add_scaled(&mut dx[at.near * row..][..row], 1.0 - at.share, line);
                        add_scaled(&mut dx[at.far * row..][..row], at.share, line);
                    }
                }
            },
        );
    }
}

/// Means of 2x2 pixels of rows of `row` numbers.
fn pool(x: &[f32], y: &mut [f32], row: usize, n_channels: usize) {
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
}

/// The transposed sum of [`pool`]: a quarter to each of 2x2 pixels.
fn unpool(dy: &[f32], dx: &mut [f32], row: usize, n_channels: usize) {
    widest(
        #[inline(always)]
        || {
            for (dx, dy) in dx.chunks_exact_mut(2 * row).zip(dy.chunks_exact(row / 2)) {
                for dx in dx.chunks_exact_mut(row) {
                    let pairs = dx.chunks_exact_mut(2 * n_channels);
                    for (pair, dy) in pairs.zip(dy.chunks_exact(n_channels)) {
                        for dx in pair.chunks_exact_mut(n_channels) {
                            dx.iter_mut().zip(dy).for_each(|(dx, dy)| *dx = 0.25 * dy);
                        }
                    }
                }
            }
        },
    );
}
