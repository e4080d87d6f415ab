//! Layers of generators and discriminators, initialised from a random stream of the trial.
//!
//! Weights of convolutions are uniform in `+-sqrt(6 / (k^2 (inputs + outputs)))` (Glorot and Bengio 2010, eq.
//! 16), with `k` the side of the kernel. Their biases and all numbers of deconvolutions and linear layers are
//! uniform in `+-1 / sqrt(n)`, like PyTorch's: `n` numbers enter an output, for a deconvolution 4 times its
//! outputs. Weights of batch normalisation are normal with mean 1 and standard deviation 0.02.
//!
//! A layer is a name and its sizes. Its numbers are in a state, under names that begin with its own:
//!
//! | name | content | shape |
//! |---|---|---|
//! | `LAYER.weight`, `LAYER.bias` | parameters | see each layer |
//! | `LAYER.u`, `LAYER.v` | singular vectors of a weight | `[outputs, 1]`, `[rows, 1]` |
//! | `LAYER.running` | running means, then variances | `[1, 2 channels]` |

use crate::architecture::{Normalisation, Upsampling};
use crate::image::Image;
use crate::image::normalisation::{Affine, MOMENTUM, unbiased};
use crate::image::spectral::SingularVectors;
use numerics::gaussian::standard_normal;
use plan::{Activation, Equations, Expression, Shape, State};
use rand::{Rng, RngCore};

/// Purpose of a forward pass.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PassMode {
    /// Normalises by the batch and absorbs its statistics; takes one power iteration.
    Training,
    /// Uses running statistics and singular vectors unchanged.
    Evaluation,
}

/// A trained parameter of a network.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Parameter {
    /// Name in the state.
    pub name: String,
    /// Numbers of rows and columns.
    pub shape: Shape,
}

impl Parameter {
    /// The parameter in equations.
    #[must_use]
    pub fn expression<'e>(&self, equations: &'e Equations) -> Expression<'e> {
        equations.parameter(&self.name, self.shape)
    }
}

/// All parameters of a list in equations.
#[must_use]
pub fn expressions<'e>(parameters: &[Parameter], equations: &'e Equations) -> Vec<Expression<'e>> {
    parameters.iter().map(|it| it.expression(equations)).collect()
}

/// Adds the first numbers of layers to a state.
pub struct Start<'a> {
    /// State that gets the numbers.
    pub state: &'a mut State<f32>,
    /// Stream of which they are drawn.
    pub rng: &'a mut dyn RngCore,
    /// The parameters that were added, in their order.
    pub parameters: &'a mut Vec<Parameter>,
}

impl Start<'_> {
    fn parameter(&mut self, name: String, shape: Shape, entries: Vec<f32>) {
        self.state.insert(name.clone(), shape, entries);
        self.parameters.push(Parameter { name, shape });
    }

    /// Adds a parameter uniform in `+-bound`.
    #[allow(clippy::cast_possible_truncation, reason = "parameters are f32")]
    fn uniform(&mut self, name: String, shape: Shape, bound: f64) {
        let count = shape[0] * shape[1];
        let entries = (0..count).map(|_| ((2.0 * self.rng.random::<f64>() - 1.0) * bound) as f32);
        let entries = entries.collect();
        self.parameter(name, shape, entries);
    }

    /// Adds random directions for both sides of a weight `[rows, outputs]`.
    fn singular_vectors(&mut self, layer: &str, [n_rows, n_outputs]: Shape) {
        for (name, length) in [("u", n_outputs), ("v", n_rows)] {
            let drawn: Vec<f64> = (0..length).map(|_| standard_normal(&mut self.rng)).collect();
            let norm = drawn.iter().map(|x| x * x).sum::<f64>().sqrt();
            #[allow(clippy::cast_possible_truncation, reason = "parameters are f32")]
            let direction = drawn.iter().map(|x| (x / norm) as f32).collect();
            self.state
                .insert(format!("{layer}.{name}"), [length, 1], direction);
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

/// A weight `[rows, outputs]`, divided by its largest singular value.
fn divided<'e>(layer: &str, weight: Expression<'e>, pass: PassMode) -> Expression<'e> {
    let (equations, [n_rows, n_outputs]) = (weight.equations(), weight.shape());
    let vectors = SingularVectors {
        of_outputs: equations.parameter(&format!("{layer}.u"), [n_outputs, 1]),
        of_rows: equations.parameter(&format!("{layer}.v"), [n_rows, 1]),
    };
    if pass == PassMode::Evaluation {
        return vectors.divided(weight);
    }
    let iterated = vectors.iterated(weight);
    equations.assign(vectors.of_outputs, iterated.of_outputs);
    equations.assign(vectors.of_rows, iterated.of_rows);
    iterated.divided(weight)
}

