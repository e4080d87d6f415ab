//! Recorded flights instead of synthetic ones: CSV, Parquet or HDF5 with the quantities of N-CMAPSS under its
//! names and in its units (M. Arias Chao, C. Kulkarni, K. Goebel and O. Fink, "Aircraft engine run-to-failure
//! dataset under real flight conditions for prognostics and diagnostics", Data 6 (2021) 5).
//!
//! | N-CMAPSS | here | unit there |
//! |---|---|---|
//! | `unit`, `cycle` | number of the engine, and of its flight | - |
//! | `alt`, `Mach`, `T2` | `altitude_m`, `mach`, `delta_t_k` | ft, -, degR |
//! | `T40` | `turbine_inlet_temperature_k` | degR |
//! | `T24`, `T30`, `T48`, `T50` | `t24_k`, `t30_k`, `t48_k`, `t50_k` | degR |
//! | `P2`, `P15`, `P21`, `P24`, `P30`, `P45`, `P50` | `p2_pa`, `p15_pa`, ... | psia |
//! | `Nf`, `Nc`, `Wf` | `n1_rpm`, `n2_rpm`, `fuel_flow_kg_s` | rpm, rpm, lbm/s |
//! | `HPT_eff_mod`, `HPT_flow_mod`, ... | `hpt_efficiency`, `hpt_flow`, ... | - |
//!
//! A row is a sample; rows of a flight are consecutive, and those of a unit are in the order of its cycles.

mod files;
#[cfg(feature = "hdf5")]
mod hdf5;
#[cfg(test)]
mod tests;

use super::atmosphere::Air;
use super::config::HealthParameter;
use super::flight::FlightPoint;
use super::model::FlightCondition;
use super::sensors::{Correction, range};
use super::solver::HeldQuantity;
use contract::{DataFile, Error};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::{
    collections::BTreeMap,
    sync::{Arc, Mutex, PoisonError, Weak},
};

/// Recorded flights in a file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RecordedFlights {
    /// CSV, Parquet, or HDF5 as N-CMAPSS is published, with its names and units: `unit`, `cycle`, `alt` (ft), `Mach`,
    /// `T2` and `T40` (degR), the sensors (`T24`, `P30` (psia), `Nf`, `Wf` (lbm/s), ...) and the true health
    /// (`HPT_eff_mod`, ...).
    pub file: DataFile,
    /// Only every n-th sample of each flight is kept, beginning with the first.
    #[serde(default = "one")]
    #[schemars(range(min = 1, max = 100_000))]
    pub every: u32,
    /// Numbers of the units that are kept; all if empty.
    #[serde(default)]
    pub units: Vec<u32>,
}

fn one() -> u32 {
    1
}

/// The sensors and health parameters that are read from a recording.
#[derive(Debug, Clone, Copy)]
pub(super) struct RecordingRequest<'a> {
    pub sensors: &'a [String],
    pub calibrated: &'a [HealthParameter],
    /// Smallest and largest health parameter.
    pub theta_range: [f64; 2],
}

/// The samples of the kept units.
#[derive(Debug)]
pub(super) struct Recording {
    units: Vec<Unit>,
    /// Smallest and largest reading of each sensor, as it is and corrected, over all units of the file, since a
    /// policy that is trained with some units is measured with others.
    extremes: [Vec<(f64, f64)>; 2],
}

#[derive(Debug)]
struct Unit {
    number: u32,
    samples: Vec<Sample>,
}

/// Flight condition, health and sensor readings at one time.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Sample {
    pub condition: FlightCondition,
    /// The true health.
    pub theta: Vec<f64>,
    /// Sensor readings, SI; `None` where they still have to be computed with an engine.
    pub read: Option<Vec<f64>>,
}

impl Recording {
    /// Reads a file, unless another environment in use has read the same part of it.
    ///
    /// # Errors
    /// [`Error::Config`] at the key `recorded` for units that do not exist and sensors that are not recorded,
    /// [`Error::File`], [`Error::Damaged`] and [`Error::Input`] for a file that cannot be read or is invalid.
    pub(super) fn of(recorded: &RecordedFlights, asked: &RecordingRequest<'_>) -> Result<Arc<Self>, Error> {
        static IN_USE: Mutex<BTreeMap<String, Weak<Recording>>> = Mutex::new(BTreeMap::new());
        let RecordedFlights { file, every, units } = recorded;
        let key = format!("{} {every} {units:?} {asked:?}", file.digest()?);
        // A panic while the lock was held has left the map unchanged.
        let mut in_use = IN_USE.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = in_use.get(&key).and_then(Weak::upgrade) {
            return Ok(known);
        }
        let read = Arc::new(Self::read(recorded, asked)?);
        in_use.retain(|_, recording| recording.strong_count() > 0);
        in_use.insert(key, Arc::downgrade(&read));
        Ok(read)
    }

