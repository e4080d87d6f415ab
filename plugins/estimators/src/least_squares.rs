//! Health parameters by least squares over the latest samples: moving-horizon estimation with a window of
//! several samples, or the best fit of one sample alone.
//!
//! The objective is `sum_k |y_k - F(w_k, theta)|^2 + |theta - theta_before|^2 / prior_sd^2`, with sensors in
//! units of their errors. A library minimises it by the Levenberg-Marquardt method (J. J. Moré 1978), from
//! the last estimate.

use crate::{Plant, Reading};
use contract::{Action, Agent, AgentTraits, Error, Interface, Mode, Observation, Registry, Rng};
use environments::turbofan::{EngineName, Model};
use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use nalgebra::{DMatrix, DVector, Dyn, Owned};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::{cell::RefCell, collections::VecDeque};

const NAME: &str = "least_squares";

/// Model, window and prior of the fit.
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
    /// Number of the latest samples that are fitted jointly.
    #[schemars(range(min = 1, max = 1000))]
    pub window: usize,
    /// Standard deviation of a parameter around the last estimate; null for no prior.
    #[schemars(range(min = 1e-9, max = 1.0))]
    pub prior_sd: Option<f64>,
    /// Standard deviation of a sensor, in parts of its reading.
    #[schemars(range(min = 1e-9, max = 1.0))]
    pub noise: f64,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            engine: EngineName::default(),
            model: Model::default(),
            model_bias: 1.0,
            model_noise: 0.0,
            window: 5,
            prior_sd: None,
            noise: 1e-3,
        }
    }
}

impl contract::Config for Config {}

/// Estimator with its window of samples.
#[derive(Debug, Clone)]
pub struct LeastSquares {
    config: Config,
    plant: Plant,
    window: VecDeque<Reading>,
    estimate: Vec<f64>,
}

/// Registers the estimator.
pub(crate) fn register(registry: &mut Registry, version: u32) {
    let about = "an engine's health parameters by least squares over the last samples";
    registry.agent(NAME, version, about, AgentTraits::default(), build);
}

fn build(config: Config, interface: &Interface, _rng: &mut Rng) -> Result<Box<dyn Agent>, Error> {
    let plant = Plant::new(NAME, config.engine, &config.model, config.noise, interface)?
        .distorted(config.model_bias, config.model_noise);
    Ok(Box::new(LeastSquares {
        estimate: vec![0.0; plant.n_parameters()],
        config,
        plant,
        window: VecDeque::new(),
    }))
}

/// Sum of squares in the form of the library. An error of the engine ends the minimisation and is kept.
struct FitProblem<'a> {
    plant: RefCell<&'a mut Plant>,
    /// Random stream of the model's noise.
    rng: RefCell<&'a mut Rng>,
    window: &'a VecDeque<Reading>,
    prior: Option<(&'a [f64], f64)>,
    theta: DVector<f64>,
    failed: RefCell<Option<Error>>,
}

impl FitProblem<'_> {
    fn kept<T>(&self, result: Result<T, Error>) -> Option<T> {
        result
            .map_err(|error| *self.failed.borrow_mut() = Some(error))
            .ok()
    }
}

impl LeastSquaresProblem<f64, Dyn, Dyn> for FitProblem<'_> {
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, Dyn>;
    type ParameterStorage = Owned<f64, Dyn>;

    fn set_params(&mut self, theta: &DVector<f64>) {
        self.theta.copy_from(theta);
    }

    fn params(&self) -> DVector<f64> {
        self.theta.clone()
    }

    fn residuals(&self) -> Option<DVector<f64>> {
        let mut off = Vec::new();
        for reading in self.window {
            let said = self.kept(self.plant.borrow_mut().expected(
                reading,
                self.theta.as_slice(),
                *self.rng.borrow_mut(),
            ))?;
            off.extend(said.iter().zip(&reading.measured).map(|(x, y)| x - y));
        }
        if let Some((before, sd)) = self.prior {
            off.extend(self.theta.iter().zip(before).map(|(x, y)| (x - y) / sd));
        }
        Some(DVector::from_vec(off))
    }

    fn jacobian(&self) -> Option<DMatrix<f64>> {
        let d = self.theta.len();
        let mut columns = vec![Vec::new(); d];
        for reading in self.window {
            let slopes = self.kept(self.plant.borrow_mut().slopes(
                reading,
                self.theta.as_slice(),
                *self.rng.borrow_mut(),
            ))?;
            columns
                .iter_mut()
                .zip(slopes)
                .for_each(|(column, slopes)| column.extend(slopes));
        }
        if let Some((_, sd)) = self.prior {
            for (entry, column) in columns.iter_mut().enumerate() {
                column.extend((0..d).map(|other| if other == entry { 1.0 / sd } else { 0.0 }));
            }
        }
        Some(DMatrix::from_fn(columns[0].len(), d, |row, column| {
            columns[column][row]
        }))
    }
}

impl Agent for LeastSquares {
    fn act(
        &mut self,
        observations: &[Observation],
        _mode: Mode,
        rng: &mut Rng,
    ) -> Result<Vec<Action>, Error> {
        let reading = self.plant.reading(NAME, observations)?;
        if self.window.len() == self.config.window {
            self.window.pop_front();
        }
        self.window.push_back(reading);
        let before = self.estimate.clone();
        let fit = FitProblem {
            plant: RefCell::new(&mut self.plant),
            rng: RefCell::new(rng),
            window: &self.window,
            prior: self.config.prior_sd.map(|sd| (&before[..], sd)),
            theta: DVector::from_column_slice(&before),
            failed: RefCell::new(None),
        };
        let (fit, _) = LevenbergMarquardt::new().with_patience(20).minimize(fit);
        let (theta, failed) = (fit.theta.as_slice().to_vec(), fit.failed.into_inner());
        if let Some(error) = failed {
            return Err(error);
        }
        self.estimate = self.plant.within(&theta);
        Ok(self.plant.action(&self.estimate))
    }

    fn remembers(&self) -> bool {
        true
    }

    fn restart(&mut self) {
        self.plant.model.restart();
        self.window.clear();
        self.estimate = vec![0.0; self.plant.n_parameters()];
    }
}
