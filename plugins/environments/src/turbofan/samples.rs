//! Sensor readings of an engine, one sample at a time: the examples to which a surrogate is fitted (thesis,
//! section 2.4, its surrogate of three hidden layers).
//!
//! An episode is one decision. A sample of a flight of the fleet and health parameters are drawn, the latter
//! uniformly in their range, whatever the fleet's own health; both are observed. For recorded flights a sample
//! is drawn with its recorded health. The action is a prediction of the sensor readings, in SI units; the
//! environment's full state is the true readings. The reward is minus the mean squared error of the outputs,
//! scaled by their ranges.
//!
//! With `corrected`, temperatures, pressures, speeds and flows are those of the same operating point in the air
//! of a standard day at sea level, which makes the function simpler to learn; the thesis' network gets the last
//! outputs instead, which hold the same information about the air.

use super::config::HealthParameter;
use super::course::Course;
use super::cycle::N;
use super::engine::EngineName;
use super::fleet::Fleet;
use super::model::{FlightCondition, Model, SensorModel};
use super::recorded::RecordedFlights;
use super::sensors::{Correction, SENSORS, SensorSetup, sensor_channels};
use crate::unit_box::check_seats;
use contract::{Channel, End, Environment, Error, Metric, PerEpisode, Rng, Seat, Space, Step};
use rand::Rng as _;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Settings of the `turbofan_samples` environment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SamplesConfig {
    /// The engine whose sensors are read.
    pub engine: EngineName,
    /// The health parameters that are drawn.
    #[schemars(length(min = 1, max = 10))]
    pub calibrated: Vec<HealthParameter>,
    /// The sensors, by names of the outputs of `turbofan`.
    #[schemars(length(min = 1, max = 25))]
    pub sensors: Vec<String>,
    /// Smallest and largest health parameter.
    #[schemars(inner(range(min = -0.1, max = 0.1)))]
    pub theta_range: [f64; 2],
    /// The fleet from whose flights samples are drawn.
    pub fleet: Fleet,
    /// Recorded flights instead of the fleet, with the recorded health.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub recorded: Option<RecordedFlights>,
    /// Whether inputs and outputs are those of a standard day at sea level.
    pub corrected: bool,
}

impl Default for SamplesConfig {
    fn default() -> Self {
        Self {
            engine: EngineName::Hbtf,
            calibrated: vec![HealthParameter::HptEfficiency],
            sensors: SENSORS.map(String::from).to_vec(),
            theta_range: [-0.03, 0.01],
            fleet: Fleet::default(),
            recorded: None,
            corrected: true,
        }
    }
}

impl contract::Config for SamplesConfig {}

/// The `turbofan_samples` environment.
#[derive(Debug)]
pub struct TurbofanSamples {
    config: SamplesConfig,
    engine: SensorModel,
    course: Course,
    /// The sensors with middle and half width over the fleet.
    channels: Vec<Channel>,
    seats: Vec<Seat>,
    metrics: Vec<Metric>,
    sample: Sample,
}

/// State of an episode.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Sample {
    /// Flight condition and health, as observed.
    inputs: Vec<f64>,
    /// True sensor readings.
    read: Vec<f64>,
    /// The action; `None` before the step.
    said: Option<Vec<f64>>,
    /// Unknowns from which the next search for an operating point starts.
    unknowns: [f64; N],
}

/// Builds the environment; registered as `turbofan_samples`.
///
/// # Errors
/// [`Error::Config`] where keys contradict each other or a sensor is not an output.
pub fn build(config: SamplesConfig) -> Result<Box<dyn Environment>, Error> {
    Ok(Box::new(TurbofanSamples::new(config)?))
}

impl TurbofanSamples {
    fn new(config: SamplesConfig) -> Result<Self, Error> {
        let SamplesConfig {
            calibrated,
            sensors,
            theta_range,
            corrected,
            ..
        } = &config;
        let watched = SensorSetup {
            sensors,
            calibrated,
            theta_range: *theta_range,
            fleet: config.fleet,
            recorded: config.recorded.as_ref(),
        };
        watched.check()?;
        let mut engine = SensorModel::new(config.engine, &Model::Engine, calibrated, sensors)?;
        let condition = if *corrected {
            FlightCondition::corrected_channels()
        } else {
            FlightCondition::channels()
        };
        let course = watched.course(engine.design_ratio())?;
        let ranges = watched.ranges(&course, (&mut engine, *corrected))?;
        engine.restart();
        let channels = sensor_channels("", sensors, &ranges);
        let [low, high] = *theta_range;
        let health = |parameter: &HealthParameter| {
            let channel = Channel::new(parameter.name(), "").within(low, high);
            channel.typical((low + high) / 2.0, (high - low) / 2.0)
        };
        let observed = condition.into_iter();
        let seat = Seat {
            name: String::new(),
            observation: Space::Box(observed.chain(calibrated.iter().map(health)).collect()),
            action: Space::Box(channels.clone()),
        };
        Ok(Self {
            sample: Sample {
                inputs: vec![0.0; 4 + calibrated.len()],
                read: vec![0.0; sensors.len()],
                said: None,
                unknowns: engine.unknowns(),
            },
            seats: vec![seat],
            metrics: metrics(),
            channels,
            engine,
            course,
            config,
        })
    }