    fn read(recorded: &RecordedFlights, asked: &RecordingRequest<'_>) -> Result<Self, Error> {
        let columns = columns(asked)?;
        let names: Vec<&str> = columns.iter().map(|column| column.name).collect();
        let mut reading = RecordingReader::new(recorded, asked);
        files::read(&recorded.file, &names, &mut |line, values| {
            let row: Vec<f64> = values
                .iter()
                .zip(&columns)
                .map(|(value, column)| value * column.factor)
                .collect();
            reading.take(line, &row)
        })?;
        reading.whole()
    }

    pub(super) fn n_units(&self) -> usize {
        self.units.len()
    }

    /// The number of a unit in the file.
    pub(super) fn number(&self, unit: usize) -> u32 {
        self.units[unit].number
    }

    /// Number of samples of a unit.
    pub(super) fn length(&self, unit: usize) -> usize {
        self.units[unit].samples.len()
    }

    pub(super) fn sample(&self, unit: usize, at: usize) -> &Sample {
        &self.units[unit].samples[at]
    }

    /// Middle and half width of each sensor, as it is read or corrected.
    pub(super) fn ranges(&self, is_corrected: bool) -> Vec<(f64, f64)> {
        let extremes = self.extremes[usize::from(is_corrected)].iter();
        extremes
            .map(|(low, high)| range([*low, *high].into_iter()))
            .collect()
    }
}

/// A column of a file, with the factor from its unit to SI.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Column {
    name: &'static str,
    factor: f64,
}

const KELVIN: f64 = 1.0 / 1.8;
const PASCAL: f64 = 6_894.757_293_168;
const KILOGRAM: f64 = 0.453_592_37;

/// The columns of every recording, in the order in which [`RecordingReader::take`] gets them.
const PLACE: [Column; 6] = [
    Column {
        name: "unit",
        factor: 1.0,
    },
    Column {
        name: "cycle",
        factor: 1.0,
    },
    Column {
        name: "alt",
        factor: 0.3048,
    },
    Column {
        name: "Mach",
        factor: 1.0,
    },
    Column {
        name: "T2",
        factor: KELVIN,
    },
    Column {
        name: "T40",
        factor: KELVIN,
    },
];

/// Sensors by the names of outputs.
const SENSORS: [(&str, &str, f64); 16] = [
    ("n1_rpm", "Nf", 1.0),
    ("n2_rpm", "Nc", 1.0),
    ("fuel_flow_kg_s", "Wf", KILOGRAM),
    ("t2_k", "T2", KELVIN),
    ("t24_k", "T24", KELVIN),
    ("t30_k", "T30", KELVIN),
    ("t40_k", "T40", KELVIN),
    ("t48_k", "T48", KELVIN),
    ("t50_k", "T50", KELVIN),
    ("p2_pa", "P2", PASCAL),
    ("p15_pa", "P15", PASCAL),
    ("p21_pa", "P21", PASCAL),
    ("p24_pa", "P24", PASCAL),
    ("p30_pa", "P30", PASCAL),
    ("p45_pa", "P45", PASCAL),
    ("p50_pa", "P50", PASCAL),
];

fn columns(asked: &RecordingRequest<'_>) -> Result<Vec<Column>, Error> {
    let sensor = |sensor: &String| {
        let found = SENSORS.iter().find(|(output, ..)| output == sensor);
        let column = found.map(|(_, name, factor)| Column {
            name,
            factor: *factor,
        });
        column.ok_or_else(|| {
            let known: Vec<&str> = SENSORS.iter().map(|(output, ..)| *output).collect();
            let problem = format!("`{sensor}` is not recorded; there are {}", known.join(", "));
            Error::config("sensors", problem)
        })
    };
    let sensors = asked.sensors.iter().map(sensor).collect::<Result<Vec<_>, _>>()?;
    let health = asked.calibrated.iter().map(|parameter| Column {
        name: modifier(*parameter),
        factor: 1.0,
    });
    Ok(PLACE.into_iter().chain(sensors).chain(health).collect())
}

fn modifier(parameter: HealthParameter) -> &'static str {
    use HealthParameter as P;
    match parameter {
        P::FanEfficiency => "fan_eff_mod",
        P::FanFlow => "fan_flow_mod",
        P::LpcEfficiency => "LPC_eff_mod",
        P::LpcFlow => "LPC_flow_mod",
        P::HpcEfficiency => "HPC_eff_mod",
        P::HpcFlow => "HPC_flow_mod",
        P::HptEfficiency => "HPT_eff_mod",
        P::HptFlow => "HPT_flow_mod",
        P::LptEfficiency => "LPT_eff_mod",
        P::LptFlow => "LPT_flow_mod",
    }
}

fn widen(extremes: &mut [(f64, f64)], values: impl Iterator<Item = f64>) {
    for ((low, high), value) in extremes.iter_mut().zip(values) {
        (*low, *high) = (low.min(value), high.max(value));
    }
}

/// A recording while its rows are read.
struct RecordingReader<'a> {
    recorded: &'a RecordedFlights,
    asked: &'a RecordingRequest<'a>,
    units: Vec<Unit>,
    extremes: [Vec<(f64, f64)>; 2],
    /// Unit and cycle of the last row, and the number of rows of that flight before.
    flight: (u32, u32),
    in_flight: u32,
    /// All unit numbers of the file.
    seen: Vec<u32>,
}

