//! The machine as the engine sees it: files, clocks, processes, and names that nobody has.
//!
//! Nothing else in the engine names them. A program that people run gets those of the system, without anything in
//! between; tests of crashes and power losses put a simulated machine in their place.

pub mod clock;
pub mod fs;
pub mod process;
#[cfg(test)]
pub(crate) mod simulated;
