//! The command line: the commands, their output, and the descriptions of the program for people.

mod commands;
pub mod describe;
pub mod first_study;
pub mod watch;

pub use commands::main;
