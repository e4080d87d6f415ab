//! The hyper-parameters of multi-agent deep deterministic policy gradient, each with the source of its
//! default.

use super::exploration::Noise;
use crate::shared::{
    joint::ObservationScope,
    seat_network::{HiddenLayers, check_batch},
};
use contract::{Error, Preset};
use numerics::activation::Activation;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::json;

/// Hyper-parameters. The defaults are those of the authors' code where it states them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Step size of Adam for the policies.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "Lowe et al. 2017, appendix; authors' code"))]
    pub actor_learning_rate: f64,
    /// Step size of Adam for the critics.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "Lowe et al. 2017, appendix; authors' code"))]
    pub critic_learning_rate: f64,
    /// Transitions per update and seat.
    #[schemars(range(min = 1, max = 65536), extend("x-source" = "own choice; Lowe et al. 2017, appendix: \
                                                                 1024"))]
    pub batch_size: usize,
    /// Discount gamma.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "Lowe et al. 2017, appendix"))]
    pub discount: f64,
    /// Smoothing tau of all target networks.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "Lowe et al. 2017, appendix"))]
    pub target_smoothing: f64,
    /// Updates of all seats per environment step, all environments counted.
    #[schemars(range(min = 0.0, max = 64.0), extend("x-source" = "own choice; Lowe et al. 2017, appendix: \
                                                                  one per 100 steps"))]
    pub updates_per_step: f64,
    /// Units of each hidden layer.
    #[schemars(range(min = 1, max = 4096), extend("x-source" = "Lowe et al. 2017, appendix"))]
    pub width: usize,
    /// Number of hidden layers of every network.
    #[schemars(range(min = 1, max = 8), extend("x-source" = "Lowe et al. 2017, appendix"))]
    pub hidden_layers: usize,
    /// Activation after each hidden layer.
    #[schemars(extend("x-source" = "Lowe et al. 2017, appendix"))]
    pub activation: Activation,
    /// Transitions that the replay buffer holds.
    #[schemars(range(min = 1, max = 100_000_000), extend("x-source" = "Lowe et al. 2017, appendix"))]
    pub replay_capacity: usize,
    /// Environment steps before the first update.
    #[schemars(range(min = 1), extend("x-source" = "own choice; authors' code: batches of 25 steps, 25600"))]
    pub learning_starts: u64,
    /// Largest Euclidean norm of a gradient, or null for no limit.
    #[schemars(range(min = 0.0), extend("x-source" = "authors' code"))]
    pub gradient_clip: Option<f64>,
    /// Observations that the policy of a seat sees.
    pub policy_sight: ObservationScope,
    /// Weight of the mean square of the inputs of tanh.
    #[schemars(range(min = 0.0, max = 1e3), extend("x-source" = "authors' code"))]
    pub logit_penalty: f64,
    /// Kind of the noise on the actions while training.
    pub exploration_noise: Noise,
    /// Standard deviation of the noise at the first step.
    #[schemars(range(min = 0.0, max = 10.0), extend("x-source" = "own choice"))]
    pub exploration_sd: f64,
    /// Standard deviation of the noise at the end of its decline.
    #[schemars(range(min = 0.0, max = 10.0), extend("x-source" = "own choice"))]
    pub final_exploration_sd: f64,
    /// Environment steps of the linear decline of the noise; 0 starts with the final deviation.
    #[schemars(extend("x-source" = "own choice"))]
    pub exploration_steps: u64,
    /// Standardise rewards by their mean and deviation over the whole buffer.
    pub reward_normalisation: bool,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            actor_learning_rate: 1e-2,
            critic_learning_rate: 1e-2,
            batch_size: 256,
            discount: 0.95,
            target_smoothing: 0.01,
            updates_per_step: 0.25,
            width: 64,
            hidden_layers: 2,
            activation: Activation::Relu,
            replay_capacity: 1_000_000,
            learning_starts: 1_000,
            gradient_clip: Some(0.5),
            policy_sight: ObservationScope::Own,
            logit_penalty: 1e-3,
            exploration_noise: Noise::Gaussian,
            exploration_sd: 0.5,
            final_exploration_sd: 0.1,
            exploration_steps: 20_000,
            reward_normalisation: false,
        }
    }
}

impl contract::Config for Config {
    fn presets() -> Vec<Preset> {
        let openai = json!({ "batch_size": 1024, "updates_per_step": 0.01, "learning_starts": 25_600 });
        let thesis = json!({
            "actor_learning_rate": 3e-4, "critic_learning_rate": 3e-4, "width": 256,
            "activation": "leaky_relu",
            "updates_per_step": 1.0, "learning_starts": 256, "gradient_clip": null, "policy_sight": "joint",
        });
        let mut released = thesis.clone();
        released["activation"] = json!("relu");
        released["gradient_clip"] = json!(0.5);
        released["reward_normalisation"] = json!(true);
        let mut game = released.clone();
        for rate in ["actor_learning_rate", "critic_learning_rate"] {
            game[rate] = json!(1e-2);
        }
        (game["width"], game["batch_size"], game["learning_starts"]) = (json!(128), json!(512), json!(16));
        game["exploration_steps"] = json!(1_000);
        let preset = |name, about, values| Preset { name, about, values };
        vec![
            preset(
                "openai",
                "the authors' code; continuous actions in the place of Gumbel-softmax",
                openai,
            ),
            preset(
                "thesis",
                "sizes and rates as printed in thesis, section 4.5, for its own algorithm",
                thesis,
            ),
            preset(
                "released_code",
                "sizes and rates of the thesis's code in the particle tasks",
                released,
            ),
            preset(
                "released_code_differential_game",
                "sizes and rates of the thesis's code in the differential game",
                game,
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
        if self.final_exploration_sd <= self.exploration_sd {
            return Ok(());
        }
        let (end, start) = (self.final_exploration_sd, self.exploration_sd);
        let problem = format!("the noise declines, but {end} is above `exploration_sd`, {start}");
        Err(Error::Config {
            key: "final_exploration_sd".into(),
            problem,
        })
    }

    /// Standard deviation of the noise at a step: a straight line from the first to the final one.
    #[must_use]
    #[allow(clippy::cast_precision_loss, reason = "a number of steps is far below 2^52")]
    pub fn exploration_sd_at(&self, step: u64) -> f64 {
        let left = 1.0 - (step as f64 / self.exploration_steps.max(1) as f64).min(1.0);
        let left = if self.exploration_steps == 0 { 0.0 } else { left };
        self.final_exploration_sd + left * (self.exploration_sd - self.final_exploration_sd)
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
