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
use crate::layers::{Convolution, PassMode, SpectralLinear};
use crate::memory::StatefulModule;
use burn::module::Module;
use burn::tensor::{Device, Tensor};
use numerics::image::pointwise::relu;
use numerics::image::resize::{average_pool, sum_pixels};
use rand::RngCore;

/// A discriminator with one block for each cell of its generator.
#[derive(Module, Debug)]
pub struct Discriminator {
    pub(crate) ending: LastLayers,
    pub(crate) blocks: Vec<Residual>,
    #[module(skip)]
    pub(crate) n_channels: usize,
}

/// The last block and the linear layer, which all stages share.
#[derive(Module, Debug)]
pub(crate) struct LastLayers {
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
#[derive(Module, Debug)]
pub(crate) struct Residual {
    first: Convolution,
    second: Convolution,
    shortcut: Option<Convolution>,
    #[module(skip)]
    kind: BlockKind,
}

impl Discriminator {
    /// The last block and the linear layer, for maps with `n_channels`; it must grow at least once before use.
    pub fn new(n_channels: usize, rng: &mut impl RngCore, device: &Device) -> Self {
        let ending = LastLayers {
            block: Residual::new(BlockKind::Keeping, n_channels, rng, device),
            linear: SpectralLinear::new([n_channels, 1], rng, device),
        };
        Self {
            ending,
            blocks: Vec::new(),
            n_channels,
        }
    }

    /// Adds a block before the last one; the other parts keep their numbers.
    pub fn grow(&mut self, rng: &mut impl RngCore, device: &Device) {
        let kind = match self.blocks.len() {
            0 => BlockKind::First,
            1 => BlockKind::Halving,
            _ => BlockKind::Keeping,
        };
        self.blocks
            .push(Residual::new(kind, self.n_channels, rng, device));
    }

    /// Scores `[batch, 1]` of images `[batch, side, side, 3]`.
    pub fn forward(&mut self, images: Tensor<4>, pass: PassMode) -> Tensor<2> {
        let blocks = self.blocks.iter_mut().chain([&mut self.ending.block]);
        let map = relu(blocks.fold(images, |map, block| block.forward(map, pass)));
        let scores = self.ending.linear.forward(sum_pixels(map), pass);
        scores.flatten(1, 3)
    }
}

impl StatefulModule for Discriminator {
    fn state_vectors(&mut self) -> Vec<&mut Vec<f32>> {
        let LastLayers { block, linear } = &mut self.ending;
        let blocks = self.blocks.iter_mut().chain([block]);
        let convolutions = blocks.flat_map(|block| {
            let both = [&mut block.first, &mut block.second];
            both.into_iter().chain(block.shortcut.as_mut())
        });
        let of_convolutions = convolutions.flat_map(StatefulModule::state_vectors);
        of_convolutions.chain(linear.state_vectors()).collect()
    }
}

impl Residual {
    fn new(kind: BlockKind, n_channels: usize, rng: &mut impl RngCore, device: &Device) -> Self {
        let n_inputs = if kind == BlockKind::First {
            IMAGE_CHANNELS
        } else {
            n_channels
        };
        let mut convolution =
            |side, n_inputs| Convolution::spectral(side, [n_inputs, n_channels], rng, device);
        Self {
            first: convolution(3, n_inputs),
            second: convolution(3, n_channels),
            shortcut: (kind != BlockKind::Keeping).then(|| convolution(1, n_inputs)),
            kind,
        }
    }

    fn forward(&mut self, input: Tensor<4>, pass: PassMode) -> Tensor<4> {
        let rectified = if self.kind == BlockKind::First {
            input.clone()
        } else {
            relu(input.clone())
        };
        let hidden = relu(self.first.forward(rectified, pass));
        let residual = self.second.forward(hidden, pass);
        match (&mut self.shortcut, self.kind) {
            (Some(shortcut), BlockKind::First) => {
                average_pool(residual) + shortcut.forward(average_pool(input), pass)
            }
            (Some(shortcut), _) => average_pool(residual) + average_pool(shortcut.forward(input, pass)),
            (None, _) => residual + input,
        }
    }
}

#[cfg(test)]
mod tests;
