//! Agents that train themselves, such as external programs. The protocol waits for them, records their measurements,
//! and steps no environment.

use crate::{Error, Metric, resources::Share};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::{collections::BTreeMap, path::PathBuf, time::Duration};

/// The key of an agent that decides how the protocol measures it. Only the agent's own config can set it: no sweep,
/// search or override can change it.
pub const MEASURED: &str = "measured";

/// The key of an agent that trains itself for the metrics that it reports, by name.
pub const REPORTED: &str = "metrics";

/// Ways in which the protocol measures an agent that trains itself, on the same episodes as agents that the protocol
/// trains.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Measured {
    /// When the training asks for it; the training then gives the actions.
    Calls,
    /// Once the training has ended, with the policy that it left.
    Policy,
}

/// The task for which an agent trains.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Assignment {
    /// Id of the trial.
    pub trial: String,
    /// Seed of the trial.
    pub seed: u64,
    /// Steps of the training, in the unit of the protocol's `steps`.
    pub steps: u64,
    /// Steps between two measurements; 0 if only the last one is taken.
    pub evaluate_every: u64,
    /// Complete config of the environment, with the names that the environment has in other programs.
    pub environment: Value,
    /// Description with which other programs can make the environment.
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
    /// The folder for the trial's files, which is kept until the trial ends.
    pub folder: PathBuf,
    /// Step at which the trial pauses, after the measurement there; `None` if it runs to its end.
    pub until: Option<u64>,
    /// Longest time without output of the training; `None` for no limit.
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
    /// The training continues.
    Running {
        /// Whether there was output, or a file grew, since the last call.
        heard: bool,
    },
    /// The training asks to be measured.
    Asks(MeasurementPoint),
    /// The training has ended successfully.
    Ended,
}

/// Point of a measurement that a training asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MeasurementPoint {
    /// The one that is due at this step during the training, if any.
    At(u64),
    /// The last measurement.
    Last,
}

/// The training of an agent that trains itself.
pub trait OwnTraining {
    /// The command for an assignment, word by word; nothing is run yet.
    ///
    /// # Errors
    /// [`Error::Config`] if the assignment lacks a value that the words name.
    fn command(&self, of: &Assignment) -> Result<Vec<String>, Error>;

    /// Words of the command as they are written, beginning with the program that runs here.
    fn written(&self) -> Vec<String>;

    /// Environment variables that are set for the command.
    fn variables(&self) -> BTreeMap<String, String> {
        BTreeMap::new()
    }

    /// Whether the training continues after an interruption instead of starting again.
    fn goes_on(&self) -> bool;

    /// Settings that can be run for this number of seeds but are probably not intended, each an [`Error::Config`] with
    /// its key.
    fn doubts(&self, _seeds: usize) -> Vec<Error> {
        Vec::new()
    }

    /// Starts the training, or continues it from where an earlier process left it.
    ///
    /// # Errors
    /// The training cannot be started, or a file cannot be written.
    fn begin(&mut self, of: &Assignment, place: &TrainingAllocation) -> Result<(), Error>;

    /// Waits for news for at most `wait`.
    ///
    /// # Errors
    /// [`Error::Program`] or [`Error::Ended`] if the training ended unsuccessfully.
    fn advance(&mut self, wait: Duration) -> Result<Advance, Error>;

    /// The measurements so far, by metric. `last` is true once the training has ended, when all of them must exist.
    ///
    /// # Errors
    /// A written file cannot be read. While the training runs, a file that is still being written is not refused.
    fn curves(&mut self, last: bool) -> Result<&[Curve], Error>;

    /// Way in which the protocol measures the agent; `None` if only the training gives measurements.
    fn measured(&self) -> Option<Measured> {
        None
    }

    /// Gives the training the result of the measurement that it asked for: the mean of each metric; `None` if none was
    /// due.
    ///
    /// # Errors
    /// The training cannot be reached.
    fn answer(&mut self, _means: Option<&BTreeMap<String, f64>>) -> Result<(), Error> {
        Ok(())
    }

    /// Loads the policy that the training left, once it has ended.
    ///
    /// # Errors
    /// There is no policy, or it does not fit the environment.
    fn take_up(&mut self) -> Result<(), Error> {
        Ok(())
    }

    /// Tells the training to end, and waits for it.
    fn stop(&mut self);

    /// Output of the training in this process; `None` if there is none.
    fn output(&self) -> Option<Vec<u8>> {
        None
    }
}
