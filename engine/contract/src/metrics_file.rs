//! Metrics in Parquet, long form.
//!
//! | column | type | meaning |
//! |---|---|---|
//! | `step` | u64 | environment steps or examples at the time of recording; in a trace, the decision |
//! | `step` | u64 | environment steps or examples when it was recorded; the decision in a trace |
//! | `episode` | u32 | episode inside the measurement |
//! | `seat` | u32 | seat |
//! | `metric` | text | name |
//! | `value` | f64 | value |
//!
//! The file's metadata holds `regimen.schema` (this table's version) and `regimen.trial` (the trial's id).

use crate::{
    Error, Recorder, panics,
    parquet::{self, ParquetTable, Values},
    recorder::{Phase, Row},
};
use std::{collections::HashMap, fs, path::Path};

/// Version of the columns, for other readers. This program compares a file with its acknowledged hash and knows only
/// one form.
pub const SCHEMA_VERSION: u32 = 1;

/// Rows of one or more trials read back.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct MetricsTable {
    /// Metric names, to which the rows refer by index.
    pub names: Vec<String>,
    /// Rows in the order of the files.
    pub rows: Vec<Row>,
}

/// Reads a metrics file.
///
/// # Errors
/// [`Error::Damaged`] if it is no Parquet file or its columns are not those above.
pub fn read(path: &Path) -> Result<MetricsTable, Error> {
    decode(fs::read(path).map_err(Error::file("read", path))?, path)
}

/// The metrics file of a trial.
///
/// # Errors
/// The rows cannot be encoded.
pub fn encode(record: &Recorder, trial_id: &str) -> Result<Vec<u8>, Error> {
    let entries = [
        ("regimen.schema", SCHEMA_VERSION.to_string()),
        ("regimen.trial", trial_id.to_string()),
    ];
    parquet::encode(Path::new("metrics.parquet"), columns(record), &entries)
}

fn columns(record: &Recorder) -> Vec<(&str, Values<'_>)> {
    let (rows, names) = (record.rows(), record.names());
    let counts = |value: fn(&Row) -> u32| Values::U32(rows.iter().map(value).collect());
    vec![
        (
            "phase",
            Values::Text(rows.iter().map(|row| row.phase.name()).collect()),
        ),
        ("step", Values::U64(rows.iter().map(|row| row.step).collect())),
        (
            "episode",
            counts(|row| u32::try_from(row.episode).unwrap_or(u32::MAX)),
        ),
        ("seat", counts(|row| u32::from(row.seat))),
        (
            "metric",
            Values::Text(
                rows.iter()
                    .map(|row| names[usize::from(row.metric)].as_str())
                    .collect(),
            ),
        ),
        ("value", Values::F64(rows.iter().map(|row| row.value).collect())),
    ]
}

/// Reads the bytes of a metrics file; `path` is for messages.
///
/// # Errors
/// The errors of [`read`].
pub fn decode(bytes: Vec<u8>, path: &Path) -> Result<MetricsTable, Error> {
    let damaged = |problem: String| {
        let path = path.to_path_buf();
        Error::Damaged { path, problem }
    };
    let whole = || rows(&ParquetTable::decode(bytes, path)?);
    let unknown = "a cell is empty, a phase is unknown, or there are more than 65535 names of metrics";
    panics::or_damaged(path, whole)?.ok_or_else(|| damaged(unknown.into()))
}

fn rows(read: &ParquetTable<'_>) -> Result<Option<MetricsTable>, Error> {
    let mut table = MetricsTable::default();
    let mut known: HashMap<String, u16> = HashMap::new();
    let (phases, metrics) = (read.texts("phase")?, read.texts("metric")?);
    let (steps, episodes) = (read.u64s("step")?, read.u32s("episode")?);
    let (seats, values) = (read.u32s("seat")?, read.f64s("value")?);
    for (((((phase, step), episode), seat), metric), value) in phases
        .zip(steps)
        .zip(episodes)
        .zip(seats)
        .zip(metrics)
        .zip(values)
    {
        let (Some(phase), Some(step), Some(episode), Some(seat), Some(metric), Some(value)) =
            (phase.and_then(phase_named), step, episode, seat, metric, value)
        else {
            return Ok(None);
        };
        let metric = match known.get(metric) {
            Some(index) => *index,
            None => {
                let Ok(index) = u16::try_from(table.names.len()) else {
                    return Ok(None);
                };
                table.names.push(metric.into());
                known.insert(metric.into(), index);
                index
            }
        };
        let seat = u16::try_from(seat).unwrap_or(u16::MAX);
        table.rows.push(Row {
            phase,
            step,
            episode: u64::from(episode),
            seat,
            metric,
            value,
        });
    }
    // With very many short trials, the reserved capacity would be most of the memory in use.
    table.rows.shrink_to_fit();
    Ok(Some(table))
}

fn phase_named(name: &str) -> Option<Phase> {
    Phase::ALL.into_iter().find(|phase| phase.name() == name)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(names: &[String]) -> Vec<u8> {
        let (rows, path) = (names.len(), Path::new("metrics.parquet"));
        let columns = vec![
            ("phase", Values::Text(vec!["train"; rows])),
            ("step", Values::U64(vec![0; rows])),
            ("episode", Values::U32(vec![0; rows])),
            ("seat", Values::U32(vec![0; rows])),
            ("metric", Values::Text(names.iter().map(String::as_str).collect())),
            ("value", Values::F64(vec![0.5; rows])),
        ];
        parquet::encode(path, columns, &[]).unwrap()
    }

    #[test]
    fn more_names_than_rows_can_tell_apart_are_damage() {
        let names: Vec<String> = (0..70_000).map(|name| format!("metric_{name}")).collect();
        let path = Path::new("metrics.parquet");
        let read = decode(file(&names[..1000]), path).unwrap();
        assert_eq!((read.names.len(), read.rows[999].metric), (1000, 999));
        let refused = decode(file(&names), path).unwrap_err().to_string();
        assert!(refused.contains("more than 65535 names"), "{refused}");
    }

    #[test]
    fn a_reader_that_panics_has_a_damaged_file() {
        let read = || -> Result<(), Error> { panic!("as a reader of Parquet may") };
        let refused = panics::or_damaged(Path::new("metrics.parquet"), read);
        assert!(matches!(refused, Err(Error::Damaged { .. })));
    }
}
