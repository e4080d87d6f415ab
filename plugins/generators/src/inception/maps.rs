//! Maps of images, and the operations on them beside convolutions.

use super::plan::Pool;

/// Side of the squares of a pooling, pixels.
const SIDE: usize = 3;

/// Maps `[batch, height, width, channels]`.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Maps {
    pub(super) entries: Vec<f32>,
    /// Height, width and channels.
    pub(super) shape: [usize; 3],
}

impl Maps {
    pub(super) fn new(entries: Vec<f32>, shape: [usize; 3]) -> Self {
        let length: usize = shape.iter().product();
        assert!(
            entries.len().is_multiple_of(length),
            "{} numbers in maps of {shape:?}",
            entries.len()
        );
        Self { entries, shape }
    }

    pub(super) fn n_images(&self) -> usize {
        self.entries.len() / self.shape.iter().product::<usize>()
    }

    /// Maps of one size side by side along the channels.
    pub(super) fn joined(parts: &[Self]) -> Self {
        let [height, width, _] = parts[0].shape;
        let n_channels = parts.iter().map(|part| part.shape[2]).sum();
        let mut entries = vec![0.0; parts[0].n_images() * height * width * n_channels];
        let mut first = 0;
        for part in parts {
            let width = part.shape[2];
            for (to, from) in entries
                .chunks_exact_mut(n_channels)
                .zip(part.entries.chunks_exact(width))
            {
                to[first..first + width].copy_from_slice(from);
            }
            first += width;
        }
        Self::new(entries, [height, width, n_channels])
    }

    /// Mean of each channel over the pixels, as maps of one pixel.
    pub(super) fn means(&self) -> Self {
        let [height, width, n_channels] = self.shape;
        let mut means = vec![0.0; self.n_images() * n_channels];
        let images = self.entries.chunks_exact(height * width * n_channels);
        for (means, image) in means.chunks_exact_mut(n_channels).zip(images) {
            for pixel in image.chunks_exact(n_channels) {
                means.iter_mut().zip(pixel).for_each(|(sum, x)| *sum += x);
            }
            means.iter_mut().for_each(|sum| *sum /= (height * width) as f32);
        }
        Self::new(means, [1, 1, n_channels])
    }

    /// Pooling over squares of 3x3 pixels.
    pub(super) fn pooled(&self, pool: Pool) -> Self {
        let [height, width, n_channels] = self.shape;
        // A square begins so many pixels before its pixel times the stride.
        let (stride, before) = match pool {
            Pool::Mean | Pool::Largest => (1, SIDE / 2),
            Pool::LargestOfEverySecond => (2, 0),
        };
        let side = |side: usize| (side + 2 * before - SIDE) / stride + 1;
        let (rows, columns) = (side(height), side(width));
        let mut entries = vec![0.0; self.n_images() * rows * columns * n_channels];
        let images = self.entries.chunks_exact(height * width * n_channels);
        let pooled = entries.chunks_exact_mut(rows * columns * n_channels);
        for (image, pooled) in images.zip(pooled) {
            for (at, result) in pooled.chunks_exact_mut(n_channels).enumerate() {
                let within = |at: usize, side: usize| {
                    let first = stride * at;
                    first.saturating_sub(before)..(first + SIDE - before).min(side)
                };
                let (ys, xs) = (within(at / columns, height), within(at % columns, width));
                let n = ys.len() * xs.len();
                let pixels = ys.flat_map(|y| xs.clone().map(move |x| y * width + x));
                let pixels = pixels.map(|at| &image[at * n_channels..][..n_channels]);
                match pool {
                    Pool::Mean => mean(result, pixels, n),
                    Pool::Largest | Pool::LargestOfEverySecond => largest(result, pixels),
                }
            }
        }
        Self::new(entries, [rows, columns, n_channels])
    }
}

fn mean<'a>(result: &mut [f32], pixels: impl Iterator<Item = &'a [f32]>, n: usize) {
    for pixel in pixels {
        result.iter_mut().zip(pixel).for_each(|(sum, x)| *sum += x);
    }
    result.iter_mut().for_each(|sum| *sum /= n as f32);
}

fn largest<'a>(result: &mut [f32], pixels: impl Iterator<Item = &'a [f32]>) {
    result.fill(f32::NEG_INFINITY);
    for pixel in pixels {
        for (most, x) in result.iter_mut().zip(pixel) {
            *most = if *x > *most { *x } else { *most };
        }
    }
}
