//! Protocols: the course of one trial.
//!
//! A protocol implements [`Protocol`] and is registered like any other plugin. Its building blocks are here:
//! [`measure`] runs a [`Measurement`], [`measure_alone`] runs those of an agent that does not learn, [`observe`] makes
//! an observation, and a [`Position`] gives the place to continue from.

mod evaluation;
mod going_on;
mod position;

use crate::{
    Agent, ArtifactKind, Environment, Error, Feed, Interface, Keeper, Metric, Phase, Recorder,
    drawing::Image, own_training::Assignment, random::Streams, standard_metrics::UPDATES,
};
use serde::{Serialize, de::DeserializeOwned};
use std::path::Path;

pub use evaluation::{
    Kept, Measurement, measure, measure_alone, measure_and_keep, metrics as measurement_metrics, observe,
    record_static_trace, replay as replay_measurement,
};
pub use going_on::{
    leave as leave_checkpoint, load_agent as load_from_checkpoint, misfit as checkpoint_misfit,
    take_up as take_up_checkpoint, write_stub as write_checkpoint_stub,
};
pub use position::{Blocks, Position, restored};

/// Everything that a protocol works with. All of it belongs to one trial.
pub struct Run<'a> {
    /// Makes one more copy of the trial's environment.
    pub make_environment: &'a dyn Fn() -> Result<Box<dyn Environment>, Error>,
    /// The trial's agent, freshly initialised.
    pub agent: Box<dyn Agent>,
    /// The trial's random streams.
    pub streams: Streams,
    /// Record of the trial.
    pub record: Recorder,
    /// Reports progress: steps done, and total steps.
    pub progress: &'a mut dyn FnMut(u64, u64),
    /// The task of an agent that trains itself; the protocol sets its length.
    pub assignment: Assignment,
    /// Keeps the trial's state, so that it can continue in another process.
    pub keeper: &'a mut dyn Keeper,
    /// Folder for artifacts that the protocol makes; `None` if only the record of the trial is kept.
    pub folder: Option<&'a Path>,
}

impl Run<'_> {
    /// The state that the protocol gave to [`checkpoint`](Self::checkpoint) in an earlier process; agent and record are
    /// restored too. `None` at the beginning of the trial. It must be called once, before anything else.
    ///
    /// # Errors
    /// [`Error::Checkpoint`] if it does not fit; [`TrialKey::run`](crate::trial::TrialKey::run) then starts over.
    pub fn resume<S: DeserializeOwned>(&mut self) -> Result<Option<S>, Error> {
        let state = self
            .keeper
            .load(&mut *self.agent, &mut self.record)
            .map_err(Error::of_store)?;
        state.map(serde_json::from_value).transpose().map_err(misfit)
    }

    /// Records the number of updates that the agent made so far; records nothing for one that does not learn.
    pub fn record_updates(&mut self, phase: Phase, step: u64) {
        if let Some(updates) = self.agent.updates() {
            #[allow(clippy::cast_precision_loss, reason = "a count of updates is far below 2^52")]
            self.record.add(phase, step, 0, 0, UPDATES, updates.made as f64);
        }
    }

    /// A point at which the trial can continue: if a save is due, `state` gives everything that the protocol needs
    /// besides agent and record. Numbers that may not be finite belong in a field with [`exact`](crate::exact).
    ///
    /// # Errors
    /// [`Error::Stopped`] if the trial is asked to stop, [`Error::NotFinite`] if the record has a number that is not
    /// finite, and errors of writing a file.
    pub fn checkpoint<S: Serialize>(&mut self, state: impl FnOnce() -> S) -> Result<(), Error> {
        self.record.all_finite()?;
        if self.agent.own_training().is_some() {
            // The agent manages its own checkpoint.
            if self.keeper.stopping() {
                return Err(Error::Stopped);
            }
            return self.keeper.note(&self.record).map_err(Error::of_store);
        }
        self.keeper.look(&self.record);
        if !self.keeper.due() {
            return self.keeper.note(&self.record).map_err(Error::of_store);
        }
        let state = serde_json::to_value(state()).map_err(misfit)?;
        self.keeper
            .save(state, &*self.agent, &mut self.record)
            .map_err(Error::of_store)?;
        if self.keeper.stopping() {
            Err(Error::Stopped)
        } else {
            Ok(())
        }
    }
}

