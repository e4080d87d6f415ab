//! How far a search is.

use super::Point;
use serde::{Deserialize, Serialize};

/// How far a search is.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Progress {
    /// The settings that are tried, in order.
    pub points: Vec<Point>,
    /// The step at which the trials of each pause; `None` for those that go to their ends.
    pub stops: Vec<Option<u64>>,
    /// For each the place of the one whose learning it goes on with; empty where none does.
    pub parents: Vec<Option<usize>>,
    /// The place of the one that was chosen.
    pub chosen: Option<usize>,
}
