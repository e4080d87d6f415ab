//! The engine as a library for other programs.
//!
//! A plugin needs the contract, which is exported here at the root: [`Environment`], [`Agent`], [`Protocol`] and their
//! parts. Kinds of tables and figures build on [`presentation`] and [`analysis`], executors on [`execution`]. A program
//! enters its plugins into a [`Registry`] and passes it to [`cli::main`], or runs studies itself with
//! [`session::Session`].
//!
//! Data flows one way through the crates of the engine:
//!
//! ```text
//! document -> contract -> statistics -> analysis -> presentation -> study -> report -> session -> cli
//!                      -> execution  -> imported -^
//! ```

pub use ::{analysis, cli, execution, presentation, session};
pub use contract::*;
