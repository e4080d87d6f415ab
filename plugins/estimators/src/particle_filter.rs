//! Particle filter of health parameters that follow a random walk (N. J. Gordon, D. J. Salmond and A. F. M.
//! Smith 1993; systematic resampling where the effective number of particles falls below half).

use crate::Plant;
use arithmetic::double::{exp, ln};
use contract::{Action, Agent, AgentTraits, Error, Interface, Mode, Observation, Registry, Rng};
use environments::turbofan::{EngineName, Model};
use numerics::gaussian::standard_normal;
use rand::Rng as _;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

const NAME: &str = "particle_filter";

/// Assumptions of the filter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Engine whose health is estimated.
    pub engine: EngineName,
    /// Model of the engine.
    pub model: Model,
    /// Factor of all outputs of the model, for a biased model.
    #[schemars(range(min = 0.5, max = 2.0), extend("x-source" = "thesis, table 2.4: 1.02"))]
    pub model_bias: f64,
    /// Standard deviation of the noise factor of each output of the model.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "thesis, table 2.4: 0.1"))]
    pub model_noise: f64,
    /// Number of particles, each a run of the engine per sample.
    #[schemars(range(min = 2, max = 1_000_000))]
    pub particles: usize,
    /// Standard deviation of a parameter's change from one sample to the next.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub walk_sd: f64,
    /// Standard deviation of a sensor, in parts of its reading.
    #[schemars(range(min = 1e-9, max = 1.0))]
    pub noise: f64,
    /// Standard deviation of a parameter before the first sample, around a healthy engine.
    #[schemars(range(min = 1e-9, max = 1.0))]
    pub first_sd: f64,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            engine: EngineName::default(),
            model: Model::default(),
            model_bias: 1.0,
            model_noise: 0.0,
            particles: 100,
            walk_sd: 1e-4,
            noise: 3e-3,
            first_sd: 5e-3,
        }
    }
}

impl contract::Config for Config {}

/// Filter with its particles.
#[derive(Debug, Clone)]
pub struct ParticleFilter {
    config: Config,
    plant: Plant,
    /// Parameters and weights of the particles; empty before the first sample.
    particles: Vec<(Vec<f64>, f64)>,
}

/// Registers the estimator.
pub(crate) fn register(registry: &mut Registry, version: u32) {
    let about = "particle filter of an engine's health parameters";
    registry.agent(NAME, version, about, AgentTraits::default(), build);
}

fn build(config: Config, interface: &Interface, _rng: &mut Rng) -> Result<Box<dyn Agent>, Error> {
    let plant = Plant::new(NAME, config.engine, &config.model, config.noise, interface)?
        .distorted(config.model_bias, config.model_noise);
    Ok(Box::new(ParticleFilter {
        config,
        plant,
        particles: Vec::new(),
    }))
}

impl ParticleFilter {
    /// Moves particles by one step of their walk; creates those of a healthy engine before the first sample.
    fn walk(&mut self, rng: &mut Rng) {
        let Config {
            particles,
            walk_sd,
            first_sd,
            ..
        } = self.config;
        let d = self.plant.n_parameters();
        if self.particles.is_empty() {
            let weight = 1.0 / particles as f64;
            let mut drawn = || (0..d).map(|_| first_sd * standard_normal(rng)).collect();
            self.particles = (0..particles).map(|_| (drawn(), weight)).collect();
            return;
        }
        for (theta, _) in &mut self.particles {
            theta
                .iter_mut()
                .for_each(|entry| *entry += walk_sd * standard_normal(rng));
        }
    }

    /// Weights particles by the likelihood of a reading.
    fn weigh(&mut self, reading: &crate::Reading, rng: &mut Rng) -> Result<(), Error> {
        let mut logs = Vec::with_capacity(self.particles.len());
        for (theta, weight) in &self.particles {
            let expected = self.plant.expected(reading, theta, rng)?;
            let off = expected
                .iter()
                .zip(&reading.measured)
                .map(|(x, y)| (x - y) * (x - y));
            logs.push(ln(*weight) - 0.5 * off.sum::<f64>());
        }
        let most = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let weights: Vec<f64> = logs.iter().map(|log| exp(log - most)).collect();
        let total: f64 = weights.iter().sum();
        for ((_, weight), new) in self.particles.iter_mut().zip(weights) {
            *weight = new / total;
        }
        Ok(())
    }

    fn mean(&self) -> Vec<f64> {
        let sum = |entry: usize| {
            self.particles
                .iter()
                .map(|(theta, weight)| weight * theta[entry])
                .sum()
        };
        (0..self.plant.n_parameters()).map(sum).collect()
    }

    /// Resamples particles by their weights where few of them carry the weight.
    fn resample(&mut self, rng: &mut Rng) {
        let n = self.particles.len();
        let squares: f64 = self.particles.iter().map(|(_, weight)| weight * weight).sum();
        if 1.0 / squares > 0.5 * n as f64 {
            return;
        }
        let offset = rng.random::<f64>();
        let (mut sum, mut at) = (self.particles[0].1, 0);
        let drawn = (0..n).map(|index| {
            let place = (index as f64 + offset) / n as f64;
            while sum < place && at + 1 < n {
                at += 1;
                sum += self.particles[at].1;
            }
            (self.particles[at].0.clone(), 1.0 / n as f64)
        });
        self.particles = drawn.collect();
    }
}

impl Agent for ParticleFilter {
    fn act(
        &mut self,
        observations: &[Observation],
        _mode: Mode,
        rng: &mut Rng,
    ) -> Result<Vec<Action>, Error> {
        let reading = self.plant.reading(NAME, observations)?;
        self.walk(rng);
        self.weigh(&reading, rng)?;
        let mean = self.mean();
        self.resample(rng);
        Ok(self.plant.action(&mean))
    }

    fn remembers(&self) -> bool {
        true
    }

    fn restart(&mut self) {
        self.plant.model.restart();
        self.particles.clear();
    }
}
