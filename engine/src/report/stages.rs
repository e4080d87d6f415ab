//! The graph of a study whose trials take from each other: entries, and what each takes.

use serde::Serialize;

/// An entry of a study: an agent, an entry of `prepare`, or a play.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Stage {
    /// Its name in the study.
    pub name: String,
    /// How many trials it has.
    pub trials: usize,
    /// Steps from the entries that take nothing: each stage stands below those that it takes from.
    pub depth: usize,
    /// What it takes, and from which entries.
    pub takes: Vec<Take>,
}

/// What an entry takes from another one.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub struct Take {
    /// The entry that leaves it.
    pub from: String,
    /// What is taken.
    pub product: String,
}
