//! Curves from publications: CSV files with a step and a value in each row.

use csv::{Reader, ReaderBuilder, StringRecord, Trim};
use document::{
    input_file::{self, Opened, Use},
    reach::{self, Outside, Reach},
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use statistics::estimators;
use std::{
    collections::{BTreeMap, btree_map::Entry},
    path::{Path, PathBuf},
};

/// A curve of a publication, and the location of its numbers.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PublishedCurve {
    /// Name of the curve in the legend.
    pub label: String,
    /// The agent of this study that it is compared with and that gives it its colour; grey where absent.
    #[serde(default)]
    pub agent: Option<String>,
    /// The environment in which it was measured and in whose panel it is drawn; required if there are several panels.
    #[serde(default)]
    pub environment: Option<String>,
    /// CSV file whose first line names its columns, relative to the folder of the study.
    pub file: PathBuf,
    /// Column of the steps.
    pub step: String,
    /// Column of the values.
    pub value: String,
    /// The rows to read: those with these texts in these columns; all rows where empty.
    #[serde(default, rename = "where")]
    pub rows: BTreeMap<String, String>,
    /// Column that separates runs; all rows are one run where absent.
    #[serde(default)]
    pub by: Option<String>,
    /// Set if the file lies outside the folders of the study; it is not read then.
    #[serde(skip)]
    pub outside: Option<Outside>,
}

/// One run of a curve.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CurveRun {
    /// Value of the column `by`, which identifies the run; empty if there is no such column.
    pub name: String,
    /// Steps in ascending order, with their values.
    pub points: Vec<(u64, f64)>,
}

/// Reason why a published curve cannot be read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PublishedCurveError {
    /// The file cannot be opened or is no CSV file.
    #[error("cannot read `{}`: {problem}", file.display())]
    Unreadable {
        /// Path of the file.
        file: PathBuf,
        /// Error of the system or the reader.
        problem: String,
    },
    /// The file lies outside the folders of the study.
    #[error(transparent)]
    Outside(Outside),
    /// The first line does not name a column.
    #[error("`{}` has no column `{column}`", file.display())]
    NoColumn {
        /// Path of the file.
        file: PathBuf,
        /// The requested column.
        column: String,
        /// The columns of the file.
        known: Vec<String>,
    },
    /// A field has a text of the wrong kind.
    #[error("`{}`, line {line}, column `{column}`: `{text}` is not {expected}", file.display())]
    Unfit {
        /// Path of the file.
        file: PathBuf,
        /// The line, from 1.
        line: u64,
        /// Name of the column.
        column: String,
        /// Text of the field.
        text: String,
        /// Kind of text that the field must have.
        expected: &'static str,
    },
    /// No row matches `rows`.
    #[error("no row of `{}` has {wanted}", file.display())]
    NoRow {
        /// Path of the file.
        file: PathBuf,
        /// The texts that a row must have.
        wanted: String,
    },
    /// A run has two values at one step.
    #[error("`{}`, line {line}, column `{column}`: step {step} stands in this run already", file.display())]
    StepTwice {
        /// Path of the file.
        file: PathBuf,
        /// The line of the second value, from 1.
        line: u64,
        /// The column of the steps.
        column: String,
        /// The step with two values.
        step: u64,
    },
}

impl PublishedCurve {
    /// Reads the runs, in the order in which they begin in the file.
    ///
    /// # Errors
    /// A missing file or column, fields that are no number, no matching row, and a step that a run has twice.
    pub fn runs(&self) -> Result<Vec<CurveRun>, PublishedCurveError> {
        if let Some(outside) = &self.outside {
            return Err(PublishedCurveError::Outside(outside.clone()));
        }
        let mut reader = open(&self.file)?;
        let header = reader
            .headers()
            .map_err(|error| unreadable(&self.file, &error))?
            .clone();
        let columns = Columns::find(self, &header)?;
        let mut runs: Vec<(String, BTreeMap<u64, f64>)> = Vec::new();
        for record in reader.records() {
            let row = CurveRecord {
                curve: self,
                record: record.map_err(|error| unreadable(&self.file, &error))?,
            };
            if columns
                .wanted
                .iter()
                .all(|(column, text)| row.field(*column) == *text)
            {
                row.add_to(&mut runs, &columns)?;
            }
        }
        if runs.is_empty() {
            return Err(PublishedCurveError::NoRow {
                file: self.file.clone(),
                wanted: self.wanted(),
            });
        }
        Ok(runs
            .into_iter()
            .map(|(name, points)| CurveRun {
                name,
                points: points.into_iter().collect(),
            })
            .collect())
    }

    /// Resolves the file relative to `folder`, that of a study.
    pub fn seek_from(&mut self, folder: &Path) {
        match Reach::of(folder).find(folder, &self.file.to_string_lossy()) {
            Ok(path) => self.file = path,
            Err(outside) => self.outside = Some(outside),
        }
    }

    fn wanted(&self) -> String {
        let wanted: Vec<String> = self
            .rows
            .iter()
            .map(|(column, text)| format!("`{text}` in column `{column}`"))
            .collect();
        if wanted.is_empty() {
            "a value".into()
        } else {
            wanted.join(" and ")
        }
    }
}

