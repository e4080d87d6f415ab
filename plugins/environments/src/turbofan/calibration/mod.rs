//! Calibration as a tracking problem: health parameters are chosen so that a model follows an engine's sensors
//! (thesis, section 2.3).
//!
//! | thesis | here | shape |
//! |---|---|---|
//! | x_t, measured | `target_<sensor>`: the engine with its true health, with noise if configured | `[sensors]`
//! |
//! | x̂_t = F(w_t, theta_t) | `model_<sensor>`: the model with the health of the last action | `[sensors]` |
//! | w_t | `altitude_m`, `mach`, `delta_t_k`, `turbine_inlet_temperature_k` | `[4]` |
//! | s_t = [x̂_t, w_{t+1}, x_{t+1}] | the observation | `[2 sensors + 4]` |
//! | a_t | the action, -1 to 1 for the smallest to the largest theta_{t+1} | `[calibrated]` |
//! | c_t | minus the reward, from outputs scaled to [-1, 1] over the fleet's flights | scalar |
//!
//! The model has no memory: a steady engine has no state, so that x̂_{t+1} does not depend on x̂_t. In training
//! an episode is a piece of a trajectory. It begins anywhere and continues with the beginning of the trajectory
//! at its end, so that every position in every life is equally likely, in the first sample of an episode and in
//! all of them. In tracking, an episode is the whole trajectory of one unit after the other.

mod config;
#[cfg(test)]
mod tests;

pub use config::{CalibrationConfig, Cost, Trajectory};

use super::config::HealthParameter;
use super::course::Course;
use super::cycle::N;
use super::model::{Distortion, Model, SensorModel};
use super::recorded::Sample;
use super::sensors::SensorSetup;
use crate::unit_box::check_seats;
use arithmetic::{draws::normal, power::pow};
use config::{metrics, seat};
use contract::{Channel, End, Environment, Error, Metric, Rng, Seat, Step};
use rand::RngCore as _;
use serde::{Deserialize, Serialize};

/// The `turbofan_calibration` environment.
#[derive(Debug)]
pub struct TurbofanCalibration {
    config: CalibrationConfig,
    /// The measured engine, and the model.
    truth: SensorModel,
    model: SensorModel,
    /// Middle and half width of each sensor over the flights of a fleet.
    ranges: Vec<(f64, f64)>,
    seats: Vec<Seat>,
    metrics: Vec<Metric>,
    course: Course,
    /// The target sample, which follows from `progress.unit` and `progress.at`.
    sample: Sample,
    progress: Progress,
}

/// State of an episode.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Progress {
    unit: usize,
    /// Position of the target sample in the unit's trajectory.
    at: usize,
    /// Number of samples left.
    left: usize,
    /// Sensor readings at the target sample.
    target: Vec<f64>,
    /// Last output of the model, with the position of its sample and the sensor readings there.
    model: Vec<f64>,
    said_of: usize,
    said_against: Vec<f64>,
    /// True and chosen health of the last decision; empty before the first.
    theta: Vec<f64>,
    chosen: Vec<f64>,
    /// Sums of squared errors of this episode: of health and of scaled outputs.
    squares: (f64, f64),
    decisions: u64,
    /// Unknowns of the two engines, from which the next searches start.
    unknowns: [[f64; N]; 2],
}

/// Builds the environment; registered as `turbofan_calibration`.
///
/// # Errors
/// [`Error::Config`] where keys contradict each other or a sensor is not an output.
pub fn build(config: CalibrationConfig) -> Result<Box<dyn Environment>, Error> {
    Ok(Box::new(TurbofanCalibration::new(config)?))
}

impl TurbofanCalibration {
    /// # Errors
    /// Errors of [`build`].
    pub fn new(config: CalibrationConfig) -> Result<Self, Error> {
        let of = |model: &Model| SensorModel::new(config.engine, model, &config.calibrated, &config.sensors);
        let watched = SensorSetup {
            sensors: &config.sensors,
            calibrated: &config.calibrated,
            theta_range: config.theta_range,
            fleet: config.fleet,
            recorded: config.recorded.as_ref(),
        };
        watched.check()?;
        let (truth, model) = (of(&Model::Engine)?, of(&config.model)?);
        let course = watched.course(truth.design_ratio())?;
        let ranges = watched.ranges(&course, (&mut truth.clone(), false))?;
        let unknowns = truth.unknowns();
        Ok(Self {
            seats: vec![seat(&config, &ranges)],
            metrics: metrics(&config.calibrated),
            sample: course.sample(0, 0),
            course,
            progress: Progress {
                unit: 0,
                at: 0,
                left: 0,
                target: Vec::new(),
                model: Vec::new(),
                said_of: 0,
                said_against: Vec::new(),
                theta: Vec::new(),
                chosen: Vec::new(),
                squares: (0.0, 0.0),
                decisions: 0,
                unknowns: [unknowns; 2],
            },
            model,
            truth,
            ranges,
            config,
        })
    }

