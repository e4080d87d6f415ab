//! Sets of square colour images: the embedded shapes, and files of CIFAR-10 and STL-10.
//!
//! A pixel is a byte in a set and a number of [-1, 1] in a network: `x = byte / 127.5 - 1`. The inverse takes
//! the nearest byte of `(x + 1) 127.5`, so that every byte is recovered; the public code of E2GAN and AutoGAN
//! truncates instead, which makes generated images half a step darker.

pub mod cifar10;
pub mod shapes;
pub mod stl10;

use std::path::{Path, PathBuf};

/// Red, green and blue.
pub const CHANNELS: usize = 3;

/// Square colour images of one size, with or without class labels.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Images {
    size: usize,
    /// `[count, size, size, 3]`.
    pixels: Vec<u8>,
    labels: Option<Vec<u8>>,
    class_names: &'static [&'static str],
}

/// Reason why a file does not hold the expected images.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ImageFileError {
    /// The file does not hold a whole number of images or labels, or holds none.
    #[error("`{}` has {found} bytes; expected {expected}", path.display())]
    Size {
        /// Path of the file.
        path: PathBuf,
        /// Size of the file, bytes.
        found: usize,
        /// Description of the possible sizes.
        expected: &'static str,
    },
    /// A label that is not a class.
    #[error("`{}` has the label {found} at image {image} (the first is 0); expected {expected}", path.display())]
    Label {
        /// Path of the file.
        path: PathBuf,
        /// Position of the first image with such a label, from 0.
        image: usize,
        /// Value of the label.
        found: u8,
        /// Description of the possible labels.
        expected: &'static str,
    },
    /// The number of labels differs from the number of images.
    #[error(
        "labels in `{}`: {found}; expected {expected}, one for each image of `{}`",
        path.display(),
        images.display()
    )]
    Labels {
        /// The file of labels.
        path: PathBuf,
        /// Number of labels.
        found: usize,
        /// The file of images.
        images: PathBuf,
        /// Number of images.
        expected: usize,
    },
}

impl Images {
    /// Images of `size x size` pixels, `pixels` `[count, height, width, 3]`; one label per image, which is an index
    /// of `class_names`, or none at all.
    ///
    /// # Panics
    /// Where pixels are no whole number of images, labels are not as many as images or label no class.
    #[must_use]
    pub fn new(
        size: usize,
        pixels: Vec<u8>,
        labels: Option<Vec<u8>>,
        class_names: &'static [&'static str],
    ) -> Self {
        let per_image = size * size * CHANNELS;
        assert!(
            per_image > 0 && pixels.len().is_multiple_of(per_image),
            "{} bytes are no whole number of {size} x {size} images",
            pixels.len()
        );
        if let Some(labels) = &labels {
            assert_eq!(labels.len(), pixels.len() / per_image, "labels of as many images");
            let known = |label: &u8| usize::from(*label) < class_names.len();
            assert!(labels.iter().all(known), "a label is an index of {class_names:?}");
        }
        Self {
            size,
            pixels,
            labels,
            class_names,
        }
    }

    /// Number of images.
    #[must_use]
    pub fn count(&self) -> usize {
        self.pixels.len() / self.per_image()
    }

    /// Height and width in pixels.
    #[must_use]
    pub fn size(&self) -> usize {
        self.size
    }

    /// All pixels, `[count, height, width, 3]`.
    #[must_use]
    pub fn pixels(&self) -> &[u8] {
        &self.pixels
    }

    /// The class of each image as an index, where classes are known.
    #[must_use]
    pub fn labels(&self) -> Option<&[u8]> {
        self.labels.as_deref()
    }

    /// The classes, in the order of their labels.
    #[must_use]
    pub fn class_names(&self) -> &'static [&'static str] {
        self.class_names
    }

    /// One image, `[height, width, 3]`.
    ///
    /// # Panics
    /// Where there are not so many images.
    #[must_use]
    pub fn image(&self, index: usize) -> &[u8] {
        &self.pixels[index * self.per_image()..][..self.per_image()]
    }

    /// Images in the numbers of a network, `[indices, height, width, 3]` in [-1, 1].
    ///
    /// # Panics
    /// Where there are not so many images.
    #[must_use]
    pub fn batch(&self, indices: &[usize]) -> Vec<f32> {
        let images = indices.iter().flat_map(|index| self.image(*index));
        images.map(|byte| from_byte(*byte)).collect()
    }

    /// The images at `size x size` pixels; see [`resized`].
    ///
    /// # Panics
    /// Where that is larger than the images are, or 0.
    #[must_use]
    pub fn resized(&self, size: usize) -> Self {
        let images = self.pixels.chunks_exact(self.per_image());
        Self {
            size,
            pixels: images.flat_map(|image| resized(image, self.size, size)).collect(),
            labels: self.labels.clone(),
            class_names: self.class_names,
        }
    }

    /// The first images of the set, all where it has fewer.
    #[must_use]
    pub fn first(&self, count: usize) -> Self {
        let count = count.min(self.count());
        Self {
            size: self.size,
            pixels: self.pixels[..count * self.per_image()].to_vec(),
            labels: self.labels().map(|labels| labels[..count].to_vec()),
            class_names: self.class_names,
        }
    }

    /// These images and then those of another set, with labels if both have them.
    ///
    /// # Panics
    /// Where their sizes or classes differ.
    #[must_use]
    pub fn followed_by(mut self, other: &Self) -> Self {
        assert_eq!(self.size, other.size, "sizes of images");
        assert_eq!(self.class_names, other.class_names, "classes of images");
        self.pixels.extend_from_slice(&other.pixels);
        self.labels = self.labels.zip(other.labels()).map(|(mut labels, others)| {
            labels.extend_from_slice(others);
            labels
        });
        self
    }

    fn per_image(&self) -> usize {
        self.size * self.size * CHANNELS
    }
}

