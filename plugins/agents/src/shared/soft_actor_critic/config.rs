//! The hyper-parameters of soft actor-critic, each with the source of its default.

use crate::shared::{
    scaling::ObservationScaling,
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
    /// Step size of Adam for the policy.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "Haarnoja et al. 2018, table 1"))]
    pub actor_learning_rate: f64,
    /// Step size of Adam for both critics.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "Haarnoja et al. 2018, table 1"))]
    pub critic_learning_rate: f64,
    /// Rule for the weight alpha of the entropy.
    pub temperature: Temperature,
    /// Temperature before learning; a fixed temperature keeps it.
    #[schemars(range(min = 1e-9, max = 1e3), extend("x-source" = "Haarnoja et al. 2018, authors' code"))]
    pub first_temperature: f64,
    /// Step size of Adam for the logarithm of an automatic temperature.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "Haarnoja et al. 2018, table 1"))]
    pub temperature_learning_rate: f64,
    /// Entropy in nats that an automatic temperature steers to; null for minus the number of entries of an
    /// action.
    #[schemars(extend("x-source" = "Haarnoja et al. 2018, table 1: null"))]
    pub target_entropy: Option<f64>,
    /// Transitions per update.
    #[schemars(range(min = 1, max = 65536), extend("x-source" = "Haarnoja et al. 2018, table 1"))]
    pub batch_size: usize,
    /// Discount gamma.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "Haarnoja et al. 2018, table 1"))]
    pub discount: f64,
    /// Smoothing tau of the target critics.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "Haarnoja et al. 2018, table 1"))]
    pub target_smoothing: f64,
    /// Updates per environment step, all environments counted.
    #[schemars(range(min = 0.0, max = 64.0), extend("x-source" = "Haarnoja et al. 2018, table 1"))]
    pub updates_per_step: f64,
    /// Units of each hidden layer.
    #[schemars(range(min = 1, max = 4096), extend("x-source" = "Haarnoja et al. 2018, table 1"))]
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
    /// Environment steps before the first update; until then the untrained policy acts.
    #[schemars(range(min = 1), extend("x-source" = "Haarnoja et al. 2018, authors' code"))]
    pub learning_starts: u64,
    /// Largest Euclidean norm of a gradient, or null for no limit.
    #[schemars(range(min = 0.0))]
    pub gradient_clip: Option<f64>,
    /// Scaling of observations for the networks.
    pub observation_scaling: ObservationScaling,
}

/// Rule for the weight of the entropy.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Temperature {
    /// The temperature steers the policy to the target entropy.
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
            first_temperature: 1.0,
            temperature_learning_rate: 3e-4,
            target_entropy: None,
            batch_size: 256,
            discount: 0.99,
            target_smoothing: 0.005,
            updates_per_step: 1.0,
            width: 256,
            hidden_layers: 2,
            activation: Activation::Relu,
            replay_capacity: 1_000_000,
            learning_starts: 1_000,
            gradient_clip: None,
            observation_scaling: ObservationScaling::Typical,
        }
    }
}

impl contract::Config for Config {
    fn presets() -> Vec<Preset> {
        let haarnoja = json!({
            "actor_learning_rate": 3e-4, "critic_learning_rate": 3e-4, "temperature": "automatic",
            "first_temperature": 1.0, "temperature_learning_rate": 3e-4, "target_entropy": null,
            "batch_size": 256, "discount": 0.99, "target_smoothing": 0.005, "updates_per_step": 1.0,
            "width": 256, "hidden_layers": 2, "activation": "relu", "replay_capacity": 1_000_000,
            "observation_scaling": "none",
        });
        vec![Preset {
            name: "haarnoja",
            about: "Haarnoja et al. 2018, table 1, on observations as they are",
            values: haarnoja,
        }]
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
        Err(Error::config(
            "target_entropy",
            "a fixed temperature steers to no entropy; leave it out or set `temperature: automatic`",
        ))
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

    /// Constants of an update for actions of so many entries.
    #[must_use]
    #[allow(clippy::cast_precision_loss, reason = "a number of entries is far below 2^52")]
    pub fn settings(&self, n_acted: usize) -> Settings {
        let is_learned = self.temperature == Temperature::Automatic;
        Settings {
            actor_learning_rate: self.actor_learning_rate,
            critic_learning_rate: self.critic_learning_rate,
            temperature_learning_rate: is_learned.then_some(self.temperature_learning_rate),
            gradient_clip: self.gradient_clip,
            target_entropy: self.target_entropy.unwrap_or(-(n_acted as f64)),
            discount: self.discount,
            target_smoothing: self.target_smoothing,
        }
    }
}
