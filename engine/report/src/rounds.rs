//! Verdicts over several rounds of seeds.

use serde::{Deserialize, Serialize};

/// The verdict of one round of seeds alone.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct RoundVerdict {
    /// The seeds, as in `100-115`.
    pub seeds: String,
    /// Word of the verdict.
    pub verdict: String,
    /// The value or difference, with its interval.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub value: String,
}

/// A claim or published value with several rounds of seeds.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct ConfirmedVerdict {
    /// The claim with its place, or the table with its cell.
    pub(super) about: String,
    /// The verdict of each round alone.
    pub(super) rounds: Vec<RoundVerdict>,
    /// The verdict of all rounds together.
    pub(super) all: RoundVerdict,
}
