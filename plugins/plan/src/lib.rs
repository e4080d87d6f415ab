//! Plans of operations: learners over flat buffers of numbers, built once per shape and executed many times.
//!
//! A [`Graph`] holds values, which are matrices `[rows, columns]`, and routines, which are lists of operations (act,
//! critic update, policy update). Routines share parameters and the state of optimisers; all other values belong to
//! the routine that computes them. [`Graph::gradients`] adds the operations of reverse mode. A [`Processor`]
//! executes a graph in `f32`, or in `f64` for tests of gradients.
//!
//! The results have the same bits on every processor: every operation is one of [`arithmetic`], or rounds each entry
//! of its result once per stated operation, and the order of every sum is stated.
//!
//! | module | contents |
//! |---|---|
//! | [`graph`] | the builder: leaves, routines, checks of shapes |
//! | [`operations`] | kinds of operations, and the result of each |
//! | [`build`] | the methods that add operations |
//! | [`gradients`] | reverse mode |
//! | [`updates`] | changes of parameters: Adam, moving averages, assignments; clipping of gradients |
//! | [`listing`] | a plan as text, its floating-point operations and its memory traffic |
//! | [`extension`] | operations that other crates compute |
//! | [`scalar`] | the arithmetic that an executor needs of `f32` or `f64` |
//! | [`processor`] | the executor on this processor |
//! | [`executor`] | executors that replace it |
//! | [`cuda`] | routines as kernels for a card |
//! | [`plans`] | processors by their number of rows |
//! | [`state`] | parameters, moments and step counts, apart from any plan |
//! | [`equations`] | the builder as equations with Rust's operators |
//! | [`differences`] | gradients against finite differences, for tests |
//!
//! One update of soft actor-critic (`examples/soft_actor_critic.rs`: two hidden layers of 256, a batch of 256) takes
//! 5.3 ms at best and 5.8 to 7.8 ms on average on one core of a Xeon with AVX-512 that other programs also use, 90 % of
//! it in products.
//!
//! A plan makes no data-dependent choices of operations. Its random numbers depend on the seed of the run, on the
//! draw's place in the routine and on the entry, but not on the number of rows.

mod bound;
pub mod build;
pub mod cuda;
pub mod differences;
mod dirichlet;
mod draws;
mod elsewhere;
pub mod equations;
pub mod executor;
pub mod extension;
mod fusion;
pub mod gradients;
pub mod graph;
mod kernels;
pub mod listing;
mod memory;
pub mod operations;
pub mod plans;
pub mod processor;
mod rows;
pub mod scalar;
pub mod state;
mod tensor;
pub mod updates;

pub use equations::{Descent, Equations, Expression};
pub use extension::{Backward, Extension};
pub use graph::{Graph, Number, Routine, Shape, Value};
pub use operations::Activation;
pub use plans::Plans;
pub use processor::{Processor, Work};
pub use state::{State, StateError};
pub use updates::Optimiser;

#[cfg(test)]
mod tests;
