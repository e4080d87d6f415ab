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
use crate::image::Image;
use crate::layers::{Convolution, Enlargement, NormRelu, Parameter, PassMode, Start, Stem};
use plan::{Expression, Plans, State};
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

/// The form of a generator, with the cells by which it has grown. Its numbers are in a state.
#[derive(Debug, Clone)]
pub struct Generator {
    trunk: Trunk,
    cells: Vec<Cell>,
    sizes: GeneratorSizes,
    parameters: Vec<Parameter>,
}

/// Beginning of the names of a generator's numbers.
pub const PREFIX: &str = "generator";

/// The stem and the head, which all stages share.
#[derive(Debug, Clone)]
struct Trunk {
    stem: Stem,
    norm: NormRelu,
    head: Convolution,
}

/// Images and last map of latent vectors, in equations.
#[derive(Debug, Clone, Copy)]
pub struct Generated<'e> {
    /// Images between -1 and 1.
    pub images: Image<'e>,
    /// The map of the last cell, or of the stem where there is none.
    pub map: Image<'e>,
}

impl Generator {
    /// A stem and a head without cells, whose numbers are added to a state.
    pub fn new(sizes: GeneratorSizes, state: &mut State<f32>, rng: &mut impl RngCore) -> Self {
        let GeneratorSizes {
            bottom,
            channels,
            latent,
        } = sizes;
        let mut parameters = Vec::new();
        let start = &mut Start {
            state,
            rng,
            parameters: &mut parameters,
        };
        let name = |part: &str| format!("{PREFIX}.trunk.{part}");
        let trunk = Trunk {
            stem: Stem::new(name("stem"), latent, [bottom, bottom, channels], start),
            norm: NormRelu::new(name("norm"), Normalisation::Batch, channels, start),
            head: Convolution::new(name("head"), 3, [channels, IMAGE_CHANNELS], start),
        };
        Self {
            trunk,
            cells: Vec::new(),
            sizes,
            parameters,
        }
    }

    /// Adds a cell; the other parts keep their numbers.
    pub fn grow(&mut self, architecture: &CellArchitecture, state: &mut State<f32>, rng: &mut impl RngCore) {
        let start = &mut Start {
            state,
            rng,
            parameters: &mut self.parameters,
        };
        let cell = Cell::new(architecture, self.cells.len(), self.sizes.channels, start);
        self.cells.push(cell);
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

    /// Trained parameters: those of the stem, the head, and cell after cell.
    #[must_use]
    pub fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }

    /// Images and last map of latent vectors `[batch, latent]`.
    #[must_use]
    pub fn apply<'e>(&self, latents: Expression<'e>, pass: PassMode) -> Generated<'e> {
        let mut map = self.trunk.stem.apply(latents);
        let mut skip_outputs = Vec::new();
        for cell in &self.cells {
            let (skip_output, output) = cell.apply(map, &skip_outputs, pass);
            skip_outputs.push(skip_output);
            map = output;
        }
        let rectified = self.trunk.norm.apply(map, pass);
        Generated {
            images: self.trunk.head.apply(rectified, pass).tanh(),
            map,
        }
    }
}

