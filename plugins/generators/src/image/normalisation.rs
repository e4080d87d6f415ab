//! Normalisation of the channels of images with an optional rectifier.
//!
//! Batch normalisation (Ioffe and Szegedy 2015, arXiv:1502.03167, algorithm 1) takes the statistics of each
//! channel over all pixels of the batch, instance normalisation (Ulyanov et al. 2016, arXiv:1607.08022) over
//! those of one image.
//!
//! | paper | here | shape |
//! |---|---|---|
//! | x, y | image, output | `[batch height width, channels]` |
//! | mu, sigma^2 | `statistics`: means, then biased variances, a row for each group of pixels | `[groups, 2 channels]` |
//! | gamma, beta | `weight`, `bias` | `[1, channels]` |
//! | epsilon | [`EPSILON`] | scalar |
//!
//! `y = gamma (x - mu) / sqrt(sigma^2 + epsilon) + beta`, then `max(y, 0)` with a rectifier. Backward, with `m`
//! pixels, `h` the standardised input and `dy` zero where the rectifier is: `dgamma = sum(dy h)`, `dbeta =
//! sum(dy)`, `dx = gamma (m dy - sum(dy) - h sum(dy h)) / (m sqrt(sigma^2 + epsilon))`; with given statistics
//! `dx = gamma dy / sqrt(sigma^2 + epsilon)`.

use super::Image;
use arithmetic::slices::widest;
use plan::{Backward, Expression, Extension, Graph, Shape, Value};

/// Summand that prevents division by zero for a constant channel (PyTorch's default).
pub const EPSILON: f32 = 1e-5;

/// Weight of a new batch in running statistics (PyTorch's default).
pub const MOMENTUM: f64 = 0.1;

/// Weight and bias `[1, channels]` after a normalisation.
#[derive(Debug, Clone, Copy)]
pub struct Affine<'e> {
    /// `gamma`.
    pub weight: Expression<'e>,
    /// `beta`.
    pub bias: Expression<'e>,
}

impl<'e> Image<'e> {
    /// Batch normalisation, followed by a rectifier where `relu` is set. Also returns the statistics of the batch,
    /// `[1, 2 channels]`.
    ///
    /// # Panics
    /// Where the shapes do not fit.
    #[must_use]
    pub fn normalise_batch(self, affine: Affine<'e>, relu: bool) -> (Self, Expression<'e>) {
        let sizes = self.sizes(1, relu, Source::Image);
        let statistics = self
            .pixels
            .equations()
            .apply(Normalisation::new(sizes, Part::Statistics), &[self.pixels]);
        let operands = [self.pixels, statistics, affine.weight, affine.bias];
        (self.with(self.normalised(sizes, &operands)), statistics)
    }

    /// Normalisation by given statistics `[1, 2 channels]`: the form for evaluation.
    ///
    /// # Panics
    /// Where the shapes do not fit.
    #[must_use]
    pub fn normalise_by(self, affine: Affine<'e>, statistics: Expression<'e>, relu: bool) -> Self {
        let sizes = self.sizes(1, relu, Source::Given);
        let operands = [self.pixels, statistics, affine.weight, affine.bias];
        self.with(self.normalised(sizes, &operands))
    }

    /// Instance normalisation without weights, followed by a rectifier where `relu` is set.
    #[must_use]
    pub fn normalise_instances(self, relu: bool) -> Self {
        let sizes = self.sizes(self.n_images(), relu, Source::Image);
        let statistics = self
            .pixels
            .equations()
            .apply(Normalisation::new(sizes, Part::Statistics), &[self.pixels]);
        self.with(self.normalised(sizes, &[self.pixels, statistics]))
    }

    fn sizes(self, n_groups: usize, relu: bool, source: Source) -> Sizes {
        Sizes {
            n_groups,
            n_pixels: self.pixels.n_rows(),
            n_channels: self.n_channels(),
            relu,
            source,
        }
    }

