//! Extended Kalman filter of health parameters that follow a random walk: the engine is linearised around the
//! belief (R. E. Kalman 1960; A. H. Jazwinski 1970, "Stochastic processes and filtering theory").
//!
//! | symbol | here | shape |
//! |---|---|---|
//! | x, P | `mean`, `covariance` | `[d]`, `[d, d]` |
//! | H | derivatives of the sensors in the parameters, in units of the sensors' errors | `[m, d]` |
//! | K = P H' (H P H' + 1)^-1 | `gain` | `[d, m]` |

use crate::Plant;
use contract::{Action, Agent, AgentTraits, Error, Interface, Mode, Observation, Registry, Rng};
use environments::turbofan::{EngineName, Model};
use nalgebra::{DMatrix, DVector};
use numerics::matrices::product;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

const NAME: &str = "extended_kalman_filter";

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
        }
    }
}

impl contract::Config for Config {}

/// Filter with its belief about one engine.
#[derive(Debug, Clone)]
pub struct ExtendedKalmanFilter {
    config: Config,
    plant: Plant,
    mean: DVector<f64>,
    covariance: DMatrix<f64>,
}

/// Registers the estimator.
pub(crate) fn register(registry: &mut Registry, version: u32) {
    let about = "extended Kalman filter of an engine's health parameters";
    registry.agent(NAME, version, about, AgentTraits::default(), build);
}

fn build(config: Config, interface: &Interface, _rng: &mut Rng) -> Result<Box<dyn Agent>, Error> {
    let plant = Plant::new(NAME, config.engine, &config.model, config.noise, interface)?
        .distorted(config.model_bias, config.model_noise);
    let d = plant.n_parameters();
    let mut filter = ExtendedKalmanFilter {
        config,
        plant,
        mean: DVector::zeros(d),
        covariance: DMatrix::zeros(d, d),
    };
    filter.restart();
    Ok(Box::new(filter))
}

impl Agent for ExtendedKalmanFilter {
    fn act(
        &mut self,
        observations: &[Observation],
        _mode: Mode,
        rng: &mut Rng,
    ) -> Result<Vec<Action>, Error> {
        let reading = self.plant.reading(NAME, observations)?;
        let (d, m) = (self.mean.len(), reading.measured.len());
        let theta = self.plant.within(self.mean.as_slice());
        let slopes = self.plant.slopes(&reading, &theta, rng)?;
        let slopes = DMatrix::from_fn(m, d, |sensor, parameter| slopes[parameter][sensor]);
        let expected = DVector::from_vec(self.plant.expected(&reading, &theta, rng)?);
        let walk_sd = self.config.walk_sd;
        let predicted = &self.covariance + DMatrix::identity(d, d) * (walk_sd * walk_sd);
        let joint = product(&slopes, &predicted);
        let spread = product(&joint, &slopes.transpose()) + DMatrix::identity(m, m);
        let inverse = spread.cholesky().ok_or_else(|| Error::Model {
            model: NAME,
            problem: "the covariance is not positive definite any more".into(),
        })?;
        let gain = inverse.solve(&joint).transpose();
        let off = DVector::from_vec(reading.measured) - expected;
        self.mean = DVector::from_vec(theta) + &gain * off;
        let covariance = &predicted - product(&product(&gain, &slopes), &predicted);
        // Rounding leaves the covariance slightly asymmetric.
        self.covariance = (&covariance + covariance.transpose()) * 0.5;
        Ok(self.plant.action(self.mean.as_slice()))
    }

    fn remembers(&self) -> bool {
        true
    }

    fn restart(&mut self) {
        let d = self.plant.n_parameters();
        self.plant.model.restart();
        self.mean = DVector::zeros(d);
        let first_sd = self.config.first_sd;
        self.covariance = DMatrix::identity(d, d) * (first_sd * first_sd);
    }
}
