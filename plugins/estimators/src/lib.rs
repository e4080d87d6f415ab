//! Estimators: agents that carry a model of the observed plant. Agents that learn know no environment; these
//! know the simulator behind one, and therefore have a crate of their own.
//!
//! Health parameters of turbofans (Y. Tian, M. Arias Chao, C. Kulkarni, K. Goebel and O. Fink, "Real-time model
//! calibration with deep reinforcement learning", Mechanical Systems and Signal Processing 165 (2022) 108284):
//! filters and least squares.
//! They read `target_<sensor>` and the flight condition from the observation, and choose the health
//! parameters that correspond to the action. Their model is the engine itself or a surrogate of it, as of the
//! environment `turbofan_calibration`. All of them have memory, and start over with every episode from a
//! healthy engine.

mod extended_kalman_filter;
mod least_squares;
mod particle_filter;
#[cfg(test)]
mod tests;
mod unscented_kalman_filter;

use contract::{Action, Error, Interface, Observation, Registry, Rng, Space};
use environments::turbofan::{Distortion, EngineName, FlightCondition, HealthParameter, Model, SensorModel};

/// Registers the estimators.
pub fn register(registry: &mut Registry) {
    unscented_kalman_filter::register(registry, 1);
    extended_kalman_filter::register(registry, 1);
    particle_filter::register(registry, 1);
    least_squares::register(registry, 1);
}

/// A model, and the positions of its inputs in an observation.
#[derive(Debug, Clone)]
struct Plant {
    model: SensorModel,
    /// Positions of the sensors and of the four numbers of the flight condition in the observation.
    sensors: Vec<usize>,
    condition: [usize; 4],
    /// Smallest and largest value of each parameter.
    limits: Vec<(f64, f64)>,
    /// Standard deviations of the sensors, in parts of their readings.
    noise: f64,
    /// Bias and noise of the model.
    distortion: Distortion,
}

/// One sample in the form of the estimators.
#[derive(Debug, Clone, PartialEq)]
struct Reading {
    condition: FlightCondition,
    /// Readings of the sensors, in units of their errors.
    measured: Vec<f64>,
    /// Inverse standard deviations of the sensors, SI.
    per_error: Vec<f64>,
}

const NO_LIMITS: &str = "the state has no channel `true_<parameter>` whose limits say what actions stand for";

/// Parameters for actions of -1 and 1: the limits of the true parameters.
fn limits(interface: &Interface, names: &[String]) -> Option<Vec<(f64, f64)>> {
    let of_name = |name: &String| {
        let channel = interface
            .state
            .iter()
            .find(|channel| channel.name == format!("true_{name}"))?;
        Some((channel.low, channel.high))
    };
    names.iter().map(of_name).collect()
}

impl Plant {
    /// Builds the plant with the engine `engine` behind the seat of an interface; sensors have errors of
    /// `noise`, in parts of their readings.
    fn new(
        agent: &'static str,
        engine: EngineName,
        model: &Model,
        noise: f64,
        interface: &Interface,
    ) -> Result<Self, Error> {
        let misfit = |problem: String| Error::Mismatch { agent, problem };
        let [seat] = &interface.seats[..] else {
            let seats = interface.seats.len();
            return Err(misfit(format!("it plays one seat, the environment has {seats}")));
        };
        let (Space::Box(seen), Space::Box(acted)) = (&seat.observation, &seat.action) else {
            return Err(misfit(
                "it estimates numbers of a box from numbers of a box".into(),
            ));
        };
        let place = |name: &str| seen.iter().position(|channel| channel.name == name);
        let needed = |name: &str| {
            place(name).ok_or_else(|| misfit(format!("it reads `{name}`, which is not observed")))
        };
        let [altitude, mach, delta_t, inlet] = FlightCondition::NAMES.map(needed);
        let condition = [altitude?, mach?, delta_t?, inlet?];
        let sensors: Vec<(usize, String)> = (0..)
            .zip(seen)
            .filter_map(|(place, channel)| Some((place, channel.name.strip_prefix("target_")?.to_owned())))
            .collect();
        let parameter = |name: &String| {
            serde_json::from_value::<HealthParameter>(serde_json::json!(name))
                .map_err(|_| misfit(format!("the action `{name}` is no health parameter of an engine")))
        };
        let acted_names: Vec<String> = acted.iter().map(|channel| channel.name.clone()).collect();
        let calibrated = acted_names.iter().map(parameter).collect::<Result<Vec<_>, _>>()?;
        let (sensors, names): (Vec<usize>, Vec<String>) = sensors.into_iter().unzip();
        Ok(Self {
            model: SensorModel::new(engine, model, &calibrated, &names)?,
            sensors,
            condition,
            limits: limits(interface, &acted_names).ok_or_else(|| misfit(NO_LIMITS.into()))?,
            noise,
            distortion: Distortion {
                bias: 1.0,
                noise: 0.0,
            },
        })
    }

