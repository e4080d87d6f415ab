//! The program: the registry and the command line.

use std::process::ExitCode;

/// burn allocates and frees a tensor for every operation; this allocator nearly halves the time of a large
/// update.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> ExitCode {
    cli::main(plugins::registry)
}
