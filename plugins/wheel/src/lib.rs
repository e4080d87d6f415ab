//! The simulators as a Python package: `import regimen`.
//!
//! This crate is the module `regimen._native` of it, which builds environments by the registry of the program and
//! steps them; the classes of Gymnasium and PettingZoo are plain Python, in `wheel/regimen/`.
//!
//! Numbers pass through the buffer protocol: actions are copied from an array into a vector, and what a step came
//! to from a vector into an array. In between Python's lock is released, so that its other threads go on.

mod config;
mod episodes;
mod layout;
mod refusal;
mod results;
mod simulation;
mod spaces;

use pyo3::prelude::*;

/// What Python imports.
#[pymodule]
mod _native {
    #[pymodule_export]
    use crate::{
        config::environments,
        refusal::{ActionError, ConfigError, EpisodeError, SimulationError},
        results::collect,
        simulation::Simulation,
    };
}