/// A convolution with a kernel of 1x1 or 3x3 that keeps height and width: weight `[k k inputs, outputs]`, bias
/// `[1, outputs]`.
#[derive(Debug, Clone)]
pub struct Convolution {
    name: String,
    side: usize,
    /// Inputs and outputs.
    channels: [usize; 2],
    /// Whether the weight is divided by its largest singular value.
    is_spectral: bool,
}

impl Convolution {
    /// A convolution with a kernel of `side` x `side`, 1 or 3.
    pub fn new(name: String, side: usize, channels: [usize; 2], start: &mut Start<'_>) -> Self {
        let (taps, [n_inputs, n_outputs]) = (side * side, channels);
        let bound = (6.0 / count(taps * (n_inputs + n_outputs))).sqrt();
        start.uniform(format!("{name}.weight"), [taps * n_inputs, n_outputs], bound);
        let bound = 1.0 / count(taps * n_inputs).sqrt();
        start.uniform(format!("{name}.bias"), [1, n_outputs], bound);
        Self {
            name,
            side,
            channels,
            is_spectral: false,
        }
    }

    /// The same with spectral normalisation.
    pub fn spectral(name: String, side: usize, channels: [usize; 2], start: &mut Start<'_>) -> Self {
        let plain = Self::new(name, side, channels, start);
        start.singular_vectors(&plain.name, [side * side * channels[0], channels[1]]);
        Self {
            is_spectral: true,
            ..plain
        }
    }

    /// Maps with the layer's outputs of maps with its inputs.
    #[must_use]
    pub fn apply<'e>(&self, image: Image<'e>, pass: PassMode) -> Image<'e> {
        let (equations, [n_inputs, n_outputs]) = (image.pixels.equations(), self.channels);
        let rows = self.side * self.side * n_inputs;
        let mut weight = equations.parameter(&format!("{}.weight", self.name), [rows, n_outputs]);
        if self.is_spectral {
            weight = divided(&self.name, weight, pass);
        }
        let bias = equations.parameter(&format!("{}.bias", self.name), [1, n_outputs]);
        image.convolve(self.side, weight, bias)
    }
}

/// A linear layer without bias, with spectral normalisation: weight `[inputs, outputs]`.
#[derive(Debug, Clone)]
pub struct SpectralLinear {
    name: String,
    sizes: Shape,
}

impl SpectralLinear {
    /// A layer from `sizes[0]` numbers to `sizes[1]`.
    pub fn new(name: String, sizes: Shape, start: &mut Start<'_>) -> Self {
        start.uniform(format!("{name}.weight"), sizes, 1.0 / count(sizes[0]).sqrt());
        start.singular_vectors(&name, sizes);
        Self { name, sizes }
    }

    /// Outputs `[batch, outputs]` of inputs `[batch, inputs]`.
    #[must_use]
    pub fn apply<'e>(&self, input: Expression<'e>, pass: PassMode) -> Expression<'e> {
        let weight = input
            .equations()
            .parameter(&format!("{}.weight", self.name), self.sizes);
        input.product(divided(&self.name, weight, pass), [false; 2])
    }
}

/// A linear layer whose outputs form a small image: weight `[latent, height width channels]`, bias
/// `[1, height width channels]`.
#[derive(Debug, Clone)]
pub struct Stem {
    name: String,
    n_latent: usize,
    /// Height, width and channels of the image.
    shape: [usize; 3],
}

impl Stem {
    /// A layer from `n_latent` numbers to an image `[height, width, channels]`.
    pub fn new(name: String, n_latent: usize, shape: [usize; 3], start: &mut Start<'_>) -> Self {
        let (n_outputs, bound) = (shape.iter().product(), 1.0 / count(n_latent).sqrt());
        start.uniform(format!("{name}.weight"), [n_latent, n_outputs], bound);
        start.uniform(format!("{name}.bias"), [1, n_outputs], bound);
        Self {
            name,
            n_latent,
            shape,
        }
    }

    /// Images of latent vectors `[batch, latent]`.
    #[must_use]
    pub fn apply<'e>(&self, latents: Expression<'e>) -> Image<'e> {
        let (equations, [height, width, channels]) = (latents.equations(), self.shape);
        let n_outputs = height * width * channels;
        let weight = equations.parameter(&format!("{}.weight", self.name), [self.n_latent, n_outputs]);
        let bias = equations.parameter(&format!("{}.bias", self.name), [1, n_outputs]);
        let images = latents.dense(weight, bias, Activation::Identity);
        let n_pixels = latents.n_rows() * height * width;
        Image::new(images.reshape([n_pixels, channels]), [height, width])
    }
}