/// The mean over the batch of maps resized to one pixel, `[1, channels]`: for a map with even sides the mean of its
/// four central pixels.
#[must_use]
pub fn central_features(map: Image<'_>) -> Expression<'_> {
    map.resize_bilinear([1, 1]).pixels.mean_rows()
}

/// A generator with its numbers, for evaluation: running statistics stay unchanged.
#[derive(Debug, Clone)]
pub struct FinishedGenerator {
    generator: Generator,
    state: State<f32>,
    plans: Plans,
}

/// Images of a batch of latent vectors.
#[derive(Debug, Clone, PartialEq)]
pub struct GeneratedBatch {
    /// Images `[batch, side, side, 3]` between -1 and 1.
    pub images: Vec<f32>,
    /// Mean over the batch of the last map's central pixels, `[channels]`; see [`central_features`].
    pub central_features: Vec<f32>,
}

impl FinishedGenerator {
    /// A generator whose numbers are in a state.
    #[must_use]
    pub fn new(generator: Generator, state: State<f32>) -> Self {
        Self {
            generator,
            state,
            plans: Plans::default(),
        }
    }

    /// Height and width of the images, pixels.
    #[must_use]
    pub fn side(&self) -> usize {
        self.generator.side()
    }

    /// Images of latent vectors `[batch, latent]`.
    ///
    /// # Panics
    /// Where the numbers are no whole number of latent vectors.
    pub fn evaluate(&mut self, latents: &[f32]) -> GeneratedBatch {
        let (generator, n_latent) = (&self.generator, self.generator.sizes.latent);
        let plan = self.plans.of_rows(latents.len() / n_latent, |equations| {
            let latents = equations.input("latents", [latents.len() / n_latent, n_latent]);
            equations.routine("evaluate");
            let Generated { images, map } = generator.apply(latents, PassMode::Evaluation);
            equations.output("images", images.pixels);
            equations.output("central_features", central_features(map));
        });
        plan.write("latents", latents);
        plan.run("evaluate", &mut self.state);
        let read = |name: &str| plan.entries(name).to_vec();
        GeneratedBatch {
            images: read("images"),
            central_features: read("central_features"),
        }
    }
}

/// One cell of a generator.
#[derive(Debug, Clone)]
struct Cell {
    first: Block,
    second: Block,
    shortcut: Option<SideBranch>,
    skips: Vec<SideBranch>,
    /// The earlier cell of each skip.
    from: Vec<usize>,
}

/// A branch beside the blocks: enlargement and convolution 1x1.
#[derive(Debug, Clone)]
struct SideBranch {
    enlargement: Enlargement,
    convolution: Convolution,
}

impl Cell {
    /// Cell number `at` of a generator, counted from 0.
    fn new(architecture: &CellArchitecture, at: usize, n_channels: usize, start: &mut Start<'_>) -> Self {
        let (upsampling, name) = (architecture.upsampling, format!("{PREFIX}.cells.{at}"));
        let first = Block::new(format!("{name}.first"), architecture, true, n_channels, start);
        let second = Block::new(format!("{name}.second"), architecture, false, n_channels, start);
        let mut side = |part: String, doublings: usize| {
            let name = |layer: &str| format!("{name}.{part}.{layer}");
            SideBranch {
                enlargement: Enlargement::new(
                    name("enlargement"),
                    upsampling,
                    1 << doublings,
                    n_channels,
                    start,
                ),
                convolution: Convolution::new(name("convolution"), 1, [n_channels; 2], start),
            }
        };
        let shortcut = architecture.shortcut.then(|| side("shortcut".into(), 1));
        let chosen = architecture.skips.iter().take(at).enumerate();
        let from: Vec<usize> = chosen
            .filter(|(_, skip)| **skip)
            .map(|(earlier, _)| earlier)
            .collect();
        let skips = from.iter().enumerate();
        let skips = skips
            .map(|(place, earlier)| side(format!("skips.{place}"), at - earlier))
            .collect();
        Self {
            first,
            second,
            shortcut,
            skips,
            from,
        }
    }

    /// The cell's skip output and its output.
    fn apply<'e>(
        &self,
        input: Image<'e>,
        skip_outputs: &[Image<'e>],
        pass: PassMode,
    ) -> (Image<'e>, Image<'e>) {
        let mut hidden = self.first.apply(input, pass);
        for (skip, from) in self.skips.iter().zip(&self.from) {
            hidden = hidden + skip.apply(skip_outputs[*from], pass);
        }
        let mut output = self.second.apply(hidden, pass);
        if let Some(shortcut) = &self.shortcut {
            output = output + shortcut.apply(input, pass);
        }
        (hidden, output)
    }
}

impl SideBranch {
    fn apply<'e>(&self, map: Image<'e>, pass: PassMode) -> Image<'e> {
        self.convolution.apply(self.enlargement.apply(map), pass)
    }
}

/// Convolution, normalisation and rectifier, in the order of the architecture.
#[derive(Debug, Clone)]
struct Block {
    enlargement: Option<Enlargement>,
    convolution: Convolution,
    norm: NormRelu,
    order: Order,
}

impl Block {
    /// A block that doubles the sides where `enlarges` is set.
    fn new(
        name: String,
        architecture: &CellArchitecture,
        enlarges: bool,
        n_channels: usize,
        start: &mut Start<'_>,
    ) -> Self {
        let kind = architecture.upsampling;
        let part = |part: &str| format!("{name}.{part}");
        Self {
            enlargement: enlarges.then(|| Enlargement::new(part("enlargement"), kind, 2, n_channels, start)),
            convolution: Convolution::new(part("convolution"), 3, [n_channels; 2], start),
            norm: NormRelu::new(part("norm"), architecture.normalisation, n_channels, start),
            order: architecture.order,
        }
    }

    fn apply<'e>(&self, map: Image<'e>, pass: PassMode) -> Image<'e> {
        match self.order {
            Order::ConvolutionFirst => {
                let map = self.convolution.apply(self.enlarged(map), pass);
                self.norm.apply(map, pass)
            }
            Order::NormalisationFirst => {
                let map = self.norm.apply(map, pass);
                self.convolution.apply(self.enlarged(map), pass)
            }
        }
    }

    fn enlarged<'e>(&self, map: Image<'e>) -> Image<'e> {
        match &self.enlargement {
            Some(enlargement) => enlargement.apply(map),
            None => map,
        }
    }
}

#[cfg(test)]
mod tests;
