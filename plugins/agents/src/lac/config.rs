//! The hyper-parameters of the Lyapunov actor-critics, each with the source of its default.

use crate::shared::{scaling::ObservationScaling, seat_network::check_batch};
use contract::{Error, Preset};
use numerics::activation::Activation;
use plan::Expression;
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};
use std::borrow::Cow;

/// Hyper-parameters of `lac`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Step size of Adam for the policy.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "thesis, table 2.1"))]
    pub actor_learning_rate: f64,
    /// Step size of Adam for the Lyapunov critic.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "thesis, table 2.1"))]
    pub lyapunov_learning_rate: f64,
    /// Step size of Adam for the logarithm of the multiplier lambda.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "Han et al. 2020, authors' code: that of \
                                                                 the policy; released code: a tenth of it"))]
    pub multiplier_learning_rate: f64,
    /// Step size of Adam for the logarithm of the temperature beta.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "Han et al. 2020, authors' code: that of \
                                                                 the policy"))]
    pub temperature_learning_rate: f64,
    /// Environment steps, all environments counted, over which every learning rate declines linearly to 0;
    /// null keeps them.
    #[schemars(range(min = 1), extend("x-unit" = "steps", "x-source" = "thesis: none told; released code: \
                                                                        all of its 5e6 steps"))]
    pub decline_steps: Option<u64>,
    /// Transitions per update.
    #[schemars(range(min = 1, max = 65536), extend("x-source" = "thesis, table 2.1"))]
    pub batch_size: usize,
    /// Discount gamma.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "thesis, table 2.1; released code: 0.995"))]
    pub discount: f64,
    /// Smoothing tau of the target critic and the target policy.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "thesis, table 2.1"))]
    pub target_smoothing: f64,
    /// Share of the cost by which the Lyapunov value has to fall at each step, alpha_3.
    #[schemars(range(min = 0.0, max = 1e3), extend("x-source" = "thesis, table 2.1"))]
    pub decrease: f64,
    /// Multiplier lambda before learning; it counts as at most 1.
    #[schemars(range(min = 1e-9, max = 1.0), extend("x-source" = "thesis, table 2.1; released code: 1"))]
    pub first_multiplier: f64,
    /// Temperature beta before learning.
    #[schemars(range(min = 1e-9, max = 1e3), extend("x-source" = "thesis, table 2.1"))]
    pub first_temperature: f64,
    /// Entropy in nats that the temperature steers to; null for minus the number of entries of an action.
    #[schemars(extend("x-source" = "thesis, table 2.1: null"))]
    pub target_entropy: Option<f64>,
    /// Weight alpha of the distance between the deterministic actions of a state and its predecessor; 0
    /// leaves it out and makes the algorithm LAC.
    #[schemars(range(min = 0.0, max = 1e6), extend("x-source" = "thesis, eq. 2.10, without a value; \
                                                                 released code: 0.5 for CLAC"))]
    pub smoothness: f64,
    /// Norm of the differences between neighbouring actions of a batch.
    #[schemars(extend("x-source" = "thesis, eq. 2.10; released code: frobenius"))]
    pub smoothness_norm: SmoothnessNorm,
    /// Units of each hidden layer.
    #[schemars(range(min = 1, max = 4096), extend("x-source" = "thesis, section 2.4.1"))]
    pub width: usize,
    /// Number of hidden layers of policy and Lyapunov critic.
    #[schemars(range(min = 1, max = 8), extend("x-source" = "thesis, section 2.4.1; released code: 3"))]
    pub hidden_layers: usize,
    /// Activation after each hidden layer.
    #[schemars(extend("x-source" = "thesis, section 2.4.1"))]
    pub activation: Activation,
    /// Smallest logarithm of the policy's standard deviation.
    #[schemars(range(min = -20.0, max = 2.0), extend("x-source" = "Han et al. 2020, authors' code; released \
                                                                   code: -2"))]
    pub log_sd_low: f64,
    /// Largest logarithm of the policy's standard deviation.
    #[schemars(range(min = -20.0, max = 2.0), extend("x-source" = "Han et al. 2020, authors' code; released \
                                                                   code: 1"))]
    pub log_sd_high: f64,
    /// Whether a value still follows the last step of an episode that was cut off.
    #[schemars(extend("x-source" = "own choice; released code: false"))]
    pub bootstrap_at_time_limit: bool,
    /// Standard deviation of the noise that is added to scaled observations while exploring; stored
    /// observations have none.
    #[schemars(range(min = 0.0, max = 1e3), extend("x-source" = "thesis: none told; released code: 0.01 for \
                                                                 CLAC, none for LAC"))]
    pub exploration_observation_sd: f64,
    /// Beginnings of the names of the channels with that noise; empty for all channels.
    #[schemars(extend("x-source" = "released code: the measurements to be tracked"))]
    pub exploration_noise_channels: Vec<String>,
    /// Updates per environment step, all environments counted.
    #[schemars(range(min = 0.0, max = 64.0), extend("x-source" = "released code"))]
    pub updates_per_step: f64,
    /// Environment steps before the first update; until then the untrained policy acts.
    #[schemars(range(min = 1), extend("x-source" = "released code: 1000 for LAC, 10000 for CLAC"))]
    pub learning_starts: u64,
    /// Transitions that the replay buffer holds.
    #[schemars(range(min = 1, max = 100_000_000), extend("x-source" = "released code"))]
    pub replay_capacity: usize,
    /// Largest Euclidean norm of a gradient, or null for no limit.
    #[schemars(range(min = 0.0))]
    pub gradient_clip: Option<f64>,
    /// Scaling of observations for the networks.
    pub observation_scaling: ObservationScaling,
}

