//! Agents that train themselves, such as programs of others: the protocol waits for them, records what they measure,
//! and steps no environment.

use crate::{Error, Metric, resources::Share};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::{collections::BTreeMap, path::PathBuf, time::Duration};

/// The key of an agent that says how the protocol measures it. It counts as the agent's own config writes it: no sweep,
/// search or override can change it.
pub const MEASURED: &str = "measured";

/// How the protocol measures an agent that trains itself, on the episodes of the agents that it trains.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Measured {
    /// When the training asks for it; then the training gives the actions.
    Calls,
    /// Once the training has ended, by the policy that it left.
    Policy,
}

/// The task that an agent trains for.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Assignment {
    /// Id of the trial.
    pub trial: String,
    /// Seed of the trial.
    pub seed: u64,
    /// Steps of the training, in the unit of the protocol's `steps`.
    pub steps: u64,
    /// Steps between two measurements; 0 where only the last one is taken.
    pub evaluate_every: u64,
    /// Complete config of the environment, with the names that the environment has in other programs.
    pub environment: Value,
    /// Description by which other programs can make the environment.
    pub simulator: Simulator,
}

/// Description of an environment for programs that make it themselves.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Simulator {
    /// Name of the environment's plugin.
    pub plugin: String,
    /// Its config; paths of files are absolute.
    pub config: Value,
    /// The key of its random streams.
    pub stream_id: String,
}

/// Folder, time and share of the machine of a training.
#[derive(Debug, Clone, PartialEq)]
pub struct TrainingAllocation {
    /// The folder of the trial's work, which stays until the trial ends.
    pub folder: PathBuf,
    /// Step at which the trial pauses, after the measurement there; `None` where it goes to its end.
    pub until: Option<u64>,
    /// Longest silence of the training; `None` for any.
    pub patience: Option<Duration>,
    /// Share of the machine.
    pub share: Share,
}

/// The values of a metric so far, each at its step, in the order of the training.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// The metric of the values.
    pub metric: Metric,
    /// Number of last values whose mean is the measurement at a step.
    pub last: u64,
    /// Steps with values.
    pub values: Vec<(u64, f64)>,
}

/// The state of a training.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Advance {
    /// The training goes on.
    Running {
        /// Whether there was output, or a file that grew, since the last question.
        heard: bool,
    },
    /// The training asks to be measured.
    Asks(MeasurementPoint),
    /// The training has ended well.
    Ended,
}

/// Point of a measurement that a training asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MeasurementPoint {
    /// The one during the training that is due at this step, if any.
    At(u64),
    /// The last measurement.
    Last,
}

/// The training of an agent that trains itself.
pub trait OwnTraining {
    /// The command for an assignment, word by word: nothing runs yet.
    ///
    /// # Errors
    /// [`Error::Config`] where the assignment lacks a value that the words name.
    fn command(&self, of: &Assignment) -> Result<Vec<String>, Error>;

    /// Words of the command as they are written, with the program that runs here in the first place.
    fn written(&self) -> Vec<String>;

    /// Whether the training goes on after an interruption instead of beginning anew.
    fn goes_on(&self) -> bool;

    /// Settings that can be run and are probably not meant, each an [`Error::Config`] with its key.
    fn doubts(&self) -> Vec<Error> {
        Vec::new()
    }

    /// Starts the training, or goes on with it where an earlier process left it.
    ///
    /// # Errors
    /// Where it cannot be started, or a file cannot be written.
    fn begin(&mut self, of: &Assignment, place: &TrainingAllocation) -> Result<(), Error>;

    /// Waits for news, not longer than `wait`.
    ///
    /// # Errors
    /// [`Error::Program`] or [`Error::Ended`] where the training did not end well.
    fn advance(&mut self, wait: Duration) -> Result<Advance, Error>;

    /// The measurements so far, by metric; `last` once the training has ended, when everything has to be there.
    ///
    /// # Errors
    /// Where a written file cannot be read; while the training runs, a file that is still being written is not refused.
    fn curves(&mut self, last: bool) -> Result<&[Curve], Error>;

    /// How the protocol measures the agent; `None` where the training alone gives the measurements.
    fn measured(&self) -> Option<Measured> {
        None
    }

    /// Gives the training the result of the measurement that it asked for: the mean of each metric; `None` where none
    /// was due.
    ///
    /// # Errors
    /// Where the training cannot be reached.
    fn answer(&mut self, _means: Option<&BTreeMap<String, f64>>) -> Result<(), Error> {
        Ok(())
    }

    /// Takes up the policy that the training left, once it has ended.
    ///
    /// # Errors
    /// Where there is no policy, or it does not fit the environment.
    fn take_up(&mut self) -> Result<(), Error> {
        Ok(())
    }

    /// Tells the training to end, and waits until it has.
    fn stop(&mut self);

    /// Output of the training in this process; `None` where there is none.
    fn output(&self) -> Option<Vec<u8>> {
        None
    }
}