    fn normalised(self, sizes: Sizes, operands: &[Expression<'e>]) -> Expression<'e> {
        self.pixels
            .equations()
            .apply(Normalisation::new(sizes, Part::Output), operands)
    }
}

/// Running statistics after those of a batch of `n_pixels`, both `[1, 2 channels]`, as [`plan::Equations::follow`] has
/// it with [`MOMENTUM`]: the statistics that they move towards. They take the unbiased variance of the batch, so their
/// own variance is unbiased.
#[must_use]
pub fn unbiased(statistics: Expression<'_>, n_pixels: usize) -> Expression<'_> {
    let (n, n_channels) = (n_pixels as f64, statistics.n_columns() / 2);
    let factor = [1.0, n / (n - 1.0).max(1.0)].map(|factor| vec![factor; n_channels]);
    let equations = statistics.equations();
    statistics * equations.constant(statistics.shape(), &factor.concat())
}

/// Where statistics come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Source {
    /// The image itself, through which its gradient passes, too.
    Image,
    /// Elsewhere: they are constants.
    Given,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Sizes {
    /// Sets of consecutive pixels that are normalised by their own statistics.
    n_groups: usize,
    n_pixels: usize,
    n_channels: usize,
    relu: bool,
    source: Source,
}

/// A result, by its operands; parts in brackets are there only with weights or with a rectifier.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Part {
    /// Statistics of x.
    Statistics,
    /// `y` of x, statistics, (weight, bias).
    Output,
    /// For each group `sum(dy)`, then `sum(dy h)`, of x, statistics, dy, (y).
    Sums,
    /// `dx` of x, statistics, sums, dy, (y), (weight).
    OfImage,
}

#[derive(Debug, Clone, Copy)]
struct Normalisation {
    sizes: Sizes,
    part: Part,
}

impl Normalisation {
    fn new(sizes: Sizes, part: Part) -> Self {
        Self { sizes, part }
    }
}

impl Extension for Normalisation {
    fn name(&self) -> String {
        let Sizes { n_groups, relu, .. } = self.sizes;
        let then = if relu { " and rectifier" } else { "" };
        format!("Normalisation of {n_groups} groups{then}: {:?}", self.part)
    }

    fn shape(&self, operands: &[Shape]) -> Option<Shape> {
        let Sizes {
            n_groups,
            n_pixels,
            n_channels,
            relu,
            ..
        } = self.sizes;
        let (image, per_group, per_channel) = (
            [n_pixels, n_channels],
            [n_groups, 2 * n_channels],
            [1, n_channels],
        );
        let masked: &[Shape] = if relu { &[image, image] } else { &[image] };
        let is =
            |known: &[Shape], optional: &[Shape]| operands == known || operands == [known, optional].concat();
        let (fits, shape) = match self.part {
            Part::Statistics => (is(&[image], &[]), per_group),
            Part::Output => (is(&[image, per_group], &[per_channel; 2]), image),
            Part::Sums => (is(&[&[image, per_group], masked].concat(), &[]), per_group),
            Part::OfImage => {
                let known = [&[image, per_group, per_group], masked].concat();
                (is(&known, &[per_channel]), image)
            }
        };
        (fits && n_pixels.is_multiple_of(n_groups)).then_some(shape)
    }

    fn flops(&self, _: &[Shape], _: Shape) -> u64 {
        let each = match self.part {
            Part::Statistics | Part::Sums => 4,
            Part::Output => 3,
            Part::OfImage => 5,
        };
        each * (self.sizes.n_pixels * self.sizes.n_channels) as u64
    }

    fn compute(&self, operands: &[&[f32]], result: &mut [f32], memory: &mut Vec<f32>) {
        let Sizes {
            n_groups,
            n_pixels,
            n_channels,
            relu,
            ..
        } = self.sizes;
        let (group, pair) = (n_pixels / n_groups * n_channels, 2 * n_channels);
        memory.clear();
        memory.resize(3 * n_channels, 0.0);
        for at in 0..n_groups {
            let of = |operand: usize| &operands[operand][at * group..][..group];
            let pair_of = |operand: usize| &operands[operand][at * pair..][..pair];
            let mask = |place: usize| relu.then(|| of(place));
            match self.part {
                Part::Statistics => statistics(of(0), &mut result[at * pair..][..pair]),
                Part::Output => {
                    let (factors, bias) = memory.split_at_mut(n_channels);
                    if let Some(from) = operands.get(3) {
                        bias[..n_channels].copy_from_slice(from);
                    }
                    let (mean, variance) = pair_of(1).split_at(n_channels);
                    scales(factors, variance, operands.get(2).copied());
                    let y = &mut result[at * group..][..group];
                    apply(of(0), y, [mean, factors, &bias[..n_channels]], relu);
                }
                Part::Sums => {
                    let sums = &mut result[at * pair..][..pair];
                    gradient_sums(of(0), of(2), mask(3), pair_of(1), sums);
                }
                Part::OfImage => {
                    let weight = operands.get(4 + usize::from(relu)).copied();
                    let through = (self.sizes.source == Source::Image).then(|| pair_of(2));
                    factors(memory, pair_of(1), through, weight, group / n_channels);
                    let dx = &mut result[at * group..][..group];
                    image_gradient(of(0), of(3), mask(4), dx, &pair_of(1)[..n_channels], memory);
                }
            }
        }
    }

    fn passes(&self, operand: usize) -> bool {
        // The gradient through statistics of the image is in that of the image.
        self.part != Part::Statistics && operand != 1
    }

    fn gradients(&self, graph: &mut Graph, backward: &Backward<'_>) -> Vec<Option<Value>> {
        let Backward {
            operands,
            result,
            upstream,
            is_needed,
        } = *backward;
        if self.part != Part::Output {
            return vec![None; operands.len()];
        }
        let (image, statistics) = (operands[0], operands[1]);
        let masked: &[Value] = if self.sizes.relu {
            &[upstream, result]
        } else {
            &[upstream]
        };
        let all = [&[image, statistics], masked].concat();
        let sums = graph.apply(Self::new(self.sizes, Part::Sums), &all);
        let weight = if operands.len() > 2 { &operands[2..3] } else { &[] };
        let of_image = [&[image, statistics, sums], masked, weight].concat();
        let of_image = is_needed[0].then(|| graph.apply(Self::new(self.sizes, Part::OfImage), &of_image));
        let mut found = vec![of_image, None];
        if operands.len() > 2 {
            let n = self.sizes.n_channels;
            found.push(is_needed[2].then(|| graph.columns(sums, n..2 * n)));
            found.push(is_needed[3].then(|| graph.columns(sums, 0..n)));
        }
        found
    }
}

/// Adds each pixel to sums, one per channel.
fn add_pixels(sums: &mut [f32], pixels: &[f32]) {
    widest(
        #[inline(always)]
        || {
            for pixel in pixels.chunks_exact(sums.len()) {
                sums.iter_mut().zip(pixel).for_each(|(sum, x)| *sum += x);
            }
        },
    );
}

/// Means, then biased variances of contiguous pixels.
#[allow(
    clippy::cast_precision_loss,
    reason = "a batch has far fewer than 2^24 pixels"
)]
fn statistics(pixels: &[f32], statistics: &mut [f32]) {
    let n_channels = statistics.len() / 2;
    let n_pixels = (pixels.len() / n_channels) as f32;
    statistics.fill(0.0);
    let (mean, variance) = statistics.split_at_mut(n_channels);
    add_pixels(mean, pixels);
    mean.iter_mut().for_each(|sum| *sum /= n_pixels);
    let mean = &*mean;
    widest(
        #[inline(always)]
        || {
            for pixel in pixels.chunks_exact(n_channels) {
                for ((sum, x), mean) in variance.iter_mut().zip(pixel).zip(mean) {
                    *sum += (x - mean) * (x - mean);
                }
            }
        },
    );
    variance.iter_mut().for_each(|sum| *sum /= n_pixels);
}