/// Normalisation followed by a rectifier; over the batch with weight and bias `[1, channels]`.
#[derive(Debug, Clone)]
pub struct NormRelu {
    name: String,
    kind: Normalisation,
    n_channels: usize,
}

impl NormRelu {
    /// Normalisation of `n_channels`.
    pub fn new(name: String, kind: Normalisation, n_channels: usize, start: &mut Start<'_>) -> Self {
        if kind == Normalisation::Batch {
            #[allow(clippy::cast_possible_truncation, reason = "parameters are f32")]
            let drawn = (0..n_channels).map(|_| (1.0 + 0.02 * standard_normal(&mut start.rng)) as f32);
            let drawn = drawn.collect();
            start.parameter(format!("{name}.weight"), [1, n_channels], drawn);
            start.parameter(format!("{name}.bias"), [1, n_channels], vec![0.0; n_channels]);
            let neutral = [0.0, 1.0].map(|number| vec![number; n_channels]).concat();
            start
                .state
                .insert(format!("{name}.running"), [1, 2 * n_channels], neutral);
        }
        Self {
            name,
            kind,
            n_channels,
        }
    }

    /// The normalised map, with 0 in place of negative values.
    #[must_use]
    pub fn apply<'e>(&self, map: Image<'e>, pass: PassMode) -> Image<'e> {
        let (equations, n_channels) = (map.pixels.equations(), self.n_channels);
        match self.kind {
            Normalisation::None => return map.relu(),
            Normalisation::Instance => return map.normalise_instances(true),
            Normalisation::Batch => {}
        }
        let part = |part: &str, n| equations.parameter(&format!("{}.{part}", self.name), [1, n]);
        let running = part("running", 2 * n_channels);
        let affine = Affine {
            weight: part("weight", n_channels),
            bias: part("bias", n_channels),
        };
        if pass == PassMode::Evaluation {
            return map.normalise_by(affine, running, true);
        }
        let (output, of_batch) = map.normalise_batch(affine, true);
        equations.follow(&[running], &[unbiased(of_batch, map.pixels.n_rows())], MOMENTUM);
        output
    }
}

/// Enlargement by a power of 2: where it is learnt, deconvolutions with weight `[channels, 2 2 channels]` and bias
/// `[1, channels]`.
#[derive(Debug, Clone)]
pub struct Enlargement {
    name: String,
    kind: Upsampling,
    factor: usize,
    n_channels: usize,
}

impl Enlargement {
    /// Enlargement of maps with `n_channels` by `factor`, a power of 2; learnt doublings follow each other.
    ///
    /// # Panics
    /// Where `factor` is no power of 2.
    pub fn new(
        name: String,
        kind: Upsampling,
        factor: usize,
        n_channels: usize,
        start: &mut Start<'_>,
    ) -> Self {
        assert!(factor.is_power_of_two(), "doublings do not enlarge by {factor}");
        let layer = Self {
            name,
            kind,
            factor,
            n_channels,
        };
        let bound = 1.0 / count(4 * n_channels).sqrt();
        for doubling in layer.doublings() {
            start.uniform(format!("{doubling}.weight"), [n_channels, 4 * n_channels], bound);
            start.uniform(format!("{doubling}.bias"), [1, n_channels], bound);
        }
        layer
    }

    /// Names of the deconvolutions.
    fn doublings(&self) -> Vec<String> {
        let n_doublings = if self.kind == Upsampling::Deconvolution {
            self.factor.ilog2()
        } else {
            0
        };
        (0..n_doublings)
            .map(|at| format!("{}.doublings.{at}", self.name))
            .collect()
    }

    /// Maps whose sides are `factor` times as long.
    #[must_use]
    pub fn apply<'e>(&self, map: Image<'e>) -> Image<'e> {
        let (equations, n) = (map.pixels.equations(), self.n_channels);
        match self.kind {
            Upsampling::Bilinear => map.resize_bilinear([self.factor * map.height, self.factor * map.width]),
            Upsampling::Nearest => map.enlarge_nearest(self.factor),
            Upsampling::Deconvolution => self.doublings().into_iter().fold(map, |map, doubling| {
                let weight = equations.parameter(&format!("{doubling}.weight"), [n, 4 * n]);
                let bias = equations.parameter(&format!("{doubling}.bias"), [1, n]);
                map.deconvolve_2x2(weight, bias)
            }),
        }
    }
}
