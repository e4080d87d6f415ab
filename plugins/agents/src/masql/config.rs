//! The hyper-parameters of multi-agent soft Q-learning, each with the source of its default.

use crate::shared::{
    joint::ObservationScope,
    seat_network::{HiddenLayers, check_batch},
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
    /// Step size of Adam for the samplers.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "own choice; code of Tian et al. 2019: \
                                                                 3e-4"))]
    pub actor_learning_rate: f64,
    /// Step size of Adam for the critics.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "own choice; code of Tian et al. 2019: \
                                                                 3e-4"))]
    pub critic_learning_rate: f64,
    /// Transitions per update and seat.
    #[schemars(range(min = 1, max = 65536), extend("x-source" = "own choice; code of Tian et al. 2019: 512"))]
    pub batch_size: usize,
    /// Discount gamma.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "thesis's code; code of Tian et al. 2019: \
                                                                 0.99"))]
    pub discount: f64,
    /// Smoothing tau of the target critics.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "code of Tian et al. 2019"))]
    pub target_smoothing: f64,
    /// Updates between two moves of the target critics.
    #[schemars(range(min = 1, max = 1_000_000), extend("x-source" = "own choice; code of Tian et al. 2019: \
                                                                     10"))]
    pub target_period: u64,
    /// Updates of all seats per environment step, all environments counted.
    #[schemars(range(min = 0.0, max = 64.0), extend("x-source" = "own choice; code of Tian et al. 2019: 1"))]
    pub updates_per_step: f64,
    /// Units of each hidden layer.
    #[schemars(range(min = 1, max = 4096), extend("x-source" = "code of Tian et al. 2019"))]
    pub width: usize,
    /// Number of hidden layers of every network.
    #[schemars(range(min = 1, max = 8), extend("x-source" = "code of Tian et al. 2019"))]
    pub hidden_layers: usize,
    /// Activation after each hidden layer.
    #[schemars(extend("x-source" = "code of Tian et al. 2019"))]
    pub activation: Activation,
    /// Transitions that the replay buffer holds.
    #[schemars(range(min = 1, max = 100_000_000), extend("x-source" = "code of Tian et al. 2019"))]
    pub replay_capacity: usize,
    /// Environment steps before the first update.
    #[schemars(range(min = 1), extend("x-source" = "code of Tian et al. 2019"))]
    pub learning_starts: u64,
    /// Largest Euclidean norm of a gradient, or null for no limit.
    #[schemars(range(min = 0.0))]
    pub gradient_clip: Option<f64>,
    /// Observations that sampler and critic of a seat see.
    pub sight: ObservationScope,
    /// Joint actions drawn uniformly for the value of a next observation.
    #[schemars(range(min = 1, max = 4096), extend("x-source" = "code of Tian et al. 2019"))]
    pub value_particles: usize,
    /// Joint actions drawn by the sampler in an update.
    #[schemars(range(min = 3, max = 4096), extend("x-source" = "code of Tian et al. 2019"))]
    pub kernel_particles: usize,
    /// Number of these particles that move; the others are held.
    #[schemars(range(min = 1, max = 4096), extend("x-source" = "code of Tian et al. 2019: half"))]
    pub moved_particles: usize,
    /// Final temperature alpha of the schedule.
    #[schemars(range(min = 1e-9, max = 1e6), extend("x-source" = "code of Tian et al. 2019"))]
    pub final_temperature: f64,
    /// Excess of the first temperature over the final one.
    #[schemars(range(min = 0.0, max = 1e6), extend("x-source" = "own choice; code of Tian et al. 2019: 500"))]
    pub excess_temperature: f64,
    /// Rate of the exponential decline of the temperature, per environment step.
    #[schemars(range(min = 0.0, max = 1e3), extend("x-source" = "own choice; code of Tian et al. 2019: 0.1"))]
    pub temperature_decline: f64,
    /// Environment steps before the decline.
    #[schemars(extend("x-source" = "code of Tian et al. 2019"))]
    pub temperature_delay: u64,
    /// Action in evaluation.
    pub evaluation_action: EvaluationAction,
    /// Standardise rewards by their mean and deviation over the whole buffer.
    pub reward_normalisation: bool,
}

