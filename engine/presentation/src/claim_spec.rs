//! Claims of a study: comparisons of agents' metrics.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use statistics::estimators::mean;

/// The share of the range from floor to bound that matters, in every study without a reason for another.
const SHARE: f64 = 0.05;

/// The smallest difference that matters for claims without one of their own: a share of the range between an agent that
/// learned nothing and the best possible or known agent.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Relevance {
    /// The agent at the lower end of the range.
    #[schemars(extend("x-kind" = "agent"))]
    pub floor: String,
    /// The agent at the upper end.
    #[schemars(extend("x-kind" = "agent"))]
    pub bound: String,
    /// The share of the range that matters; a share other than 0.05 needs a reason.
    #[serde(default = "share")]
    #[schemars(range(max = 1.0), extend("exclusiveMinimum" = 0.0))]
    pub share: f64,
    /// The reason, from the field, for another share.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub why: String,
}

fn share() -> f64 {
    SHARE
}

impl Relevance {
    /// Whether the share differs from the usual one without a reason.
    pub(super) fn lacks_reason(&self) -> bool {
        #[allow(clippy::float_cmp, reason = "a constant, or another number")]
        let is_another = self.share != SHARE;
        is_another && self.why.trim().is_empty()
    }

    /// The smallest difference that matters, from the values of floor and bound; `None` if one of them has no value.
    #[must_use]
    pub fn margin(&self, values: &dyn Fn(&str) -> Option<Vec<f64>>) -> Option<f64> {
        let of = |agent: &str| {
            values(agent)
                .filter(|values| !values.is_empty())
                .map(|values| mean(&values))
        };
        let range = (of(&self.bound)? - of(&self.floor)?).abs();
        Some(self.share * range).filter(|margin| margin.is_finite() && *margin > 0.0)
    }
}

impl std::fmt::Display for Relevance {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self {
            floor, bound, share, ..
        } = self;
        write!(f, "{} % of the range from {floor} to {bound}", 100.0 * share)
    }
}

/// A claim alone, or with what is known of it besides.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum ClaimText {
    /// The comparison, such as `learner.return > rule.return`.
    Alone(String),
    /// The comparison with what is known of it besides.
    Long(ClaimSpec),
}

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
    /// The smallest difference between the two sides that matters, in their unit, of a claim with `>`, `>=`, `<`
    /// or `<=`. SUPPORTED then needs a larger one; a smaller one in the claimed direction is DIRECTION ONLY.
    /// Where the whole interval is smaller, the verdict is EQUIVALENT. Where absent, `relevance` says it, and any
    /// difference matters without.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub min_effect: Option<f64>,
    /// A choice that was made with the claim in view. That the claim holds then says nothing: CALIBRATED stands for
    /// SUPPORTED.
    #[serde(default)]
    pub calibrated_on: Option<String>,
    /// Attempts to find out why the claim is refuted; printed where it is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cause: Option<String>,
    /// True where it was thought of after results were seen; its verdict is counted apart.
    #[serde(default)]
    pub exploratory: bool,
}
