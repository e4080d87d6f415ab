//! Hyper-parameters of all algorithms with opponent models. Their released code departs from the text in many
//! of them.

use super::super::joint::ObservationScope;
use contract::{Error, Preset};
use numerics::activation::Activation;
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

/// Actions of the others that the policy is given when it explores. In evaluation it is given the mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ActingPrediction {
    /// The mean of the opponent model.
    #[default]
    Mean,
    /// A draw from the opponent model.
    Sample,
}

/// Hyper-parameters of networks, optimisers and the loop of updates. A config holds them among its own keys
/// (`flatten`).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Settings {
    /// Weight alpha of the policy's entropy in its own objective.
    #[schemars(range(min = 0.0), extend("x-source" = "thesis, section 4.5; released code: 1"))]
    pub policy_entropy_weight: f64,
    /// Weight alpha of the entropy in the objective of the opponent models (of ROMMEO: of the policy's log
    /// density there).
    #[schemars(range(min = 0.0), extend("x-source" = "thesis, section 4.5; released code: 1"))]
    pub opponent_entropy_weight: f64,
    /// Step size of Adam for every network.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "thesis, section 4.5"))]
    pub learning_rate: f64,
    /// Transitions per update of a seat; all that are stored where they are fewer.
    #[schemars(range(min = 1, max = 65536), extend("x-source" = "thesis, section 4.5"))]
    pub batch_size: usize,
    /// Discount gamma.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "thesis, section 4.5"))]
    pub discount: f64,
    /// Smoothing tau of the target critics.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "thesis, section 4.5"))]
    pub target_smoothing: f64,
    /// Updates of all seats per environment step, all environments counted.
    #[schemars(range(min = 0.0, max = 64.0), extend("x-source" = "released code"))]
    pub updates_per_step: f64,
    /// Environment steps before the first update.
    #[schemars(range(min = 1), extend("x-source" = "released code"))]
    pub learning_starts: u64,
    /// Units of both hidden layers of every network.
    #[schemars(range(min = 1, max = 4096), extend("x-source" = "thesis, section 4.5"))]
    pub width: usize,
    /// Activation of the hidden layers of every network.
    #[schemars(schema_with = "rectifiers", extend("x-source" = "released code; thesis, section 4.5: \
                                                                leaky_relu"))]
    pub activation: Activation,
    /// Normalise the inputs of every network: by the moments of the batch in training, by running moments
    /// where the network acts.
    #[schemars(extend("x-source" = "released code; the thesis does not speak of it"))]
    pub input_normalisation: bool,
    /// Standardise the rewards of a batch by the mean and deviation of the seat's rewards in the whole
    /// buffer.
    #[schemars(extend("x-source" = "released code; the thesis does not speak of it"))]
    pub reward_normalisation: bool,
    /// Largest Euclidean norm of the gradient of each network, or null for no limit.
    #[schemars(range(min = 0.0), extend("x-source" = "released code; the thesis does not speak of it"))]
    pub gradient_clip: Option<f64>,
    /// Let the policy take a second step along its latest gradient after each update of the critic.
    #[schemars(extend("x-source" = "released code, most likely by accident"))]
    pub stale_policy_step: bool,
    /// Transitions that the replay buffer holds.
    #[schemars(range(min = 1, max = 100_000_000), extend("x-source" = "released code"))]
    pub replay_capacity: usize,
    /// Observations that policy, opponent models and prior of a seat see; null for those of all seats.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-source" = "released code: what all seats observe; code of Tian et al. 2019: own"))]
    pub sight: Option<ObservationScope>,
}

/// The settings of the released code in the particle tasks.
impl Default for Settings {
    fn default() -> Self {
        Self {
            policy_entropy_weight: 1.0,
            opponent_entropy_weight: 1.0,
            learning_rate: 3e-4,
            batch_size: 256,
            discount: 0.95,
            target_smoothing: 0.01,
            updates_per_step: 1.0,
            learning_starts: 256,
            width: 256,
            activation: Activation::Relu,
            input_normalisation: true,
            reward_normalisation: true,
            gradient_clip: Some(0.5),
            stale_policy_step: true,
            replay_capacity: 1_000_000,
            // Absent from stored configs where it is not set, so that the ids of earlier trials stay.
            sight: None,
        }
    }
}

/// The rectifiers among the activations: neither the text nor the code has networks with the tangent.
fn rectifiers(generator: &mut SchemaGenerator) -> Schema {
    let mut schema = Activation::json_schema(generator);
    if let Some(Value::Array(kinds)) = schema.get_mut("oneOf") {
        kinds.retain(|kind| kind["const"] != "tanh");
    }
    schema
}

impl Settings {
    /// Observations that policies, opponent models and priors see; critics see those of all seats.
    #[must_use]
    pub fn sight(&self) -> ObservationScope {
        self.sight.unwrap_or(ObservationScope::Joint)
    }

    /// Refuses batches of one row, which have no moments to normalise by.
    ///
    /// # Errors
    /// [`Error::Config`] for such a batch size.
    pub(super) fn check(&self) -> Result<(), Error> {
        if self.input_normalisation && (self.batch_size < 2 || self.learning_starts < 2) {
            let problem = "one transition has no moments to normalise by: take at least 2 for it and for \
                           `learning_starts`";
            return Err(Error::config("batch_size", problem));
        }
        Ok(())
    }
}

/// Source of the settings that all algorithms share.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Origin {
    /// Thesis, section 4.5, without anything that the text does not name.
    Text,
    /// Released code, for the particle tasks.
    ParticleCode,
    /// Released code, for the differential game.
    GameCode,
}

impl Origin {
    /// Builds a preset of these settings, with an algorithm's own keys on top.
    #[must_use]
    pub fn preset(self, name: &'static str, about: &'static str, own: Value) -> Preset {
        let mut values = self.values();
        if let (Some(values), Value::Object(own)) = (values.as_object_mut(), own) {
            values.extend(own);
        }
        Preset { name, about, values }
    }

    fn values(self) -> Value {
        match self {
            Self::Text => json!({
                "critic_entropy_weight": 1.0,
                "activation": "leaky_relu",
                "input_normalisation": false,
                "reward_normalisation": false,
                "gradient_clip": null,
                "stale_policy_step": false,
            }),
            Self::ParticleCode => released_code(3e-4, 256, 256, 256),
            Self::GameCode => released_code(0.01, 512, 128, 16),
        }
    }
}

fn released_code(learning_rate: f64, batch_size: usize, width: usize, learning_starts: u64) -> Value {
    json!({
        "learning_rate": learning_rate,
        "batch_size": batch_size,
        "width": width,
        "learning_starts": learning_starts,
        "activation": "relu",
        "input_normalisation": true,
        "reward_normalisation": true,
        "gradient_clip": 0.5,
        "stale_policy_step": true,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn networks_have_rectifiers_alone() {
        let schema = schemars::schema_for!(Settings).to_value();
        let kinds = schema["properties"]["activation"]["oneOf"].as_array().unwrap();
        let names: Vec<_> = kinds.iter().map(|kind| kind["const"].as_str().unwrap()).collect();
        assert_eq!(names, ["relu", "leaky_relu"]);
    }

    #[test]
    fn a_batch_of_one_is_refused_where_inputs_are_normalised() {
        let one = Settings {
            batch_size: 1,
            ..Settings::default()
        };
        assert!(
            one.check()
                .unwrap_err()
                .to_string()
                .contains("`batch_size`: one transition")
        );
        assert!(
            Settings {
                input_normalisation: false,
                ..one
            }
            .check()
            .is_ok()
        );
    }
}
