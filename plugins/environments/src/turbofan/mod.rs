//! A turbofan over a flight: the sensor readings for the health parameters that actions set.
//!
//! Thesis, chapter 2. Its two case studies run on programs and data that are not public, so the engines are
//! models of this project: component maps and conservation laws, compared with pyCycle's high-bypass example
//! and its N+3 engine (O. J. Jasa et al., OpenMDAO/pyCycle) and NASA's AGTF30. The modules hold the atmosphere,
//! the gas, maps and components, the cycle, its design point, and Newton's method.
//!
//! One decision is one point of the flight: the action sets the calibrated health parameters, and the engine
//! finds its operating point. There is no reward; the tracking problem of section 2.3 is another environment.
//!
//! | thesis | here | unit |
//! |---|---|---|
//! | theta | the action, one entry per calibrated parameter, added to 1; 0 is healthy | - |
//! | w | `altitude_m`, `mach`, `delta_t_k` and the held quantity | m, -, K |
//! | x | the trace: speeds, fuel flow, temperatures and pressures by station | SI |
//!
//! Stations: 2 behind the inlet, 21 behind the fan, 15 before the bypass nozzle, 24 behind the low-pressure
//! compressor, 30 behind the high-pressure one, 40 behind the burner, 45 and 48 behind the high-pressure turbine
//! (pressure and temperature), 50 behind the low-pressure one. `n1_rpm` is the low-pressure shaft, which turns the
//! fan through the gear, and `n2_rpm` the high-pressure one.

mod atmosphere;
pub mod calibration;
mod component;
mod config;
mod course;
mod cycle;
mod design_point;
mod engine;
mod fleet;
mod flight;
mod gas;
mod map;
mod model;
mod number;
mod recorded;
pub mod samples;
mod sensors;
mod solver;
mod surrogate;
#[cfg(test)]
mod tests;
mod transient;

pub use config::{Dynamics, HealthParameter, TurbofanConfig};
pub use engine::EngineName;
pub use fleet::{Degradation, Fleet};
pub use flight::{Flight, FlightClass};
pub use model::{Distortion, FlightCondition, Model, SensorModel};
pub use recorded::RecordedFlights;

use crate::unit_box::check_seats;
use config::LARGEST_WEAR;
use contract::{Channel, End, Environment, Error, Metric, Rng, Seat, Space, Step};
use cycle::{Engine, Health, N, Point};
use flight::{FlightPoint, Route};
use serde::{Deserialize, Serialize};
use solver::Operation;

/// Names and units of a point's recorded outputs.
const OUTPUTS: [(&str, &str); 25] = [
    ("n1_rpm", "rpm"),
    ("n2_rpm", "rpm"),
    ("fuel_flow_kg_s", "kg/s"),
    ("t24_k", "K"),
    ("p24_pa", "Pa"),
    ("t30_k", "K"),
    ("p30_pa", "Pa"),
    ("t40_k", "K"),
    ("t48_k", "K"),
    ("p45_pa", "Pa"),
    ("t50_k", "K"),
    ("p50_pa", "Pa"),
    ("p21_pa", "Pa"),
    ("bypass_ratio", ""),
    ("thrust_n", "N"),
    ("mass_flow_kg_s", "kg/s"),
    ("fan_rpm", "rpm"),
    ("t2_k", "K"),
    ("p2_pa", "Pa"),
    ("t21_k", "K"),
    ("p15_pa", "Pa"),
    ("fuel_air_ratio", ""),
    ("bypass_nozzle_area_m2", "m^2"),
    ("n1_acceleration_rpm_s", "rpm/s"),
    ("n2_acceleration_rpm_s", "rpm/s"),
];

/// The `turbofan` environment.
#[derive(Debug)]
pub struct Turbofan {
    config: TurbofanConfig,
    engine: Engine,
    given_health: Health,
    route: Route,
    seats: Vec<Seat>,
    metrics: Vec<Metric>,
    progress: Progress,
}

