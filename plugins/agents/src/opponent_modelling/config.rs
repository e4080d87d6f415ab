//! Hyper-parameters that the algorithms with opponent models share. Their released code departs from the text in many of them.

use crate::joint::Sight;
use engine::Error;
use numerics::network::Activation;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The non-linearity of all hidden layers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Rectifier {
    /// `max(x, 0)`.
    #[default]
    Relu,
    /// `x` above zero, `0.01 x` below.
    LeakyRelu,
}

/// What the policy is given as the others' actions when it explores; where it is scored, it is given the mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ActingPrediction {
    /// The mean of the opponent model.
    #[default]
    Mean,
    /// A draw from the opponent model.
    Sample,
}

/// What networks, optimisers and the loop of updates need of a config.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Step size of Adam for every network.
    pub learning_rate: f64,
    /// Transitions per update, as many as there are where the buffer holds fewer.
    pub batch_size: usize,
    /// Discount gamma.
    pub discount: f64,
    /// Smoothing tau of the target critics.
    pub target_smoothing: f64,
    /// Updates of all seats per environment step.
    pub updates_per_step: f64,
    /// Environment steps before the first update.
    pub learning_starts: u64,
    /// Units of both hidden layers.
    pub width: usize,
    /// The activation of both hidden layers.
    pub activation: Activation,
    /// Whether networks see their inputs normalised by the batch.
    pub input_normalisation: bool,
    /// Whether rewards are standardised over the buffer.
    pub reward_normalisation: bool,
    /// Largest Euclidean norm of a network's gradient.
    pub gradient_clip: Option<f64>,
    /// Whether the policy takes a second step along its latest gradient after each update of the critic.
    pub stale_policy_step: bool,
    /// Transitions that the buffer holds.
    pub replay_capacity: usize,
    /// What policies, opponent models and priors see; critics see what all seats do.
    pub sight: Sight,
}

impl Rectifier {
    pub(crate) fn activation(self) -> Activation {
        match self {
            Rectifier::Relu => Activation::Relu,
            Rectifier::LeakyRelu => Activation::LeakyRelu,
        }
    }
}

impl Settings {
    /// Refuses batches of one row, which have no moments to be normalised by.
    ///
    /// # Errors
    /// [`Error::Config`].
    pub(super) fn check(&self) -> Result<(), Error> {
        if self.input_normalisation && (self.batch_size < 2 || self.learning_starts < 2) {
            let problem = "one transition has no moments to normalise by: take at least 2 for it and for `learning_starts`";
            return Err(Error::config("batch_size", problem));
        }
        Ok(())
    }
}

/// Declares the `Config` of an algorithm: its own keys, then those that all share, with `settings()` to read these.
macro_rules! opponent_config {
    ($(#[$about:meta])* critic_entropy_weight = $critic:literal; $($(#[$meta:meta])* $key:ident: $kind:ty = $default:expr,)*) => {
        $(#[$about])*
        #[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
        #[serde(deny_unknown_fields, default)]
        pub struct Config {
            $($(#[$meta])* pub $key: $kind,)*
            /// Weight alpha of the policy's entropy in its own objective.
            #[schemars(range(min = 0.0), extend("x-source" = "thesis, section 4.5; released code: 1"))]
            pub policy_entropy_weight: f64,
            /// Weight alpha of the entropy in the objective of the opponent models (of ROMMEO: of the policy's log density there).
            #[schemars(range(min = 0.0), extend("x-source" = "thesis, section 4.5; released code: 1"))]
            pub opponent_entropy_weight: f64,
            /// Weight alpha of the entropy in the critic's target.
            #[schemars(range(min = 0.0), extend("x-source" = "released code; thesis, section 4.5: 1"))]
            pub critic_entropy_weight: f64,
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
            #[schemars(extend("x-source" = "released code; thesis, section 4.5: leaky_relu"))]
            pub activation: crate::opponent_modelling::Rectifier,
            /// Normalise the inputs of every network by the moments of the batch, and by running ones where it acts.
            #[schemars(extend("x-source" = "released code; the thesis does not speak of it"))]
            pub input_normalisation: bool,
            /// Standardise the rewards of a batch by mean and deviation of the seat's rewards in the whole buffer.
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
            /// What policy, opponent models and prior of a seat see; null: what all seats observe.
            #[serde(skip_serializing_if = "Option::is_none")]
            #[schemars(extend("x-source" = "released code: what all seats observe; code of Tian et al. 2019: own"))]
            pub sight: Option<crate::joint::Sight>,
        }

        impl Default for Config {
            fn default() -> Self {
                Self {
                    $($key: $default,)*
                    policy_entropy_weight: 1.0,
                    opponent_entropy_weight: 1.0,
                    critic_entropy_weight: $critic,
                    learning_rate: 3e-4,
                    batch_size: 256,
                    discount: 0.95,
                    target_smoothing: 0.01,
                    updates_per_step: 1.0,
                    learning_starts: 256,
                    width: 256,
                    activation: crate::opponent_modelling::Rectifier::Relu,
                    input_normalisation: true,
                    reward_normalisation: true,
                    gradient_clip: Some(0.5),
                    stale_policy_step: true,
                    replay_capacity: 1_000_000,
                    // Absent from stored configs where it is not given, so that ids of earlier trials stay.
                    sight: None,
                }
            }
        }

        impl Config {
            fn shared(&self) -> crate::opponent_modelling::Settings {
                crate::opponent_modelling::Settings {
                    learning_rate: self.learning_rate,
                    batch_size: self.batch_size,
                    discount: self.discount,
                    target_smoothing: self.target_smoothing,
                    updates_per_step: self.updates_per_step,
                    learning_starts: self.learning_starts,
                    width: self.width,
                    activation: self.activation.activation(),
                    input_normalisation: self.input_normalisation,
                    reward_normalisation: self.reward_normalisation,
                    gradient_clip: self.gradient_clip,
                    stale_policy_step: self.stale_policy_step,
                    replay_capacity: self.replay_capacity,
                    sight: self.sight.unwrap_or(crate::joint::Sight::Joint),
                }
            }
        }
    };
}
pub(crate) use opponent_config;

/// A preset of settings that all algorithms share, with an algorithm's own keys on top.
pub(crate) fn preset(name: &'static str, about: &'static str, own: serde_json::Value) -> engine::Preset {
    let mut values = match name {
        "thesis" => thesis(),
        "differential_game" => differential_game(),
        _ => released_code(),
    };
    if let (Some(values), serde_json::Value::Object(own)) = (values.as_object_mut(), own) {
        values.extend(own);
    }
    engine::Preset { name, about, values }
}

/// Thesis, section 4.5: nothing that the text does not name.
fn thesis() -> serde_json::Value {
    serde_json::json!({
        "critic_entropy_weight": 1.0,
        "activation": "leaky_relu",
        "input_normalisation": false,
        "reward_normalisation": false,
        "gradient_clip": null,
        "stale_policy_step": false,
    })
}

/// What the released code trains the particle tasks with.
fn released_code() -> serde_json::Value {
    serde_json::json!({
        "learning_rate": 3e-4,
        "batch_size": 256,
        "width": 256,
        "learning_starts": 256,
        "activation": "relu",
        "input_normalisation": true,
        "reward_normalisation": true,
        "gradient_clip": 0.5,
        "stale_policy_step": true,
    })
}

/// What the released code trains the differential game with.
fn differential_game() -> serde_json::Value {
    let mut values = released_code();
    values["learning_rate"] = 0.01.into();
    values["batch_size"] = 512.into();
    values["width"] = 128.into();
    values["learning_starts"] = 16.into();
    values
}
