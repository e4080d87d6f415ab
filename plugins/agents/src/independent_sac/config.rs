//! The hyper-parameters of independent soft actor-critic, each with the source of its default.

use crate::shared::{
    joint::ObservationScope,
    seat_network::{HiddenLayers, check_batch},
    soft_learner::Settings,
};
use contract::{Error, Preset};
use numerics::activation::Activation;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::json;

/// Hyper-parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Step size of Adam for the policies.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "Haarnoja et al. 2018, table 1"))]
    pub actor_learning_rate: f64,
    /// Step size of Adam for the critics.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "Haarnoja et al. 2018, table 1"))]
    pub critic_learning_rate: f64,
    /// Rule for the weight alpha of the entropy.
    pub temperature: Temperature,
    /// Temperature before learning; a fixed temperature keeps it.
    #[schemars(range(min = 1e-9, max = 1e3), extend("x-source" = "own choice"))]
    pub first_temperature: f64,
    /// Step size of Adam for the logarithm of an automatic temperature.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "Haarnoja et al. 2018, table 1"))]
    pub temperature_learning_rate: f64,
    /// Entropy in nats that an automatic temperature steers to; null for minus the number of entries of the
    /// seat's action.
    #[schemars(extend("x-source" = "Haarnoja et al. 2018, table 1"))]
    pub target_entropy: Option<f64>,
    /// Transitions per update and seat.
    #[schemars(range(min = 1, max = 65536), extend("x-source" = "Haarnoja et al. 2018, table 1"))]
    pub batch_size: usize,
    /// Discount gamma.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "as for the other agents of several seats"))]
    pub discount: f64,
    /// Smoothing tau of the target critics.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "as for the other agents of several seats"))]
    pub target_smoothing: f64,
    /// Updates of all seats per environment step, all environments counted.
    #[schemars(range(min = 0.0, max = 64.0), extend("x-source" = "own choice; Haarnoja et al. 2018, table \
                                                                  1: 1"))]
    pub updates_per_step: f64,
    /// Units of each hidden layer.
    #[schemars(range(min = 1, max = 4096), extend("x-source" = "own choice; Haarnoja et al. 2018, table 1: \
                                                                256"))]
    pub width: usize,
    /// Number of hidden layers of every network.
    #[schemars(range(min = 1, max = 8), extend("x-source" = "Haarnoja et al. 2018, table 1"))]
    pub hidden_layers: usize,
    /// Activation after each hidden layer.
    #[schemars(extend("x-source" = "Haarnoja et al. 2018, table 1"))]
    pub activation: Activation,
    /// Transitions that the replay buffer holds.
    #[schemars(range(min = 1, max = 100_000_000), extend("x-source" = "Haarnoja et al. 2018, table 1"))]
    pub replay_capacity: usize,
    /// Environment steps before the first update; until then the untrained policies act.
    #[schemars(range(min = 1), extend("x-source" = "own choice"))]
    pub learning_starts: u64,
    /// Largest Euclidean norm of a gradient, or null for no limit.
    #[schemars(range(min = 0.0))]
    pub gradient_clip: Option<f64>,
    /// Observations that policy and critics of a seat see.
    pub sight: ObservationScope,
    /// Standardise rewards by their mean and deviation over the whole buffer.
    pub reward_normalisation: bool,
}

/// Rule for the weight of the entropy.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Temperature {
    /// The temperature steers each seat to the target entropy.
    #[default]
    Automatic,
    /// The temperature keeps its first value.
    Fixed,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            actor_learning_rate: 3e-4,
            critic_learning_rate: 3e-4,
            temperature: Temperature::Automatic,
            first_temperature: 0.1,
            temperature_learning_rate: 3e-4,
            target_entropy: None,
            batch_size: 256,
            discount: 0.95,
            target_smoothing: 0.01,
            updates_per_step: 0.25,
            width: 128,
            hidden_layers: 2,
            activation: Activation::Relu,
            replay_capacity: 1_000_000,
            learning_starts: 1_000,
            gradient_clip: None,
            sight: ObservationScope::Own,
            reward_normalisation: false,
        }
    }
}

