//! Progress of a search.

use super::Point;
use serde::{Deserialize, Serialize};

/// Progress of a search.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Progress {
    /// The settings that are tried, in order.
    pub points: Vec<Point>,
    /// The step at which the trials of each pause; `None` for those that go to their ends.
    pub stops: Vec<Option<u64>>,
    /// For each the place of the setting whose learning it goes on with; empty where none does.
    pub parents: Vec<Option<usize>>,
    /// Place of the chosen setting; `None` before the choice.
    pub chosen: Option<usize>,
}