impl CurveRun {
    /// Mean of the last `last` values at steps up to `up_to_step`.
    ///
    /// `None` if there are fewer than `last` values up to there (or none is asked for), or if the run ends more than
    /// one evaluation interval before `up_to_step`: its end says nothing about a step that it did not reach. The
    /// interval is the median distance of its steps, and 0 for a run of a single value.
    #[must_use]
    pub fn last_mean(&self, up_to_step: u64, last: usize) -> Option<f64> {
        let (end, _) = self.points.last()?;
        let values: Vec<f64> = self
            .points
            .iter()
            .take_while(|(step, _)| *step <= up_to_step)
            .map(|(_, value)| *value)
            .collect();
        let first = values.len().checked_sub(last)?;
        (last > 0 && end.saturating_add(self.interval()) >= up_to_step)
            .then(|| estimators::mean(&values[first..]))
    }

    fn interval(&self) -> u64 {
        let mut distances: Vec<u64> = self.points.windows(2).map(|ends| ends[1].0 - ends[0].0).collect();
        distances.sort_unstable();
        distances.get(distances.len() / 2).copied().unwrap_or(0)
    }
}

/// Places of the fields in a row.
struct Columns<'a> {
    step: usize,
    value: usize,
    by: Option<usize>,
    wanted: Vec<(usize, &'a str)>,
}

impl<'a> Columns<'a> {
    fn find(curve: &'a PublishedCurve, header: &StringRecord) -> Result<Self, PublishedCurveError> {
        let index = |column: &String| {
            header
                .iter()
                .position(|known| known == column)
                .ok_or_else(|| PublishedCurveError::NoColumn {
                    file: curve.file.clone(),
                    column: column.clone(),
                    known: known_columns(&curve.file, header),
                })
        };
        Ok(Self {
            step: index(&curve.step)?,
            value: index(&curve.value)?,
            by: curve.by.as_ref().map(index).transpose()?,
            wanted: curve
                .rows
                .iter()
                .map(|(column, text)| Ok((index(column)?, text.as_str())))
                .collect::<Result<_, _>>()?,
        })
    }
}

struct CurveRecord<'a> {
    curve: &'a PublishedCurve,
    record: StringRecord,
}

impl CurveRecord<'_> {
    fn field(&self, column: usize) -> &str {
        self.record.get(column).unwrap_or_default()
    }

    fn line(&self) -> u64 {
        self.record.position().map_or(0, csv::Position::line)
    }

    fn add_to(
        &self,
        runs: &mut Vec<(String, BTreeMap<u64, f64>)>,
        columns: &Columns<'_>,
    ) -> Result<(), PublishedCurveError> {
        let unfit = |column: &String, text: &str, expected| PublishedCurveError::Unfit {
            file: self.curve.file.clone(),
            line: self.line(),
            column: column.clone(),
            text: reach::quoted(&self.curve.file, text),
            expected,
        };
        let (step, value) = (self.field(columns.step), self.field(columns.value));
        let step = whole(step).ok_or_else(|| unfit(&self.curve.step, step, "a number of steps"))?;
        let number: Option<f64> = value.parse().ok();
        let finite = number.filter(|number| number.is_finite());
        let expected = if number.is_some() {
            "a finite number"
        } else {
            "a number"
        };
        let value = finite.ok_or_else(|| unfit(&self.curve.value, value, expected))?;
        let name = columns.by.map_or("", |column| self.field(column));
        match run(runs, name).entry(step) {
            Entry::Vacant(place) => {
                place.insert(value);
                Ok(())
            }
            Entry::Occupied(_) => {
                let (file, column) = (self.curve.file.clone(), self.curve.step.clone());
                Err(PublishedCurveError::StepTwice {
                    file,
                    line: self.line(),
                    column,
                    step,
                })
            }
        }
    }
}

fn run<'a>(runs: &'a mut Vec<(String, BTreeMap<u64, f64>)>, name: &str) -> &'a mut BTreeMap<u64, f64> {
    let index = runs
        .iter()
        .position(|(known, _)| known == name)
        .unwrap_or_else(|| {
            runs.push((name.into(), BTreeMap::new()));
            runs.len() - 1
        });
    &mut runs[index].1
}

/// A step, which logs may write as `500`, `500.0` or `5e2`.
fn whole(text: &str) -> Option<u64> {
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "whole, not negative and below 2^53"
    )]
    let of_float =
        |number: f64| (number.fract() == 0.0 && (0.0..9.0e15).contains(&number)).then_some(number as u64);
    text.parse().ok().or_else(|| text.parse().ok().and_then(of_float))
}

fn open(file: &Path) -> Result<Reader<Opened>, PublishedCurveError> {
    let opened = input_file::open(file, Use::Text).map_err(|error| unreadable(file, &error))?;
    Ok(ReaderBuilder::new().trim(Trim::All).from_reader(opened))
}

