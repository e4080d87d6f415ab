//! The load of a pack.

use contract::{DataFile, Error, Rng};
use document::reach::quoted;
use rand::Rng as _;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Largest demand of the thesis' load, W per cell.
pub const LARGEST_W_PER_CELL: f64 = 15.0;
/// Smallest fraction of the largest demand; smaller draws are raised to it.
const SMALLEST_PART: f64 = 0.4;

/// The load of the whole pack.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Load {
    /// 15 W times the number of cells times max(U, 0.4), U uniform in [0, 1), drawn anew for each decision.
    #[default]
    Thesis,
    /// A total power that is drawn uniformly for each decision.
    Uniform {
        /// Smallest total power over all cells.
        #[schemars(range(min = 0.0), extend("x-unit" = "W"))]
        low_w: f64,
        /// Largest total power over all cells.
        #[schemars(range(min = 0.0), extend("x-unit" = "W"))]
        high_w: f64,
    },
    /// A constant total power.
    Constant {
        /// Total power over all cells.
        #[schemars(range(min = 0.0), extend("x-unit" = "W"))]
        power_w: f64,
    },
    /// A constant total current; positive discharges.
    ConstantCurrent {
        /// Total current over all cells.
        #[schemars(extend("x-unit" = "A"))]
        current_a: f64,
    },
    /// A CSV file with the columns `t_s` and either `power_w` or `current_a` (totals over all cells). A value
    /// holds from its time until that of the next row; the last one holds forever.
    File(DataFile),
}

/// A total over all cells.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum Demand {
    /// Power, W.
    Power(f64),
    /// Current, A.
    Current(f64),
}

impl Demand {
    /// The power; `None` for a current.
    pub fn power_w(self) -> Option<f64> {
        match self {
            Self::Power(power_w) => Some(power_w),
            Self::Current(_) => None,
        }
    }
}

/// Source of the demands of an episode.
#[derive(Debug, Clone)]
pub enum LoadSource {
    /// Uniform in [low, high), at least `floor`, W.
    Drawn { low: f64, high: f64, floor: f64 },
    /// The same demand at all times.
    Constant(Demand),
    /// Demands with their times, sorted by time.
    Rows(Vec<(f64, Demand)>),
}

impl LoadSource {
    /// Prepares `load` for a pack of `cells` cells.
    ///
    /// # Errors
    /// [`Error::File`] and [`Error::Config`] for a load file that cannot be read or is invalid.
    pub fn new(load: &Load, cells: usize) -> Result<Self, Error> {
        let largest = LARGEST_W_PER_CELL * cells as f64;
        Ok(match load {
            Load::Thesis => Self::Drawn {
                low: 0.0,
                high: largest,
                floor: SMALLEST_PART * largest,
            },
            Load::Uniform { low_w, high_w } if low_w > high_w => {
                return Err(Error::config(
                    "load.uniform",
                    format!("low_w {low_w} lies above high_w {high_w}"),
                ));
            }
            Load::Uniform { low_w, high_w } => Self::Drawn {
                low: *low_w,
                high: *high_w,
                floor: *low_w,
            },
            Load::Constant { power_w } => Self::Constant(Demand::Power(*power_w)),
            Load::ConstantCurrent { current_a } => Self::Constant(Demand::Current(*current_a)),
            Load::File(file) => Self::Rows(rows(file)?),
        })
    }

    /// Least power that a decision can demand, W; `None` for currents and for loads that change within a
    /// decision.
    pub fn least_power_w(&self) -> Option<f64> {
        match self {
            Self::Drawn { low, floor, .. } => Some(low.max(*floor)),
            Self::Constant(Demand::Power(power_w)) => Some(*power_w),
            Self::Constant(Demand::Current(_)) | Self::Rows(_) => None,
        }
    }

    /// The demand of a decision that begins at `time_s`.
    pub fn draw(&self, time_s: f64, rng: &mut Rng) -> Demand {
        match self {
            Self::Drawn { low, high, floor } => {
                Demand::Power((low + (high - low) * rng.random::<f64>()).max(*floor))
            }
            Self::Constant(demand) => *demand,
            Self::Rows(rows) => at(rows, time_s),
        }
    }

    /// The demand at `time_s` within a decision that began with `drawn`: only loads from a file change within a
    /// decision.
    #[inline]
    pub fn within(&self, drawn: Demand, time_s: f64) -> Demand {
        match self {
            Self::Rows(rows) => at(rows, time_s),
            _ => drawn,
        }
    }
}

/// The row that holds at `time_s`; before the first row, the first one.
fn at(rows: &[(f64, Demand)], time_s: f64) -> Demand {
    // The time of a step is a product of a count and a step size: half a microsecond keeps rounding from
    // missing a row.
    let begun = rows.partition_point(|(start_s, _)| *start_s <= time_s + 5e-7);
    rows[begun.saturating_sub(1)].1
}

