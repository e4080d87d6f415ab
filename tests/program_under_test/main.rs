//! The program that tests misuse: all plugins of `regimen`, an agent that misbehaves on request, and the hook that ends the
//! process at a boundary between two steps of writing. Built by `cargo test` alone; the program that people run has neither.

mod crash;
mod misbehaving;

use std::process::ExitCode;

fn main() -> ExitCode {
    crash::install();
    let mut registry = engine::Registry {
        numerics_version: numerics::VERSION,
        build: engine::Build::told(env!("REGIMEN_COMMIT"), env!("REGIMEN_CHANGED")),
        ..engine::Registry::default()
    };
    engine::protocol::register(&mut registry);
    environments::register(&mut registry);
    agents::register(&mut registry);
    misbehaving::register(&mut registry);
    engine::cli::main(&registry, include_str!("../../experiments/quickstart.yaml"))
}
