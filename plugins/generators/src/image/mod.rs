//! Operations on images for convolutional networks, in the equations of plans.
//!
//! A pixel is a row: images are matrices `[batch height width, channels]`, channels last. So every pixel is one short
//! row of neighbouring numbers, and all loops run over rows: a convolution adds rows of weights, a normalisation adds
//! rows of pixels, a resize copies or mixes them. [`Image`] has the operations.
//!
//! | operation | module |
//! |---|---|
//! | convolution with bias, deconvolution 2x2 with stride 2 | [`convolution`], on the loops of [`direct_convolution`] |
//! | batch and instance normalisation, with an optional rectifier | [`normalisation`] |
//! | enlarging, resizing, average pooling | [`resize`] |
//! | division by the largest singular value | [`spectral`] |
//!
//! Every sum has one order, which depends on the sizes alone and never on the width of a vector register: results
//! have the same bits on every processor. Except for batch normalisation, a row of the batch depends on its own row
//! of the input.

pub mod convolution;
pub mod direct_convolution;
pub mod normalisation;
pub mod resize;
pub mod spectral;

#[cfg(test)]
mod oracle_tests;

use plan::Expression;
use std::ops::Add;

/// Images of one size in equations.
#[derive(Debug, Clone, Copy)]
pub struct Image<'e> {
    /// Pixels `[batch height width, channels]`.
    pub pixels: Expression<'e>,
    /// Height, pixels.
    pub height: usize,
    /// Width, pixels.
    pub width: usize,
}

impl<'e> Image<'e> {
    /// Images of pixels `[batch height width, channels]`.
    ///
    /// # Panics
    /// Where the pixels make no whole number of images.
    #[must_use]
    pub fn new(pixels: Expression<'e>, [height, width]: [usize; 2]) -> Self {
        let n_pixels = pixels.n_rows();
        assert!(
            n_pixels.is_multiple_of(height * width),
            "{n_pixels} pixels in images of {height} x {width}"
        );
        Self {
            pixels,
            height,
            width,
        }
    }

    /// Images of the same size with other pixels.
    #[must_use]
    pub fn with(self, pixels: Expression<'e>) -> Self {
        Self::new(pixels, [self.height, self.width])
    }

    /// Number of images.
    #[must_use]
    pub fn n_images(self) -> usize {
        self.pixels.n_rows() / (self.height * self.width)
    }

    /// Number of channels.
    #[must_use]
    pub fn n_channels(self) -> usize {
        self.pixels.n_columns()
    }

    /// Rectifier `max(x, 0)`.
    #[must_use]
    pub fn relu(self) -> Self {
        self.with(self.pixels.relu())
    }

    /// Hyperbolic tangent.
    #[must_use]
    pub fn tanh(self) -> Self {
        self.with(self.pixels.tanh())
    }

    /// Sum over the pixels of each channel, `[batch, channels]`.
    #[must_use]
    pub fn sum_pixels(self) -> Expression<'e> {
        self.pixels.sum_groups(self.height * self.width)
    }
}

impl Add for Image<'_> {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        self.with(self.pixels + other.pixels)
    }
}
