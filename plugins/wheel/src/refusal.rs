//! What can be refused, and which exception of Python says so.

use contract::Error;
use pyo3::{
    PyErr, create_exception,
    exceptions::{PyRuntimeError, PyValueError},
};

create_exception!(
    regimen,
    ConfigError,
    PyValueError,
    "A config that the registry refuses, in the words of `regimen check`."
);
create_exception!(
    regimen,
    ActionError,
    PyValueError,
    "An action outside its space: which entry, which value, which limit."
);
create_exception!(
    regimen,
    EpisodeError,
    PyRuntimeError,
    "A step without an episode under way, or an episode without a seed."
);
create_exception!(
    regimen,
    SimulationError,
    PyRuntimeError,
    "A model whose equations cannot be continued."
);

/// Why something was not done.
#[derive(Debug, thiserror::Error)]
pub enum Refusal {
    /// A config that does not pass the checks.
    #[error("{0}")]
    Config(String),
    /// A vector of actions of another length.
    #[error("{found} numbers of actions in place of {expected}")]
    Length {
        /// How many there are.
        found: usize,
        /// How many there must be.
        expected: usize,
    },
    /// A step where there is nothing to step.
    #[error("no episode is under way in environment {place}: call `reset`")]
    NoEpisode {
        /// Which of the environments side by side.
        place: usize,
    },
    /// An episode that is to go on with a random stream that never began.
    #[error("environment {place} was never given a seed: call `reset(seed=...)`")]
    NoSeed {
        /// Which of the environments side by side.
        place: usize,
    },
    /// A step that ended in a panic left the environments half stepped.
    #[error("an earlier step ended in a panic: make the environment anew")]
    Panicked,
    /// What the engine or an environment says.
    #[error(transparent)]
    Engine(#[from] Error),
}

impl From<Refusal> for PyErr {
    fn from(refusal: Refusal) -> Self {
        let text = refusal.to_string();
        match refusal {
            Refusal::Config(_)
            | Refusal::Engine(
                Error::Config { .. } | Error::Unavailable { .. } | Error::File { .. } | Error::Source { .. },
            ) => ConfigError::new_err(text),
            Refusal::Length { .. } | Refusal::Engine(Error::Action { .. }) => ActionError::new_err(text),
            Refusal::NoEpisode { .. } | Refusal::NoSeed { .. } | Refusal::Panicked => {
                EpisodeError::new_err(text)
            }
            Refusal::Engine(_) => SimulationError::new_err(text),
        }
    }
}
