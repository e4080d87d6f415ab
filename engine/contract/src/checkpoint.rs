//! Checkpoints, with which a running trial continues in another process.

use crate::{Agent, Error, Recorder, own_training::TrainingAllocation};
use serde_json::Value;
use std::time::Duration;

/// Keeps the state that a running trial needs to continue in another process. Results do not depend on whether and how
/// often it saves.
pub trait Keeper {
    /// Whether the state should be saved now, because the interval has passed or the trial is asked to stop.
    fn due(&mut self) -> bool;

    /// Whether the trial is asked to stop; after a save the protocol returns [`Error::Stopped`].
    fn stopping(&self) -> bool;

    /// Receives the record so far, before [`due`](Self::due) is called: a trial may have to pause after a measurement.
    fn look(&mut self, _record: &Recorder) {}

    /// Receives the record of a trial that ends with an error.
    fn fails(&mut self, _record: &Recorder) {}

    /// Saves the protocol's own state, the agent and the record.
    ///
    /// # Errors
    /// A file cannot be written.
    fn save(&mut self, state: Value, agent: &dyn Agent, record: &mut Recorder) -> Result<(), Error>;

    /// Restores agent and record and returns the protocol's state; `None` if there is nothing (or only damaged data) to
    /// continue from, in which case agent and record are unchanged.
    ///
    /// # Errors
    /// [`Error::Checkpoint`] if the agent refuses its saved state; agent and record must then be built again.
    fn load(&mut self, agent: &mut dyn Agent, record: &mut Recorder) -> Result<Option<Value>, Error>;

    /// Receives the record now and then, so that rows reach the log (live metrics) although no checkpoint is due.
    ///
    /// # Errors
    /// A file cannot be written.
    fn note(&mut self, record: &Recorder) -> Result<(), Error>;

    /// The folder in which an agent that trains itself works; `None` if nothing of the trial is kept.
    ///
    /// # Errors
    /// The folder cannot be created.
    fn place(&mut self) -> Result<Option<TrainingAllocation>, Error> {
        Ok(None)
    }

    /// Longest time without output of an agent that trains itself; `None` for no limit.
    fn patience(&self) -> Option<Duration> {
        None
    }

    /// Takes the output of the training of such an agent so far.
    ///
    /// # Errors
    /// The output cannot be stored.
    fn keep_output(&mut self, _said: &[u8]) -> Result<(), Error> {
        Ok(())
    }

    /// Restarts the record: rows noted before no longer count.
    fn begin_anew(&mut self) {}

    /// Refuses the state that [`load`](Self::load) restored last, since it does not fit. It is not restored again;
    /// returns false if there was none.
    fn refuse(&mut self) -> bool {
        false
    }
}

/// Never saves: for tests and rollouts.
#[derive(Debug, Clone, Copy, Default)]
pub struct NoKeeper;

impl Keeper for NoKeeper {
    fn due(&mut self) -> bool {
        false
    }

    fn stopping(&self) -> bool {
        false
    }

    fn save(&mut self, _: Value, _: &dyn Agent, _: &mut Recorder) -> Result<(), Error> {
        Ok(())
    }

    fn load(&mut self, _: &mut dyn Agent, _: &mut Recorder) -> Result<Option<Value>, Error> {
        Ok(None)
    }

    fn note(&mut self, _: &Recorder) -> Result<(), Error> {
        Ok(())
    }
}