    /// Draws a flight condition and health, with the sensor readings there.
    fn drawn(&mut self, rng: &mut Rng) -> Result<(FlightCondition, Vec<f64>, Vec<f64>), Error> {
        let (unit, at) = self.course.draw(rng);
        let sample = self.course.sample(unit, at);
        if let Some(read) = sample.read {
            return Ok((sample.condition, sample.theta, read));
        }
        let [low, high] = self.config.theta_range;
        let theta: Vec<f64> = (0..self.config.calibrated.len())
            .map(|_| low + (high - low) * rng.random::<f64>())
            .collect();
        let read = self.engine.read(&sample.condition, &theta)?;
        Ok((sample.condition, theta, read))
    }

    /// Errors of a prediction, in units of the half widths.
    fn errors<'a>(&'a self, said: &'a [f64]) -> impl Iterator<Item = f64> + 'a {
        let pairs = said.iter().zip(&self.sample.read).zip(&self.channels);
        pairs.map(|((said, read), channel)| (said - read) / channel.spread)
    }
}

fn metrics() -> Vec<Metric> {
    let last = |name: &str, unit: &str, about: &str| {
        let metric = Metric::new(name, unit, about).lower_is_better();
        metric.per_episode(PerEpisode::Last)
    };
    vec![
        last(
            "squared_error",
            "",
            "mean squared error of the outputs, scaled to [-1, 1]",
        ),
        last(
            "largest_error",
            "",
            "largest error of an output, scaled to [-1, 1]",
        ),
        last(
            "relative_error",
            "%",
            "mean absolute error of the outputs in parts of what they read",
        ),
    ]
}

impl Environment for TurbofanSamples {
    fn seats(&self) -> &[Seat] {
        &self.seats
    }

    fn metrics(&self) -> &[Metric] {
        &self.metrics
    }

    fn reset(&mut self, rng: &mut Rng) -> Result<Vec<Vec<f64>>, Error> {
        let (condition, theta, mut read) = self.drawn(rng)?;
        let seen = if self.config.corrected {
            let correction = Correction::of(&condition);
            correction.correct(&self.config.sensors, &mut read);
            correction.corrected(&condition)
        } else {
            condition
        };
        self.sample = Sample {
            inputs: [&seen.to_array()[..], &theta].concat(),
            read,
            said: None,
            unknowns: self.engine.unknowns(),
        };
        Ok(vec![self.sample.inputs.clone()])
    }

    fn step(&mut self, actions: &[Vec<f64>], _: &mut Rng) -> Result<Step, Error> {
        check_seats(actions, 1)?;
        let said = &actions[0];
        let (given, wanted) = (said.len(), self.channels.len());
        if given != wanted {
            let problem = format!("{given} entries in place of {wanted}");
            return Err(Error::Action { problem });
        }
        let squared = self.errors(said).map(|it| it * it).sum::<f64>() / wanted as f64;
        let largest = self.errors(said).fold(0.0, |most: f64, it| most.max(it.abs()));
        let parts = said.iter().zip(&self.sample.read);
        let relative = parts
            .map(|(said, read)| ((said - read) / read).abs())
            .sum::<f64>()
            / wanted as f64;
        self.sample.said = Some(said.clone());
        let seen = vec![self.sample.inputs.clone()];
        Ok(Step::new(seen, vec![-squared], Some(End::Terminated))
            .record("squared_error", squared)
            .record("largest_error", largest)
            .record("relative_error", 100.0 * relative))
    }

    fn state_channels(&self) -> Vec<Channel> {
        self.channels.clone()
    }

    /// The true sensor readings.
    fn state(&self) -> Vec<f64> {
        self.sample.read.clone()
    }

    fn trace_channels(&self) -> Vec<Channel> {
        let sensors = |prefix: &str| {
            let named = self.channels.iter();
            let channel = |it: &Channel| Channel::new(format!("{prefix}_{}", it.name), &it.unit);
            named.map(channel).collect::<Vec<_>>()
        };
        let inputs = self.seats[0].observation.names().into_iter();
        let inputs = inputs.map(|name| Channel::new(name, "")).collect();
        [inputs, sensors("read"), sensors("said")].concat()
    }