    /// Reads the sensors at the target sample.
    fn measure(&mut self, rng: &mut Rng) -> Result<Vec<f64>, Error> {
        let Sample {
            condition,
            theta,
            read,
        } = &self.sample;
        let mut read = match read {
            Some(read) => read.clone(),
            None => self.truth.read(condition, theta)?,
        };
        if let Some(snr_db) = self.config.sensor_snr_db {
            let sd = pow(10.0, -snr_db / 20.0);
            read.iter_mut()
                .for_each(|value| *value *= 1.0 + sd * normal(rng.next_u64()));
        }
        Ok(read)
    }

    /// Moves the target to a sample of the unit and reads its sensors.
    fn aim(&mut self, at: usize, rng: &mut Rng) -> Result<(), Error> {
        self.progress.at = at;
        self.sample = self.course.sample(self.progress.unit, at);
        self.progress.target = self.measure(rng)?;
        Ok(())
    }

    /// Begins an episode of a unit with the sample `at`.
    fn begin(
        &mut self,
        unit: usize,
        (at, left): (usize, usize),
        rng: &mut Rng,
    ) -> Result<Vec<Vec<f64>>, Error> {
        self.truth.restart();
        self.model.restart();
        self.progress.unit = unit;
        self.aim(at, rng)?;
        self.progress.left = left;
        // The model's first output is the sensor readings.
        self.progress.model.clone_from(&self.progress.target);
        self.remember_target();
        (self.progress.theta, self.progress.chosen) = (Vec::new(), Vec::new());
        (self.progress.squares, self.progress.decisions) = ((0.0, 0.0), 0);
        Ok(self.observe())
    }

    /// Output of the model for the target sample with the chosen health.
    fn model_output(&mut self, theta: &[f64], rng: &mut Rng) -> Result<Vec<f64>, Error> {
        let mut said = self.model.read(&self.sample.condition, theta)?;
        let distortion = Distortion {
            bias: self.config.model_bias,
            noise: self.config.model_noise,
        };
        distortion.apply(&mut said, rng);
        Ok(said)
    }

    /// Remembers the present target for the error of the model's output, since the target moves on.
    fn remember_target(&mut self) {
        self.progress.said_of = self.progress.at;
        self.progress.said_against.clone_from(&self.progress.target);
    }

    /// Mean and norm of the squared scaled errors of the outputs.
    fn output_error(&self) -> (f64, f64) {
        let errors = self
            .progress
            .model
            .iter()
            .zip(&self.progress.target)
            .zip(&self.ranges);
        let sum: f64 = errors
            .map(|((model, target), (_, half))| (model - target) / half)
            .map(|error| error * error)
            .sum();
        (sum / self.ranges.len() as f64, sum.sqrt())
    }

    fn observe(&self) -> Vec<Vec<f64>> {
        let condition = self.sample.condition.to_array();
        vec![[&self.progress.model[..], &condition, &self.progress.target].concat()]
    }

    /// The health parameters of an action.
    fn chosen(&self, actions: &[Vec<f64>]) -> Result<Vec<f64>, Error> {
        check_seats(actions, 1)?;
        let (given, wanted) = (actions[0].len(), self.config.calibrated.len());
        if given != wanted {
            let problem = format!("{given} entries in place of {wanted}");
            return Err(Error::Action { problem });
        }
        let [low, high] = self.config.theta_range;
        let of_unit = |(parameter, unit): (&HealthParameter, &f64)| {
            // Squashing functions in single precision round to just beyond 1.
            if unit.abs() <= 1.0 + 1e-6 {
                return Ok((low + high) / 2.0 + (high - low) / 2.0 * unit.clamp(-1.0, 1.0));
            }
            let problem = format!("{} is {unit}, outside [-1, 1]", parameter.name());
            Err(Error::Action { problem })
        };
        self.config
            .calibrated
            .iter()
            .zip(&actions[0])
            .map(of_unit)
            .collect()
    }
}

impl Environment for TurbofanCalibration {
    fn seats(&self) -> &[Seat] {
        &self.seats
    }

    fn metrics(&self) -> &[Metric] {
        &self.metrics
    }

    fn reset(&mut self, rng: &mut Rng) -> Result<Vec<Vec<f64>>, Error> {
        let (unit, at) = self.course.draw(rng);
        let length = self.course.length(unit);
        match self.config.trajectory {
            Trajectory::Units => self.begin(unit, (0, length), rng),
            Trajectory::Piece(piece) => self.begin(unit, (at, piece.min(length)), rng),
        }
    }

