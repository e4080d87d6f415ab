//! An engine from the view of estimators: sensor readings for a flight condition and the calibrated health.

use super::atmosphere::Air;
use super::config::{HealthParameter, LARGEST_WEAR};
use super::cycle::{Engine, Health, N};
use super::engine::EngineName;
use super::flight::FlightPoint;
use super::sensors::Correction;
use super::solver::{HeldQuantity, Operation};
use super::surrogate::Surrogate;
use super::{OUTPUTS, outputs};
use arithmetic::draws::normal;
use contract::{Artifact, Channel, Error, Rng, artifact::Policy};
use rand::RngCore as _;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The model of an engine.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Model {
    /// The engine itself.
    #[default]
    Engine,
    /// A network fitted to the engine, which `network_regression` leaves after `turbofan_samples`.
    Surrogate(Artifact<Policy>),
}

/// The error of a model: random and constant factors of its outputs (thesis, table 2.4).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Distortion {
    /// Constant factor of all outputs; 1 for none.
    pub bias: f64,
    /// Standard deviation of a normal factor around 1, drawn for each output; 0 for none.
    pub noise: f64,
}

impl Distortion {
    /// Multiplies outputs, in any unit.
    pub fn apply(&self, outputs: &mut [f64], rng: &mut Rng) {
        for value in outputs {
            *value *= self.bias;
            if self.noise > 0.0 {
                *value *= 1.0 + self.noise * normal(rng.next_u64());
            }
        }
    }
}

/// The sensors of a steady engine, or of a surrogate of one.
#[derive(Debug, Clone)]
pub struct SensorModel {
    engine: Engine,
    calibrated: Vec<HealthParameter>,
    /// Positions of the sensors among the outputs.
    sensors: Vec<usize>,
    /// Unknowns of the last point, from which the next search starts.
    unknowns: [f64; N],
    /// The network that replaces the engine, if any.
    surrogate: Option<Surrogate>,
}

/// A flight condition.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FlightCondition {
    /// Altitude, m.
    pub altitude_m: f64,
    /// Mach number.
    pub mach: f64,
    /// Excess over the temperature of a standard day, K.
    pub delta_t_k: f64,
    /// Turbine inlet temperature, K.
    pub turbine_inlet_temperature_k: f64,
}

impl SensorModel {
    /// An engine, or a model of it, whose sensors are outputs by name.
    ///
    /// # Errors
    /// [`Error::Config`] at the key `sensors` for a name that is not an output, and for a surrogate that has
    /// other inputs or cannot be read.
    pub fn new(
        engine: EngineName,
        model: &Model,
        calibrated: &[HealthParameter],
        sensors: &[String],
    ) -> Result<Self, Error> {
        let engine = Engine::of(engine.design());
        let surrogate = match model {
            Model::Engine => None,
            Model::Surrogate(product) => {
                let health: Vec<&str> = calibrated.iter().map(|it| it.name()).collect();
                Some(Surrogate::read(product, &health, sensors)?)
            }
        };
        Ok(Self {
            unknowns: engine.unknowns,
            sensors: sensors.iter().map(output).collect::<Result<_, _>>()?,
            calibrated: calibrated.to_vec(),
            engine,
            surrogate,
        })
    }

    /// Sensor readings, SI, without noise.
    ///
    /// # Errors
    /// [`Error::Model`] where the engine finds no operating point.
    pub fn read(&mut self, condition: &FlightCondition, theta: &[f64]) -> Result<Vec<f64>, Error> {
        if let Some(surrogate) = &self.surrogate {
            return Ok(surrogate.read_sensors(condition, theta));
        }
        let mut health = Health::default();
        for (parameter, value) in self.calibrated.iter().zip(theta) {
            parameter.set(&mut health, value.clamp(-LARGEST_WEAR, LARGEST_WEAR));
        }
        let operation = Operation::at(&condition.point(), health);
        let found = self.engine.solve(&operation, &mut self.unknowns);
        let point = found.map_err(|failed| Error::Model {
            model: "turbofan",
            problem: format!(
                "no operating point at {condition:?} for {theta:?}: {}",
                failed.in_words()
            ),
        })?;
        let all = outputs(&self.engine, &point, &self.unknowns);
        Ok(self.sensors.iter().map(|place| all[*place]).collect())
    }

