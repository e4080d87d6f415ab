//! Reasons for a refusal, and the Python exceptions for them.

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

/// Reason why a call was refused.
#[derive(Debug, thiserror::Error)]
pub enum Refusal {
    /// A config that does not pass the checks.
    #[error("{0}")]
    Config(String),
    /// A vector of actions with a wrong length.
    #[error("{found} numbers of actions in place of {expected}")]
    Length {
        /// Length of the vector.
        found: usize,
        /// Required length.
        expected: usize,
    },
    /// A step of an environment without an episode in progress.
    #[error("no episode is under way in environment {place}: call `reset`")]
    NoEpisode {
        /// Number of the environment.
        place: usize,
    },
    /// A random stream that should continue but never began.
    #[error("environment {place} was never given a seed: call `reset(seed=...)`")]
    NoSeed {
        /// Number of the environment.
        place: usize,
    },
    /// A call after a panic, which left some environments stepped and others not.
    #[error("an earlier step ended in a panic: make the environment anew")]
    Panicked,
    /// An error of the engine or an environment.
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