    fn reset_to(&mut self, episode: u64, rng: &mut Rng) -> Result<Vec<Vec<f64>>, Error> {
        match self.config.trajectory {
            Trajectory::Piece(_) => self.reset(rng),
            Trajectory::Units => {
                // The remainder is below the number of units.
                let unit = (episode % self.course.n_units() as u64) as usize;
                self.begin(unit, (0, self.course.length(unit)), rng)
            }
        }
    }

    fn step(&mut self, actions: &[Vec<f64>], rng: &mut Rng) -> Result<Step, Error> {
        let chosen = self.chosen(actions)?;
        self.progress.model = self.model_output(&chosen, rng)?;
        self.remember_target();
        let theta = self.sample.theta.clone();
        let squared: Vec<f64> = theta
            .iter()
            .zip(&chosen)
            .map(|(true_one, it)| (true_one - it) * (true_one - it))
            .collect();
        let (mean, norm) = self.output_error();
        let cost = match self.config.cost {
            Cost::MeanSquared => mean,
            Cost::Kinked if norm <= 0.01 => norm,
            Cost::Kinked => 10.0 * norm,
        };
        let progress = &mut self.progress;
        progress.squares.0 += squared.iter().sum::<f64>() / squared.len() as f64;
        progress.squares.1 += mean;
        progress.decisions += 1;
        (progress.theta, progress.chosen) = (theta, chosen);
        let n = progress.decisions as f64;
        let rmse = [progress.squares.0, progress.squares.1].map(|sum| (sum / n).sqrt());
        progress.left -= 1;
        let over = progress.left == 0;
        if !over {
            let next = (self.progress.at + 1) % self.course.length(self.progress.unit);
            self.aim(next, rng)?;
        }
        let calibrated = self.config.calibrated.iter().zip(squared);
        Ok(
            Step::new(self.observe(), vec![-cost], over.then_some(End::Truncated))
                .record("theta_rmse", rmse[0])
                .record("output_rmse", rmse[1])
                .record_all(
                    calibrated.map(|(parameter, squared)| (config::squared_error(parameter), squared)),
                ),
        )
    }

    /// The limits are the health at actions of -1 and 1.
    fn state_channels(&self) -> Vec<Channel> {
        let [low, high] = self.config.theta_range;
        let channel = |parameter: &HealthParameter| {
            Channel::new(format!("true_{}", parameter.name()), "")
                .within(low, high)
                .typical((low + high) / 2.0, (high - low) / 2.0)
        };
        self.config.calibrated.iter().map(channel).collect()
    }

    /// The true health of the target sample.
    fn state(&self) -> Vec<f64> {
        self.sample.theta.clone()
    }

    fn trace_channels(&self) -> Vec<Channel> {
        let parameters = |prefix: &str| {
            let names = self.config.calibrated.iter();
            names
                .map(|it| Channel::new(format!("{prefix}_{}", it.name()), ""))
                .collect::<Vec<_>>()
        };
        let sensors = |prefix: &str| {
            let names = self.config.sensors.iter();
            names
                .map(|it| Channel::new(format!("{prefix}_{it}"), ""))
                .collect::<Vec<_>>()
        };
        [
            vec![Channel::new("unit", ""), Channel::new("sample", "")],
            parameters("true"),
            parameters("inferred"),
            sensors("target"),
            sensors("model"),
        ]
        .concat()
    }

    fn trace(&self) -> Vec<f64> {
        let progress = &self.progress;
        let (parameters, sensors) = (self.config.calibrated.len(), self.config.sensors.len());
        let mut row = vec![self.course.number(progress.unit) as f64, progress.said_of as f64];
        let or_blank = |values: &[f64], n: usize| {
            if values.is_empty() {
                vec![f64::NAN; n]
            } else {
                values.to_vec()
            }
        };
        row.extend(or_blank(&progress.theta, parameters));
        row.extend(or_blank(&progress.chosen, parameters));
        row.extend(or_blank(&progress.said_against, sensors));
        row.extend(or_blank(&progress.model, sensors));
        row
    }

    fn snapshot(&self) -> serde_json::Value {
        let unknowns = [self.truth.unknowns(), self.model.unknowns()];
        let progress = Progress {
            unknowns,
            ..self.progress.clone()
        };
        // Plain structs of numbers: serde_json refuses only maps whose keys are no strings.
        serde_json::to_value(progress).expect("a snapshot serialises")
    }

    fn restore(&mut self, snapshot: &serde_json::Value) -> Result<(), Error> {
        self.progress = Progress::deserialize(snapshot).map_err(|source| Error::Checkpoint {
            what: "turbofan_calibration",
            problem: source.to_string(),
        })?;
        self.truth.set_unknowns(self.progress.unknowns[0]);
        self.model.set_unknowns(self.progress.unknowns[1]);
        self.sample = self.course.sample(self.progress.unit, self.progress.at);
        Ok(())
    }
}
