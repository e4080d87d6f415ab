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
//! | bilinear resize to 299 x 299, centres of pixels at halves (`align_corners=False`) | `[batch, 3, 299, 299]` | |
//! | stem: 3x3 of stride 2, 3x3, 3x3, largest of 3x3; 1x1, 3x3, largest of 3x3 | `[batch, 192, 35, 35]` | |
//! | A, three times: `Mixed_5b` to `5d` | `[batch, 288, 35, 35]` | means leave out the padding |
//! | B: `Mixed_6a` | `[batch, 768, 17, 17]` | |
//! | C, four times: `Mixed_6b` to `6e` | `[batch, 768, 17, 17]` | means leave out the padding |
//! | D: `Mixed_7a` | `[batch, 1280, 8, 8]` | |
//! | E: `Mixed_7b` | `[batch, 2048, 8, 8]` | means leave out the padding |
//! | E: `Mixed_7c` | `[batch, 2048, 8, 8]` | largest of 3x3 in place of the mean |
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
//! Convolutions are `burn`'s, whose matrix products are summed in blocks that follow the caches of the
//! processor: features are the same bits for any number of workers, and equal up to rounding on another kind of
//! processor.

mod plan;
mod weights;

use burn::tensor::activation::relu;
use burn::tensor::module::{avg_pool2d, conv2d, max_pool2d};
use burn::tensor::ops::{AvgPoolOptions, ConvOptions, MaxPoolOptions};
use burn::tensor::{Tensor, TensorData};
use numerics::image::resize::resize_bilinear;
use numerics::network::device;
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

/// The network, without gradients.
#[derive(Debug)]
pub struct Inception {
    blocks: Vec<Block>,
    /// `[features, classes]`.
    last: Tensor<2>,
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
        let mut channels = crate::images::CHANNELS;
        let mut blocks = Vec::new();
        for plan in plan::network() {
            blocks.push(Block::new(&plan, channels, lookup)?);
            channels = plan.outputs(channels);
        }
        let last = lookup("fc.weight", &[CLASSES, channels])?;
        let last = Tensor::<2>::from_data(TensorData::new(last, [CLASSES, channels]), &device());
        Ok(Self {
            blocks,
            last: last.transpose(),
        })
    }

    /// Features `[batch, 2048]` and logits `[batch, 1008]` of `images` `[batch, height, width, 3]` in [-1, 1],
    /// of any size. No gradients flow back to the images.
    ///
    /// A batch takes about 15 MB of memory per image.
    #[must_use]
    pub fn see(&self, images: Tensor<4>) -> (Tensor<2>, Tensor<2>) {
        let features = means(self.blocks.iter().fold(planes(images), |x, block| block.see(x)));
        (features.clone(), features.matmul(self.last.clone()))
    }
}

/// `[batch, 3, 299, 299]`.
fn planes(images: Tensor<4>) -> Tensor<4> {
    let images = if images.is_autodiff() {
        images.inner()
    } else {
        images
    };
    let [_, height, width, _] = images.dims();
    let images = if [height, width] == [SIZE; 2] {
        images
    } else {
        resize_bilinear(images, [SIZE; 2])
    };
    images.permute([0, 3, 1, 2])
}

/// `[batch, channels]` from `[batch, channels, height, width]`.
fn means(x: Tensor<4>) -> Tensor<2> {
    let [batch, channels, height, width] = x.dims();
    x.reshape([batch, channels, height * width])
        .mean_dim(2)
        .reshape([batch, channels])
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
    /// `[outputs, inputs, height, width]`.
    weight: Tensor<4>,
    /// `[outputs]`.
    bias: Tensor<1>,
    options: ConvOptions<2>,
}

impl Block {
    fn new(plan: &BlockPlan, inputs: usize, lookup: Lookup) -> Result<Self, InceptionError> {
        let branches = plan.branches.iter();
        let branches = branches.map(|branch| Branch::new(plan.name, branch, inputs, lookup));
        Ok(Self {
            branches: branches.collect::<Result<_, _>>()?,
        })
    }

    /// `[batch, channels, height, width]` in and out.
    fn see(&self, x: Tensor<4>) -> Tensor<4> {
        let outputs = self.branches.iter().flat_map(|branch| branch.see(x.clone()));
        Tensor::cat(outputs.collect(), 1)
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

    fn see(&self, x: Tensor<4>) -> Vec<Tensor<4>> {
        let x = match self.pool {
            None => x,
            Some(pool) => pool_3x3(x, pool),
        };
        let x = self.chain.iter().fold(x, |x, convolution| convolution.see(x));
        if self.fork.is_empty() {
            return vec![x];
        }
        let fork = self.fork.iter();
        fork.map(|convolution| convolution.see(x.clone())).collect()
    }
}

impl Convolution {
    fn new(block: &str, plan: &LayerPlan, inputs: usize, lookup: Lookup) -> Result<Self, InceptionError> {
        let shape = [plan.outputs, inputs, plan.kernel[0], plan.kernel[1]];
        let (weight, bias) = weights::folded(&plan.name_in(block), shape, lookup)?;
        Ok(Self {
            weight: Tensor::from_data(TensorData::new(weight, shape), &device()),
            bias: Tensor::from_data(TensorData::new(bias, [plan.outputs]), &device()),
            options: ConvOptions::new([plan.stride; 2], plan.padding, [1, 1], 1),
        })
    }

    fn see(&self, x: Tensor<4>) -> Tensor<4> {
        relu(conv2d(
            x,
            self.weight.clone(),
            Some(self.bias.clone()),
            self.options.clone(),
        ))
    }
}

/// Pooling over squares of 3x3 pixels.
fn pool_3x3(x: Tensor<4>, pool: Pool) -> Tensor<4> {
    let largest = MaxPoolOptions::new([3, 3]);
    match pool {
        Pool::Mean => {
            let mean = AvgPoolOptions::new([3, 3]).with_stride([1, 1]);
            avg_pool2d(x, mean.with_padding([1, 1]).with_count_include_pad(false))
        }
        Pool::Largest => max_pool2d(x, largest.with_stride([1, 1]).with_padding([1, 1])),
        Pool::LargestOfEverySecond => max_pool2d(x, largest.with_stride([2, 2])),
    }
}

#[cfg(test)]
mod tests;