impl contract::Config for Config {
    fn presets() -> Vec<Preset> {
        let haarnoja = json!({
            "discount": 0.99, "target_smoothing": 0.005, "updates_per_step": 1.0, "width": 256,
            "first_temperature": 1.0,
        });
        let thesis = json!({
            "temperature": "fixed", "first_temperature": 1.0, "updates_per_step": 1.0, "width": 256,
            "activation": "leaky_relu", "learning_starts": 256, "sight": "joint",
        });
        let mut released = thesis.clone();
        released["activation"] = json!("relu");
        released["gradient_clip"] = json!(0.5);
        released["reward_normalisation"] = json!(true);
        let preset = |name, about, values| Preset { name, about, values };
        vec![
            preset(
                "haarnoja",
                "Haarnoja et al. 2018, table 1, for every seat",
                haarnoja,
            ),
            preset(
                "thesis",
                "sizes, rates and temperature as printed in thesis, section 4.5, for its own algorithm",
                thesis,
            ),
            preset(
                "released_code",
                "sizes, rates and rewards of the thesis's code in the particle tasks",
                released,
            ),
        ]
    }
}

impl Config {
    /// Refuses settings that contradict each other.
    ///
    /// # Errors
    /// [`Error::Config`] with the key.
    pub fn check(&self) -> Result<(), Error> {
        check_batch(self.batch_size, self.replay_capacity)?;
        if self.temperature == Temperature::Automatic || self.target_entropy.is_none() {
            return Ok(());
        }
        let problem =
            "a fixed temperature steers to no entropy; leave it out or set `temperature: automatic`".into();
        Err(Error::Config {
            key: "target_entropy".into(),
            problem,
        })
    }

    /// Target entropy in nats of a seat whose action has `n` entries.
    #[must_use]
    #[allow(clippy::cast_precision_loss, reason = "a number of entries is far below 2^52")]
    pub fn target_nats(&self, n: usize) -> f64 {
        self.target_entropy.unwrap_or(-(n as f64))
    }

    /// Constants of the updates of a seat whose action has `n` entries.
    #[must_use]
    pub fn settings(&self, n: usize) -> Settings {
        let learned = self.temperature == Temperature::Automatic;
        Settings {
            actor_learning_rate: self.actor_learning_rate,
            critic_learning_rate: self.critic_learning_rate,
            temperature_learning_rate: learned.then_some(self.temperature_learning_rate),
            gradient_clip: self.gradient_clip,
            target_entropy: self.target_nats(n),
            discount: self.discount,
            target_smoothing: self.target_smoothing,
        }
    }

    /// Size and activation of the hidden layers of every network.
    #[must_use]
    pub fn hidden(&self) -> HiddenLayers {
        HiddenLayers {
            width: self.width,
            layers: self.hidden_layers,
            activation: self.activation,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contradictions_are_named() {
        let problem = |config: Config| config.check().unwrap_err().to_string();
        assert!(
            problem(Config {
                replay_capacity: 9,
                ..Config::default()
            })
            .contains("`batch_size`")
        );
        let fixed = Config {
            temperature: Temperature::Fixed,
            target_entropy: Some(-1.0),
            ..Config::default()
        };
        assert!(problem(fixed).contains("`target_entropy`: a fixed temperature"));
        let presets = <Config as contract::Config>::presets();
        assert!(presets.iter().all(|p| {
            serde_json::from_value::<Config>(p.values.clone())
                .unwrap()
                .check()
                .is_ok()
        }));
    }

    #[test]
    fn the_target_entropy_is_minus_the_number_of_entries() {
        assert_eq!(Config::default().target_nats(3), -3.0);
        assert_eq!(
            Config {
                target_entropy: Some(-1.5),
                ..Config::default()
            }
            .target_nats(3),
            -1.5
        );
    }
}