fn inverse_sd(variance: f32) -> f32 {
    1.0 / (variance + EPSILON).sqrt()
}

/// Factor `gamma / sqrt(sigma^2 + epsilon)` of each channel.
fn scales(scales: &mut [f32], variance: &[f32], weight: Option<&[f32]>) {
    for (scale, variance) in scales.iter_mut().zip(variance) {
        *scale = inverse_sd(*variance);
    }
    if let Some(weight) = weight {
        scales
            .iter_mut()
            .zip(weight)
            .for_each(|(scale, weight)| *scale *= weight);
    }
}

/// Rectifier `max(x, 0)`; a NaN stays one.
#[inline(always)]
fn rectified(x: f32) -> f32 {
    if x <= 0.0 { 0.0 } else { x }
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

/// Calls `each` with the numbers of each pixel: of `x`, `dy`, and `y` where a rectifier was; else `dy` takes its place.
#[inline(always)]
fn pixels<'a>(
    [x, dy]: [&'a [f32]; 2],
    y: Option<&'a [f32]>,
    n_channels: usize,
) -> impl Iterator<Item = [&'a [f32]; 3]> {
    let y = y.unwrap_or(dy);
    let pixels = x.chunks_exact(n_channels).zip(dy.chunks_exact(n_channels));
    pixels.zip(y.chunks_exact(n_channels)).map(
        #[inline(always)]
        |((x, dy), y)| [x, dy, y],
    )
}

/// Sums over pixels, one number per channel: of `dy`, then of `dy h`.
fn gradient_sums(x: &[f32], dy: &[f32], y: Option<&[f32]>, statistics: &[f32], sums: &mut [f32]) {
    let n_channels = statistics.len() / 2;
    let (mean, variance) = statistics.split_at(n_channels);
    sums.fill(0.0);
    let (alone, with_input) = sums.split_at_mut(n_channels);
    let is_open = y.is_none();
    widest(
        #[inline(always)]
        || {
            for [x, dy, y] in pixels([x, dy], y, n_channels) {
                let sums = alone.iter_mut().zip(with_input.iter_mut());
                let numbers = x.iter().zip(dy).zip(y);
                for (((alone, product), mean), ((x, dy), y)) in sums.zip(mean).zip(numbers) {
                    let dy = if is_open | (*y > 0.0) { *dy } else { 0.0 };
                    *alone += dy;
                    *product += dy * (x - mean);
                }
            }
        },
    );
    for (sum, variance) in with_input.iter_mut().zip(variance) {
        *sum *= inverse_sd(*variance);
    }
}

/// Factors of `dx = scale dy + of_x (x - mu) + constant`, one after the other; the last two are zero where the
/// statistics are constants.
#[allow(
    clippy::cast_precision_loss,
    reason = "a batch has far fewer than 2^24 pixels"
)]
fn factors(
    factors: &mut [f32],
    statistics: &[f32],
    sums: Option<&[f32]>,
    weight: Option<&[f32]>,
    n_pixels: usize,
) {
    let n = statistics.len() / 2;
    let variance = &statistics[n..];
    let (scale, rest) = factors.split_at_mut(n);
    scales(scale, variance, weight);
    rest.fill(0.0);
    if let Some(sums) = sums {
        let share = 1.0 / n_pixels as f32;
        for k in 0..n {
            rest[k] = -scale[k] * share * sums[n + k] * inverse_sd(variance[k]);
            rest[n + k] = -scale[k] * share * sums[k];
        }
    }
}

/// Gradient `dx` from the factors of [`factors`].
fn image_gradient(x: &[f32], dy: &[f32], y: Option<&[f32]>, dx: &mut [f32], mean: &[f32], factors: &[f32]) {
    let n_channels = mean.len();
    let (scale, rest) = factors.split_at(n_channels);
    let (of_x, constant) = rest.split_at(n_channels);
    let is_open = y.is_none();
    let pixels = pixels([x, dy], y, n_channels).zip(dx.chunks_exact_mut(n_channels));
    widest(
        #[inline(always)]
        || {
            for ([x, dy, y], dx) in pixels {
                let factors = scale.iter().zip(mean).zip(of_x.iter().zip(constant));
                let numbers = dx.iter_mut().zip(x.iter().zip(dy).zip(y));
                for ((dx, ((x, dy), y)), ((scale, mean), (of_x, constant))) in numbers.zip(factors) {
                    let dy = if is_open | (*y > 0.0) { *dy } else { 0.0 };
                    *dx = scale * dy + of_x * (x - mean) + constant;
                }
            }
        },
    );
}
