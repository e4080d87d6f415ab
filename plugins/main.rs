//! The program: a registry, the register calls, the command line.

use std::process::ExitCode;

/// burn allocates and frees a tensor for every operation; this allocator nearly halves the time of a large update.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> ExitCode {
    let mut registry = engine::Registry {
        numerics_version: numerics::VERSION,
        build: engine::Build::told(env!("REGIMEN_COMMIT"), env!("REGIMEN_CHANGED")),
        ..engine::Registry::default()
    };
    engine::protocol::register(&mut registry);
    environments::register(&mut registry);
    agents::register(&mut registry);
    engine::cli::main(&registry, include_str!("../experiments/quickstart.yaml"))
}
