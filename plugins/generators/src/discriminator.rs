//! The discriminator of AutoGAN and E2GAN: residual blocks with spectral normalisation, grown with the generator.
//!
//! Miyato et al. 2018, arXiv:1802.05957, table 3b, as the released programs of AutoGAN build it. With `n` cells
//! in the generator an image goes through the first `n` of three blocks and then the last one, a rectifier, a sum
//! over pixels and a linear layer to one number. The first two blocks halve the sides:
//!
//! - first block: `pool(conv(relu(conv(x)))) + conv 1x1 (pool(x))`;
//! - second: `pool(conv(relu(conv(relu(x))))) + pool(conv 1x1 (x))`;
//! - third and last: `conv(relu(conv(relu(x)))) + x`.

use crate::generator::IMAGE_CHANNELS;
use crate::image::Image;
use crate::layers::{Convolution, Parameter, PassMode, SpectralLinear, Start};
use plan::{Expression, State};
use rand::RngCore;

/// Beginning of the names of a discriminator's numbers.
pub const PREFIX: &str = "discriminator";

/// The form of a discriminator with one block for each cell of its generator. Its numbers are in a state.
#[derive(Debug, Clone)]
pub struct Discriminator {
    ending: LastLayers,
    blocks: Vec<Residual>,
    n_channels: usize,
    parameters: Vec<Parameter>,
}

/// The last block and the linear layer, which all stages share.
#[derive(Debug, Clone)]
struct LastLayers {
    block: Residual,
    linear: SpectralLinear,
}

/// Kind of a block, by its input and its change of size.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum BlockKind {
    /// Takes the image, and halves the sides.
    First,
    /// Halves the sides.
    Halving,
    /// Keeps the sides.
    Keeping,
}

/// Two convolutions with a shortcut.
#[derive(Debug, Clone)]
struct Residual {
    first: Convolution,
    second: Convolution,
    shortcut: Option<Convolution>,
    kind: BlockKind,
}

impl Discriminator {
    /// The last block and the linear layer, for maps with `n_channels`, whose numbers are added to a state; it must
    /// grow at least once before use.
    pub fn new(n_channels: usize, state: &mut State<f32>, rng: &mut impl RngCore) -> Self {
        let mut parameters = Vec::new();
        let start = &mut Start {
            state,
            rng,
            parameters: &mut parameters,
        };
        let name = |part: &str| format!("{PREFIX}.ending.{part}");
        let ending = LastLayers {
            block: Residual::new(name("block"), BlockKind::Keeping, n_channels, start),
            linear: SpectralLinear::new(name("linear"), [n_channels, 1], start),
        };
        Self {
            ending,
            blocks: Vec::new(),
            n_channels,
            parameters,
        }
    }

    /// Adds a block before the last one; the other parts keep their numbers.
    pub fn grow(&mut self, state: &mut State<f32>, rng: &mut impl RngCore) {
        let kind = match self.blocks.len() {
            0 => BlockKind::First,
            1 => BlockKind::Halving,
            _ => BlockKind::Keeping,
        };
        let start = &mut Start {
            state,
            rng,
            parameters: &mut self.parameters,
        };
        let name = format!("{PREFIX}.blocks.{}", self.blocks.len());
        self.blocks
            .push(Residual::new(name, kind, self.n_channels, start));
    }

    /// Trained parameters: those of the last layers, and block after block.
    #[must_use]
    pub fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }

    /// Scores `[batch, 1]` of images with 3 channels.
    #[must_use]
    pub fn apply<'e>(&self, images: Image<'e>, pass: PassMode) -> Expression<'e> {
        let blocks = self.blocks.iter().chain([&self.ending.block]);
        let map = blocks.fold(images, |map, block| block.apply(map, pass)).relu();
        self.ending.linear.apply(map.sum_pixels(), pass)
    }
}

impl Residual {
    fn new(name: String, kind: BlockKind, n_channels: usize, start: &mut Start<'_>) -> Self {
        let n_inputs = if kind == BlockKind::First {
            IMAGE_CHANNELS
        } else {
            n_channels
        };
        let mut convolution = |part: &str, side, n_inputs| {
            Convolution::spectral(format!("{name}.{part}"), side, [n_inputs, n_channels], start)
        };
        Self {
            first: convolution("first", 3, n_inputs),
            second: convolution("second", 3, n_channels),
            shortcut: (kind != BlockKind::Keeping).then(|| convolution("shortcut", 1, n_inputs)),
            kind,
        }
    }

    fn apply<'e>(&self, input: Image<'e>, pass: PassMode) -> Image<'e> {
        let rectified = if self.kind == BlockKind::First {
            input
        } else {
            input.relu()
        };
        let hidden = self.first.apply(rectified, pass).relu();
        let residual = self.second.apply(hidden, pass);
        match (&self.shortcut, self.kind) {
            (Some(shortcut), BlockKind::First) => {
                residual.average_pool() + shortcut.apply(input.average_pool(), pass)
            }
            (Some(shortcut), _) => residual.average_pool() + shortcut.apply(input, pass).average_pool(),
            (None, _) => residual + input,
        }
    }
}

#[cfg(test)]
mod tests;