/// Writes the graph and the images of an environment after its last episode into a trial's folder, if it has them;
/// returns the kinds that were written.
///
/// # Errors
/// Errors of the environment, [`Error::Drawing`] if a drawing cannot be drawn, and [`Error::Store`] if a file cannot be
/// written.
pub fn leave_drawings(environment: &mut dyn Environment, folder: &Path) -> Result<Vec<ArtifactKind>, Error> {
    let mut left = Vec::new();
    if let Some(graph) = environment.graph() {
        graph.write(folder)?;
        left.push(ArtifactKind::Graph);
    }
    let images = environment.images()?;
    if !images.is_empty() {
        Image::write_all(&images, folder)?;
        left.push(ArtifactKind::Images);
    }
    Ok(left)
}

fn misfit(source: serde_json::Error) -> Error {
    Error::Checkpoint {
        what: "the protocol",
        problem: source.to_string(),
    }
}

/// The course of one trial, from the first step to the final measurement.
pub trait Protocol: Send + Sync {
    /// Metrics that the protocol records besides those of the environment and the agent.
    fn metrics(&self) -> Vec<Metric>;

    /// Further metrics that it records in an environment with this interface.
    fn metrics_of_interface(&self, _interface: &Interface) -> Vec<Metric> {
        Vec::new()
    }

    /// Whether the environment's metrics are recorded per episode under their names.
    fn records_environment_metrics(&self) -> bool {
        true
    }

    /// Metrics that are recorded of an environment with these metrics.
    fn metrics_of_environment(&self, of: &[Metric]) -> Vec<Metric> {
        if self.records_environment_metrics() {
            of.to_vec()
        } else {
            Vec::new()
        }
    }

    /// Things that it gives to agents that learn.
    fn feed(&self) -> Feed {
        Feed::Decisions
    }

    /// Whether an agent that learned nothing is the baseline of others.
    fn compares_untrained(&self) -> bool {
        false
    }

    /// Checks before a trial whether it can run in an environment with this interface and these metrics; `check` calls
    /// it with stubs for artifacts.
    ///
    /// # Errors
    /// The misfit, as [`run`](Self::run) would report it.
    fn accepts(&self, _interface: &Interface, _metrics: &[Metric]) -> Result<(), Error> {
        Ok(())
    }

    /// Artifacts that a trial leaves for others besides those that its agent exports.
    fn leaves(&self) -> Vec<ArtifactKind> {
        Vec::new()
    }

    /// Writes stubs of the artifacts that a trial of this protocol leaves: `check` builds trials that take them from
    /// these.
    ///
    /// # Errors
    /// A file cannot be written.
    fn write_stub(&self, _interface: &Interface, _folder: &Path) -> Result<(), Error> {
        Ok(())
    }

    /// A config that can be run but is probably not intended: an [`Error::Config`] that names the key.
    fn doubt(&self) -> Option<Error> {
        None
    }

    /// Total number of steps, for progress and cost estimates.
    fn total_steps(&self) -> u64;

    /// Whether it measures at this step before its end, so that a trial can pause there.
    fn measures_at(&self, _step: u64) -> bool {
        false
    }

    /// Total number of transitions that the agent is given to learn from.
    fn experience(&self) -> u64;

    /// Runs the trial from its start or from the state that [`Run::resume`] returns; the numbers are the same either
    /// way.
    ///
    /// [`Error::Stopped`] and [`Error::NotFinite`] from [`Run::checkpoint`], and errors of the environment and the
    /// agent.
    fn run(&self, run: &mut Run<'_>) -> Result<(), Error>;
}