/// State of an episode.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Progress {
    points: Vec<FlightPoint>,
    /// Number of points flown so far.
    flown: usize,
    /// The unknowns of the last point, from which the next search starts.
    unknowns: [f64; N],
    /// The operation of the last point.
    last: Option<Operation>,
    /// The outputs of the last point, in the order of [`OUTPUTS`]; empty before the first.
    outputs: Vec<f64>,
}

/// Builds the environment; registered as `turbofan`.
///
/// # Errors
/// [`Error::Config`] where keys contradict each other, [`Error::File`] and [`Error::Input`] for a file of a
/// flight that cannot be read or is invalid.
pub fn build(config: TurbofanConfig) -> Result<Box<dyn Environment>, Error> {
    Ok(Box::new(Turbofan::new(config)?))
}

impl Turbofan {
    /// An engine on the ground; call `reset` before `step`.
    ///
    /// # Errors
    /// Errors of [`build`].
    pub fn new(config: TurbofanConfig) -> Result<Self, Error> {
        let engine = Engine::of(config.engine.design());
        let action = config
            .calibrated
            .iter()
            .map(|parameter| {
                Channel::new(parameter.name(), "")
                    .within(-LARGEST_WEAR, LARGEST_WEAR)
                    .typical(0.0, 0.02)
            })
            .collect();
        let seat = Seat {
            name: String::new(),
            observation: Space::Box(flight_channels()),
            action: Space::Box(action),
        };
        Ok(Self {
            given_health: config.given_health()?,
            route: Route::new(&config.flight)?,
            seats: vec![seat],
            metrics: vec![
                Metric::new(
                    "fuel_kg",
                    "kg",
                    "fuel burnt over the points, each held for a second",
                )
                .lower_is_better(),
            ],
            progress: Progress {
                points: Vec::new(),
                flown: 0,
                unknowns: engine.unknowns,
                last: None,
                outputs: Vec::new(),
            },
            engine,
            config,
        })
    }

    /// The configured health with the parameters of an action.
    fn health(&self, action: &[f64]) -> Result<Health, Error> {
        let (given, wanted) = (action.len(), self.config.calibrated.len());
        if given != wanted {
            let problem = format!("{given} entries in place of {wanted}");
            return Err(Error::Action { problem });
        }
        let mut health = self.given_health;
        for (parameter, value) in self.config.calibrated.iter().zip(action) {
            if !(-LARGEST_WEAR..=LARGEST_WEAR).contains(value) {
                let problem = format!(
                    "{} {value} is not from -{LARGEST_WEAR} to {LARGEST_WEAR}",
                    parameter.name()
                );
                return Err(Error::Action { problem });
            }
            parameter.set(&mut health, *value);
        }
        Ok(health)
    }

    /// Flies the next point.
    fn fly(&mut self, health: Health) -> Result<(), Error> {
        let point = self.progress.points[self.progress.flown];
        let operation = Operation::at(&point, health);
        let mut unknowns = self.progress.unknowns;
        let times = (self.config.interval_s, self.config.step_s);
        let reached = match &self.progress.last {
            Some(last) if self.config.dynamics == Dynamics::Transient => {
                self.engine.accelerate(last, &operation, &mut unknowns, times)
            }
            _ => self.engine.solve(&operation, &mut unknowns),
        };
        let reached = reached.map_err(|failed| Error::Model {
            model: "turbofan",
            problem: format!(
                "point {} (altitude {} m, mach {}, {} K from a standard day, {} {}): the engine finds no \
                 operating point; its parts disagree by {:.1e} after {} iterations ({})",
                self.progress.flown + 1,
                point.altitude_m,
                point.mach,
                point.delta_t_k,
                point.held.name(),
                point.held.value(),
                failed.residual,
                failed.iterations,
                failed.in_words(),
            ),
        })?;
        self.progress.outputs = outputs(&self.engine, &reached, &unknowns);
        self.progress.unknowns = unknowns;
        self.progress.last = Some(operation);
        self.progress.flown += 1;
        Ok(())
    }

