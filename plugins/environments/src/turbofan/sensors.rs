//! Sensors of an engine: their names, their ranges, and the settings that environments with sensors share.

use super::OUTPUTS;
use super::atmosphere::SEA_LEVEL;
use super::config::{HealthParameter, LARGEST_WEAR, check_calibrated};
use super::course::{Course, SyntheticCourse};
use super::fleet::Fleet;
use super::model::{FlightCondition, SensorModel};
use super::recorded::{RecordedFlights, Recording, RecordingRequest};
use contract::{Channel, Error};

/// Default sensors: those of N-CMAPSS that are informative about health.
pub(super) const SENSORS: [&str; 14] = [
    "n1_rpm",
    "n2_rpm",
    "fuel_flow_kg_s",
    "t21_k",
    "t24_k",
    "t30_k",
    "t48_k",
    "t50_k",
    "p15_pa",
    "p21_pa",
    "p24_pa",
    "p30_pa",
    "p45_pa",
    "p50_pa",
];

/// The part of a config that the environments with sensors share.
#[derive(Debug, Clone, Copy)]
pub(super) struct SensorSetup<'a> {
    pub sensors: &'a [String],
    pub calibrated: &'a [HealthParameter],
    pub theta_range: [f64; 2],
    pub fleet: Fleet,
    pub recorded: Option<&'a RecordedFlights>,
}

impl SensorSetup<'_> {
    /// Refuses parameters that are named twice, a range of theta outside the engines' range of validity, and a
    /// fleet beside recorded flights.
    ///
    /// # Errors
    /// [`Error::Config`] at the key.
    pub(super) fn check(&self) -> Result<(), Error> {
        check_calibrated(self.calibrated)?;
        let [low, high] = self.theta_range;
        if !(-LARGEST_WEAR..LARGEST_WEAR).contains(&low) || low >= high || high > LARGEST_WEAR {
            let problem = format!("[{low}, {high}] is no range inside [-{LARGEST_WEAR}, {LARGEST_WEAR}]");
            return Err(Error::config("theta_range", problem));
        }
        if self.recorded.is_some() && self.fleet != Fleet::default() {
            let problem = "flights are recorded, so that there is no fleet: leave one of the two out";
            return Err(Error::config("fleet", problem));
        }
        Ok(())
    }

    /// The flights of the units, and their health.
    ///
    /// # Errors
    /// The errors of [`Recording::of`].
    pub(super) fn course(&self, design_ratio: f64) -> Result<Course, Error> {
        let Self {
            sensors,
            calibrated,
            theta_range,
            ..
        } = *self;
        let Some(recorded) = self.recorded else {
            return Ok(Course::Synthetic(SyntheticCourse {
                fleet: self.fleet,
                calibrated: calibrated.to_vec(),
                design_ratio,
            }));
        };
        let asked = RecordingRequest {
            sensors,
            calibrated,
            theta_range,
        };
        Recording::of(recorded, &asked).map(Course::Recorded)
    }

    /// Middle and half width of each sensor, as it is read or corrected: those of the whole recording, or over
    /// some points of some flights of the default fleet at the smallest and the largest health, since a policy
    /// that is trained with one fleet is measured with another. Few points have to suffice, because
    /// environments are built often.
    ///
    /// # Errors
    /// [`Error::Model`] where the engine finds no operating point.
    pub(super) fn ranges(
        &self,
        course: &Course,
        (engine, is_corrected): (&mut SensorModel, bool),
    ) -> Result<Vec<(f64, f64)>, Error> {
        if let Course::Recorded(recording) = course {
            return Ok(recording.ranges(is_corrected));
        }
        let read = if is_corrected {
            SensorModel::read_corrected
        } else {
            SensorModel::read
        };
        let [low, high] = self.theta_range;
        let mut reads = Vec::new();
        for unit in 0..3 {
            let flight = Fleet::default().flight(unit, 0, engine.design_ratio());
            for point in (0..4).map(|corner| &flight[corner * (flight.len() - 1) / 3]) {
                for theta in [low.max(-0.02), high.min(0.01)] {
                    let theta = vec![theta; self.calibrated.len()];
                    reads.push(read(engine, &FlightCondition::of(point), &theta)?);
                }
            }
        }
        let of_sensor = |sensor: usize| range(reads.iter().map(|read| read[sensor]));
        Ok((0..reads[0].len()).map(of_sensor).collect())
    }
}

/// Middle and half width of some values; the half width is never 0.
pub(super) fn range(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| {
        (low.min(value), high.max(value))
    });
    ((low + high) / 2.0, ((high - low) / 2.0).max(1e-9 * high.abs()))
}

/// Factors of outputs for an engine with the same corrected speeds and temperatures in other air: one for each
/// unit, from theta = T / 288.15 K and delta = p / 101325 Pa of the air's total temperature and pressure (P. P.
/// Walsh and P. Fletcher, "Gas turbine performance", chapter 4). A surrogate of corrected outputs does not have
/// to learn these dimensional relations.
#[derive(Debug, Clone, Copy)]
pub(super) struct Correction {
    theta: f64,
    delta: f64,
}

impl Correction {
    pub(super) fn of(condition: &FlightCondition) -> Self {
        let air = condition.air();
        Self {
            theta: air.total_temperature / SEA_LEVEL.0,
            delta: air.total_pressure / SEA_LEVEL.1,
        }
    }

    /// The factor of an output.
    pub(super) fn factor(&self, output: &str) -> f64 {
        let Self { theta, delta } = *self;
        match unit(output) {
            "K" => theta,
            "Pa" | "N" => delta,
            "rpm" => theta.sqrt(),
            "kg/s" if output == "fuel_flow_kg_s" => delta * theta.sqrt(),
            "kg/s" => delta / theta.sqrt(),
            _ => 1.0,
        }
    }

    /// Corrects sensor readings.
    pub(super) fn correct(&self, sensors: &[String], read: &mut [f64]) {
        for (value, sensor) in read.iter_mut().zip(sensors) {
            *value /= self.factor(sensor);
        }
    }

    /// The flight condition with the turbine inlet temperature of a standard day at sea level.
    pub(super) fn corrected(&self, condition: &FlightCondition) -> FlightCondition {
        FlightCondition {
            turbine_inlet_temperature_k: condition.turbine_inlet_temperature_k / self.theta,
            ..*condition
        }
    }
}

fn unit(output: &str) -> &'static str {
    let known = OUTPUTS.iter().find(|(name, _)| *name == output);
    known.map_or("", |(_, unit)| unit)
}

/// Channels of sensors with their ranges.
pub(super) fn sensor_channels(prefix: &str, sensors: &[String], ranges: &[(f64, f64)]) -> Vec<Channel> {
    let channel = |(name, (middle, half)): (&String, &(f64, f64))| {
        Channel::new(format!("{prefix}{name}"), unit(name)).typical(*middle, *half)
    };
    sensors.iter().zip(ranges).map(channel).collect()
}