/// Action of a sampler in evaluation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum EvaluationAction {
    /// The own part of the draw with the largest value by the critic, among `value_particles` draws.
    #[default]
    BestOfDraws,
    /// The own part of one draw, as in training.
    Draw,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            actor_learning_rate: 1e-3,
            critic_learning_rate: 1e-3,
            batch_size: 256,
            discount: 0.95,
            target_smoothing: 0.01,
            target_period: 1,
            updates_per_step: 0.25,
            width: 100,
            hidden_layers: 2,
            activation: Activation::Relu,
            replay_capacity: 1_000_000,
            learning_starts: 1_000,
            gradient_clip: None,
            sight: ObservationScope::Own,
            value_particles: 16,
            kernel_particles: 32,
            moved_particles: 16,
            final_temperature: 0.1,
            excess_temperature: 10.0,
            temperature_decline: 1e-3,
            temperature_delay: 10,
            evaluation_action: EvaluationAction::BestOfDraws,
            reward_normalisation: false,
        }
    }
}

impl contract::Config for Config {
    fn presets() -> Vec<Preset> {
        let rommeo = json!({
            "actor_learning_rate": 3e-4, "critic_learning_rate": 3e-4, "batch_size": 512, "discount": 0.99,
            "target_period": 10, "updates_per_step": 1.0, "excess_temperature": 500.0,
            "temperature_decline": 0.1,
            "evaluation_action": "draw",
        });
        let thesis = json!({
            "actor_learning_rate": 3e-4, "critic_learning_rate": 3e-4, "width": 256,
            "activation": "leaky_relu",
            "updates_per_step": 1.0, "learning_starts": 256, "sight": "joint", "final_temperature": 1.0,
            "excess_temperature": 0.0,
        });
        let about =
            "sizes, rates and temperature as printed in the thesis, section 4.5, for its own algorithm";
        vec![
            Preset {
                name: "rommeo_paper",
                about: "Tian et al. 2019, the authors' code for its baseline",
                values: rommeo,
            },
            Preset {
                name: "thesis",
                about,
                values: thesis,
            },
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
        let (all, moved) = (self.kernel_particles, self.moved_particles);
        if moved >= 1 && moved + 2 <= all {
            return Ok(());
        }
        let problem = format!(
            "of `kernel_particles`, {all}, at least 1 has to move and 2 have to be held; {moved} moved \
             leaves {}",
            all.saturating_sub(moved)
        );
        Err(Error::Config {
            key: "moved_particles".into(),
            problem,
        })
    }

    /// Number of held particles in an update.
    #[must_use]
    pub fn n_held(&self) -> usize {
        self.kernel_particles - self.moved_particles
    }

    /// `alpha(t) = final + excess exp(-decline max(t - delay, 0))`.
    #[must_use]
    #[allow(clippy::cast_precision_loss, reason = "a number of steps is far below 2^52")]
    pub fn temperature_at(&self, step: u64) -> f64 {
        let declining = step.saturating_sub(self.temperature_delay) as f64;
        self.final_temperature + self.excess_temperature * (-self.temperature_decline * declining).exp()
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
    fn the_temperature_declines() {
        let preset = <Config as contract::Config>::presets().remove(0);
        let paper: Config = serde_json::from_value(preset.values).unwrap();
        assert!(
            (paper.temperature_at(0) - 500.1).abs() < 1e-9 && (paper.temperature_at(10) - 500.1).abs() < 1e-9
        );
        assert!((paper.temperature_at(20) - (0.1 + 500.0 / std::f64::consts::E)).abs() < 1e-9);
        assert!((paper.temperature_at(1_000) - 0.1).abs() < 1e-9);
    }

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
        let text = problem(Config {
            kernel_particles: 16,
            ..Config::default()
        });
        assert!(
            text.contains("`moved_particles`") && text.contains("16 moved leaves 0"),
            "{text}"
        );
        let presets = <Config as contract::Config>::presets();
        assert!(presets.iter().all(|p| {
            serde_json::from_value::<Config>(p.values.clone())
                .unwrap()
                .check()
                .is_ok()
        }));
    }
}
