//! Metrics in Parquet, long form; the only file that names `polars`.
//!
//! | column | type | meaning |
//! |---|---|---|
//! | `phase` | text | `train`, `evaluate`, `final`, `trace` |
//! | `step` | u64 | environment steps or examples when it was recorded; the decision in a trace |
//! | `episode` | u32 | episode inside the measurement |
//! | `seat` | u32 | seat |
//! | `metric` | text | name |
//! | `value` | f64 | value |
//!
//! The file's metadata holds `regimen.schema` (this table's version) and `regimen.trial` (the trial's id).

use crate::{
    Error, Recorder,
    recorder::{Phase, Row, intern},
    results::Results,
    trial::Trial,
};
use polars::prelude::{Column, DataFrame, PolarsError};
use polars_io::{
    SerReader,
    parquet::{
        read::{ParallelStrategy, ParquetReader},
        write::{KeyValueMetadata, ParquetCompression, ParquetWriter},
    },
};
use std::{io::Cursor, path::Path};

/// Version of the columns, for other readers: this program holds a file against its acknowledged hash and knows one form.
pub const SCHEMA_VERSION: u32 = 1;

/// Rows of one or more trials read back.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct MetricsTable {
    /// Metric names that the rows point into.
    pub names: Vec<String>,
    /// The rows.
    pub rows: Vec<Row>,
}

/// Writes a study's evaluations as one small file that stands without the store: the mean over the episodes of every measurement,
/// one row per trial, phase, step and metric, with the names of environment, agent and setting beside the seed.
///
/// # Errors
/// Where the file cannot be written.
pub fn write_results(path: &Path, results: &Results) -> Result<(), Error> {
    let mut rows = Vec::new();
    for result in &results.trials {
        for phase in [Phase::Evaluate, Phase::Final] {
            for metric in &result.names {
                rows.extend(
                    result.curve(phase, metric).into_iter().map(|(step, value)| (&result.trial, phase, step, metric, value)),
                );
            }
        }
    }
    let text = |name: &str, of: &dyn Fn(&(&Trial, Phase, u64, &String, f64)) -> String| {
        Column::new(name.into(), rows.iter().map(of).collect::<Vec<_>>())
    };
    let columns = vec![
        text("environment", &|row| row.0.environment.clone()),
        text("agent", &|row| row.0.agent.clone()),
        text("setting", &|row| row.0.setting.clone()),
        Column::new("seed".into(), rows.iter().map(|row| row.0.key.seed).collect::<Vec<_>>()),
        text("phase", &|row| row.1.name().to_owned()),
        Column::new("step".into(), rows.iter().map(|row| row.2).collect::<Vec<_>>()),
        text("metric", &|row| row.3.clone()),
        Column::new("value".into(), rows.iter().map(|row| row.4).collect::<Vec<_>>()),
    ];
    let mut bytes = Vec::new();
    let mut frame = DataFrame::new(rows.len(), columns).map_err(|source| unreadable(path, &source))?;
    let written =
        ParquetWriter::new(&mut bytes).with_compression(ParquetCompression::Zstd(None)).set_parallel(false).finish(&mut frame);
    written.map_err(|source| unreadable(path, &source))?;
    super::write_durably(path, &bytes)
}

/// Reads a metrics file.
///
/// # Errors
/// [`Error::Damaged`] where it is no Parquet file or its columns are not those above.
pub fn read(path: &Path) -> Result<MetricsTable, Error> {
    decode(std::fs::read(path).map_err(Error::file("read", path))?, path)
}

/// The metrics file of a trial.
///
/// # Errors
/// Where the rows cannot be encoded.
pub fn encode(record: &Recorder, trial_id: &str) -> Result<Vec<u8>, Error> {
    let mut bytes = Vec::new();
    let metadata = [("regimen.schema".into(), SCHEMA_VERSION.to_string()), ("regimen.trial".into(), trial_id.into())];
    let mut frame = frame(record).map_err(|source| unreadable(Path::new("metrics.parquet"), &source))?;
    ParquetWriter::new(&mut bytes)
        .with_compression(ParquetCompression::Zstd(None))
        .with_key_value_metadata(Some(KeyValueMetadata::from_static(metadata.to_vec())))
        .set_parallel(false)
        .finish(&mut frame)
        .map_err(|source| unreadable(Path::new("metrics.parquet"), &source))?;
    Ok(bytes)
}

fn frame(record: &Recorder) -> Result<DataFrame, PolarsError> {
    let rows = record.rows();
    let names = record.names();
    let column = |name: &str, value: fn(&Row) -> u32| Column::new(name.into(), rows.iter().map(value).collect::<Vec<_>>());
    let columns = vec![
        Column::new("phase".into(), rows.iter().map(|row| row.phase.name()).collect::<Vec<_>>()),
        Column::new("step".into(), rows.iter().map(|row| row.step).collect::<Vec<_>>()),
        column("episode", |row| u32::try_from(row.episode).unwrap_or(u32::MAX)),
        column("seat", |row| u32::from(row.seat)),
        Column::new("metric".into(), rows.iter().map(|row| names[usize::from(row.metric)].as_str()).collect::<Vec<_>>()),
        Column::new("value".into(), rows.iter().map(|row| row.value).collect::<Vec<_>>()),
    ];
    DataFrame::new(rows.len(), columns)
}

pub(super) fn decode(bytes: Vec<u8>, path: &Path) -> Result<MetricsTable, Error> {
    let frame = ParquetReader::new(Cursor::new(bytes))
        .read_parallel(ParallelStrategy::None)
        .finish()
        .map_err(|source| unreadable(path, &source))?;
    rows(&frame)
        .map_err(|source| unreadable(path, &source))?
        .ok_or_else(|| Error::Damaged { path: path.to_path_buf(), problem: "a cell is empty or a phase is unknown".into() })
}

fn rows(frame: &DataFrame) -> Result<Option<MetricsTable>, PolarsError> {
    let mut table = MetricsTable::default();
    let (phases, metrics) = (frame.column("phase")?.str()?, frame.column("metric")?.str()?);
    let (steps, episodes) = (frame.column("step")?.u64()?, frame.column("episode")?.u32()?);
    let (seats, values) = (frame.column("seat")?.u32()?, frame.column("value")?.f64()?);
    let columns = phases.iter().zip(steps.iter()).zip(episodes.iter()).zip(seats.iter()).zip(metrics.iter()).zip(values.iter());
    for (((((phase, step), episode), seat), metric), value) in columns {
        let (Some(phase), Some(step), Some(episode), Some(seat), Some(metric), Some(value)) =
            (phase.and_then(phase_named), step, episode, seat, metric, value)
        else {
            return Ok(None);
        };
        let metric = intern(&mut table.names, metric);
        let seat = u16::try_from(seat).unwrap_or(u16::MAX);
        table.rows.push(Row { phase, step, episode: u64::from(episode), seat, metric, value });
    }
    Ok(Some(table))
}

fn phase_named(name: &str) -> Option<Phase> {
    Phase::ALL.into_iter().find(|phase| phase.name() == name)
}

fn unreadable(path: &Path, source: &PolarsError) -> Error {
    Error::Damaged { path: path.to_path_buf(), problem: source.to_string() }
}
