//! Continuation of learning in another trial: the [checkpoint](ArtifactKind::Checkpoint) that a trial leaves, and its
//! use by another one.
//!
//! ```text
//! <trial's folder>/checkpoint/state.json        state of the protocol, and means that are not recorded yet
//!                             metrics.parquet   rows recorded while learning
//!                             agent/            files of the agent
//! ```

use super::Run;
use crate::{
    Agent, Artifact, ArtifactKind, Checkpoint, Error, Phase, Recorder,
    artifact::{CHECKPOINT, CHECKPOINT_AGENT, CHECKPOINT_ROWS, CHECKPOINT_STATE},
    metrics_file,
    recorder::Running,
};
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use serde_json::Value;
use std::{fs, io, path::Path};

/// Content of `state.json`.
#[derive(Serialize, Deserialize)]
struct ProtocolCheckpoint {
    protocol: Value,
    running: Running,
}

/// Writes a checkpoint into the folder of a trial whose learning is over; does nothing if no folder is kept.
///
/// # Errors
/// A file cannot be written.
pub fn leave(run: &Run<'_>, protocol: &impl Serialize) -> Result<(), Error> {
    let Some(trial) = run.folder else { return Ok(()) };
    let learned = |row: &&crate::recorder::Row| matches!(row.phase, Phase::Train | Phase::Evaluate);
    let rows = run.record.rows().iter().filter(learned).copied().collect();
    let names = run.record.names().to_vec();
    let record = Recorder::resumed(names, rows, run.record.running().clone());
    write(trial, protocol, &*run.agent, &record).map_err(Error::of_store)
}

/// Writes the checkpoint of learning that has not begun, from which no protocol could continue: `check` uses it to test
/// whether an agent accepts one.
///
/// # Errors
/// A file cannot be written.
pub fn write_stub(trial: &Path, agent: &dyn Agent) -> Result<(), Error> {
    write(trial, &Value::Null, agent, &Recorder::default())
}

fn write(trial: &Path, protocol: &impl Serialize, agent: &dyn Agent, record: &Recorder) -> Result<(), Error> {
    let folder = trial.join(CHECKPOINT);
    // An attempt that was interrupted may have left files.
    if let Err(source) = fs::remove_dir_all(&folder)
        && source.kind() != io::ErrorKind::NotFound
    {
        return Err(Error::file("remove", &folder)(source));
    }
    let of_agent = folder.join(CHECKPOINT_AGENT);
    fs::create_dir_all(&of_agent).map_err(Error::file("create", &of_agent))?;
    agent.save(&of_agent)?;
    let rows = folder.join(CHECKPOINT_ROWS);
    fs::write(&rows, metrics_file::encode(record, "")?).map_err(Error::file("write", &rows))?;
    let path = folder.join(CHECKPOINT_STATE);
    let json = |source: serde_json::Error| Error::file("write", &path)(source.into());
    let state = ProtocolCheckpoint {
        protocol: serde_json::to_value(protocol).map_err(json)?,
        running: record.running().clone(),
    };
    let text = serde_json::to_vec(&state).map_err(json)?;
    fs::write(&path, text).map_err(Error::file("write", &path))
}

/// Loads a checkpoint: agent and record then have the state in which they were left. Returns the protocol's state.
///
/// # Errors
/// [`Error::Source`] if it is not available, or if it does not fit the agent or the protocol.
pub fn take_up<S: DeserializeOwned>(run: &mut Run<'_>, artifact: &Artifact<Checkpoint>) -> Result<S, Error> {
    let trial = artifact.folder()?;
    load_agent(&mut *run.agent, trial)
        .map_err(|error| misfit(artifact, &format!("it does not fit this agent: {error}")))?;
    let folder = trial.join(CHECKPOINT);
    let path = folder.join(CHECKPOINT_STATE);
    let text = fs::read(&path).map_err(Error::file("read", &path))?;
    let state: ProtocolCheckpoint =
        serde_json::from_slice(&text).map_err(|source| misfit(artifact, &source))?;
    let table = metrics_file::read(&folder.join(CHECKPOINT_ROWS))?;
    run.record = Recorder::resumed(table.names, table.rows, state.running);
    serde_json::from_value(state.protocol).map_err(|source| misfit(artifact, &source))
}

/// Loads the checkpoint in the folder of another trial into an agent.
///
/// # Errors
/// The error of an agent that the checkpoint does not fit.
pub fn load_agent(agent: &mut dyn Agent, trial: &Path) -> Result<(), Error> {
    agent.load(&trial.join(CHECKPOINT).join(CHECKPOINT_AGENT))
}

/// The error about a checkpoint that cannot be used.
pub fn misfit(artifact: &Artifact<Checkpoint>, problem: &impl ToString) -> Error {
    Error::Source {
        trial: format!("`{}`", artifact.source()),
        problem: format!("its {}: {}", ArtifactKind::Checkpoint, problem.to_string()),
    }
}
