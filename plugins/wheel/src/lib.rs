//! The simulators as a Python package: `import regimen`.
//!
//! This crate is its extension module `regimen._native`, which builds environments with the program's registry and
//! steps them. The classes for Gymnasium and PettingZoo are plain Python, in `wheel/regimen/`.
//!
//! Numbers pass through the buffer protocol: actions are copied from an array into a vector, and results of a step from
//! a vector into an array. Python's lock is released in between, so its other threads continue.

mod config;
mod episodes;
mod layout;
mod refusal;
mod results;
mod simulation;
mod spaces;

use pyo3::prelude::*;

/// The module that Python imports.
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
