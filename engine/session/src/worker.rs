//! Processes that a run starts of the same program.

use crate::Failure;
use contract::{Registry, panics};
use document::{input_file, reach};
use execution::{guard, scheduler};
use std::process::ExitCode;

/// Serves where this process was started by a run: as the guard of a program, or as a worker that computes trials. A
/// program that opens a session asks this first, since a run starts the program itself again, once a core.
///
/// `None` where a person started it.
///
/// # Errors
/// A run that cannot be heard or answered any more.
#[expect(
    clippy::disallowed_methods,
    reason = "the run says by a variable how large files may be, as it was told"
)]
pub fn serve_if_asked(registry: impl FnOnce() -> Registry) -> Option<Result<ExitCode, Failure>> {
    // Once for every trial of a program, before anything is built.
    if let Some(code) = guard::serve_if_asked() {
        return Some(Ok(code));
    }
    if std::env::args_os().nth(1)? != scheduler::WORKER {
        return None;
    }
    panics::print_no_caught_ones();
    let size = std::env::var(input_file::VARIABLE).ok();
    size.and_then(|size| size.parse().ok())
        .into_iter()
        .for_each(input_file::allow);
    reach::quote_nothing();
    let input = std::io::BufReader::new(std::io::stdin());
    let served = scheduler::serve(&registry(), input, std::io::stdout());
    Some(served.map(|()| ExitCode::SUCCESS).map_err(Failure::from))
}
