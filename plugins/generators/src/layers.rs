//! Layers of generators and discriminators, initialised from a random stream of the trial.
//!
//! Weights of convolutions are uniform in `+-sqrt(6 / (k^2 (inputs + outputs)))` (Glorot and Bengio 2010, eq.
//! 16), with `k` the side of the kernel. Their biases and all numbers of deconvolutions and linear layers are
//! uniform in `+-1 / sqrt(n)`, like PyTorch's: `n` numbers enter an output, for a deconvolution 4 times its
//! outputs. Weights of batch normalisation are normal with mean 1 and standard deviation 0.02.
//!
//! The state of a layer beside its parameters (singular vectors, running statistics) is plain numbers, of which
//! each copy has its own.

use crate::architecture::{Normalisation, Upsampling};
use crate::memory::StatefulModule;
use burn::module::{Module, Param};
use burn::tensor::{Device, Tensor, TensorData};
use numerics::gaussian::standard_normal;
use numerics::image::normalisation::{Statistics, normalise_batch, normalise_by, normalise_instances};
use numerics::image::resize::{enlarge_nearest, resize_bilinear};
use numerics::image::spectral::{SingularVectors, normalised};
use numerics::image::{convolution, deconvolution, pointwise};
use numerics::network::device;
use rand::{Rng, RngCore};

/// Purpose of a forward pass.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PassMode {
    /// Normalises by the batch and absorbs its statistics; takes one power iteration.
    Training,
    /// Uses running statistics and singular vectors unchanged.
    Evaluation,
}

/// A convolution with a kernel of 1x1 or 3x3 that keeps height and width.
#[derive(Module, Debug)]
pub struct Convolution {
    /// `[k, k, inputs, outputs]`.
    weight: Param<Tensor<4>>,
    bias: Param<Tensor<1>>,
    /// Singular vectors, where the weight is divided by its largest singular value.
    #[module(skip)]
    singular: Option<SingularVectors>,
}

impl Convolution {
    /// A convolution with a kernel of `side` x `side`, 1 or 3.
    pub fn new(
        side: usize,
        [n_inputs, n_outputs]: [usize; 2],
        rng: &mut impl RngCore,
        device: &Device,
    ) -> Self {
        let taps = side * side;
        let bound = (6.0 / count(taps * (n_inputs + n_outputs))).sqrt();
        let weight = uniform(taps * n_inputs * n_outputs, bound, rng);
        Self {
            weight: parameter(weight, [side, side, n_inputs, n_outputs], device),
            bias: parameter(
                uniform(n_outputs, 1.0 / count(taps * n_inputs).sqrt(), rng),
                [n_outputs],
                device,
            ),
            singular: None,
        }
    }

    /// The same with spectral normalisation.
    pub fn spectral(side: usize, channels: [usize; 2], rng: &mut impl RngCore, device: &Device) -> Self {
        let plain = Self::new(side, channels, rng, device);
        let singular = Some(singular_vectors(side * side * channels[0], channels[1], rng));
        Self { singular, ..plain }
    }

    /// Output `[batch, height, width, outputs]` of an image `[batch, height, width, inputs]`.
    pub fn forward(&mut self, image: Tensor<4>, pass: PassMode) -> Tensor<4> {
        let mut weight = self.weight.val();
        if let Some(singular) = &mut self.singular {
            if pass == PassMode::Training {
                singular.iterate(&weight);
            }
            weight = normalised(weight, singular);
        }
        match weight.dims() {
            [1, 1, inputs, outputs] => {
                convolution::convolve_1x1(image, weight.reshape([inputs, outputs]), self.bias.val())
            }
            _ => convolution::convolve_3x3(image, weight, self.bias.val()),
        }
    }
}

impl StatefulModule for Convolution {
    fn state_vectors(&mut self) -> Vec<&mut Vec<f32>> {
        let singular = self.singular.iter_mut();
        singular
            .flat_map(|singular| [&mut singular.of_outputs, &mut singular.of_rows])
            .collect()
    }
}

/// A linear layer without bias, with spectral normalisation.
#[derive(Module, Debug)]
pub struct SpectralLinear {
    /// `[inputs, outputs]`.
    weight: Param<Tensor<2>>,
    #[module(skip)]
    singular: SingularVectors,
}

