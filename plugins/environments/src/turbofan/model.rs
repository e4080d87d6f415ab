//! An engine as estimators see it: what its sensors read for a flight condition and the calibrated health.

use super::config::{HealthParameter, LARGEST_WEAR};
use super::cycle::{Engine, Health, N};
use super::engine::EngineName;
use super::flight::FlightPoint;
use super::solver::{Held, Operation};
use super::{OUTPUTS, outputs};
use engine::Error;

/// A steady engine with warm starts.
#[derive(Debug, Clone)]
pub struct SensorModel {
    engine: Engine,
    calibrated: Vec<HealthParameter>,
    /// Places of the sensors among the outputs.
    sensors: Vec<usize>,
    unknowns: [f64; N],
}

/// A flight condition.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FlightCondition {
    /// m.
    pub altitude_m: f64,
    /// Mach number.
    pub mach: f64,
    /// How much warmer than a standard day it is, K.
    pub delta_t_k: f64,
    /// K.
    pub turbine_inlet_temperature_k: f64,
}

impl SensorModel {
    /// An engine whose sensors are outputs by name.
    ///
    /// # Errors
    /// [`Error::Config`] with the key `sensors` for a name that is no output.
    pub fn new(
        engine: EngineName,
        calibrated: &[HealthParameter],
        sensors: &[String],
    ) -> Result<Self, Error> {
        let engine = Engine::of(engine.design());
        let place = |name: &String| {
            OUTPUTS
                .iter()
                .position(|(output, _)| output == name)
                .ok_or_else(|| {
                    let known: Vec<&str> = OUTPUTS.iter().map(|(output, _)| *output).collect();
                    Error::config(
                        "sensors",
                        format!("no output is called `{name}`; there are {}", known.join(", ")),
                    )
                })
        };
        Ok(Self {
            unknowns: engine.unknowns,
            sensors: sensors.iter().map(place).collect::<Result<_, _>>()?,
            calibrated: calibrated.to_vec(),
            engine,
        })
    }

    /// What the sensors read, SI, without noise.
    ///
    /// # Errors
    /// [`Error::Model`] where the engine finds no operating point.
    pub fn read(&mut self, condition: &FlightCondition, theta: &[f64]) -> Result<Vec<f64>, Error> {
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

    /// Ratio of turbine inlet and ambient total temperature at the design point.
    pub(super) fn design_ratio(&self) -> f64 {
        self.engine.design_ratio()
    }

    /// Forgets where the last point was.
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

impl FlightCondition {
    fn point(&self) -> FlightPoint {
        FlightPoint {
            altitude_m: self.altitude_m,
            mach: self.mach,
            delta_t_k: self.delta_t_k,
            held: Held::TurbineInletTemperature(self.turbine_inlet_temperature_k),
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

    /// From the four numbers.
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
