//! Claims of a study: comparisons of agents' metrics.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A comparison that the results support, refute or leave open.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ClaimSpec {
    /// The comparison, such as `learner.return > rule.return`.
    pub claim: String,
    /// The environment it is about; each in turn where absent.
    #[serde(default)]
    pub environment: Option<String>,
    /// Which sentence of the source it stands for; empty where absent.
    #[serde(default)]
    pub about: String,
    /// Why its margin or factor is what it is; empty where absent.
    #[serde(default)]
    pub why: String,
    /// The smallest difference between the two sides that matters, in their unit, of a claim with `>`, `>=`, `<` or `<=`.
    /// SUPPORTED then needs a larger one; a smaller one in the claimed direction is DIRECTION ONLY. Where the whole
    /// interval is smaller, the verdict is EQUIVALENT. Any difference matters where absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub matters: Option<f64>,
    /// What was chosen with the claim in view. That it holds then says nothing: CALIBRATED stands for SUPPORTED.
    #[serde(default)]
    pub calibrated_on: Option<String>,
    /// What was tried to find out why it is refuted; printed where it is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cause: Option<String>,
    /// True where it was thought of after results were seen; its verdict is counted apart.
    #[serde(default)]
    pub exploratory: bool,
}
