//! The hyper-parameters of the Dirichlet soft actor-critic, each with the source of its default.

use crate::shared::scaling::ObservationScaling;
use contract::{Artifact, Preset, artifact::Networks};
use numerics::dirichlet::entropy;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::json;

/// Hyper-parameters. The defaults are a setting that learns; `preset: thesis` has the printed values.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Step size of Adam for the policy.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "thesis, table 3.1"))]
    pub actor_learning_rate: f64,
    /// Step size of Adam for both critics.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "thesis, table 3.1"))]
    pub critic_learning_rate: f64,
    /// Step size of Adam for the logarithm of the temperature beta.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "own choice, the critics' rate"))]
    pub temperature_learning_rate: f64,
    /// Temperature beta before learning. The entropy of n shares is at most -ln (n - 1)!, which is below zero
    /// from three shares on. The entropy bonus is then a cost of every step, and a high temperature rewards
    /// an early end.
    #[schemars(range(min = 1e-9, max = 1e3), extend("x-source" = "pilot study"))]
    pub first_temperature: f64,
    /// Transitions per update.
    #[schemars(range(min = 1, max = 65536), extend("x-source" = "pilot study; thesis, table 3.1: 1024"))]
    pub batch_size: usize,
    /// Discount gamma.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "thesis, table 3.1"))]
    pub discount: f64,
    /// Smoothing tau of the target critics.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "thesis, table 3.1"))]
    pub target_smoothing: f64,
    /// Updates per environment step, all environments counted; below 1 for more data per update.
    #[schemars(range(min = 0.0, max = 64.0), extend("x-source" = "pilot study, 16 per 256 steps; thesis, \
                                                                  table 3.1: 1"))]
    pub updates_per_step: f64,
    /// Whether the networks are fully connected or treat assets alike.
    pub network: NetworkKind,
    /// Units of each hidden layer of policy and critics.
    #[schemars(range(min = 1, max = 4096), extend("x-source" = "thesis, section 3.4.5"))]
    pub width: usize,
    /// Number of hidden layers of a fully connected policy.
    #[schemars(range(min = 1, max = 8), extend("x-source" = "thesis, section 3.4.5"))]
    pub policy_layers: usize,
    /// Number of hidden layers of a fully connected critic.
    #[schemars(range(min = 1, max = 8), extend("x-source" = "thesis, section 3.4.5"))]
    pub critic_layers: usize,
    /// The temperature steers to the entropy of `Dirichlet(c, ..., c)` with this concentration c of each
    /// share.
    #[schemars(range(min = 1.0, max = 1e6), extend("x-source" = "pilot study"))]
    pub target_concentration: f64,
    /// Entropy that the temperature steers to, instead of that of a concentration.
    pub target_entropy: Option<TargetEntropy>,
    /// Transitions that the replay buffer holds.
    #[schemars(range(min = 1, max = 100_000_000), extend("x-source" = "Haarnoja et al. 2018, table 1"))]
    pub replay_capacity: usize,
    /// Environment steps before the first update; until then the untrained policy acts.
    #[schemars(range(min = 1), extend("x-source" = "pilot study"))]
    pub learning_starts: u64,
    /// Largest Euclidean norm of a gradient, or null for no limit.
    #[schemars(range(min = 0.0))]
    pub gradient_clip: Option<f64>,
    /// Action in evaluation.
    pub evaluation_action: EvaluationAction,
    /// Scaling of observations for the networks.
    pub observation_scaling: ObservationScaling,
    /// Scaling of actions for the critics.
    pub critic_action_scaling: ActionScaling,
    /// Take `beta (-log pi - target)` instead of `beta (-log pi)` as the bonus, so that it does not reward an
    /// early end.
    pub shifted_entropy_bonus: bool,
    /// Largest concentration of one share, or null for no limit.
    #[schemars(range(min = 1.0))]
    pub concentration_cap: Option<f64>,
    /// Permute the assets of a transition each time it is learned from: the shares, and the channels of
    /// assets before and after the step. The order is drawn at random. Experience with one asset thus trains
    /// the networks for all assets; the networks are unchanged.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub permute_assets: bool,
    /// Networks to begin from instead of new ones: policy, critics and temperature of another trial.
    /// Optimisers and replay are new.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub start: Option<Artifact<Networks>>,
}

/// Symmetry of the networks in the assets.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum NetworkKind {
    /// None: fully connected, as in the thesis.
    #[default]
    Dense,
    /// Assets are interchangeable: permuted assets get permuted shares.
    Equivariant,
}

