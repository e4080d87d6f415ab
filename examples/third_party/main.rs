//! A program of somebody else: its own environment, agents and protocol beside the engine's, and everything
//! that `regimen` does with studies.
//!
//! ```text
//! third-party run examples/third_party/study.yaml --profile smoke
//! ```

mod episodes;
mod proportional;
mod thermostat;

use engine::Registry;
use std::process::ExitCode;

fn main() -> ExitCode {
    engine::cli::main(registry)
}

fn registry() -> Registry {
    let mut registry = Registry::default();
    protocols::register(&mut registry);
    thermostat::register(&mut registry);
    proportional::register(&mut registry);
    episodes::register(&mut registry);
    registry
}