    /// The same plant with a biased and noisy model.
    fn distorted(self, bias: f64, noise: f64) -> Self {
        Self {
            distortion: Distortion { bias, noise },
            ..self
        }
    }

    fn n_parameters(&self) -> usize {
        self.limits.len()
    }

    /// The reading in a batch of one observation, the only size for an agent with memory.
    fn reading(&self, agent: &'static str, observations: &[Observation]) -> Result<Reading, Error> {
        let [observation] = observations else {
            let problem = format!(
                "{} rows at a time for an estimator that remembers",
                observations.len()
            );
            return Err(Error::Mismatch { agent, problem });
        };
        let seen = &observation.seats[0];
        let values: Vec<f64> = self.sensors.iter().map(|place| seen[*place]).collect();
        let per_error: Vec<f64> = values
            .iter()
            .map(|value| 1.0 / (self.noise * value.abs()).max(f64::MIN_POSITIVE))
            .collect();
        Ok(Reading {
            condition: FlightCondition::from_array(self.condition.map(|place| seen[place])),
            measured: values
                .iter()
                .zip(&per_error)
                .map(|(value, per)| value * per)
                .collect(),
            per_error,
        })
    }

    /// Outputs of the model for the condition of a reading, in units of the sensors' errors.
    fn expected(&mut self, reading: &Reading, theta: &[f64], rng: &mut Rng) -> Result<Vec<f64>, Error> {
        let held = self.within(theta);
        let mut said = self.model.read(&reading.condition, &held)?;
        self.distortion.apply(&mut said, rng);
        said.iter_mut()
            .zip(&reading.per_error)
            .for_each(|(value, per)| *value *= per);
        Ok(said)
    }

    /// Derivatives of the model's outputs in each parameter, by central differences.
    fn slopes(&mut self, reading: &Reading, theta: &[f64], rng: &mut Rng) -> Result<Vec<Vec<f64>>, Error> {
        let step = 1e-5;
        let moved = |entry: usize, by: f64| {
            let mut moved = theta.to_vec();
            moved[entry] += by;
            moved
        };
        (0..theta.len())
            .map(|entry| {
                let above = self.expected(reading, &moved(entry, step), rng)?;
                let below = self.expected(reading, &moved(entry, -step), rng)?;
                Ok(above
                    .iter()
                    .zip(below)
                    .map(|(above, below)| (above - below) / (2.0 * step))
                    .collect())
            })
            .collect()
    }

    /// Parameters clamped to their limits.
    fn within(&self, theta: &[f64]) -> Vec<f64> {
        theta
            .iter()
            .zip(&self.limits)
            .map(|(value, (low, high))| value.clamp(*low, *high))
            .collect()
    }

    /// Action for parameters: -1 and 1 are the limits.
    fn action(&self, theta: &[f64]) -> Vec<Action> {
        let unit = |(value, (low, high)): (f64, &(f64, f64))| (2.0 * value - low - high) / (high - low);
        vec![vec![
            self.within(theta)
                .into_iter()
                .zip(&self.limits)
                .map(unit)
                .collect(),
        ]]
    }
}
