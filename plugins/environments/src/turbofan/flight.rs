//! Flight conditions of an engine: points of a flight, from a file or drawn in the shape of real ones.

use super::atmosphere::Air;
use super::solver::HeldQuantity;
use arithmetic::trigonometry::sin;
use contract::{DataFile, Error, Rng};
use document::reach::{quoted, quoted_names};
use rand::Rng as _;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

const FOOT: f64 = 0.3048;

/// The flight of an episode.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Flight {
    /// A CSV file with the columns `altitude_m`, `mach`, `delta_t_k` (the excess over the temperature of a
    /// standard day) and one of `turbine_inlet_temperature_k`, `thrust_n` and `fuel_flow_kg_s`, which is held.
    File(DataFile),
    /// A flight drawn anew for each episode: climb from 3 km, cruise and descent to 3 km, with a throttle that
    /// follows, in the manner of the flights of N-CMAPSS.
    Drawn {
        /// Length of the flight.
        #[serde(default)]
        class: FlightClass,
        /// Time between two points of the flight.
        #[serde(default = "interval")]
        #[schemars(range(min = 1.0, max = 3600.0), extend("x-unit" = "s"))]
        interval_s: f64,
    },
}

impl Default for Flight {
    fn default() -> Self {
        Self::Drawn {
            class: FlightClass::default(),
            interval_s: interval(),
        }
    }
}

fn interval() -> f64 {
    60.0
}

/// Length of a flight, approximately from the top of climb to touch-down.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FlightClass {
    /// 1 to 3 hours.
    #[default]
    Short,
    /// 3 to 5 hours.
    Medium,
    /// 5 to 7 hours.
    Long,
}

/// A point of a flight.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct FlightPoint {
    pub altitude_m: f64,
    pub mach: f64,
    pub delta_t_k: f64,
    pub held: HeldQuantity,
}

impl FlightPoint {
    pub(super) fn air(&self) -> Air {
        Air::at(self.altitude_m, self.mach, self.delta_t_k)
    }

    /// The problem of a point outside the envelope: Mach 0 to 0.9, up to 35 K from a standard day, and from 100
    /// m below sea level up to a ceiling of 3048 m at Mach 0.2, 7620 m at 0.5, 10 668 m at 0.6 and 13 110 m
    /// from 0.7 on (NASA's AGTF30, with the highest regime of C-MAPSS).
    pub(super) fn outside(&self) -> Option<String> {
        let Self {
            altitude_m,
            mach,
            delta_t_k,
            held,
        } = *self;
        let ceiling = ceiling_m(mach);
        if !(0.0..=0.9).contains(&mach) {
            Some(format!("mach {mach} is not from 0 to 0.9"))
        } else if !(-35.0..=35.0).contains(&delta_t_k) {
            Some(format!("delta_t_k {delta_t_k} is not from -35 to 35"))
        } else if !(-100.0..=ceiling).contains(&altitude_m) {
            Some(format!(
                "altitude_m {altitude_m} is not from -100 to the ceiling at mach {mach}, {ceiling:.0}"
            ))
        } else if held.value() <= 0.0 {
            Some(format!("{} {} is not above 0", held.name(), held.value()))
        } else {
            None
        }
    }
}

/// The highest altitude at a Mach number, m.
pub(super) fn ceiling_m(mach: f64) -> f64 {
    const CORNERS: [(f64, f64); 4] = [(0.2, 10_000.0), (0.5, 25_000.0), (0.6, 35_000.0), (0.7, 43_000.0)];
    let above = CORNERS.iter().position(|(corner, _)| mach < *corner);
    let feet = match above {
        Some(0) => CORNERS[0].1,
        Some(next) => {
            let ((from, low), (to, high)) = (CORNERS[next - 1], CORNERS[next]);
            low + (high - low) * (mach - from) / (to - from)
        }
        None => CORNERS[3].1,
    };
    // Altitudes are often rounded feet.
    feet * FOOT + 4.0
}

/// Source of an episode's points.
#[derive(Debug, Clone)]
pub(super) enum Route {
    /// The same points in every episode.
    Given(Vec<FlightPoint>),
    /// Points that are drawn for each episode.
    Drawn { class: FlightClass, interval_s: f64 },
}

impl Route {
    /// # Errors
    /// [`Error::File`] and [`Error::Input`] where a file cannot be read or understood.
    pub(super) fn new(flight: &Flight) -> Result<Self, Error> {
        Ok(match flight {
            Flight::File(file) => Self::Given(points(file)?),
            Flight::Drawn { class, interval_s } => Self::Drawn {
                class: *class,
                interval_s: *interval_s,
            },
        })
    }

    /// The points of an episode; `design_ratio` is the ratio of turbine inlet and ambient total temperature at
    /// the engine's design point.
    pub(super) fn points(&self, design_ratio: f64, rng: &mut Rng) -> Vec<FlightPoint> {
        match self {
            Self::Given(points) => points.clone(),
            Self::Drawn { class, interval_s } => {
                let flight = DrawnFlight::of(*class, design_ratio, rng);
                (0..flight.n_points(*interval_s))
                    .map(|index| flight.at(index as f64 * interval_s))
                    .collect()
            }
        }
    }
}

/// A flight in three legs. Throttles are relative to the design point's ratio of temperatures: 0.94 to 1 in
/// climb, 0.82 to 0.94 in cruise, 0.66 to 0.74 in descent, each with slow and small changes.
#[derive(Debug, Clone, Copy)]
pub(super) struct DrawnFlight {
    duration_s: f64,
    cruise_m: f64,
    cruise_mach: f64,
    delta_t_k: f64,
    /// Throttles of climb, cruise and descent.
    throttles: [f64; 3],
    phase: f64,
    /// Duration of climb and of descent, 20 to 25 minutes.
    climb_s: f64,
    descent_s: f64,
    design_ratio: f64,
}

