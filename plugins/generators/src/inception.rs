//! Inception-v3 in the form by which published Fréchet distances and inception scores are computed.
//!
//! C. Szegedy et al. 2015, "Rethinking the Inception architecture for computer vision", arXiv:1512.00567, in
//! the form of TensorFlow's graph of 2015-12-05, by which M. Heusel et al. 2017 (arXiv:1706.08500) compute
//! scores and which M. Seitzer's pytorch-fid translates. The weights are not part of this program: the user
//! gives the published PyTorch state dict as a safetensors file, `f32` or `f16`, with its names:
//! `Conv2d_1a_3x3.conv.weight`, `Mixed_5b.branch1x1.bn.running_mean`, `fc.weight`. Unneeded tensors may be
//! present or absent: `fc.bias` and the counters `num_batches_tracked`.
//!
//! | part | output | difference from other networks of this name |
//! |---|---|---|
//! | bilinear resize to 299 x 299, centres of pixels at halves (`align_corners=False`) | `[batch, 299, 299, 3]` | |
//! | stem: 3x3 of stride 2, 3x3, 3x3, largest of 3x3; 1x1, 3x3, largest of 3x3 | `[batch, 35, 35, 192]` | |
//! | A, three times: `Mixed_5b` to `5d` | `[batch, 35, 35, 288]` | means leave out the padding |
//! | B: `Mixed_6a` | `[batch, 17, 17, 768]` | |
//! | C, four times: `Mixed_6b` to `6e` | `[batch, 17, 17, 768]` | means leave out the padding |
//! | D: `Mixed_7a` | `[batch, 8, 8, 1280]` | |
//! | E: `Mixed_7b` | `[batch, 8, 8, 2048]` | means leave out the padding |
//! | E: `Mixed_7c` | `[batch, 8, 8, 2048]` | largest of 3x3 in place of the mean |
//! | mean over all pixels: the *features* (`pool3`) | `[batch, 2048]` | |
//! | features times `fc.weight`: the *logits* | `[batch, 1008]` | no bias; 1008 classes, 8 of them unused |
//!
//! The published inception score is computed from the softmax of these logits: its code multiplies `pool3` by
//! the matrix of the graph's last layer and adds no bias. Each convolution has no bias of its own and is
//! followed by batch normalisation (variance + 0.001) and a rectifier; the normalisation is folded into weight
//! and bias, in `f64`, when the file is read, which moves outputs by rounding only.
//!
//! Two properties follow pytorch-fid instead of the graph of 2015. That graph resizes with the corners of
//! pixels in the place of their centres (TensorFlow 1's `ResizeBilinear`), so features of images that are not
//! 299 x 299 differ slightly. And it takes bytes as `(byte - 128) / 128` where [-1, 1] is `byte / 127.5 - 1`.
//! Published code scores bytes, so a comparison rounds images to bytes first.
//!
//! The network is only evaluated, so its layers are computed one after the other, without a plan. Maps are
//! `[batch, height, width, channels]`, channels last; weights are laid out for the loops of the convolutions when they
//! are read. Features have the same bits on every processor.

mod maps;
mod plan;
mod weights;

use crate::feature_network::ImageFeatures;
use crate::image::direct_convolution::{Sizes, convolve, pack};
use crate::image::resize::bilinear;
use crate::images::CHANNELS;
use maps::Maps;
use plan::{BlockPlan, BranchPlan, LayerPlan, Pool};
use std::path::Path;
use weights::{Lookup, WeightFile};

pub use weights::InceptionError;

/// Height and width to which images are resized, pixels.
pub const SIZE: usize = 299;
/// Number of features of an image.
pub const FEATURES: usize = 2048;
/// Number of classes, 1000 of them those of `ImageNet`.
pub const CLASSES: usize = 1008;

/// The network.
#[derive(Debug)]
pub struct Inception {
    blocks: Vec<Block>,
    /// Logits of features.
    last: Convolution,
}

impl Inception {
    /// Reads the published weights.
    ///
    /// # Errors
    /// [`InceptionError`] where the file cannot be read or is not a safetensors file, or for the first tensor
    /// that is missing, cut off, of another shape or type, or not finite.
    pub fn read(path: &Path) -> Result<Self, InceptionError> {
        let file = WeightFile::read(path)?;
        Self::from_weights(&|name, shape| file.tensor(name, shape))
    }

    fn from_weights(lookup: Lookup) -> Result<Self, InceptionError> {
        let mut channels = CHANNELS;
        let mut blocks = Vec::new();
        for plan in plan::network() {
            blocks.push(Block::new(&plan, channels, lookup)?);
            channels = plan.outputs(channels);
        }
        let last = lookup("fc.weight", &[CLASSES, channels])?;
        let sizes = Sizes {
            n_images: 1,
            height: 1,
            width: 1,
            n_inputs: channels,
            n_outputs: CLASSES,
            kernel: [1, 1],
            stride: 1,
            padding: [0, 0],
        };
        Ok(Self {
            blocks,
            last: Convolution::packed(&last, &[0.0; CLASSES], sizes),
        })
    }

