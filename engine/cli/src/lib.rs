//! The command line: what each command does, what it prints, and what describes the program to a person.

mod commands;
pub mod describe;
pub mod first_study;
pub mod watch;

pub use commands::main;
