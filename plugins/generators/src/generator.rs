//! The generator of AutoGAN and E2GAN, grown cell by cell.
//!
//! A linear stem makes a map of `bottom` x `bottom` pixels, each cell doubles its sides, and one head shared by
//! all stages makes an image of the last map: batch normalisation, rectifier, convolution 3x3 to three channels,
//! tangent. With `x` the input of a cell and `e` the enlargement by two of its architecture:
//!
//! - `h = block_1(x)`, which enlarges, plus for each skip `conv 1x1 (e(s))`, where `s` is the skip output of an
//!   earlier cell, enlarged to the size of `h`;
//! - the skip output of the cell is this `h`: as in the released programs, whose additions are made in place,
//!   it includes the skips that were added to it;
//! - output `block_2(h)`, plus `conv 1x1 (e(x))` with a shortcut.
//!
//! A block is upsampling (in the first one), convolution 3x3, normalisation and rectifier, or normalisation,
//! rectifier, upsampling and convolution. Every map has the same number of channels.

use crate::architecture::{CellArchitecture, Normalisation, Order};
use crate::layers::{Convolution, Enlargement, NormRelu, PassMode, Stem};
use crate::memory::StatefulModule;
use burn::module::Module;
use burn::tensor::{Device, Tensor};
use numerics::image::{pointwise, resize};
use numerics::network::values;
use rand::RngCore;

/// Channels of an image.
pub const IMAGE_CHANNELS: usize = 3;

/// Sizes that are not part of an architecture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GeneratorSizes {
    /// Height and width of the stem's map, pixels.
    pub bottom: usize,
    /// Channels of every map.
    pub channels: usize,
    /// Length of a latent vector.
    pub latent: usize,
}

/// A generator with the cells by which it has grown.
#[derive(Module, Debug)]
pub struct Generator {
    pub(crate) trunk: Trunk,
    pub(crate) cells: Vec<Cell>,
    #[module(skip)]
    pub(crate) sizes: GeneratorSizes,
}

/// The stem and the head, which all stages share.
#[derive(Module, Debug)]
pub(crate) struct Trunk {
    stem: Stem,
    norm: NormRelu,
    head: Convolution,
}

/// Images and last map of a batch of latent vectors.
#[derive(Debug, Clone)]
pub struct GeneratedBatch {
    /// Images `[batch, side, side, 3]` between -1 and 1.
    pub images: Tensor<4>,
    /// The map of the last cell `[batch, side, side, channels]`, or of the stem where there is none.
    pub map: Tensor<4>,
}

impl Generator {
    /// A stem and a head without cells.
    pub fn new(sizes: GeneratorSizes, rng: &mut impl RngCore, device: &Device) -> Self {
        let GeneratorSizes {
            bottom,
            channels,
            latent,
        } = sizes;
        let trunk = Trunk {
            stem: Stem::new(latent, [bottom, bottom, channels], rng, device),
            norm: NormRelu::new(Normalisation::Batch, channels, rng, device),
            head: Convolution::new(3, [channels, IMAGE_CHANNELS], rng, device),
        };
        Self {
            trunk,
            cells: Vec::new(),
            sizes,
        }
    }

    /// Adds a cell; the other parts keep their numbers.
    pub fn grow(&mut self, architecture: &CellArchitecture, rng: &mut impl RngCore, device: &Device) {
        let at = self.cells.len();
        self.cells
            .push(Cell::new(architecture, at, self.sizes.channels, rng, device));
    }

    /// Number of cells so far.
    #[must_use]
    pub fn n_cells(&self) -> usize {
        self.cells.len()
    }

    /// Height and width of the images, pixels.
    #[must_use]
    pub fn side(&self) -> usize {
        self.sizes.bottom << self.cells.len()
    }

    /// The sizes given to [`Generator::new`].
    #[must_use]
    pub fn sizes(&self) -> GeneratorSizes {
        self.sizes
    }

    /// Images and last map of latent vectors `[batch, latent]`.
    pub fn forward(&mut self, latents: Tensor<2>, pass: PassMode) -> GeneratedBatch {
        let mut map = self.trunk.stem.forward(latents);
        let mut skip_outputs = Vec::new();
        for cell in &mut self.cells {
            let (skip_output, output) = cell.forward(map, &skip_outputs, pass);
            skip_outputs.push(skip_output);
            map = output;
        }
        let rectified = self.trunk.norm.forward(map.clone(), pass);
        GeneratedBatch {
            images: pointwise::tanh(self.trunk.head.forward(rectified, pass)),
            map,
        }
    }

    /// As [`Generator::forward`] in evaluation: running statistics stay unchanged.
    #[must_use]
    pub fn evaluate(&self, latents: Tensor<2>) -> GeneratedBatch {
        self.clone().forward(latents, PassMode::Evaluation)
    }
}

