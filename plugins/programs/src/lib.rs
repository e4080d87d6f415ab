//! Programs in any language as trials: an agent that trains itself, and environments that only have a name.
//!
//! A trial of a program has a working folder of its own, which holds only the files that the study declares.
//! The program runs there under a guard of the engine; its metrics are read from its output and its files while
//! it runs.
//!
//! A trial's id holds everything that determines numbers: the words of the command with the parameters, the
//! content of sources, lock file and inputs, and the environment's values. Machine, folder and interpreter are
//! not part of it.

use contract::{AgentTraits, Feed};
mod agent;
mod checks;
mod config;
mod first;
mod lines;
mod link;
mod metric_errors;
mod metrics;
mod named;
mod output;
mod policy;
mod process;
mod variables;
mod words;
mod working_folder;

pub use config::ProgramConfig;
pub use named::NamedConfig;

/// Registers the agent `program`, the environment `named`, and first studies of programs.
pub fn register(registry: &mut contract::Registry) {
    registry.environment(
        "named",
        1,
        "a task that is only named: a program of your own knows it, and is told its values",
        named::build,
    );
    registry.agent(
        "program",
        1,
        "a program of your own, in any language, that trains and measures itself",
        AgentTraits {
            learns_from: vec![Feed::Decisions],
            trains_itself: true,
            ..AgentTraits::default()
        },
        agent::build,
    );
    registry.draft = Some(first::begin);
}
