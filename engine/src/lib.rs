//! The engine for programs of others.
//!
//! A plugin needs the contract, which stands here at the root: [`Environment`], [`Agent`], [`Protocol`] and what they
//! are made of. Kinds of tables and figures stand on [`presentation`] and [`analysis`], executors on
//! [`execution`]. A program enters its plugins into a [`Registry`] and hands it to [`cli::main`], or runs
//! studies itself by [`session::Session`].
//!
//! Data flows one way through the crates of the engine:
//!
//! ```text
//! document -> contract -> statistics -> analysis -> presentation -> study -> report -> session -> cli
//!                      -> execution  -> imported -^
//! ```

pub use ::{analysis, cli, execution, presentation, session};
pub use contract::*;