    /// Sensor readings for corrected outputs.
    ///
    /// # Errors
    /// The errors of [`read`](Self::read).
    pub(super) fn read_corrected(
        &mut self,
        condition: &FlightCondition,
        theta: &[f64],
    ) -> Result<Vec<f64>, Error> {
        let correction = Correction::of(condition);
        let mut read = self.read(condition, theta)?;
        for (value, place) in read.iter_mut().zip(&self.sensors) {
            *value /= correction.factor(OUTPUTS[*place].0);
        }
        Ok(read)
    }

    /// Ratio of turbine inlet and ambient total temperature at the design point.
    pub(super) fn design_ratio(&self) -> f64 {
        self.engine.design_ratio()
    }

    /// Forgets the last point, so that the next search starts at the design point.
    pub fn restart(&mut self) {
        self.unknowns = self.engine.unknowns;
    }

    pub(super) fn unknowns(&self) -> [f64; N] {
        self.unknowns
    }

    pub(super) fn set_unknowns(&mut self, unknowns: [f64; N]) {
        self.unknowns = unknowns;
    }
}

/// Channel of the turbine inlet temperature on a standard day at sea level, an input of surrogates.
const CORRECTED_TEMPERATURE: &str = "corrected_turbine_inlet_temperature_k";

/// Position of a sensor among the outputs.
fn output(name: &String) -> Result<usize, Error> {
    let found = OUTPUTS.iter().position(|(output, _)| output == name);
    found.ok_or_else(|| {
        let known: Vec<&str> = OUTPUTS.iter().map(|(output, _)| *output).collect();
        let problem = format!("no output is called `{name}`; there are {}", known.join(", "));
        Error::config("sensors", problem)
    })
}

impl FlightCondition {
    /// Names of the numbers, in the order of observations.
    pub const NAMES: [&str; 4] = ["altitude_m", "mach", "delta_t_k", "turbine_inlet_temperature_k"];

    /// Channels of the numbers in observations.
    pub(super) fn channels() -> Vec<Channel> {
        vec![
            Channel::new(Self::NAMES[0], "m").typical(6500.0, 3500.0),
            Channel::new(Self::NAMES[1], "").typical(0.6, 0.2),
            Channel::new(Self::NAMES[2], "K").typical(0.0, 15.0),
            Channel::new(Self::NAMES[3], "K").typical(1400.0, 200.0),
        ]
    }

    /// The air in which the engine flies.
    pub(super) fn air(&self) -> Air {
        Air::at(self.altitude_m, self.mach, self.delta_t_k)
    }

    /// The channels of a flight condition with corrected turbine inlet temperature.
    pub(super) fn corrected_channels() -> Vec<Channel> {
        let mut channels = Self::channels();
        channels[3] = Channel::new(CORRECTED_TEMPERATURE, "K").typical(1600.0, 150.0);
        channels
    }

    fn point(&self) -> FlightPoint {
        FlightPoint {
            altitude_m: self.altitude_m,
            mach: self.mach,
            delta_t_k: self.delta_t_k,
            held: HeldQuantity::TurbineInletTemperature(self.turbine_inlet_temperature_k),
        }
    }

    pub(super) fn of(point: &FlightPoint) -> Self {
        Self {
            altitude_m: point.altitude_m,
            mach: point.mach,
            delta_t_k: point.delta_t_k,
            turbine_inlet_temperature_k: point.held.value(),
        }
    }

    /// The four numbers, in the order of observations.
    #[must_use]
    pub fn to_array(self) -> [f64; 4] {
        [
            self.altitude_m,
            self.mach,
            self.delta_t_k,
            self.turbine_inlet_temperature_k,
        ]
    }

    /// A flight condition from the four numbers.
    #[must_use]
    pub fn from_array([altitude_m, mach, delta_t_k, turbine_inlet_temperature_k]: [f64; 4]) -> Self {
        Self {
            altitude_m,
            mach,
            delta_t_k,
            turbine_inlet_temperature_k,
        }
    }
}
