//! Claims of a study: comparisons of agents' metrics.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A comparison that the results support, refute or leave open.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ClaimSpec {
    /// The comparison, such as `learner.return > rule.return`.
    pub claim: String,
    /// The environment it is about; each in turn where absent.
    pub environment: Option<String>,
    /// Which sentence of the source it stands for; empty where absent.
    pub about: String,
}