/// Names of columns; empty for a file outside the study's folder.
fn known_columns(file: &Path, header: &StringRecord) -> Vec<String> {
    let names = header.iter().filter(|_| !reach::is_foreign(file));
    names.map(String::from).collect()
}

fn unreadable(file: &Path, problem: &impl std::fmt::Display) -> PublishedCurveError {
    PublishedCurveError::Unreadable {
        file: file.into(),
        problem: problem.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LOGS: &str =
        "algorithm,seed,step,score\nours,1,20,3\nours,1,10,1\nours,2,1e1,5.5\ntheirs,1,10,-7\n";

    fn curve(dir: &Path, text: &str) -> PublishedCurve {
        std::fs::write(dir.join("logs.csv"), text).unwrap();
        let rows = BTreeMap::from([("algorithm".into(), "ours".into())]);
        let (file, step, value, by) = (
            "logs.csv".into(),
            "step".into(),
            "score".into(),
            Some("seed".into()),
        );
        let mut curve = PublishedCurve {
            file,
            step,
            value,
            rows,
            by,
            ..PublishedCurve::default()
        };
        curve.seek_from(dir);
        curve
    }

    fn error(text: &str, change: impl Fn(&mut PublishedCurve)) -> String {
        let dir = tempfile::tempdir().unwrap();
        let mut curve = curve(dir.path(), text);
        change(&mut curve);
        curve
            .runs()
            .unwrap_err()
            .to_string()
            .replace(&dir.path().display().to_string(), "")
    }

    #[test]
    fn rows_become_runs_with_their_steps_in_order() {
        let dir = tempfile::tempdir().unwrap();
        // Spreadsheets put a byte order mark before the first column and spaces around fields.
        let text = format!("\u{feff}{}", LOGS.replace(",seed", " , seed"));
        let runs = curve(dir.path(), &text).runs().unwrap();
        let run = |name: &str, points: &[(u64, f64)]| CurveRun {
            name: name.into(),
            points: points.into(),
        };
        assert_eq!(runs, [run("1", &[(10, 1.0), (20, 3.0)]), run("2", &[(10, 5.5)])]);
    }

    #[test]
    fn what_is_wrong_is_said_with_file_line_and_column() {
        assert!(
            error(LOGS, |curve| curve.file = "/no/logs.csv".into())
                .starts_with("cannot read `/no/logs.csv`: No such file")
        );
        assert_eq!(
            error(LOGS, |curve| curve.value = "scores".into()),
            "`/logs.csv` has no column `scores`"
        );
        assert_eq!(
            error(LOGS, |curve| curve.by = Some("run".into())),
            "`/logs.csv` has no column `run`"
        );
        let nobody = BTreeMap::from([
            ("algorithm".into(), "nobody's".into()),
            ("seed".into(), "1".into()),
        ]);
        assert_eq!(
            error(LOGS, |curve| curve.rows = nobody.clone()),
            "no row of `/logs.csv` has `nobody's` in column `algorithm` and `1` in column `seed`"
        );
        let value = |text: &str| error(&LOGS.replace("5.5", text), |_| ());
        assert_eq!(
            value("high"),
            "`/logs.csv`, line 4, column `score`: `high` is not a number"
        );
        assert_eq!(
            value(""),
            "`/logs.csv`, line 4, column `score`: `` is not a number"
        );
        assert_eq!(
            value("NaN"),
            "`/logs.csv`, line 4, column `score`: `NaN` is not a finite number"
        );
        let step = error(&LOGS.replace("1e1", "10.5"), |_| ());
        assert_eq!(
            step,
            "`/logs.csv`, line 4, column `step`: `10.5` is not a number of steps"
        );
        let together = error(LOGS, |curve| curve.by = None);
        assert_eq!(
            together,
            "`/logs.csv`, line 4, column `step`: step 10 stands in this run already"
        );
        assert!(error(&LOGS.replace("3\n", "3,4\n"), |_| ()).contains("line: 2"));
    }

    #[test]
    fn other_rows_need_no_numbers() {
        let dir = tempfile::tempdir().unwrap();
        assert_eq!(
            curve(dir.path(), &LOGS.replace("-7", "none"))
                .runs()
                .unwrap()
                .len(),
            2
        );
    }

    #[test]
    fn the_mean_of_the_last_values_needs_a_run_that_goes_so_far() {
        let run = CurveRun {
            name: String::new(),
            points: (1..=8).map(|index| (250 * index, index as f64)).collect(),
        };
        assert_eq!(run.last_mean(1000, 2), Some(3.5));
        assert_eq!(run.last_mean(1249, 2), Some(3.5));
        assert_eq!((run.last_mean(1000, 5), run.last_mean(1000, 0)), (None, None));
        assert_eq!(
            (run.last_mean(2250, 8), run.last_mean(2251, 8)),
            (Some(4.5), None)
        );
        let single = CurveRun {
            name: String::new(),
            points: vec![(500, 1.0)],
        };
        assert_eq!(
            (single.last_mean(500, 1), single.last_mean(501, 1)),
            (Some(1.0), None)
        );
    }
}
