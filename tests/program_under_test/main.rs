//! The program that tests misuse: all plugins of `regimen`, an agent that misbehaves on request, and the hook
//! that ends the process at a boundary between two steps of writing. Built by `cargo test` alone; the program
//! that people run has neither.

mod crash;
mod misbehaving;

use std::process::ExitCode;

fn main() -> ExitCode {
    crash::install();
    let mut registry = plugins::registry();
    misbehaving::register(&mut registry);
    engine::cli::main(&registry, plugins::SELFTEST)
}
