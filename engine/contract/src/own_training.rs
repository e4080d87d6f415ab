//! Agents that train themselves, such as programs that are not ours: the protocol waits while they do, takes in
//! what they measure, and steps no environment.

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
    /// When the training asks for it, which is then asked for actions.
    Calls,
    /// Once the training has ended, by the policy that it left.
    Policy,
}

/// The task that an agent trains for.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Assignment {
    /// The trial's id.
    pub trial: String,
    /// The replicate.
    pub seed: u64,
    /// Steps of the training.
    pub steps: u64,
    /// Steps between two measurements; 0 where there are none but the last.
    pub evaluate_every: u64,
    /// The complete config of the environment, with what the environment is called elsewhere.
    pub environment: Value,
    /// The environment as others can make it.
    pub simulator: Simulator,
}

/// An environment for those who make it themselves.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Simulator {
    /// Name of the plugin.
    pub plugin: String,
    /// Its config; paths of files are absolute.
    pub config: Value,
    /// The key of its random streams.
    pub stream_id: String,
}

/// Where a training has its files, how long it has, and what of the machine.
#[derive(Debug, Clone, PartialEq)]
pub struct Place {
    /// The folder of the trial's work, which stays until the trial ends.
    pub folder: PathBuf,
    /// The step at which the trial pauses, once that is measured.
    pub until: Option<u64>,
    /// The time for which nothing may be heard of it; `None` for any.
    pub patience: Option<Duration>,
    /// Its share of the machine.
    pub share: Share,
}

/// The values of a metric so far, each at its step, in the order of the training.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// The metric.
    pub metric: Metric,
    /// How many of the last values make what is measured at a step.
    pub last: u64,
    /// Steps with values.
    pub values: Vec<(u64, f64)>,
}

/// How a training stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Advance {
    /// It goes on; whether something was heard of it since the last question.
    Running {
        /// True for output, or a file that grew.
        heard: bool,
    },
    /// It asks to be measured.
    Asks(Asked),
    /// It has ended well.
    Ended,
}

/// Which measurement a training asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Asked {
    /// The one during the training that is due at this step, if any.
    At(u64),
    /// The last one.
    Last,
}

/// The training of an agent that trains itself.
pub trait OwnTraining {
    /// The command for an assignment, word by word: nothing runs yet.
    ///
    /// # Errors
    /// [`Error::Config`] where the assignment lacks what the words name.
    fn command(&self, of: &Assignment) -> Result<Vec<String>, Error>;

    /// The words of the command as they are written, with the program that runs here in the first place.
    fn written(&self) -> Vec<String>;

    /// True where the training goes on after an interruption, and does not begin anew.
    fn goes_on(&self) -> bool;

    /// Settings that can be run and are probably not meant, each an [`Error::Config`] with its key.
    fn doubts(&self) -> Vec<Error> {
        Vec::new()
    }

    /// Starts the training, or goes on with it where an earlier process left it.
    ///
    /// # Errors
    /// Where it cannot be started, or a file cannot be written.
    fn begin(&mut self, of: &Assignment, place: &Place) -> Result<(), Error>;

    /// Waits for news, not longer than `wait`.
    ///
    /// # Errors
    /// [`Error::Program`] or [`Error::Ended`] where the training did not end well.
    fn advance(&mut self, wait: Duration) -> Result<Advance, Error>;

    /// The measurements so far, by metric; `last` once the training has ended, when everything has to be there.
    ///
    /// # Errors
    /// Where what was written cannot be read; while the training runs nothing is refused that may become whole.
    fn curves(&mut self, last: bool) -> Result<&[Curve], Error>;

    /// How the protocol measures it; `None` where the training alone says what is measured.
    fn measured(&self) -> Option<Measured> {
        None
    }

    /// Told what the measurement came to that was asked for: the mean of each metric; `None` where none was due.
    ///
    /// # Errors
    /// Where the training cannot be told.
    fn answer(&mut self, _means: Option<&BTreeMap<String, f64>>) -> Result<(), Error> {
        Ok(())
    }

    /// Takes up the policy that the training left, once it has ended.
    ///
    /// # Errors
    /// Where there is none, or it does not fit the environment.
    fn take_up(&mut self) -> Result<(), Error> {
        Ok(())
    }

    /// Tells the training to end, and waits until it has.
    fn stop(&mut self);

    /// The output of the training in this process; `None` where that is nothing.
    fn output(&self) -> Option<Vec<u8>> {
        None
    }
}
