//! Results of a study, from a store.

use crate::{config::REGISTRY, refusal::Refusal};
use contract::{Phase, trial_result::TrialResult};
use pyo3::prelude::*;
use serde_json::{Map, Value, json};
use session::{Failure, MachineOptions, Selection, Session, Silent};
use std::path::PathBuf;

/// The trials of a study as a list of JSON objects: setting, state, and means of the final measurement.
///
/// # Errors
/// A study that does not pass the checks, or a store that cannot be read.
#[pyfunction]
#[pyo3(signature = (study, profile, sets, store))]
pub fn collect(
    study: PathBuf,
    profile: Option<String>,
    sets: Vec<String>,
    store: Option<PathBuf>,
) -> PyResult<String> {
    let selection = Selection {
        profile,
        sets,
        ..Selection::of(study)
    };
    let machine = MachineOptions {
        store,
        ..MachineOptions::default()
    };
    let rows = rows(selection, machine).map_err(|failure| Refusal::Config(failure.text))?;
    Ok(Value::Array(rows).to_string())
}

fn rows(selection: Selection, machine: MachineOptions) -> Result<Vec<Value>, Failure> {
    let session = Session::open(&REGISTRY, selection, machine, &Silent)?;
    let mut rows = Vec::new();
    for one in session.load_with_looks()? {
        rows.extend(session.collect(&one)?.trials.iter().map(row));
    }
    Ok(rows)
}

fn row(result: &TrialResult) -> Value {
    let trial = &result.trial;
    let means = result.names.iter().filter_map(|name| {
        let mean = result.mean(Phase::Final, name)?;
        Some((name.to_string(), json!(mean)))
    });
    json!({
        "trial": trial.id,
        "environment": trial.cell.environment,
        "agent": trial.cell.agent,
        "setting": trial.cell.point.words(),
        "seed": trial.key.seed,
        "end": result.end.as_ref().map(|end| end.state.name()),
        "final": means.collect::<Map<String, Value>>(),
    })
}