    /// Features `[batch, 2048]` and logits `[batch, 1008]` of `images` `[batch, height, width, 3]` in [-1, 1],
    /// of any size.
    ///
    /// A batch takes about 15 MB of memory per image.
    ///
    /// # Panics
    /// Where the numbers are no whole number of images.
    #[must_use]
    pub fn see(&self, images: &[f32], [height, width]: [usize; 2]) -> ImageFeatures {
        let images = if [height, width] == [SIZE; 2] {
            images.to_vec()
        } else {
            bilinear(images, CHANNELS, [height, width], [SIZE; 2])
        };
        let images = Maps::new(images, [SIZE, SIZE, CHANNELS]);
        let means = self.blocks.iter().fold(images, |x, block| block.see(&x)).means();
        let logits = self.last.convolved(&means).entries;
        ImageFeatures {
            features: means.entries,
            logits,
        }
    }
}

/// Branches with the same input; their outputs are concatenated along the channels.
#[derive(Debug)]
struct Block {
    branches: Vec<Branch>,
}

/// A pooling, then a chain of convolutions, then parallel convolutions of the chain's output.
#[derive(Debug)]
struct Branch {
    pool: Option<Pool>,
    chain: Vec<Convolution>,
    fork: Vec<Convolution>,
}

/// A convolution with its normalisation folded in, followed by a rectifier.
#[derive(Debug)]
struct Convolution {
    /// Weight and bias, laid out for the loops.
    panels: Vec<f32>,
    /// Sizes, but for those of the images.
    sizes: Sizes,
}

impl Block {
    fn new(plan: &BlockPlan, inputs: usize, lookup: Lookup) -> Result<Self, InceptionError> {
        let branches = plan.branches.iter();
        let branches = branches.map(|branch| Branch::new(plan.name, branch, inputs, lookup));
        Ok(Self {
            branches: branches.collect::<Result<_, _>>()?,
        })
    }

    fn see(&self, x: &Maps) -> Maps {
        let outputs: Vec<Maps> = self.branches.iter().flat_map(|branch| branch.see(x)).collect();
        Maps::joined(&outputs)
    }
}

impl Branch {
    fn new(block: &str, plan: &BranchPlan, inputs: usize, lookup: Lookup) -> Result<Self, InceptionError> {
        let mut channels = inputs;
        let mut chain = Vec::new();
        for layer in &plan.chain {
            chain.push(Convolution::new(block, layer, channels, lookup)?);
            channels = layer.outputs;
        }
        let fork = plan.fork.iter();
        let fork = fork.map(|layer| Convolution::new(block, layer, channels, lookup));
        Ok(Self {
            pool: plan.pool,
            chain,
            fork: fork.collect::<Result<_, _>>()?,
        })
    }

    fn see(&self, x: &Maps) -> Vec<Maps> {
        let pooled = self.pool.map(|pool| x.pooled(pool));
        let first = pooled.as_ref().unwrap_or(x);
        let mut layers = self.chain.iter();
        let x = layers
            .next()
            .map_or_else(|| first.clone(), |layer| layer.see(first));
        let x = layers.fold(x, |x, layer| layer.see(&x));
        if self.fork.is_empty() {
            return vec![x];
        }
        self.fork.iter().map(|layer| layer.see(&x)).collect()
    }
}

impl Convolution {
    fn new(block: &str, plan: &LayerPlan, inputs: usize, lookup: Lookup) -> Result<Self, InceptionError> {
        let shape = [plan.outputs, inputs, plan.kernel[0], plan.kernel[1]];
        let (weight, bias) = weights::folded(&plan.name_in(block), shape, lookup)?;
        let sizes = Sizes {
            n_images: 1,
            height: plan.kernel[0],
            width: plan.kernel[1],
            n_inputs: inputs,
            n_outputs: plan.outputs,
            kernel: plan.kernel,
            stride: plan.stride,
            padding: plan.padding,
        };
        Ok(Self::packed(&weight, &bias, sizes))
    }

    /// A convolution with a weight `[outputs, inputs, height, width]`.
    fn packed(weight: &[f32], bias: &[f32], sizes: Sizes) -> Self {
        let (n_inputs, n_outputs) = (sizes.n_inputs, sizes.n_outputs);
        let n_places = sizes.kernel[0] * sizes.kernel[1];
        // To `[height, width, inputs, outputs]`.
        let mut turned = vec![0.0; weight.len()];
        for (at, w) in weight.iter().enumerate() {
            let (output, input, place) = (at / n_places / n_inputs, at / n_places % n_inputs, at % n_places);
            turned[(place * n_inputs + input) * n_outputs + output] = *w;
        }
        let mut panels = vec![0.0; sizes.panels()];
        pack(&turned, bias, &sizes, &mut panels);
        Self { panels, sizes }
    }

    fn see(&self, x: &Maps) -> Maps {
        let mut y = self.convolved(x);
        for entry in &mut y.entries {
            *entry = entry.max(0.0);
        }
        y
    }

    fn convolved(&self, x: &Maps) -> Maps {
        let [height, width, _] = x.shape;
        let sizes = Sizes {
            n_images: x.n_images(),
            height,
            width,
            ..self.sizes
        };
        let [rows, columns] = sizes.result();
        let mut output = vec![0.0; sizes.n_result_pixels() * sizes.n_outputs];
        let frames = &mut vec![0.0; sizes.frames()];
        convolve(
            &x.entries,
            &self.panels,
            &sizes,
            &sizes.starts(),
            &mut output,
            frames,
        );
        Maps::new(output, [rows, columns, sizes.n_outputs])
    }
}

#[cfg(test)]
mod tests;
