//! The program that tests misuse: all plugins of `regimen`, agents that misbehave on request, an environment
//! and a protocol that leave drawings, devices without a card, and the hook that ends the process at a boundary between two steps of
//! writing. Built by `cargo test` alone; the program that people run has none of them.

mod crash;
mod fickle;
mod literal;
mod misbehaving;
mod painter;

use std::process::ExitCode;

fn main() -> ExitCode {
    crash::install();
    cli::main(registry)
}

fn registry() -> contract::Registry {
    let mut registry = plugins::registry();
    misbehaving::register(&mut registry);
    fickle::register(&mut registry);
    literal::register(&mut registry);
    painter::register(&mut registry);
    registry
}
