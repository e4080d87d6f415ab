//! Unscented Kalman filter of health parameters that follow a random walk and are observed through the
//! engine.
//!
//! Thesis, section 2.5 (its `UKF`); the filter itself is in [`numerics::unscented`]. The thesis states
//! neither the variances nor the sigma points. It runs the engine for `2 (2 d + 1)` points a sample, those of
//! the prediction included. A random walk predicts without an engine, so `2 d + 1` runs are enough here.

use crate::Plant;
use contract::{Action, Agent, AgentTraits, Error, Interface, Mode, Observation, Registry, Rng};
use environments::turbofan::{EngineName, Model};
use numerics::unscented::{FilterError, SigmaPoints, UnscentedFilter};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

const NAME: &str = "unscented_kalman_filter";

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
    /// Standard deviation of a parameter's change from one sample to the next.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub walk_sd: f64,
    /// Standard deviation of a sensor, in parts of its reading.
    #[schemars(range(min = 1e-9, max = 1.0))]
    pub noise: f64,
    /// Standard deviation of a parameter before the first sample, around a healthy engine.
    #[schemars(range(min = 1e-9, max = 1.0))]
    pub first_sd: f64,
    /// Spread of the sigma points. Far below 0.1 the weights cancel beyond the accuracy of the engine's
    /// solution.
    #[schemars(range(min = 1e-3, max = 10.0))]
    pub alpha: f64,
    /// Weight of the middle point in the covariance; 2 is best for normal beliefs.
    #[schemars(range(min = 0.0, max = 10.0))]
    pub beta: f64,
    /// Second spread of the sigma points.
    #[schemars(range(min = 0.0, max = 10.0))]
    pub kappa: f64,
    /// Draw the sigma points again between prediction and update.
    pub redraw: bool,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            engine: EngineName::default(),
            model: Model::default(),
            model_bias: 1.0,
            model_noise: 0.0,
            walk_sd: 2e-5,
            noise: 1e-3,
            first_sd: 5e-3,
            alpha: 0.5,
            beta: 2.0,
            kappa: 0.0,
            redraw: true,
        }
    }
}

impl contract::Config for Config {}

/// Filter with its belief about one engine.
#[derive(Debug, Clone)]
pub struct UnscentedKalmanFilter {
    config: Config,
    plant: Plant,
    belief: UnscentedFilter,
}

/// Registers the estimator.
pub(crate) fn register(registry: &mut Registry, version: u32) {
    let about = "unscented Kalman filter of an engine's health parameters";
    registry.agent(NAME, version, about, AgentTraits::default(), build);
}

fn build(config: Config, interface: &Interface, _rng: &mut Rng) -> Result<Box<dyn Agent>, Error> {
    let plant = Plant::new(NAME, config.engine, &config.model, config.noise, interface)?
        .distorted(config.model_bias, config.model_noise);
    let belief = healthy(&config, plant.n_parameters());
    Ok(Box::new(UnscentedKalmanFilter {
        config,
        plant,
        belief,
    }))
}

/// Belief before the first sample.
fn healthy(config: &Config, n_parameters: usize) -> UnscentedFilter {
    let Config {
        alpha, beta, kappa, ..
    } = *config;
    let (mean, sd) = (vec![0.0; n_parameters], vec![config.first_sd; n_parameters]);
    UnscentedFilter::new(SigmaPoints { alpha, beta, kappa }, config.redraw, &mean, &sd)
}

impl Agent for UnscentedKalmanFilter {
    fn act(
        &mut self,
        observations: &[Observation],
        _mode: Mode,
        rng: &mut Rng,
    ) -> Result<Vec<Action>, Error> {
        let reading = self.plant.reading(NAME, observations)?;
        let walk_sd = self.config.walk_sd;
        let walk = vec![walk_sd * walk_sd; self.plant.n_parameters()];
        let ones = vec![1.0; reading.measured.len()];
        let (plant, belief) = (&mut self.plant, &mut self.belief);
        let stepped = belief.step(&walk, &reading.measured, &ones, |theta| {
            plant.expected(&reading, theta, rng)
        });
        stepped.map_err(|failed| match failed {
            FilterError::Function(error) => error,
            FilterError::Indefinite => Error::Model {
                model: NAME,
                problem: failed.to_string(),
            },
        })?;
        Ok(self.plant.action(self.belief.mean()))
    }

    fn remembers(&self) -> bool {
        true
    }

    fn restart(&mut self) {
        self.plant.model.restart();
        self.belief = healthy(&self.config, self.plant.n_parameters());
    }
}