impl SpectralLinear {
    /// A layer from `n_inputs` to `n_outputs`.
    pub fn new([n_inputs, n_outputs]: [usize; 2], rng: &mut impl RngCore, device: &Device) -> Self {
        let weight = uniform(n_inputs * n_outputs, 1.0 / count(n_inputs).sqrt(), rng);
        Self {
            weight: parameter(weight, [n_inputs, n_outputs], device),
            singular: singular_vectors(n_inputs, n_outputs, rng),
        }
    }

    /// Outputs `[batch, height, width, outputs]` of every pixel of `[batch, height, width, inputs]`.
    pub fn forward(&mut self, input: Tensor<4>, pass: PassMode) -> Tensor<4> {
        let weight = self.weight.val();
        if pass == PassMode::Training {
            self.singular.iterate(&weight);
        }
        let no_bias = Tensor::zeros([weight.dims()[1]], &device());
        convolution::convolve_1x1(input, normalised(weight, &self.singular), no_bias)
    }
}

impl StatefulModule for SpectralLinear {
    fn state_vectors(&mut self) -> Vec<&mut Vec<f32>> {
        vec![&mut self.singular.of_outputs, &mut self.singular.of_rows]
    }
}

/// A linear layer whose outputs form a small image.
#[derive(Module, Debug)]
pub struct Stem {
    /// `[latent, height * width * channels]`.
    weight: Param<Tensor<2>>,
    bias: Param<Tensor<1>>,
    #[module(skip)]
    shape: [usize; 3],
}

impl Stem {
    /// A layer from `n_latent` numbers to an image `[height, width, channels]`.
    pub fn new(n_latent: usize, shape: [usize; 3], rng: &mut impl RngCore, device: &Device) -> Self {
        let (n_outputs, bound) = (shape.iter().product(), 1.0 / count(n_latent).sqrt());
        Self {
            weight: parameter(
                uniform(n_latent * n_outputs, bound, rng),
                [n_latent, n_outputs],
                device,
            ),
            bias: parameter(uniform(n_outputs, bound, rng), [n_outputs], device),
            shape,
        }
    }

    /// Images `[batch, height, width, channels]` of latent vectors `[batch, latent]`.
    #[must_use]
    pub fn forward(&self, latents: Tensor<2>) -> Tensor<4> {
        let ([n_images, _], [height, width, channels]) = (latents.dims(), self.shape);
        // A convolution of one pixel gives the same bits on every processor, which a matrix product does not
        // promise.
        let pixels = latents.reshape([n_images as i64, 1, 1, -1]);
        convolution::convolve_1x1(pixels, self.weight.val(), self.bias.val())
            .reshape([n_images, height, width, channels])
    }
}

/// Normalisation followed by a rectifier.
#[derive(Module, Debug)]
pub struct NormRelu {
    weight: Option<Param<Tensor<1>>>,
    bias: Option<Param<Tensor<1>>>,
    #[module(skip)]
    kind: Normalisation,
    /// Running statistics; empty unless normalisation is over the batch.
    #[module(skip)]
    running: Statistics,
}

impl NormRelu {
    /// Normalisation of `n_channels`.
    pub fn new(kind: Normalisation, n_channels: usize, rng: &mut impl RngCore, device: &Device) -> Self {
        let batch = kind == Normalisation::Batch;
        #[allow(clippy::cast_possible_truncation, reason = "parameters are f32")]
        let weight = batch.then(|| {
            let drawn = (0..n_channels).map(|_| (1.0 + 0.02 * standard_normal(rng)) as f32);
            parameter(drawn.collect(), [n_channels], device)
        });
        Self {
            weight,
            bias: batch.then(|| parameter(vec![0.0; n_channels], [n_channels], device)),
            kind,
            running: Statistics::neutral(if batch { n_channels } else { 0 }),
        }
    }

    /// The normalised image `[batch, height, width, channels]`, with 0 in place of negative values.
    pub fn forward(&mut self, image: Tensor<4>, pass: PassMode) -> Tensor<4> {
        let affine = self.weight.as_ref().zip(self.bias.as_ref());
        match (affine, self.kind, pass) {
            (Some((weight, bias)), _, PassMode::Training) => {
                let [n_images, height, width, _] = image.dims();
                let (output, of_batch) = normalise_batch(image, weight.val(), bias.val(), true);
                self.running.absorb(&of_batch, n_images * height * width);
                output
            }
            (Some((weight, bias)), _, PassMode::Evaluation) => {
                normalise_by(image, weight.val(), bias.val(), self.running.clone(), true)
            }
            (None, Normalisation::Instance, _) => normalise_instances(image, true),
            (None, ..) => pointwise::relu(image),
        }
    }
}