impl<'a> RecordingReader<'a> {
    fn new(recorded: &'a RecordedFlights, asked: &'a RecordingRequest<'a>) -> Self {
        Self {
            recorded,
            asked,
            units: Vec::new(),
            extremes: [(); 2].map(|()| vec![(f64::INFINITY, f64::NEG_INFINITY); asked.sensors.len()]),
            flight: (0, 0),
            in_flight: 0,
            seen: Vec::new(),
        }
    }

    /// Takes a row: the columns of [`PLACE`], the sensors, the health; SI.
    fn take(&mut self, line: u64, row: &[f64]) -> Result<(), Error> {
        let (place, rest) = row.split_at(PLACE.len());
        let (read, theta) = rest.split_at(self.asked.sensors.len());
        widen(&mut self.extremes[0], read.iter().copied());
        let flight = self.flight(line, place)?;
        self.in_flight = if flight == self.flight {
            self.in_flight + 1
        } else {
            0
        };
        self.flight = flight;
        if !self.in_flight.is_multiple_of(self.recorded.every) {
            return Ok(());
        }
        let condition = self.condition(line, place)?;
        self.check_health(line, theta)?;
        let correction = Correction::of(&condition);
        let corrected = read.iter().zip(self.asked.sensors);
        widen(
            &mut self.extremes[1],
            corrected.map(|(value, sensor)| value / correction.factor(sensor)),
        );
        let units = &self.recorded.units;
        if !(units.is_empty() || units.contains(&flight.0)) {
            return Ok(());
        }
        let sample = Sample {
            condition,
            theta: theta.to_vec(),
            read: Some(read.to_vec()),
        };
        match self.units.last_mut() {
            Some(unit) if unit.number == flight.0 => unit.samples.push(sample),
            _ => self.units.push(Unit {
                number: flight.0,
                samples: vec![sample],
            }),
        }
        Ok(())
    }

    /// Unit and cycle of a row.
    fn flight(&mut self, line: u64, place: &[f64]) -> Result<(u32, u32), Error> {
        let whole = |column: usize| {
            let value = place[column];
            if value.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(&value) {
                return Ok(value as u32);
            }
            Err(self.wrong(line, PLACE[column].name, format!("{value} is no number of one")))
        };
        let (unit, cycle) = (whole(0)?, whole(1)?);
        if self.seen.last() != Some(&unit) {
            if self.seen.contains(&unit) {
                let problem =
                    format!("unit {unit} comes again after others; its rows have to stand together");
                return Err(self.wrong(line, "unit", problem));
            }
            self.seen.push(unit);
        } else if cycle < self.flight.1 {
            let problem = format!("cycle {cycle} of unit {unit} comes after cycle {}", self.flight.1);
            return Err(self.wrong(line, "cycle", problem));
        }
        Ok((unit, cycle))
    }

    fn condition(&self, line: u64, place: &[f64]) -> Result<FlightCondition, Error> {
        let [altitude_m, mach, total, inlet] = [place[2], place[3], place[4], place[5]];
        let point = FlightPoint {
            altitude_m,
            mach,
            delta_t_k: Air::delta_t_k(altitude_m, mach, total),
            held: HeldQuantity::TurbineInletTemperature(inlet),
        };
        match point.outside() {
            None => Ok(FlightCondition::of(&point)),
            Some(problem) => {
                let problem = format!("the sample lies outside the envelope: {problem}");
                Err(self.wrong(line, "alt", problem))
            }
        }
    }

    fn check_health(&self, line: u64, theta: &[f64]) -> Result<(), Error> {
        let [low, high] = self.asked.theta_range;
        let outside = theta.iter().position(|value| !(low..=high).contains(value));
        outside.map_or(Ok(()), |place| {
            let problem = format!("{} is not within `theta_range`, {low} to {high}", theta[place]);
            Err(self.wrong(line, modifier(self.asked.calibrated[place]), problem))
        })
    }

    fn wrong(&self, line: u64, column: &str, problem: String) -> Error {
        Error::Input {
            path: self.recorded.file.path().into(),
            line: Some(line),
            column: Some(column.into()),
            problem,
        }
    }

    /// The recording once all rows are read.
    ///
    /// # Errors
    /// [`Error::Config`] for a requested unit that does not exist, [`Error::Input`] for a file without units.
    fn whole(self) -> Result<Recording, Error> {
        let missing = self.recorded.units.iter().find(|unit| !self.seen.contains(unit));
        if let Some(unit) = missing {
            let known: Vec<String> = self.seen.iter().map(u32::to_string).collect();
            let problem = format!("there is no unit {unit}; there are {}", known.join(", "));
            return Err(Error::config("recorded.units", problem));
        }
        if self.units.is_empty() {
            return Err(Error::Input {
                path: self.recorded.file.path().into(),
                line: None,
                column: None,
                problem: "there is no sample".into(),
            });
        }
        Ok(Recording {
            units: self.units,
            extremes: self.extremes,
        })
    }
}
