//! Progress of a search.

use super::Point;
use serde::{Deserialize, Serialize};

/// Progress of a search.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Progress {
    /// The settings that are tried, in order.
    pub points: Vec<Point>,
    /// The step at which the trials of each pause; `None` for those that run to their ends.
    pub stops: Vec<Option<u64>>,
    /// For each setting, the place of the one whose learning it continues; empty if none does.
    pub parents: Vec<Option<usize>>,
    /// Place of the chosen setting; `None` before the choice.
    pub chosen: Option<usize>,
}
