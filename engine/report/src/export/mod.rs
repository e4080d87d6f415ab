//! Exports of a study: its numbers in forms that other programs read.
//!
//! | form | files |
//! |---|---|
//! | `parquet`, `csv` | tidy tables `evaluations`, `training` and `trials`, and `columns.json`, which says what each column is |
//! | `tensorboard` | a folder with an event file per trial, and `runs.json` |
//! | `ro-crate` | study, report, tables and metrics with their hashes, described by `ro-crate-metadata.json` |
//! | `trace` | `trace.json`, when trials ran, for Perfetto |
//! | `onnx` | `policy.onnx` of each trial, or one file per seat |
//!
//! All files are a function of the store and the study, apart from the date of publication of a crate.

mod comma_separated;
mod config;
mod policy;
mod ro_crate;
mod table;
mod tables;
mod tensorboard;
mod trace;

pub use policy::{PolicySubject, onnx_files};
pub use ro_crate::{Crate, Piece};
pub use table::{ExportCells, ExportColumn, ExportTable};
pub use tables::tables;
pub use tensorboard::{describe_run, folder_of_run};

use contract::{Error, Metric, Registry, trial_result::TrialResult};
use execution::{
    store::{StoredTrial, write_durably},
    world::fs,
};
use serde_json::{Value, json};
use std::{collections::BTreeMap, path::Path};

/// Format of an export.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum ExportFormat {
    /// Tidy tables as Parquet files.
    Parquet,
    /// Tidy tables as comma-separated values.
    Csv,
    /// Event files of TensorBoard, one folder a trial; values have single precision there.
    Tensorboard,
    /// The times of trials as a trace for Perfetto and the tracing page of Chromium.
    Trace,
    /// A research object crate: study, report, tables, metrics with their hashes, and the builds that computed them.
    RoCrate,
    /// The policies that trials left as ONNX files, in a folder per trial, and `policies.json`.
    Onnx,
}

/// A study with its stored trials.
pub struct Subject<'a> {
    /// Name of the study.
    pub name: &'a str,
    /// Title of the study; empty where it has none.
    pub title: &'a str,
    /// Source of the published numbers; empty where the study has none.
    pub source: &'a str,
    /// Metrics that its trials record.
    pub metrics: &'a [Metric],
    /// Units of these metrics, by name.
    pub units: &'a BTreeMap<String, String>,
    /// Plugins of the program, with the descriptions of config keys.
    pub registry: &'a Registry,
    /// The trials in the order of the plan, each with its entry in the store.
    pub trials: Vec<(&'a TrialResult, Option<&'a StoredTrial>)>,
}

impl Subject<'_> {
    /// Name and version of the program that writes the export.
    fn program(&self) -> String {
        contract::build::version(self.registry.build.as_ref())
    }
}

/// Writes a study's tables into a folder, with `columns.json`. Returns the names of the files inside the folder.
///
/// # Errors
/// [`Error::File`] where a file cannot be written.
pub fn write_tables(subject: &Subject<'_>, as_csv: bool, folder: &Path) -> Result<Vec<String>, Error> {
    fs::create_dir_all(folder).map_err(Error::file("create", folder))?;
    let extension = if as_csv { "csv" } else { "parquet" };
    let mut names = Vec::new();
    let mut described = Vec::new();
    for table in tables(subject) {
        let name = format!("{}.{extension}", table.name);
        let path = folder.join(&name);
        if as_csv {
            comma_separated::write(&table, &path)?;
        } else {
            write_durably(&path, &table.to_parquet(&path)?)?;
        }
        described.push(table.describe(&name));
        names.push(name);
    }
    let text = pretty(&columns_json(subject, as_csv, described));
    write_durably(&folder.join("columns.json"), text.as_bytes())?;
    names.push("columns.json".into());
    Ok(names)
}

/// Writes event files of TensorBoard into a folder.
///
/// # Errors
/// [`Error::File`] where a file cannot be written.
pub fn write_event_files(subject: &Subject<'_>, folder: &Path) -> Result<(), Error> {
    tensorboard::write(subject, folder)
}

/// Writes the times of trials into a folder, as a trace.
///
/// # Errors
/// [`Error::File`] where the file cannot be written.
pub fn write_trace(subject: &Subject<'_>, folder: &Path) -> Result<(), Error> {
    trace::write(subject, folder)
}

fn columns_json(subject: &Subject<'_>, as_csv: bool, tables: Vec<Value>) -> Value {
    let metric = |metric: &Metric| {
        json!({"name": metric.name, "unit": metric.unit, "description": metric.about,
            "better": metric.better, "per_episode": metric.per_episode})
    };
    let metrics: Vec<Value> = subject.metrics.iter().map(metric).collect();
    let mut described = json!({"schema": 1, "study": subject.name, "title": subject.title,
        "source": subject.source, "program": subject.program(), "tables": tables, "metrics": metrics});
    if as_csv {
        described["csv"] = json!({"encoding": "utf-8", "delimiter": ",", "missing": "",
            "guard": comma_separated::ABOUT_GUARD});
    }
    described
}

/// JSON with line breaks, for human readers.
fn pretty(value: &Value) -> String {
    // All keys here are texts, so the value can be written.
    serde_json::to_string_pretty(value).unwrap_or_default() + "\n"
}

/// Words as a list in JSON.
fn json_list(words: &[String]) -> String {
    json!(words).to_string()
}

#[cfg(test)]
mod tests;
