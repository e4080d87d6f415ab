//! A generator under construction: its networks, its training and its scores.

use super::Config;
use super::scoring::{Scores, Scoring};
use crate::{
    adversarial::{Adversaries, Training, latents},
    architecture::CellArchitecture,
    generator::{FinishedGenerator, GeneratorSizes},
    images::Images,
};
use contract::{Error, Rng};
use rand::Rng as _;
use std::sync::Arc;

/// Images that are generated at once for scoring.
const ROWS: usize = 100;

/// A generator with its discriminator and the cells so far.
#[derive(Debug, Clone)]
pub(super) struct Proxy {
    networks: Adversaries,
    rng: Rng,
    /// Number of cells so far.
    n_cells: usize,
}

/// Scores and state features of a generator.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct GeneratorEvaluation {
    pub(super) scores: Scores,
    /// Mean over the images of the last map's central pixels, `[channels]`.
    pub(super) features: Vec<f64>,
    /// Whether all numbers are finite; otherwise the scores are the worst ones.
    pub(super) finite: bool,
}

/// Losses, means over the steps of a training.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Losses {
    pub(super) critic: f64,
    pub(super) generator: f64,
}

impl Proxy {
    /// The stem and the head without a cell.
    pub(super) fn new(config: &Config, mut rng: Rng) -> Self {
        let sizes = GeneratorSizes {
            bottom: config.bottom(),
            channels: config.generator_channels,
            latent: config.latent,
        };
        let training = Training {
            learning_rate: config.learning_rate,
            average_decay: config.average_decay.unwrap_or(0.0),
            ..Training::default()
        };
        Self {
            networks: Adversaries::new(sizes, config.discriminator_channels, training, &mut rng),
            rng,
            n_cells: 0,
        }
    }

    pub(super) fn grow(&mut self, cell: &CellArchitecture) {
        self.networks.grow(cell, &mut self.rng);
        self.n_cells += 1;
    }

    /// Trains all cells so far with `steps` steps of the critic on `real` images of the generator's size.
    pub(super) fn train(&mut self, config: &Config, real: &Images, steps: u64) -> Losses {
        let (mut critic, mut generator, mut n_generator) = (0.0, 0.0, 0u64);
        for step in 0..steps {
            let batch = self.drawn(real, config.batch);
            let noise = latents(config.batch, config.latent, &mut self.rng);
            critic += self.networks.critic_step(&batch, &noise);
            if step.is_multiple_of(config.critic_steps_per_generator_step) {
                let noise = latents(config.generator_batch, config.latent, &mut self.rng);
                generator += self.networks.generator_step(&noise);
                n_generator += 1;
            }
        }
        #[allow(clippy::cast_precision_loss, reason = "few steps")]
        let mean = |sum: f64, n: u64| if n == 0 { 0.0 } else { sum / n as f64 };
        Losses {
            critic: mean(critic, steps),
            generator: mean(generator, n_generator),
        }
    }

    fn drawn(&mut self, real: &Images, count: usize) -> Vec<f32> {
        let n = real.count() as u64;
        // Below the number of images, which is a usize.
        let rows: Vec<usize> = (0..count).map(|_| self.rng.random_range(0..n) as usize).collect();
        real.batch(&rows)
    }

    /// The generator that is scored: the averaged one where an average is kept.
    fn shown(&self, config: &Config) -> FinishedGenerator {
        if config.average_decay.is_some() && self.n_cells > 0 {
            self.networks.averaged_generator()
        } else {
            self.networks.trained_generator()
        }
    }

    /// Scores images of latent vectors that are the same for every generator.
    ///
    /// # Errors
    /// Errors of the scoring.
    pub(super) fn look(&self, config: &Config, scoring: &Arc<Scoring>) -> Result<GeneratorEvaluation, Error> {
        let mut generator = self.shown(config);
        let stage = generator.side();
        let mut seen = scoring.begin(stage);
        let mut sums = vec![0.0; config.generator_channels];
        let mut finite = true;
        for (batch, first) in (0..config.scored_images).step_by(ROWS).enumerate() {
            let count = ROWS.min(config.scored_images - first);
            let generated = generator.evaluate(&fixed_latents(batch, count, config.latent));
            finite &= generated.images.iter().all(|number| number.is_finite());
            let features = generated.central_features;
            finite &= features.iter().all(|number| number.is_finite());
            if !finite {
                break;
            }
            #[allow(clippy::cast_precision_loss, reason = "few images")]
            let share = count as f64 / config.scored_images as f64;
            sums.iter_mut()
                .zip(&features)
                .for_each(|(sum, feature)| *sum += share * f64::from(*feature));
            seen.add(scoring, &generated.images)?;
        }
        if !finite {
            return Ok(GeneratorEvaluation {
                scores: scoring.worst(stage),
                features: vec![0.0; config.generator_channels],
                finite,
            });
        }
        Ok(GeneratorEvaluation {
            scores: seen.scores(scoring)?,
            features: sums,
            finite,
        })
    }

    /// The first scored images, as consecutive bytes.
    pub(super) fn samples(&self, config: &Config, count: usize) -> (usize, Vec<u8>) {
        let mut generator = self.shown(config);
        let images = generator.evaluate(&fixed_latents(0, count, config.latent)).images;
        (generator.side(), crate::images::to_bytes(&images))
    }
}

/// Latent vectors number `batch` of those for scoring, which are the same for every generator.
fn fixed_latents(batch: usize, count: usize, length: usize) -> Vec<f32> {
    let mut rng = contract::random::stream(&["latent vectors to look at", &batch.to_string()]);
    latents(count, length, &mut rng)
}