/// Entropy that the temperature steers to.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum TargetEntropy {
    /// A number of nats.
    Nats(f64),
    /// Minus the square root of the number of shares, as printed in the thesis (table 3.1). For 4 shares it
    /// is nearly the largest entropy that a policy with concentrations of at least 1 can have, for 8 it is
    /// out of reach.
    MinusSqrtD,
}

/// Deterministic action of a Dirichlet distribution.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum EvaluationAction {
    /// `alpha / sum(alpha)`.
    #[default]
    Mean,
    /// `(alpha - 1) / sum(alpha - 1)`.
    Mode,
}

/// Scaling of actions for the critics.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ActionScaling {
    /// `N (a - 1 / N)`: zero for equal shares, of order 1 otherwise.
    Centred,
    /// Plain shares, as in the thesis.
    #[default]
    None,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            actor_learning_rate: 1e-4,
            critic_learning_rate: 3e-4,
            temperature_learning_rate: 3e-4,
            first_temperature: 0.1,
            batch_size: 256,
            discount: 0.99,
            target_smoothing: 0.005,
            updates_per_step: 0.0625,
            network: NetworkKind::Dense,
            width: 256,
            policy_layers: 3,
            critic_layers: 3,
            target_concentration: 30.0,
            target_entropy: None,
            replay_capacity: 1_000_000,
            learning_starts: 5_000,
            gradient_clip: None,
            evaluation_action: EvaluationAction::Mean,
            observation_scaling: ObservationScaling::Typical,
            critic_action_scaling: ActionScaling::None,
            shifted_entropy_bonus: false,
            concentration_cap: None,
            permute_assets: false,
            start: None,
        }
    }
}

impl contract::Config for Config {
    fn presets() -> Vec<Preset> {
        let values = json!({
            "batch_size": 1024,
            "target_entropy": "minus_sqrt_d",
            "updates_per_step": 1.0,
            "first_temperature": 1.0,
        });
        let about = "thesis, table 3.1, as printed; observations stay scaled, on which the text is silent";
        vec![Preset {
            name: "thesis",
            about,
            values,
        }]
    }
}

impl Config {
    /// Target entropy in nats for `n` shares.
    #[must_use]
    #[allow(clippy::cast_precision_loss, reason = "a number of shares is far below 2^52")]
    pub fn target_nats(&self, n: usize) -> f64 {
        match self.target_entropy {
            None => entropy(&vec![self.target_concentration; n]),
            Some(TargetEntropy::Nats(nats)) => nats,
            Some(TargetEntropy::MinusSqrtD) => -(n as f64).sqrt(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn targets_by_hand() {
        let concentration = |c: f64, n| {
            Config {
                target_concentration: c,
                ..Config::default()
            }
            .target_nats(n)
        };
        // The uniform distribution on the simplex of N shares has the density Gamma(N).
        assert!((concentration(1.0, 4) + 6f64.ln()).abs() < 1e-12);
        assert!((concentration(1.0, 8) + 5040f64.ln()).abs() < 1e-11);
        // Beta(2, 2) has the density 6 x (1 - x) and the entropy 5/3 - ln 6.
        assert!((concentration(2.0, 2) - (5.0 / 3.0 - 6f64.ln())).abs() < 1e-12);
        let entropy = |target| {
            Config {
                target_entropy: Some(target),
                ..Config::default()
            }
            .target_nats(4)
        };
        assert_eq!(entropy(TargetEntropy::MinusSqrtD), -2.0);
        assert_eq!(entropy(TargetEntropy::Nats(-3.5)), -3.5);
    }

    #[test]
    fn targets_are_written_as_words_or_maps() {
        let read = |text: &str| serde_json::from_str::<Config>(text);
        assert_eq!(
            read(r#"{"target_entropy": {"nats": -3}}"#)
                .unwrap()
                .target_entropy,
            Some(TargetEntropy::Nats(-3.0))
        );
        assert_eq!(
            read(r#"{"target_entropy": "minus_sqrt_d"}"#)
                .unwrap()
                .target_entropy,
            Some(TargetEntropy::MinusSqrtD)
        );
        assert!(read(r#"{"target_entropie": "minus_sqrt_d"}"#).is_err());
        let preset = &<Config as contract::Config>::presets()[0];
        assert_eq!(
            serde_json::from_value::<Config>(preset.values.clone())
                .unwrap()
                .batch_size,
            1024
        );
    }
}
