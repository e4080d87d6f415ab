//! Normalisation of the channels of images with an optional rectifier, as one autodiff operation.
//!
//! Batch normalisation (Ioffe and Szegedy 2015, arXiv:1502.03167, algorithm 1) takes the statistics of each
//! channel over all pixels of the batch, instance normalisation (Ulyanov et al. 2016, arXiv:1607.08022) over
//! those of one image.
//!
//! | paper | here | shape |
//! |---|---|---|
//! | x, y | image, output | `[batch, height, width, channels]` |
//! | mu, sigma^2 | [`Statistics`]: mean and biased variance | `[channels]` |
//! | gamma, beta | weight, bias | `[channels]` |
//! | epsilon | [`EPSILON`] | scalar |
//!
//! `y = gamma (x - mu) / sqrt(sigma^2 + epsilon) + beta`, then `max(y, 0)` with a rectifier. Backward, with `m`
//! pixels, `h` the standardised input and `dy` zero where the rectifier is: `dgamma = sum(dy h)`, `dbeta =
//! sum(dy)`, `dx = gamma (m dy - sum(dy) - h sum(dy h)) / (m sqrt(sigma^2 + epsilon))`; with given statistics
//! `dx = gamma dy / sqrt(sigma^2 + epsilon)`.

use super::operation::{Operation, PlainTensor, host, of_one, of_three, shape};
use super::pointwise::{rectified, rectified_gradient};
use super::widest;
use burn::Tensor;
use std::sync::{Arc, OnceLock};

/// Summand that prevents division by zero for a constant channel (PyTorch's default).
pub const EPSILON: f32 = 1e-5;

/// Weight of a new batch in running statistics (PyTorch's default).
pub const MOMENTUM: f32 = 0.1;

/// Mean and variance of each channel; the variance of a batch is biased.
#[derive(Debug, Clone, PartialEq)]
pub struct Statistics {
    /// Means, `[channels]`.
    pub mean: Vec<f32>,
    /// Variances, `[channels]`.
    pub variance: Vec<f32>,
}

impl Statistics {
    /// Statistics with mean 0 and variance 1 of each channel.
    #[must_use]
    pub fn neutral(n_channels: usize) -> Self {
        Self {
            mean: vec![0.0; n_channels],
            variance: vec![1.0; n_channels],
        }
    }

    /// Moves running statistics towards those of a batch of `n_pixels`. They take the unbiased variance of
    /// the batch, so their own variance is unbiased.
    #[allow(
        clippy::cast_precision_loss,
        reason = "a batch has far fewer than 2^24 pixels"
    )]
    pub fn absorb(&mut self, batch: &Self, n_pixels: usize) {
        let unbiased = n_pixels as f32 / (n_pixels as f32 - 1.0).max(1.0);
        let follow = |running: &mut Vec<f32>, batch: &[f32], factor: f32| {
            let pairs = running.iter_mut().zip(batch);
            pairs.for_each(|(running, batch)| *running += MOMENTUM * (factor * batch - *running));
        };
        follow(&mut self.mean, &batch.mean, 1.0);
        follow(&mut self.variance, &batch.variance, unbiased);
    }
}

/// Batch normalisation of `image` `[batch, height, width, channels]` with `weight` and `bias` `[channels]`,
/// followed by a rectifier where `relu` is set. Also returns the statistics of the batch.
///
/// # Panics
/// Where the shapes do not fit, one of them is 0, or a tensor is not `f32`.
#[must_use]
pub fn normalise_batch(
    image: Tensor<4>,
    weight: Tensor<1>,
    bias: Tensor<1>,
    relu: bool,
) -> (Tensor<4>, Statistics) {
    let operation = Arc::new(Normalisation::of_batch(relu));
    let output = affine(image, weight, bias, operation.clone());
    // The forward pass has just filled the cell.
    let statistics = operation
        .statistics
        .get()
        .expect("statistics of the forward pass");
    (output, statistics[0].clone())
}

/// Normalisation as in [`normalise_batch`] with given statistics: the form for evaluation.
///
/// # Panics
/// Where the shapes do not fit, one of them is 0, or a tensor is not `f32`.
#[must_use]
pub fn normalise_by(
    image: Tensor<4>,
    weight: Tensor<1>,
    bias: Tensor<1>,
    statistics: Statistics,
    relu: bool,
) -> Tensor<4> {
    let n_channels = weight.dims()[0];
    assert_eq!(
        [statistics.mean.len(), statistics.variance.len()],
        [n_channels; 2],
        "one mean and one variance per channel"
    );
    affine(image, weight, bias, Arc::new(Normalisation::by(statistics, relu)))
}

/// Instance normalisation of `image` `[batch, height, width, channels]` without weights, followed by a
/// rectifier where `relu` is set.
///
/// # Panics
/// Where a dimension is 0 or the tensor is not `f32`.
#[must_use]
pub fn normalise_instances(image: Tensor<4>, relu: bool) -> Tensor<4> {
    of_one(image, Arc::new(Normalisation::of_instances(relu)))
}

