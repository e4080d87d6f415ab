//! Checkpoints: how a running trial goes on in another process.

use crate::{Agent, Error, Recorder, own_training::TrainingAllocation};
use serde_json::Value;
use std::time::Duration;

/// Keeps the state that a running trial needs to continue in another process. Whether and how often it saves cannot
/// reach a result.
pub trait Keeper {
    /// Whether the state should be saved now: the interval has passed, or the trial is asked to stop.
    fn due(&mut self) -> bool;

    /// Whether the trial is asked to stop: after a save the protocol leaves with [`Error::Stopped`].
    fn stopping(&self) -> bool;

    /// Shows the record so far, before [`due`](Self::due) is asked: a trial may have to pause where something was
    /// measured.
    fn look(&mut self, _record: &Recorder) {}

    /// Shows the record of a trial that ends with an error.
    fn fails(&mut self, _record: &Recorder) {}

    /// Saves the protocol's own state, the agent and the record.
    ///
    /// # Errors
    /// Where a file cannot be written.
    fn save(&mut self, state: Value, agent: &dyn Agent, record: &mut Recorder) -> Result<(), Error>;

    /// Restores agent and record and gives the protocol's state back; `None` where there is nothing (or only
    /// damaged things) to continue from: then agent and record are as they were.
    ///
    /// # Errors
    /// [`Error::Checkpoint`] where the agent does not take its saved state; agent and record are then to be
    /// made anew.
    fn load(&mut self, agent: &mut dyn Agent, record: &mut Recorder) -> Result<Option<Value>, Error>;

    /// Shows the record now and then, so that rows reach the log (live metrics) though no checkpoint is due.
    ///
    /// # Errors
    /// Where a file cannot be written.
    fn note(&mut self, record: &Recorder) -> Result<(), Error>;

    /// The folder in which an agent that trains itself works; `None` where nothing is kept of the trial.
    ///
    /// # Errors
    /// Where the folder cannot be made.
    fn place(&mut self) -> Result<Option<TrainingAllocation>, Error> {
        Ok(None)
    }

    /// The longest silence of an agent that trains itself; `None` for any.
    fn patience(&self) -> Option<Duration> {
        None
    }

    /// Takes the output of the training of such an agent so far.
    ///
    /// # Errors
    /// Where it cannot be kept.
    fn keep_output(&mut self, _said: &[u8]) -> Result<(), Error> {
        Ok(())
    }

    /// Begins the record anew: rows noted before count no more.
    fn begin_anew(&mut self) {}

    /// Refuses the state that [`load`](Self::load) took up last, since it does not fit. It is not taken up again; false
    /// where there was nothing.
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
