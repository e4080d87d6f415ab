//! Populations of learners on a graphics card: the learners of hundreds of trials train at once, each with the same
//! bits as a trial alone on a core.
//!
//! One process drives the card. Every trial has its own process, with its environment, its replay memory and its
//! limits, and asks the first process to run the routines of its learners. Waiting requests for the same routine become
//! one batch. No bit depends on the batch.
//!
//! | module | contents |
//! |---|---|
//! | [`backend`] | a device that holds states and runs batches |
//! | [`cohort`] | members whose states have one shape, and their memory |
//! | [`population`] | the thread that makes batches of requests |
//! | [`socket`] | requests of other processes |
//! | [`device`] | the card as a device of the engine |
//! | [`cuda`] | NVIDIA's cards |
//! | [`compiler`] | the compiler of kernels |
//! | [`literal`] | a processor that runs the text of the kernels, for tests |

pub mod backend;
pub mod cohort;
pub mod compiler;
pub mod cuda;
pub mod device;
pub mod literal;
pub mod population;
pub mod socket;

pub use device::register;

#[cfg(test)]
mod tests;