fn affine(image: Tensor<4>, weight: Tensor<1>, bias: Tensor<1>, operation: Arc<Normalisation>) -> Tensor<4> {
    let [.., n_channels] = image.dims();
    assert_eq!(
        [weight.dims(), bias.dims()],
        [[n_channels]; 2],
        "one weight and one bias per channel"
    );
    of_three(image, weight, bias, operation)
}

/// Set of pixels that is normalised by its own statistics.
#[derive(Debug, Clone, Copy, PartialEq)]
enum StatisticsScope {
    Batch,
    Instance,
}

#[derive(Debug)]
struct Normalisation {
    scope: StatisticsScope,
    /// Whether the statistics are constants.
    given: bool,
    relu: bool,
    /// Statistics, one entry per group of pixels; the forward pass fills in those of the inputs.
    statistics: OnceLock<Vec<Statistics>>,
}

/// One number per channel.
type ChannelValues = Vec<f32>;

impl Normalisation {
    fn of_batch(relu: bool) -> Self {
        Self {
            scope: StatisticsScope::Batch,
            given: false,
            relu,
            statistics: OnceLock::new(),
        }
    }

    fn of_instances(relu: bool) -> Self {
        Self {
            scope: StatisticsScope::Instance,
            ..Self::of_batch(relu)
        }
    }

    fn by(statistics: Statistics, relu: bool) -> Self {
        Self {
            given: true,
            statistics: vec![statistics].into(),
            ..Self::of_batch(relu)
        }
    }

    /// Length of a group of pixels, in numbers.
    fn group(&self, [n_images, height, width, n_channels]: [usize; 4]) -> usize {
        let n_images = if self.scope == StatisticsScope::Batch {
            n_images
        } else {
            1
        };
        n_images * height * width * n_channels
    }
}

impl Operation for Normalisation {
    fn forward(&self, inputs: Vec<PlainTensor>) -> (PlainTensor, Vec<PlainTensor>) {
        let (x, shape) = (inputs[0].storage::<f32>(), shape(&inputs[0]));
        let (group, n_channels) = (self.group(shape), shape[3]);
        let weight = numbers(inputs.get(1));
        let bias = numbers(inputs.get(2)).map_or_else(|| vec![0.0; n_channels], <[f32]>::to_vec);
        let mut y = vec![0.0; x.len()];
        let statistics = self
            .statistics
            .get_or_init(|| x.chunks_exact(group).map(|x| statistics(x, n_channels)).collect());
        for ((x, y), statistics) in x
            .chunks_exact(group)
            .zip(y.chunks_exact_mut(group))
            .zip(statistics)
        {
            let scale = scale(statistics, weight);
            apply(x, y, [&statistics.mean, &scale, &bias], self.relu);
        }
        let output = host(y, shape);
        let mut kept = inputs;
        kept.truncate(2);
        if self.relu {
            kept.push(output.clone());
        }
        (output, kept)
    }

    fn backward(
        &self,
        kept: &[PlainTensor],
        upstream: &PlainTensor,
        wanted: &[bool],
    ) -> Vec<Option<PlainTensor>> {
        let shape = shape(upstream);
        let (group, n_channels) = (self.group(shape), shape[3]);
        let weight = numbers((wanted.len() == 3).then(|| &kept[1]));
        let masked = self.relu.then(|| masked(&kept[kept.len() - 1], upstream));
        let dy = masked.as_deref().unwrap_or_else(|| upstream.storage::<f32>());
        let mut dx = vec![0.0; dy.len()];
        let (mut d_weight, mut d_bias) = (vec![0.0; n_channels], vec![0.0; n_channels]);
        // The forward pass has filled the cell.
        let statistics = self.statistics.get().expect("statistics of the forward pass");
        let groups = kept[0]
            .storage::<f32>()
            .chunks_exact(group)
            .zip(dy.chunks_exact(group));
        for (((x, dy), dx), statistics) in groups.zip(dx.chunks_exact_mut(group)).zip(statistics) {
            let sums = gradient_sums(x, dy, statistics);
            add(&mut d_weight, &sums.with_input);
            add(&mut d_bias, &sums.alone);
            let scale = scale(statistics, weight);
            input_gradient(x, dy, dx, statistics, (!self.given).then_some(&sums), &scale);
        }
        let mut found = vec![wanted[0].then(|| host(dx, shape))];
        if let [_, of_weight, of_bias] = wanted {
            found.push(of_weight.then(|| host(d_weight, [n_channels])));
            found.push(of_bias.then(|| host(d_bias, [n_channels])));
        }
        found
    }
}

fn numbers(tensor: Option<&PlainTensor>) -> Option<&[f32]> {
    tensor.map(PlainTensor::storage::<f32>)
}

fn masked(output: &PlainTensor, upstream: &PlainTensor) -> Vec<f32> {
    let (y, dy) = (output.storage::<f32>(), upstream.storage::<f32>());
    widest(
        #[inline(always)]
        || rectified_gradient(y, dy),
    )
}

fn add(sums: &mut [f32], other: &[f32]) {
    sums.iter_mut().zip(other).for_each(|(sum, other)| *sum += other);
}