fn rows(file: &DataFile) -> Result<Vec<(f64, Demand)>, Error> {
    let problem =
        |problem: String| Error::config("load.file", format!("`{}`: {problem}", file.path().display()));
    let text = file.text()?;
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .from_reader(text.as_bytes());
    let header = reader
        .headers()
        .map_err(|source| problem(source.to_string()))?
        .clone();
    let column = |name: &str| header.iter().position(|title| title == name);
    let (value_column, demand): (usize, fn(f64) -> Demand) = match (column("power_w"), column("current_a")) {
        (Some(index), None) => (index, Demand::Power),
        (None, Some(index)) => (index, Demand::Current),
        _ => {
            return Err(problem(
                "needs exactly one of the columns `power_w` and `current_a`".into(),
            ));
        }
    };
    let time_column = column("t_s").ok_or_else(|| problem("needs a column `t_s`".into()))?;
    let mut rows: Vec<(f64, Demand)> = Vec::new();
    for record in reader.records() {
        let record = record.map_err(|source| problem(source.to_string()))?;
        let unfit = |what: String| problem(format!("line {}: {what}", line_of(&record, &text)));
        let time_s =
            number(file, &record, time_column).map_err(|text| unfit(format!("t_s `{text}` is no number")))?;
        let value =
            number(file, &record, value_column).map_err(|text| unfit(format!("`{text}` is no number")))?;
        if rows.last().is_some_and(|(before_s, _)| *before_s >= time_s) {
            return Err(unfit(format!(
                "t_s {time_s} does not lie after the row before it"
            )));
        }
        rows.push((time_s, demand(value)));
    }
    if rows.is_empty() {
        Err(problem("has no rows".into()))
    } else {
        Ok(rows)
    }
}

/// Line of a record in a text. The reader's position is that of the end of the record before, from which it
/// skips empty lines.
fn line_of(record: &csv::StringRecord, text: &str) -> usize {
    let place = record
        .position()
        .and_then(|place| usize::try_from(place.byte()).ok())
        .unwrap_or_default();
    let (before, rest) = text.split_at(place);
    let empty = rest.len() - rest.trim_start_matches(['\r', '\n']).len();
    before.matches('\n').count() + rest[..empty].matches('\n').count() + 1
}

/// The finite number in `column`, or its text as the error.
fn number(file: &DataFile, record: &csv::StringRecord, column: usize) -> Result<f64, String> {
    let text = record.get(column).unwrap_or_default();
    text.parse()
        .ok()
        .filter(|value: &f64| value.is_finite())
        .ok_or_else(|| quoted(file.path(), text))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    fn load_file(text: &str) -> Result<LoadSource, Error> {
        let mut file = tempfile::NamedTempFile::new().unwrap();
        file.write_all(text.as_bytes()).unwrap();
        LoadSource::new(&Load::File(DataFile::new(file.path())), 4)
    }

    #[test]
    fn the_thesis_load_is_cut_off_below() {
        let source = LoadSource::new(&Load::Thesis, 4).unwrap();
        let mut rng = contract::random::stream(&["load"]);
        let draws: Vec<f64> = (0..20_000)
            .map(|_| match source.draw(0.0, &mut rng) {
                Demand::Power(power_w) => power_w,
                Demand::Current(_) => unreachable!(),
            })
            .collect();
        assert!(draws.iter().all(|power_w| (24.0..60.0).contains(power_w)));
        let lowest = draws.iter().filter(|power_w| **power_w == 24.0).count() as f64 / draws.len() as f64;
        assert!((lowest - 0.4).abs() < 0.02, "{lowest}");
        assert!((draws.iter().sum::<f64>() / draws.len() as f64 - 34.8).abs() < 0.3);
    }

    #[test]
    fn a_row_holds_until_the_next() {
        let source = load_file("t_s,power_w,remark\n0,10,a\n10, 20 ,b\n").unwrap();
        let mut rng = contract::random::stream(&["load"]);
        for (time_s, power_w) in [(0.0, 10.0), (9.0, 10.0), (10.0, 20.0), (1e6, 20.0)] {
            assert_eq!(source.draw(time_s, &mut rng), Demand::Power(power_w));
            assert_eq!(source.within(Demand::Power(0.0), time_s), Demand::Power(power_w));
        }
        let LoadSource::Rows(rows) = load_file("current_a,t_s\n1.5,0\n").unwrap() else {
            panic!("a file has rows")
        };
        assert_eq!(rows, [(0.0, Demand::Current(1.5))]);
    }

    #[test]
    fn bad_files_are_named_with_their_line() {
        for (text, expected) in [
            ("t_s,watts\n0,1\n", "exactly one of the columns"),
            ("t_s,power_w,current_a\n0,1,1\n", "exactly one of the columns"),
            ("power_w\n1\n", "needs a column `t_s`"),
            ("t_s,power_w\n0,1\n0,2\n", "line 3: t_s 0 does not lie after"),
            ("t_s,power_w\n0,much\n", "line 2: `much` is no number"),
            ("t_s,power_w\n\n0,1\n\n\n5,much\n", "line 6: `much` is no number"),
            ("t_s,power_w\n", "has no rows"),
        ] {
            let message = load_file(text).unwrap_err().to_string();
            assert!(
                message.starts_with("`load.file`") && message.contains(expected),
                "{message}"
            );
        }
        assert!(matches!(
            LoadSource::new(&Load::File(DataFile::new("absent.csv")), 4),
            Err(Error::File { .. })
        ));
        assert!(
            LoadSource::new(
                &Load::Uniform {
                    low_w: 2.0,
                    high_w: 1.0
                },
                4
            )
            .is_err()
        );
    }
}
