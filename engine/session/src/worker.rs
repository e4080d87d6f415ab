//! Processes of the same program that a run starts.

use crate::Failure;
use contract::{Registry, panics};
use document::{input_file, reach};
use execution::{device, guard, scheduler};
use std::process::ExitCode;

/// Serves if a run started this process: as the guard of a program, as the process of a device, or as a worker that
/// computes trials. A program that opens a session calls this first, because a run starts the program itself again,
/// once for each core.
///
/// `None` if a person started it.
///
/// # Errors
/// Fails if the run can no longer be reached.
#[expect(
    clippy::disallowed_methods,
    reason = "the run says by variables how large files may be, and where its device is"
)]
pub fn serve_if_asked(registry: impl FnOnce() -> Registry) -> Option<Result<ExitCode, Failure>> {
    // Guards run once for every trial of a program, so they are served before anything is built.
    if let Some(code) = guard::serve_if_asked() {
        return Some(Ok(code));
    }
    let mut arguments = std::env::args_os().skip(1);
    let word = arguments.next()?;
    if word == device::SERVER {
        let name = arguments.next().unwrap_or_default();
        let served = device::serve(&registry(), &name.to_string_lossy(), std::io::stdin());
        return Some(served.map(|()| ExitCode::SUCCESS).map_err(Failure::from));
    }
    if word != scheduler::WORKER {
        return None;
    }
    panics::print_no_caught_ones();
    let size = std::env::var(input_file::VARIABLE).ok();
    size.and_then(|size| size.parse().ok())
        .into_iter()
        .for_each(input_file::allow);
    reach::quote_nothing();
    let input = std::io::BufReader::new(std::io::stdin());
    let registry = registry();
    let device = std::env::var(device::VARIABLE).ok();
    let device = device
        .map(|address| device::connect(&registry, &address))
        .transpose();
    let served =
        device.and_then(|device| scheduler::serve(&registry, device.as_ref(), input, std::io::stdout()));
    Some(served.map(|()| ExitCode::SUCCESS).map_err(Failure::from))
}