/// Mean and biased variance of each channel over contiguous pixels.
#[allow(
    clippy::cast_precision_loss,
    reason = "a batch has far fewer than 2^24 pixels"
)]
fn statistics(pixels: &[f32], n_channels: usize) -> Statistics {
    let n_pixels = (pixels.len() / n_channels) as f32;
    let mut mean = super::column_sums(pixels, n_channels);
    mean.iter_mut().for_each(|sum| *sum /= n_pixels);
    let mut variance = vec![0.0; n_channels];
    widest(
        #[inline(always)]
        || {
            for pixel in pixels.chunks_exact(n_channels) {
                for ((sum, x), mean) in variance.iter_mut().zip(pixel).zip(&mean) {
                    *sum += (x - mean) * (x - mean);
                }
            }
        },
    );
    variance.iter_mut().for_each(|sum| *sum /= n_pixels);
    Statistics { mean, variance }
}

fn inverse_sd(variance: f32) -> f32 {
    1.0 / (variance + EPSILON).sqrt()
}

/// Factor `gamma / sqrt(sigma^2 + epsilon)` of each channel.
fn scale(statistics: &Statistics, weight: Option<&[f32]>) -> ChannelValues {
    let inverse = statistics.variance.iter().map(|variance| inverse_sd(*variance));
    match weight {
        Some(weight) => inverse
            .zip(weight)
            .map(|(inverse, weight)| inverse * weight)
            .collect(),
        None => inverse.collect(),
    }
}

/// Output `y = scale (x - mu) + beta`; the mean is subtracted first, so that a mean far above the deviation
/// costs no digits.
fn apply(x: &[f32], y: &mut [f32], [mean, scale, bias]: [&[f32]; 3], relu: bool) {
    let n_channels = scale.len();
    let pixels = x.chunks_exact(n_channels).zip(y.chunks_exact_mut(n_channels));
    widest(
        #[inline(always)]
        || {
            for (x, y) in pixels {
                let factors = mean.iter().zip(scale).zip(bias);
                for ((y, x), ((mean, scale), bias)) in y.iter_mut().zip(x).zip(factors) {
                    *y = scale * (x - mean) + bias;
                }
                if relu {
                    y.iter_mut().for_each(|y| *y = rectified(*y));
                }
            }
        },
    );
}

/// Sums over pixels, one number per channel.
struct GradientSums {
    /// Sum of `dy`.
    alone: ChannelValues,
    /// Sum of `dy h`.
    with_input: ChannelValues,
}

fn gradient_sums(x: &[f32], dy: &[f32], statistics: &Statistics) -> GradientSums {
    let n_channels = statistics.mean.len();
    let (mut alone, mut with_input) = (vec![0.0; n_channels], vec![0.0; n_channels]);
    widest(
        #[inline(always)]
        || {
            for (x, dy) in x.chunks_exact(n_channels).zip(dy.chunks_exact(n_channels)) {
                let sums = alone.iter_mut().zip(&mut with_input);
                for (((alone, product), mean), (x, dy)) in sums.zip(&statistics.mean).zip(x.iter().zip(dy)) {
                    *alone += dy;
                    *product += dy * (x - mean);
                }
            }
        },
    );
    let inverse = statistics.variance.iter().map(|variance| inverse_sd(*variance));
    with_input
        .iter_mut()
        .zip(inverse)
        .for_each(|(sum, inverse)| *sum *= inverse);
    GradientSums { alone, with_input }
}

/// Input gradient `dx = scale dy + of_x (x - mu) + constant`; the last two terms are zero where the
/// statistics are constants.
#[allow(
    clippy::cast_precision_loss,
    reason = "a batch has far fewer than 2^24 pixels"
)]
fn input_gradient(
    x: &[f32],
    dy: &[f32],
    dx: &mut [f32],
    statistics: &Statistics,
    through_statistics: Option<&GradientSums>,
    scale: &[f32],
) {
    let (mean, n_channels) = (&statistics.mean, scale.len());
    let (mut of_x, mut constant) = (vec![0.0; n_channels], vec![0.0; n_channels]);
    if let Some(sums) = through_statistics {
        let share = 1.0 / (x.len() / n_channels) as f32;
        for k in 0..n_channels {
            of_x[k] = -scale[k] * share * sums.with_input[k] * inverse_sd(statistics.variance[k]);
            constant[k] = -scale[k] * share * sums.alone[k];
        }
    }
    let pixels = x.chunks_exact(n_channels).zip(dy.chunks_exact(n_channels));
    let pixels = pixels.zip(dx.chunks_exact_mut(n_channels));
    widest(
        #[inline(always)]
        || {
            for ((x, dy), dx) in pixels {
                let factors = scale.iter().zip(mean).zip(of_x.iter().zip(&constant));
                let numbers = dx.iter_mut().zip(x.iter().zip(dy));
                for ((dx, (x, dy)), ((scale, mean), (of_x, constant))) in numbers.zip(factors) {
                    *dx = scale * dy + of_x * (x - mean) + constant;
                }
            }
        },
    );
}