/// Norm of the differences `d_i = pi*(s_i) - pi*(s_i before)` in a batch.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SmoothnessNorm {
    /// The mean of their lengths, `mean |d_i|`.
    #[default]
    Mean,
    /// The length of all of them as one vector, `sqrt(sum |d_i|^2)`, which grows with the batch.
    Frobenius,
}

/// Constant added to squares before their root is taken, so that equal actions have the gradient 0.
const LEAST_SQUARE: f64 = 1e-12;

impl SmoothnessNorm {
    /// Norm `[1, 1]` of differences `[batch, n]`.
    #[must_use]
    pub fn of(self, moves: Expression<'_>) -> Expression<'_> {
        let squares = moves.square();
        match self {
            Self::Mean => (squares.sum_columns() + LEAST_SQUARE).sqrt().mean(),
            Self::Frobenius => (squares.sum() + LEAST_SQUARE).sqrt(),
        }
    }
}

impl Default for Config {
    fn default() -> Self {
        Self {
            actor_learning_rate: 1e-4,
            lyapunov_learning_rate: 3e-4,
            multiplier_learning_rate: 1e-4,
            temperature_learning_rate: 1e-4,
            decline_steps: None,
            batch_size: 256,
            discount: 0.99,
            target_smoothing: 0.005,
            decrease: 1.0,
            first_multiplier: 0.1,
            first_temperature: 2.0,
            target_entropy: None,
            smoothness: 0.0,
            smoothness_norm: SmoothnessNorm::Mean,
            width: 256,
            hidden_layers: 2,
            activation: Activation::LeakyRelu,
            log_sd_low: -20.0,
            log_sd_high: 2.0,
            bootstrap_at_time_limit: true,
            exploration_observation_sd: 0.0,
            exploration_noise_channels: Vec::new(),
            updates_per_step: 1.0,
            learning_starts: 1_000,
            replay_capacity: 1_000_000,
            gradient_clip: None,
            observation_scaling: ObservationScaling::Typical,
        }
    }
}

/// Values that the thesis, table 2.1 and section 2.4.1, prints for both algorithms.
fn thesis() -> Value {
    json!({
        "actor_learning_rate": 1e-4, "lyapunov_learning_rate": 3e-4, "batch_size": 256, "discount": 0.99,
        "target_smoothing": 0.005, "decrease": 1.0, "first_multiplier": 0.1, "first_temperature": 2.0,
        "target_entropy": null, "width": 256, "hidden_layers": 2, "activation": "leaky_relu",
    })
}

/// Values in the released code of the thesis' group for LAC.
fn released_code() -> Value {
    json!({
        "actor_learning_rate": 1e-4, "lyapunov_learning_rate": 3e-4, "multiplier_learning_rate": 1e-5,
        "temperature_learning_rate": 1e-4, "decline_steps": 5_000_000, "batch_size": 256, "discount": 0.995,
        "target_smoothing": 0.005, "decrease": 1.0, "first_multiplier": 1.0, "first_temperature": 2.0,
        "target_entropy": null, "width": 256, "hidden_layers": 3, "activation": "leaky_relu",
        "log_sd_low": -2.0, "log_sd_high": 1.0, "bootstrap_at_time_limit": false,
        "exploration_observation_sd": 0.0, "updates_per_step": 1.0, "learning_starts": 1000,
        "replay_capacity": 1_000_000,
    })
}

const ABOUT_THESIS: &str = "what thesis, table 2.1 and section 2.4.1, print";

impl contract::Config for Config {
    fn presets() -> Vec<Preset> {
        vec![
            Preset {
                name: "thesis",
                about: ABOUT_THESIS,
                values: thesis(),
            },
            Preset {
                name: "released_code",
                about: "the thesis group's released code for LAC; `decline_steps` is the length of its \
                        training",
                values: released_code(),
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
        let Self {
            log_sd_low,
            log_sd_high,
            ..
        } = self;
        if log_sd_low > log_sd_high {
            let problem = format!("{log_sd_low} is above `log_sd_high`, {log_sd_high}; exchange them");
            return Err(Error::config("log_sd_low", problem));
        }
        check_batch(self.batch_size, self.replay_capacity)
    }

    /// Factor of every learning rate after `n_steps` environment steps, between 0 and 1.
    #[must_use]
    #[allow(clippy::cast_precision_loss, reason = "a number of steps is far below 2^52")]
    pub fn rate_left(&self, n_steps: u64) -> f64 {
        self.decline_steps
            .map_or(1.0, |all| 1.0 - n_steps.min(all) as f64 / all as f64)
    }
}

/// Hyper-parameters of `clac`: those of `lac`, with the smoothness term on by default.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Map<String, Value>")]
pub struct ClacConfig(pub Config);

impl Default for ClacConfig {
    fn default() -> Self {
        Self(Config {
            smoothness: 0.5,
            ..Config::default()
        })
    }
}

/// Defaults of `clac` as JSON.
fn clac_defaults() -> Map<String, Value> {
    match json!(ClacConfig::default()) {
        Value::Object(defaults) => defaults,
        _ => unreachable!("a struct is an object"),
    }
}

/// Missing keys take the defaults of `clac`; a derived implementation would take those of `lac`.
impl TryFrom<Map<String, Value>> for ClacConfig {
    type Error = serde_json::Error;

    fn try_from(given: Map<String, Value>) -> Result<Self, Self::Error> {
        let mut all = clac_defaults();
        all.extend(given);
        serde_json::from_value(Value::Object(all)).map(Self)
    }
}

impl JsonSchema for ClacConfig {
    fn schema_name() -> Cow<'static, str> {
        "ClacConfig".into()
    }

    /// The schema of [`Config`] with the defaults of `clac`.
    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let mut schema = Config::json_schema(generator);
        let properties = schema.get_mut("properties").and_then(Value::as_object_mut);
        for (key, property) in properties.into_iter().flatten() {
            property["default"] = clac_defaults()[key].clone();
        }
        schema
    }
}

impl contract::Config for ClacConfig {
    fn presets() -> Vec<Preset> {
        let mut released = released_code();
        released["smoothness"] = json!(0.5);
        released["smoothness_norm"] = json!("frobenius");
        released["exploration_observation_sd"] = json!(0.01);
        released["learning_starts"] = json!(10_000);
        let mut printed = thesis();
        printed["smoothness_norm"] = json!("mean");
        vec![
            Preset {
                name: "thesis",
                about: ABOUT_THESIS,
                values: printed,
            },
            Preset {
                name: "released_code",
                about: "the thesis group's released code for CLAC; `decline_steps` is the length of its \
                        training, and `exploration_noise_channels` are to be named",
                values: released,
            },
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shared::gradient_checks::computed;

    #[test]
    fn clac_is_lac_with_the_smoothness_term() {
        let resolved = |text: &str| serde_json::from_str::<ClacConfig>(text).unwrap().0;
        assert_eq!(resolved("{}"), ClacConfig::default().0);
        let said = resolved(r#"{ "width": 7 }"#);
        assert_eq!((said.smoothness, said.width), (0.5, 7));
        assert_eq!(resolved(r#"{ "smoothness": 0.0 }"#), Config::default());
        let text = serde_json::from_str::<ClacConfig>(r#"{ "smothness": 1.0 }"#)
            .unwrap_err()
            .to_string();
        assert!(text.contains("unknown field `smothness`"), "{text}");
        let default_of = |schema: Schema| schema.to_value()["properties"]["smoothness"]["default"].clone();
        assert_eq!(default_of(schemars::schema_for!(Config)), json!(0.0));
        assert_eq!(default_of(schemars::schema_for!(ClacConfig)), json!(0.5));
    }

    #[test]
    fn presets_differ_where_thesis_and_code_do() {
        let of = |presets: Vec<Preset>, name| presets.into_iter().find(|it| it.name == name).unwrap().values;
        let lac = |name| {
            serde_json::from_value::<Config>(of(<Config as contract::Config>::presets(), name)).unwrap()
        };
        let clac = |name| {
            serde_json::from_value::<ClacConfig>(of(<ClacConfig as contract::Config>::presets(), name))
                .unwrap()
                .0
        };
        assert_eq!(
            (lac("thesis"), clac("thesis")),
            (Config::default(), ClacConfig::default().0)
        );
        let released = clac("released_code");
        assert_eq!(
            lac("released_code"),
            Config {
                smoothness: 0.0,
                smoothness_norm: SmoothnessNorm::Mean,
                exploration_observation_sd: 0.0,
                learning_starts: 1_000,
                ..released.clone()
            }
        );
        assert_eq!(
            (released.learning_starts, released.exploration_observation_sd),
            (10_000, 0.01)
        );
        assert_eq!(released.smoothness_norm, SmoothnessNorm::Frobenius);
        assert!(released.check().is_ok());
    }

    /// Differences (3, 4) and (0, 1): lengths 5 and 1, Frobenius norm sqrt(26); equal actions have length 0.
    #[test]
    fn norms_by_hand() {
        let of = |norm: SmoothnessNorm, moves: &[f64]| {
            computed(|equations| norm.of(equations.constant([2, 2], moves)))[0]
        };
        let moves = [3.0, 4.0, 0.0, 1.0];
        assert!((of(SmoothnessNorm::Mean, &moves) - 3.0).abs() < 1e-6);
        assert!((of(SmoothnessNorm::Frobenius, &moves) - 26f32.sqrt()).abs() < 1e-6);
        for norm in [SmoothnessNorm::Mean, SmoothnessNorm::Frobenius] {
            assert!(of(norm, &[0.0; 4]) < 2e-6);
            let slope = computed(|equations| {
                let still = equations.constant([2, 2], &[0.0; 4]);
                equations.gradients(norm.of(still), &[still])[0]
            });
            assert_eq!(slope, [0.0; 4], "{norm:?}");
        }
    }

    #[test]
    fn rates_decline_to_nothing() {
        let left = |all, n| {
            Config {
                decline_steps: all,
                ..Config::default()
            }
            .rate_left(n)
        };
        assert_eq!([left(None, 900), left(Some(1000), 0)], [1.0, 1.0]);
        assert_eq!([left(Some(1000), 250), left(Some(1000), 2000)], [0.75, 0.0]);
    }

    #[test]
    fn contradictions_are_named() {
        let problem = |config: Config| config.check().unwrap_err().to_string();
        let text = problem(Config {
            replay_capacity: 9,
            ..Config::default()
        });
        assert!(text.contains("`batch_size`"), "{text}");
        let text = problem(Config {
            log_sd_low: 1.5,
            log_sd_high: 1.0,
            ..Config::default()
        });
        assert!(
            text.contains("`log_sd_low`: 1.5 is above `log_sd_high`, 1"),
            "{text}"
        );
    }
}