/// A byte as a number of [-1, 1]: `byte / 127.5 - 1`.
#[must_use]
pub fn from_byte(byte: u8) -> f32 {
    f32::from(byte) / 127.5 - 1.0
}

/// The nearest byte of `(x + 1) 127.5`: 0 below -1, 255 above 1, and 0 for NaN.
#[must_use]
pub fn to_byte(x: f32) -> u8 {
    // The cast clamps.
    ((x + 1.0) * 127.5).round() as u8
}

/// [`to_byte`] of each number.
#[must_use]
pub fn to_bytes(numbers: &[f32]) -> Vec<u8> {
    numbers.iter().map(|x| to_byte(*x)).collect()
}

/// A smaller image by bilinear interpolation with half-pixel centres, `[to, to, 3]` from `[from, from, 3]`.
///
/// Output row `i` is read at `(i + 1/2) from / to - 1/2` between the two nearest rows, columns alike, and rounded to
/// the nearest byte, halves up. No filter widens with the factor: halving takes the mean of 2 x 2 pixels, but
/// quartering that of the middle 2 x 2 of every 4 x 4, where halving twice takes all 16. (The public code of
/// E2GAN and AutoGAN resizes with PIL, whose triangle does widen: for halving it weighs four pixels a side by
/// 1/8, 3/8, 3/8, 1/8.)
///
/// # Panics
/// Where `image` is not of this size, or `to` is 0 or larger than `from`.
#[must_use]
pub fn resized(image: &[u8], from: usize, to: usize) -> Vec<u8> {
    assert_eq!(
        image.len(),
        from * from * CHANNELS,
        "bytes of a {from} x {from} image"
    );
    assert!(0 < to && to <= from, "{from} pixels cannot be made {to}");
    let positions: Vec<Position> = (0..to).map(|index| Position::of(index, from, to)).collect();
    let mut pixels = Vec::with_capacity(to * to * CHANNELS);
    for row in &positions {
        for column in &positions {
            for channel in 0..CHANNELS {
                let at = |row: usize, column: usize| image[(row * from + column) * CHANNELS + channel];
                let above = column.between(at(row.low, column.low), at(row.low, column.high));
                let below = column.between(at(row.high, column.low), at(row.high, column.high));
                let sum = above * (row.steps - row.above_low) + below * row.above_low;
                pixels.push(nearest(sum, row.steps * column.steps));
            }
        }
    }
    pixels
}

/// Position at which an output row or column is read: `above_low / steps` of the way from `low` to `high`.
/// Integers, so that no rounding decides a byte.
struct Position {
    low: usize,
    high: usize,
    above_low: usize,
    steps: usize,
}

impl Position {
    /// `(index + 1/2) from / to - 1/2 = ((2 index + 1) from - to) / (2 to)`, which lies within the image since
    /// `to <= from`.
    fn of(index: usize, from: usize, to: usize) -> Self {
        let (doubled, steps) = ((2 * index + 1) * from - to, 2 * to);
        let low = doubled / steps;
        Self {
            low,
            high: (low + 1).min(from - 1),
            above_low: doubled % steps,
            steps,
        }
    }

    fn between(&self, low: u8, high: u8) -> usize {
        usize::from(low) * (self.steps - self.above_low) + usize::from(high) * self.above_low
    }
}

/// `sum / parts` to the nearest byte, halves up.
fn nearest(sum: usize, parts: usize) -> u8 {
    // A mean of bytes is at most 255.
    u8::try_from((2 * sum + parts) / (2 * parts)).unwrap_or(u8::MAX)
}

/// Number of images of `per_image` bytes in a file.
fn whole_images(
    path: &Path,
    bytes: &[u8],
    per_image: usize,
    expected: &'static str,
) -> Result<usize, ImageFileError> {
    if bytes.is_empty() || !bytes.len().is_multiple_of(per_image) {
        return Err(ImageFileError::Size {
            path: path.into(),
            found: bytes.len(),
            expected,
        });
    }
    Ok(bytes.len() / per_image)
}

#[cfg(test)]
mod tests;
