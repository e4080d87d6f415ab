//! Where an engine flies: points of a flight, from a file or made up in the shape of real ones.

use super::atmosphere::Air;
use super::solver::Held;
use engine::{DataFile, Error, Rng};
use rand::Rng as _;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

const FOOT: f64 = 0.3048;

/// The flight of an episode.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Flight {
    /// A CSV file with the columns `altitude_m`, `mach`, `delta_t_k` (how much warmer than a standard day) and
    /// one of `turbine_inlet_temperature_k`, `thrust_n` and `fuel_flow_kg_s`, which is held.
    File(DataFile),
    /// A flight drawn anew for each episode: climb from 3 km, cruise and descent to 3 km, with a throttle that
    /// follows, as the flights of N-CMAPSS have them.
    Drawn {
        /// Length of the flight.
        #[serde(default)]
        class: FlightClass,
        /// Time between its points.
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

/// How long a flight is, from top of climb to touch down nearly.
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
    pub held: Held,
}

impl FlightPoint {
    pub(super) fn air(&self) -> Air {
        Air::at(self.altitude_m, self.mach, self.delta_t_k)
    }

    /// What is wrong with the point, if it lies outside the envelope: Mach 0 to 0.9, up to 35 K from a standard
    /// day, and from 100 m below sea level up to a ceiling of 3048 m at Mach 0.2, 7620 m at 0.5, 10 668 m at
    /// 0.6 and 13 110 m from 0.7 on (NASA's AGTF30, with the highest regime of C-MAPSS).
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

/// Points that are ready to be flown.
#[derive(Debug, Clone)]
pub(super) enum Route {
    /// The same in every episode.
    Given(Vec<FlightPoint>),
    /// Drawn for each.
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
            Self::Drawn { class, interval_s } => drawn(*class, *interval_s, design_ratio, rng),
        }
    }
}

/// A flight in three legs. Throttles are shares of the design point's ratio of temperatures: 0.94 to 1 in
/// climb, 0.82 to 0.94 in cruise, 0.66 to 0.74 in descent, each with slow and small changes.
pub(super) fn drawn(
    class: FlightClass,
    interval_s: f64,
    design_ratio: f64,
    rng: &mut Rng,
) -> Vec<FlightPoint> {
    let mut between = |low: f64, high: f64| low + (high - low) * rng.random::<f64>();
    let hours = match class {
        FlightClass::Short => between(1.0, 3.0),
        FlightClass::Medium => between(3.0, 5.0),
        FlightClass::Long => between(5.0, 7.0),
    };
    let cruise_m = between(28_000.0, 36_000.0) * FOOT;
    let cruise_mach = between(0.7, 0.8);
    let delta_t_k = between(-15.0, 15.0);
    let throttles = [between(0.94, 1.0), between(0.82, 0.94), between(0.66, 0.74)];
    let phase = between(0.0, std::f64::consts::TAU);
    let duration_s = hours * 3600.0;
    // 20 to 25 minutes up and down.
    let (climb_s, descent_s) = (between(1200.0, 1500.0), between(1200.0, 1500.0));
    let n_points = (duration_s / interval_s).floor() as usize + 1;
    let point = |index: usize| {
        let time_s = index as f64 * interval_s;
        let left_s = duration_s - time_s;
        let height = (time_s / climb_s).min(left_s / descent_s).min(1.0);
        let throttle = if time_s < climb_s {
            throttles[0]
        } else if left_s < descent_s {
            throttles[2]
        } else {
            throttles[1]
        };
        let altitude_m = 3048.0 + (cruise_m - 3048.0) * height;
        let mach = 0.42 + (cruise_mach - 0.42) * height;
        let wave = 0.01 * (time_s / 600.0 + phase).sin();
        let total = Air::at(altitude_m, mach, delta_t_k).total_temperature;
        FlightPoint {
            altitude_m,
            mach,
            delta_t_k,
            held: Held::TurbineInletTemperature((throttle + wave) * design_ratio * total),
        }
    };
    (0..n_points).map(point).collect()
}

/// Reads the points of a file.
fn points(file: &DataFile) -> Result<Vec<FlightPoint>, Error> {
    let text = file.text()?;
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .from_reader(text.as_bytes());
    let wrong = |line: Option<u64>, column: Option<&str>, problem: String| Error::Input {
        path: file.path().into(),
        line,
        column: column.map(Into::into),
        problem,
    };
    let unreadable = |error: csv::Error| {
        let line = error.position().map(csv::Position::line);
        wrong(line, None, error.to_string())
    };
    let header = reader.headers().map_err(unreadable)?.clone();
    let place = |name: &str| header.iter().position(|column| column == name);
    let needed = |name: &str| {
        place(name).ok_or_else(|| {
            let known: Vec<&str> = header.iter().collect();
            wrong(
                Some(1),
                None,
                format!("column `{name}` is missing; there are {}", known.join(", ")),
            )
        })
    };
    let conditions = [needed("altitude_m")?, needed("mach")?, needed("delta_t_k")?];
    let held: Vec<(&str, usize)> = Held::NAMES
        .into_iter()
        .filter_map(|name| Some((name, place(name)?)))
        .collect();
    let [(held_name, held_place)] = held[..] else {
        let problem = format!(
            "exactly one of the columns {} says what is held; there are {}",
            Held::NAMES.join(", "),
            held.len()
        );
        return Err(wrong(Some(1), None, problem));
    };
    let mut points = Vec::new();
    for record in reader.records() {
        let record = record.map_err(unreadable)?;
        let line = record.position().map(csv::Position::line);
        let number = |place: usize| {
            let cell = record.get(place).unwrap_or_default();
            let number = cell.parse().ok().filter(|number: &f64| number.is_finite());
            number.ok_or_else(|| wrong(line, header.get(place), format!("`{cell}` is no number")))
        };
        let point = FlightPoint {
            altitude_m: number(conditions[0])?,
            mach: number(conditions[1])?,
            delta_t_k: number(conditions[2])?,
            held: Held::named(held_name, number(held_place)?),
        };
        if let Some(problem) = point.outside() {
            return Err(wrong(
                line,
                None,
                format!("the point lies outside the envelope: {problem}"),
            ));
        }
        points.push(point);
    }
    if points.is_empty() {
        return Err(wrong(None, None, "there is no point".into()));
    }
    Ok(points)
}
