//! The machine as the engine sees it: files, clocks, processes, and random names.
//!
//! No other module of the engine uses them directly. The released program gets those of the system directly; tests of
//! crashes and power losses replace them by a simulated machine.

pub mod clock;
pub mod fs;
pub mod process;
#[cfg(test)]
pub(crate) mod simulated;
