//! The hyper-parameters of value decomposition, each with the source of its default.

use crate::shared::{
    scaling::ObservationScaling,
    seat_network::{HiddenLayers, check_batch},
};
use contract::{Error, Preset};
use numerics::activation::Activation;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::json;

/// Mixing of the seats' values into the value that is learned.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ValueMixing {
    /// None: every seat learns the value of its own choices from its own reward, and treats the others as a
    /// part of the environment (independent Q-learning).
    None,
    /// The sum of the seats' values (VDN).
    Sum,
    /// A network that grows in each value and reads the full state (QMIX).
    #[default]
    Monotonic,
}

/// Hyper-parameters. The defaults are those of QMIX where it states them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Mixing of the seats' values into the value that is learned.
    pub mixing: ValueMixing,
    /// Step size of Adam.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "Rashid et al. 2018, appendix C.1, of RMSprop"))]
    pub learning_rate: f64,
    /// Steps of all seats per update.
    #[schemars(range(min = 1, max = 65536), extend("x-source" = "own choice; Rashid et al. 2018: 32 episodes"))]
    pub batch_size: usize,
    /// Discount gamma.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "Rashid et al. 2018, appendix C.1"))]
    pub discount: f64,
    /// Smoothing tau of the target networks.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "own choice; Rashid et al. 2018: a copy every 200 episodes"))]
    pub target_smoothing: f64,
    /// Updates per environment step, all environments counted.
    #[schemars(range(min = 0.0, max = 64.0), extend("x-source" = "own choice; Rashid et al. 2018: one per episode"))]
    pub updates_per_step: f64,
    /// Units of each hidden layer of the seats' network.
    #[schemars(range(min = 1, max = 4096), extend("x-source" = "Rashid et al. 2018, appendix C.1"))]
    pub width: usize,
    /// Number of hidden layers of the seats' network.
    #[schemars(range(min = 1, max = 8), extend("x-source" = "own choice"))]
    pub hidden_layers: usize,
    /// Units of the hidden layer of the mixing network.
    #[schemars(range(min = 1, max = 1024), extend("x-source" = "Rashid et al. 2018, appendix C.1"))]
    pub mixing_width: usize,
    /// Steps of all seats that the replay buffer holds.
    #[schemars(range(min = 1, max = 100_000_000), extend("x-source" = "own choice; Rashid et al. 2018: 5000 episodes"))]
    pub replay_capacity: usize,
    /// Environment steps before the first update.
    #[schemars(range(min = 1), extend("x-source" = "own choice"))]
    pub learning_starts: u64,
    /// Largest Euclidean norm of a gradient, or null for no limit.
    #[schemars(range(min = 0.0), extend("x-source" = "authors' code: 10"))]
    pub gradient_clip: Option<f64>,
    /// Probability of a random choice of a seat at the first step.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "Rashid et al. 2018, appendix C.1"))]
    pub exploration: f64,
    /// Probability of a random choice of a seat at the end of its decline.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "Rashid et al. 2018, appendix C.1"))]
    pub final_exploration: f64,
    /// Environment steps of the linear decline of exploration; 0 starts with the final one.
    #[schemars(extend("x-source" = "Rashid et al. 2018, appendix C.1"))]
    pub exploration_steps: u64,
    /// Factor of all rewards, so that values are of order 1.
    #[schemars(range(min = 1e-9, max = 1e9), extend("x-source" = "own choice"))]
    pub reward_scale: f64,
    /// Scaling of observations and of the full state.
    pub observation_scaling: ObservationScaling,
    /// Weight by which the values of choices outside the data are held down against those in the data; 0 for
    /// none. It is for learning from datasets, where no experience corrects a choice that is overestimated
    /// and was never made.
    #[schemars(range(min = 0.0, max = 1e6), extend("x-source" = "Kumar et al. 2020, eq. 4, as alpha"))]
    #[serde(skip_serializing_if = "is_zero")]
    pub conservatism: f64,
}

/// Whether a key has its default 0 and is left out of stored configs.
#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

impl Default for Config {
    fn default() -> Self {
        Self {
            mixing: ValueMixing::default(),
            learning_rate: 5e-4,
            batch_size: 128,
            discount: 0.99,
            target_smoothing: 0.005,
            updates_per_step: 0.25,
            width: 64,
            hidden_layers: 2,
            mixing_width: 32,
            replay_capacity: 200_000,
            learning_starts: 1_000,
            gradient_clip: Some(10.0),
            exploration: 1.0,
            final_exploration: 0.05,
            exploration_steps: 50_000,
            reward_scale: 1.0,
            observation_scaling: ObservationScaling::Typical,
            conservatism: 0.0,
        }
    }
}

impl contract::Config for Config {
    fn presets() -> Vec<Preset> {
        let preset = |name, about, mixing| Preset {
            name,
            about,
            values: json!({ "mixing": mixing }),
        };
        vec![
            preset("qmix", "Rashid et al. 2018 (the defaults)", "monotonic"),
            preset("vdn", "Sunehag et al. 2018: the sum of the values", "sum"),
            preset(
                "independent",
                "Tan 1993, with deep networks: no mixing at all",
                "none",
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
        if self.final_exploration <= self.exploration {
            return Ok(());
        }
        let (end, start) = (self.final_exploration, self.exploration);
        let problem = format!("exploration declines, but {end} is above `exploration`, {start}");
        Err(Error::config("final_exploration", problem))
    }

    /// Probability of a random choice at a step: a straight line from the first to the final one.
    #[must_use]
    #[allow(clippy::cast_precision_loss, reason = "a number of steps is far below 2^52")]
    pub fn exploration_at(&self, step: u64) -> f64 {
        let gone = match self.exploration_steps {
            0 => 1.0,
            steps => (step as f64 / steps as f64).min(1.0),
        };
        self.exploration + gone * (self.final_exploration - self.exploration)
    }

    /// Size and activation of the hidden layers of the seats' network.
    #[must_use]
    pub fn hidden(&self) -> HiddenLayers {
        HiddenLayers {
            width: self.width,
            layers: self.hidden_layers,
            activation: Activation::Relu,
        }
    }
}