    /// The flight condition of the next point; of the last one where none follows.
    fn observe(&self) -> Vec<Vec<f64>> {
        let next = self
            .progress
            .flown
            .min(self.progress.points.len().saturating_sub(1));
        let seen = self.progress.points.get(next).map_or(vec![0.0; 4], |point| {
            vec![point.altitude_m, point.mach, point.delta_t_k, point.held.value()]
        });
        vec![seen]
    }
}

/// The recorded outputs of a point, in the order of [`OUTPUTS`].
fn outputs(engine: &Engine, point: &Point<f64>, unknowns: &[f64; N]) -> Vec<f64> {
    let design = &engine.design;
    let n1 = unknowns[0] * design.n1_rpm;
    let acceleration = engine.acceleration_rpm_s(point, unknowns);
    vec![
        n1,
        unknowns[1] * design.n2_rpm,
        point.fuel_flow,
        point.lpc.temperature,
        point.lpc.pressure,
        point.hpc.temperature,
        point.hpc.pressure,
        point.burner.temperature,
        point.hpt.temperature,
        point.hpt.pressure,
        point.lpt.temperature,
        point.lpt.pressure,
        point.fan.pressure,
        point.bypass_ratio,
        point.thrust,
        point.inlet.mass_flow,
        n1 / design.gear_ratio,
        point.inlet.temperature,
        point.inlet.pressure,
        point.fan.temperature,
        point.bypass.pressure,
        unknowns[cycle::FUEL],
        point.bypass_area,
        acceleration[0],
        acceleration[1],
    ]
}

fn flight_channels() -> Vec<Channel> {
    vec![
        Channel::new("altitude_m", "m").typical(8000.0, 3000.0),
        Channel::new("mach", "").typical(0.65, 0.15),
        Channel::new("delta_t_k", "K").typical(0.0, 10.0),
        Channel::new("held", "").typical(1400.0, 200.0),
    ]
}

impl Environment for Turbofan {
    fn seats(&self) -> &[Seat] {
        &self.seats
    }

    fn metrics(&self) -> &[Metric] {
        &self.metrics
    }

    fn reset(&mut self, rng: &mut Rng) -> Result<Vec<Vec<f64>>, Error> {
        self.progress = Progress {
            points: self.route.points(self.engine.design_ratio(), rng),
            flown: 0,
            unknowns: self.engine.unknowns,
            last: None,
            outputs: Vec::new(),
        };
        Ok(self.observe())
    }

    fn step(&mut self, actions: &[Vec<f64>], _rng: &mut Rng) -> Result<Step, Error> {
        check_seats(actions, 1)?;
        let health = self.health(&actions[0])?;
        if self.progress.flown >= self.progress.points.len() {
            let problem = format!("the flight has {} points and is over", self.progress.points.len());
            return Err(Error::Action { problem });
        }
        self.fly(health)?;
        let over = self.progress.flown == self.progress.points.len();
        let step = Step::new(self.observe(), vec![0.0], over.then_some(End::Truncated));
        Ok(step.record("fuel_kg", self.progress.outputs[2]))
    }

    fn trace_channels(&self) -> Vec<Channel> {
        OUTPUTS
            .iter()
            .map(|(name, unit)| Channel::new(*name, unit))
            .collect()
    }

    fn trace(&self) -> Vec<f64> {
        if self.progress.outputs.is_empty() {
            vec![f64::NAN; OUTPUTS.len()]
        } else {
            self.progress.outputs.clone()
        }
    }

    fn snapshot(&self) -> serde_json::Value {
        // Plain structs of numbers: serde_json refuses only maps whose keys are no strings.
        serde_json::to_value(&self.progress).expect("a snapshot serialises")
    }

    fn restore(&mut self, snapshot: &serde_json::Value) -> Result<(), Error> {
        self.progress = Progress::deserialize(snapshot).map_err(|source| Error::Checkpoint {
            what: "turbofan",
            problem: source.to_string(),
        })?;
        Ok(())
    }
}