    fn trace(&self) -> Vec<f64> {
        let blank = || vec![f64::NAN; self.channels.len()];
        let said = self.sample.said.clone().unwrap_or_else(blank);
        [&self.sample.inputs[..], &self.sample.read, &said].concat()
    }

    fn snapshot(&self) -> serde_json::Value {
        let sample = Sample {
            unknowns: self.engine.unknowns(),
            ..self.sample.clone()
        };
        // Plain structs of numbers: serde_json refuses only maps whose keys are no strings.
        serde_json::to_value(sample).expect("a snapshot serialises")
    }

    fn restore(&mut self, snapshot: &serde_json::Value) -> Result<(), Error> {
        self.sample = Sample::deserialize(snapshot).map_err(|source| Error::Checkpoint {
            what: "turbofan_samples",
            problem: source.to_string(),
        })?;
        self.engine.set_unknowns(self.sample.unknowns);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use contract::random::stream;

    #[test]
    fn samples_are_of_the_engine_and_what_it_reads_costs_nothing() {
        let config = SamplesConfig {
            corrected: false,
            ..SamplesConfig::default()
        };
        let mut samples = TurbofanSamples::new(config).unwrap();
        let mut rng = stream(&["samples"]);
        let mut engine = samples.engine.clone();
        for _ in 0..20 {
            let seen = samples.reset(&mut rng).unwrap().remove(0);
            // The values of one state are the same, wherever the search starts.
            engine.restart();
            let condition = FlightCondition::from_array(std::array::from_fn(|place| seen[place]));
            let read = engine.read(&condition, &seen[4..]).unwrap();
            let state = samples.state();
            assert!(
                state.iter().zip(&read).all(|(x, y)| (x / y - 1.0).abs() < 1e-6),
                "{state:?} {read:?}"
            );
            let step = samples.step(&[state], &mut rng).unwrap();
            assert_eq!(step.rewards, [0.0]);
            assert!(step.metrics.iter().all(|(_, error)| *error == 0.0), "{step:?}");
        }
    }

    #[test]
    fn corrected_outputs_hardly_depend_on_the_air() {
        // The same corrected temperature and Mach number in thin cold air and on a warm day.
        let mut engine = TurbofanSamples::new(SamplesConfig::default()).unwrap().engine;
        let mut at = |altitude_m: f64, delta_t_k: f64, is_corrected: bool| {
            let mut condition = FlightCondition::from_array([altitude_m, 0.6, delta_t_k, 1.0]);
            let corrected = Correction::of(&condition).corrected(&condition);
            condition.turbine_inlet_temperature_k = 1600.0 / corrected.turbine_inlet_temperature_k;
            if is_corrected {
                engine.read_corrected(&condition, &[0.0]).unwrap()
            } else {
                engine.read(&condition, &[0.0]).unwrap()
            }
        };
        let mut apart = |is_corrected: bool| -> Vec<f64> {
            let (high, low) = (at(9000.0, -10.0, is_corrected), at(4000.0, 10.0, is_corrected));
            high.iter().zip(&low).map(|(x, y)| (x / y).ln().abs()).collect()
        };
        let (plain, corrected) = (apart(false), apart(true));
        for (sensor, (corrected, plain)) in SENSORS.iter().zip(corrected.iter().zip(&plain)) {
            // The remaining difference: hot gas takes up more heat, and power is taken off.
            assert!(corrected < &(0.3 * plain), "{sensor}: {corrected} {plain}");
        }
    }

    #[test]
    fn errors_by_hand() {
        let mut samples = TurbofanSamples::new(SamplesConfig::default()).unwrap();
        let mut rng = stream(&["errors"]);
        samples.reset(&mut rng).unwrap();
        let mut said = samples.state();
        said[2] += 0.28 * samples.channels[2].spread;
        let expected = 100.0 * (said[2] / samples.state()[2] - 1.0) / 14.0;
        let step = samples.step(&[said], &mut rng).unwrap();
        for (metric, value) in [
            ("squared_error", 0.28 * 0.28 / 14.0),
            ("largest_error", 0.28),
            ("relative_error", expected),
        ] {
            assert!((step.metric(metric).unwrap() - value).abs() < 1e-12, "{step:?}");
        }
        let error = samples.step(&[vec![1.0]], &mut rng).unwrap_err().to_string();
        assert!(error.contains("1 entries in place of 14"), "{error}");
    }
}