impl DrawnFlight {
    pub(super) fn of(class: FlightClass, design_ratio: f64, rng: &mut Rng) -> Self {
        let mut between = |low: f64, high: f64| low + (high - low) * rng.random::<f64>();
        let hours = match class {
            FlightClass::Short => between(1.0, 3.0),
            FlightClass::Medium => between(3.0, 5.0),
            FlightClass::Long => between(5.0, 7.0),
        };
        // The fields are drawn in this order.
        Self {
            duration_s: hours * 3600.0,
            cruise_m: between(28_000.0, 36_000.0) * FOOT,
            cruise_mach: between(0.7, 0.8),
            delta_t_k: between(-15.0, 15.0),
            throttles: [between(0.94, 1.0), between(0.82, 0.94), between(0.66, 0.74)],
            phase: between(0.0, std::f64::consts::TAU),
            climb_s: between(1200.0, 1500.0),
            descent_s: between(1200.0, 1500.0),
            design_ratio,
        }
    }

    /// Number of points at intervals of `interval_s`, the first and the last of the flight included.
    pub(super) fn n_points(&self, interval_s: f64) -> usize {
        (self.duration_s / interval_s).floor() as usize + 1
    }

    pub(super) fn at(&self, time_s: f64) -> FlightPoint {
        let left_s = self.duration_s - time_s;
        let height = (time_s / self.climb_s).min(left_s / self.descent_s).min(1.0);
        let throttle = if time_s < self.climb_s {
            self.throttles[0]
        } else if left_s < self.descent_s {
            self.throttles[2]
        } else {
            self.throttles[1]
        };
        let altitude_m = 3048.0 + (self.cruise_m - 3048.0) * height;
        let mach = 0.42 + (self.cruise_mach - 0.42) * height;
        let wave = 0.01 * sin(time_s / 600.0 + self.phase);
        let total = Air::at(altitude_m, mach, self.delta_t_k).total_temperature;
        FlightPoint {
            altitude_m,
            mach,
            delta_t_k: self.delta_t_k,
            held: HeldQuantity::TurbineInletTemperature((throttle + wave) * self.design_ratio * total),
        }
    }
}

/// Reads the points of a file.
fn points(file: &DataFile) -> Result<Vec<FlightPoint>, Error> {
    let text = file.text()?;
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .from_reader(text.as_bytes());
    let unreadable = |error: csv::Error| {
        let line = error.position().map(csv::Position::line);
        wrong(file, line, None, error.to_string())
    };
    let columns = Columns::of(file, reader.headers().map_err(unreadable)?)?;
    let points = reader
        .records()
        .map(|record| columns.point(file, &record.map_err(unreadable)?))
        .collect::<Result<Vec<_>, Error>>()?;
    if points.is_empty() {
        return Err(wrong(file, None, None, "there is no point".into()));
    }
    Ok(points)
}

fn wrong(file: &DataFile, line: Option<u64>, column: Option<&str>, problem: String) -> Error {
    Error::Input {
        path: file.path().into(),
        line,
        column: column.map(Into::into),
        problem,
    }
}

/// Positions of the columns in a file of points.
struct Columns {
    header: csv::StringRecord,
    /// Altitude, Mach number and the excess over the temperature of a standard day.
    conditions: [usize; 3],
    held: (&'static str, usize),
}

impl Columns {
    fn of(file: &DataFile, header: &csv::StringRecord) -> Result<Self, Error> {
        let place = |name: &str| header.iter().position(|column| column == name);
        let needed = |name: &str| {
            place(name).ok_or_else(|| {
                let known = quoted_names(file.path(), header);
                let problem = format!("column `{name}` is missing; there are {known}");
                wrong(file, Some(1), None, problem)
            })
        };
        let conditions = [needed("altitude_m")?, needed("mach")?, needed("delta_t_k")?];
        let held: Vec<(&str, usize)> = HeldQuantity::NAMES
            .into_iter()
            .filter_map(|name| Some((name, place(name)?)))
            .collect();
        let [held] = held[..] else {
            let problem = format!(
                "exactly one of the columns {} says what is held; there are {}",
                HeldQuantity::NAMES.join(", "),
                held.len()
            );
            return Err(wrong(file, Some(1), None, problem));
        };
        Ok(Self {
            header: header.clone(),
            conditions,
            held,
        })
    }

    fn point(&self, file: &DataFile, record: &csv::StringRecord) -> Result<FlightPoint, Error> {
        let line = record.position().map(csv::Position::line);
        let number = |place: usize| {
            let cell = record.get(place).unwrap_or_default();
            let number = cell.parse().ok().filter(|number: &f64| number.is_finite());
            number.ok_or_else(|| {
                wrong(
                    file,
                    line,
                    self.header.get(place),
                    format!("`{}` is no number", quoted(file.path(), cell)),
                )
            })
        };
        let point = FlightPoint {
            altitude_m: number(self.conditions[0])?,
            mach: number(self.conditions[1])?,
            delta_t_k: number(self.conditions[2])?,
            held: HeldQuantity::named(self.held.0, number(self.held.1)?),
        };
        point.outside().map_or(Ok(point), |problem| {
            let problem = format!("the point lies outside the envelope: {problem}");
            Err(wrong(file, line, None, problem))
        })
    }
}