impl GeneratedBatch {
    /// The mean over the batch of the map resized to one pixel, `[channels]`: for a map with even sides the
    /// mean of its four central pixels.
    #[must_use]
    #[allow(
        clippy::cast_precision_loss,
        reason = "a batch has far fewer than 2^24 images"
    )]
    pub fn central_features(&self) -> Vec<f32> {
        let [n_images, .., n_channels] = self.map.dims();
        let centres = values(resize::resize_bilinear(self.map.clone(), [1, 1]));
        let mut features = vec![0.0; n_channels];
        for centre in centres.chunks_exact(n_channels) {
            let pairs = features.iter_mut().zip(centre);
            pairs.for_each(|(feature, x)| *feature += x / n_images as f32);
        }
        features
    }
}

impl StatefulModule for Generator {
    fn state_vectors(&mut self) -> Vec<&mut Vec<f32>> {
        let cells = self
            .cells
            .iter_mut()
            .flat_map(|cell| [&mut cell.first, &mut cell.second]);
        let norms = cells.map(|block| &mut block.norm);
        norms
            .chain([&mut self.trunk.norm])
            .flat_map(StatefulModule::state_vectors)
            .collect()
    }
}

/// One cell of a generator.
#[derive(Module, Debug)]
pub(crate) struct Cell {
    first: Block,
    second: Block,
    shortcut: Option<SideBranch>,
    skips: Vec<SideBranch>,
    /// The earlier cell of each skip.
    #[module(skip)]
    from: Vec<usize>,
}

/// A branch beside the blocks: enlargement and convolution 1x1.
#[derive(Module, Debug)]
struct SideBranch {
    enlargement: Enlargement,
    convolution: Convolution,
}

impl Cell {
    /// Cell number `at` of a generator, counted from 0.
    pub(crate) fn new(
        architecture: &CellArchitecture,
        at: usize,
        n_channels: usize,
        rng: &mut impl RngCore,
        device: &Device,
    ) -> Self {
        let upsampling = architecture.upsampling;
        let first = Block::new(architecture, true, n_channels, rng, device);
        let second = Block::new(architecture, false, n_channels, rng, device);
        let mut side = |doublings: usize| SideBranch {
            enlargement: Enlargement::new(upsampling, 1 << doublings, n_channels, rng, device),
            convolution: Convolution::new(1, [n_channels; 2], rng, device),
        };
        let shortcut = architecture.shortcut.then(|| side(1));
        let chosen = architecture.skips.iter().take(at).enumerate();
        let from: Vec<usize> = chosen
            .filter(|(_, skip)| **skip)
            .map(|(earlier, _)| earlier)
            .collect();
        Self {
            first,
            second,
            shortcut,
            skips: from.iter().map(|earlier| side(at - earlier)).collect(),
            from,
        }
    }

    /// The cell's skip output and its output.
    fn forward(
        &mut self,
        input: Tensor<4>,
        skip_outputs: &[Tensor<4>],
        pass: PassMode,
    ) -> (Tensor<4>, Tensor<4>) {
        let mut hidden = self.first.forward(input.clone(), pass);
        for (skip, from) in self.skips.iter_mut().zip(&self.from) {
            hidden = hidden + skip.forward(skip_outputs[*from].clone(), pass);
        }
        let mut output = self.second.forward(hidden.clone(), pass);
        if let Some(shortcut) = &mut self.shortcut {
            output = output + shortcut.forward(input, pass);
        }
        (hidden, output)
    }
}

impl SideBranch {
    fn forward(&mut self, map: Tensor<4>, pass: PassMode) -> Tensor<4> {
        self.convolution.forward(self.enlargement.forward(map), pass)
    }
}

/// Convolution, normalisation and rectifier, in the order of the architecture.
#[derive(Module, Debug)]
pub(crate) struct Block {
    enlargement: Option<Enlargement>,
    convolution: Convolution,
    norm: NormRelu,
    #[module(skip)]
    order: Order,
}

impl Block {
    /// A block that doubles the sides where `enlarges` is set.
    pub(crate) fn new(
        architecture: &CellArchitecture,
        enlarges: bool,
        n_channels: usize,
        rng: &mut impl RngCore,
        device: &Device,
    ) -> Self {
        let kind = architecture.upsampling;
        Self {
            enlargement: enlarges.then(|| Enlargement::new(kind, 2, n_channels, rng, device)),
            convolution: Convolution::new(3, [n_channels; 2], rng, device),
            norm: NormRelu::new(architecture.normalisation, n_channels, rng, device),
            order: architecture.order,
        }
    }

    pub(crate) fn forward(&mut self, map: Tensor<4>, pass: PassMode) -> Tensor<4> {
        match self.order {
            Order::ConvolutionFirst => {
                let map = self.convolution.forward(self.enlarged(map), pass);
                self.norm.forward(map, pass)
            }
            Order::NormalisationFirst => {
                let map = self.norm.forward(map, pass);
                self.convolution.forward(self.enlarged(map), pass)
            }
        }
    }

    fn enlarged(&self, map: Tensor<4>) -> Tensor<4> {
        match &self.enlargement {
            Some(enlargement) => enlargement.forward(map),
            None => map,
        }
    }
}

#[cfg(test)]
mod tests;