impl StatefulModule for NormRelu {
    fn state_vectors(&mut self) -> Vec<&mut Vec<f32>> {
        vec![&mut self.running.mean, &mut self.running.variance]
    }
}

/// Enlargement by 2 or 4.
#[derive(Module, Debug)]
pub struct Enlargement {
    /// The deconvolutions, where enlargement is learnt.
    doublings: Vec<Doubling>,
    #[module(skip)]
    kind: Upsampling,
    #[module(skip)]
    factor: usize,
}

/// A deconvolution with a kernel of 2x2 and stride 2.
#[derive(Module, Debug)]
struct Doubling {
    /// `[inputs, 2, 2, outputs]`.
    weight: Param<Tensor<4>>,
    bias: Param<Tensor<1>>,
}

impl Enlargement {
    /// Enlargement of maps with `n_channels` by `factor`, a power of 2; learnt doublings follow each other.
    ///
    /// # Panics
    /// Where `factor` is no power of 2.
    pub fn new(
        kind: Upsampling,
        factor: usize,
        n_channels: usize,
        rng: &mut impl RngCore,
        device: &Device,
    ) -> Self {
        assert!(factor.is_power_of_two(), "doublings do not enlarge by {factor}");
        let bound = 1.0 / count(4 * n_channels).sqrt();
        let mut doubling = || Doubling {
            weight: parameter(
                uniform(4 * n_channels * n_channels, bound, rng),
                [n_channels, 2, 2, n_channels],
                device,
            ),
            bias: parameter(uniform(n_channels, bound, rng), [n_channels], device),
        };
        let n_doublings = if kind == Upsampling::Deconvolution {
            factor.ilog2()
        } else {
            0
        };
        Self {
            doublings: (0..n_doublings).map(|_| doubling()).collect(),
            kind,
            factor,
        }
    }

    /// Maps `[batch, factor * height, factor * width, channels]` of `[batch, height, width, channels]`.
    #[must_use]
    pub fn forward(&self, map: Tensor<4>) -> Tensor<4> {
        let [_, height, width, _] = map.dims();
        match self.kind {
            Upsampling::Bilinear => resize_bilinear(map, [self.factor * height, self.factor * width]),
            Upsampling::Nearest => enlarge_nearest(map, self.factor),
            Upsampling::Deconvolution => self.doublings.iter().fold(map, |map, doubling| {
                deconvolution::deconvolve_2x2(map, doubling.weight.val(), doubling.bias.val())
            }),
        }
    }
}

#[allow(
    clippy::cast_precision_loss,
    reason = "numbers of channels are far below 2^52"
)]
fn count(number: usize) -> f64 {
    number as f64
}

fn parameter<const D: usize>(values: Vec<f32>, shape: [usize; D], device: &Device) -> Param<Tensor<D>> {
    Param::from_tensor(Tensor::from_data(TensorData::new(values, shape), device))
}

#[allow(clippy::cast_possible_truncation, reason = "parameters are f32")]
fn uniform(count: usize, bound: f64, rng: &mut impl RngCore) -> Vec<f32> {
    (0..count)
        .map(|_| ((2.0 * rng.random::<f64>() - 1.0) * bound) as f32)
        .collect()
}

/// Random directions for both sides of a weight `[rows, outputs]`.
fn singular_vectors(n_rows: usize, n_outputs: usize, rng: &mut impl RngCore) -> SingularVectors {
    let mut direction = |length: usize| {
        let drawn: Vec<f64> = (0..length).map(|_| standard_normal(rng)).collect();
        let norm = drawn.iter().map(|x| x * x).sum::<f64>().sqrt();
        #[allow(clippy::cast_possible_truncation, reason = "parameters are f32")]
        drawn.iter().map(|x| (x / norm) as f32).collect()
    };
    SingularVectors {
        of_outputs: direction(n_outputs),
        of_rows: direction(n_rows),
    }
}
