//! Share of the critics in the gradient of TDOM-AC's opponent models: a measurement of theorem 1 of the
//! thesis.
//!
//! TDOM-AC learns (preset `differential_game`) with one of its two objectives of the opponent models. After
//! each update the gradient of that objective is split into its parts on a new minibatch, for every opponent
//! model of every seat:
//!
//! | thesis, chapter 4 | here |
//! |---|---|
//! | gradient of `E sum Q` (4.17), of `E Q^j` (4.22) | `value_gradient`, Euclidean norm over the model's parameters |
//! | gradient of `E log rho` | `entropy_gradient`, likewise |
//!
//! The theorem: in a zero-sum game of two players the critics of (4.17) cancel, so that only the entropy part
//! is left. It holds for exact critics. The critics here are learned, one per player, and cancel as far as
//! both have become exact. The measurement does not affect learning: running moments are restored.
//!
//! Metrics: means over the models, of the latest update. Both parts are taken with the same draws.

use crate::shared::opponent_modelling::{Learner, SeatBatch, Settings, others};
use crate::tdom_ac::{self, OpponentObjective};
use burn::tensor::Tensor;
use contract::{
    Action, Agent, AgentTraits, Config as _, Error, Feed, Interface, Metric, Mode, Observation, Recorder,
    Registry, Rng, Transition, Updates,
};
use numerics::{optimizer::gradients, squashed::sample};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;

const NAME: &str = "opponent_gradients";

/// Hyper-parameters of the learning: a preset of `tdom_ac`.
const PRESET: &str = "differential_game";

/// Objective of the opponent models, and the size of the learner.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Objective of the opponent models, whose gradient is split into its parts.
    #[schemars(extend("x-source" = "thesis, eq. 4.17 and 4.22"))]
    pub opponent_objective: OpponentObjective,
    /// Units of both hidden layers of every network.
    #[schemars(range(min = 1, max = 4096), extend("x-source" = "released code, differential game"))]
    pub width: usize,
    /// Transitions per update and per measurement; all that are stored where they are fewer.
    #[schemars(range(min = 2, max = 65536), extend("x-source" = "released code, differential game"))]
    pub batch_size: usize,
    /// Environment steps before the first update and the first measurement.
    #[schemars(range(min = 2), extend("x-source" = "released code, differential game"))]
    pub learning_starts: u64,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            opponent_objective: OpponentObjective::Aligned,
            width: 128,
            batch_size: 512,
            learning_starts: 16,
        }
    }
}

impl contract::Config for Config {}

fn metrics() -> Vec<Metric> {
    let norm = |name: &str, about: &str| Metric::new(name, "", about).lower_is_better();
    vec![
        norm(
            "value_gradient",
            "norm of the critics' part of the gradient of an opponent model, mean over the models",
        ),
        norm(
            "entropy_gradient",
            "norm of the entropy's part of the gradient of an opponent model, mean over the models",
        ),
    ]
}

/// TDOM-AC with a measurement of its gradients.
#[derive(Debug, Clone)]
pub struct OpponentGradients {
    learner: Learner<tdom_ac::Config>,
}

/// Registers the agent.
pub(crate) fn register(registry: &mut Registry, version: u32) {
    let about =
        "takes the gradient of the opponent models of TDOM-AC apart into the critics' part and the entropy's";
    let traits = AgentTraits::learner([Feed::Decisions], metrics());
    registry.agent(NAME, version, about, traits, build);
}

/// Builds the agent for an environment that `tdom_ac` can be used with.
///
/// # Errors
/// Those of `tdom_ac`.
fn build(config: Config, interface: &Interface, rng: &mut Rng) -> Result<Box<dyn Agent>, Error> {
    Ok(Box::new(OpponentGradients {
        learner: Learner::new(learning(config)?, interface, rng)?,
    }))
}

fn learning(config: Config) -> Result<tdom_ac::Config, Error> {
    let preset = tdom_ac::Config::presets()
        .into_iter()
        .find(|preset| preset.name == PRESET);
    let values = preset.map(|preset| preset.values).unwrap_or_default();
    let learning: Result<tdom_ac::Config, _> = serde_json::from_value(values);
    let learning = learning
        .map_err(|problem| Error::config("opponent_objective", format!("preset `{PRESET}`: {problem}")))?;
    let Config {
        opponent_objective,
        width,
        batch_size,
        learning_starts,
    } = config;
    let settings = Settings {
        width,
        batch_size,
        learning_starts,
        ..learning.settings
    };
    Ok(tdom_ac::Config {
        opponent_objective,
        settings,
        ..learning
    })
}

impl OpponentGradients {
    /// Norms of both parts, mean over all opponent models.
    fn parts(&mut self, rng: &mut Rng) -> (f64, f64) {
        let untouched = self.learner.game.players.clone();
        let mut norms = Vec::new();
        for seat in 0..untouched.len() {
            let batch = self.learner.game.batch(seat, rng);
            for place in others(untouched.len(), seat).enumerate() {
                norms.push(self.parts_of_model(seat, place, &batch, rng));
            }
        }
        self.learner.game.players = untouched;
        #[allow(clippy::cast_precision_loss, reason = "a handful of models")]
        let mean = |of: fn(&(f64, f64)) -> f64| norms.iter().map(of).sum::<f64>() / norms.len() as f64;
        (mean(|norms| norms.0), mean(|norms| norms.1))
    }

    /// Norms of both parts for the model `at` of a seat, which predicts the seat `other`.
    fn parts_of_model(
        &mut self,
        seat: usize,
        (at, other): (usize, usize),
        batch: &SeatBatch,
        rng: &mut Rng,
    ) -> (f64, f64) {
        let settings = Settings {
            opponent_entropy_weight: 0.0,
            ..self.learner.algorithm.settings
        };
        let value_alone = tdom_ac::Config {
            settings,
            ..self.learner.algorithm.clone()
        };
        let game = &mut self.learner.game;
        let mut same_draws = rng.clone();
        let value = match value_alone.opponent_objective {
            OpponentObjective::Aligned => value_alone.aligned_loss(game, seat, (at, other), batch, rng),
            OpponentObjective::Neutralised => value_alone.neutralised_loss(game, seat, at, batch, rng),
        };
        let seen = game.seen(seat, &batch.observations);
        if value_alone.opponent_objective == OpponentObjective::Neutralised {
            game.players[seat].draw_others(&seen, &mut same_draws);
        }
        let head = game.players[seat].opponents[at].tracked_head(seen);
        let entropy = sample(head, &mut same_draws).log_density.mean();
        (self.norm(seat, at, &value), self.norm(seat, at, &entropy))
    }

    /// Norm of a loss's gradient in the parameters of one opponent model.
    fn norm(&self, seat: usize, at: usize, loss: &Tensor<1>) -> f64 {
        let network = self.learner.game.players[seat].opponents[at].network();
        let squares = gradients(network, &mut loss.backward())
            .concat()
            .into_iter()
            .map(|g| f64::from(g) * f64::from(g));
        squares.sum::<f64>().sqrt()
    }
}

impl Agent for OpponentGradients {
    fn act(&mut self, observations: &[Observation], mode: Mode, rng: &mut Rng) -> Result<Vec<Action>, Error> {
        self.learner.act(observations, mode, rng)
    }

    fn learn(
        &mut self,
        transitions: &[Transition],
        rng: &mut Rng,
        record: &mut Recorder,
    ) -> Result<(), Error> {
        self.learner.learn(transitions, rng, &mut Recorder::default())?;
        let starts = self.learner.algorithm.settings.learning_starts;
        if self.learner.game.replay.len() as u64 >= starts {
            let (value, entropy) = self.parts(rng);
            record.latest("value_gradient", value);
            record.latest("entropy_gradient", entropy);
        }
        Ok(())
    }

    fn updates(&self) -> Option<Updates> {
        self.learner.updates()
    }

    fn save(&self, dir: &Path) -> Result<(), Error> {
        self.learner.save(dir)
    }

    fn load(&mut self, dir: &Path) -> Result<(), Error> {
        self.learner.load(dir)
    }

    fn export(&self, dir: &Path) -> Result<bool, Error> {
        self.learner.export(dir)
    }

    fn import(&mut self, dir: &Path) -> Result<bool, Error> {
        self.learner.import(dir)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shared::coordination;
    use contract::random::stream;

    fn agent(opponent_objective: OpponentObjective) -> OpponentGradients {
        let config = Config {
            opponent_objective,
            width: 16,
            batch_size: 32,
            ..Config::default()
        };
        OpponentGradients {
            learner: Learner::new(
                learning(config).unwrap(),
                &coordination::game(),
                &mut stream(&["learner"]),
            )
            .unwrap(),
        }
    }

    #[test]
    fn measuring_changes_nothing_that_is_learnt_from() {
        let mut agent = agent(OpponentObjective::Neutralised);
        coordination::train(&mut agent, 4, &mut stream(&["train"]));
        let dirs = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
        agent.save(dirs[0].path()).unwrap();
        let (value, entropy) = agent.parts(&mut stream(&["measure"]));
        agent.save(dirs[1].path()).unwrap();
        assert!(value > 0.0 && entropy > 0.0);
        let files = || {
            std::fs::read_dir(dirs[0].path())
                .unwrap()
                .map(|entry| entry.unwrap().file_name())
        };
        assert!(files().count() > 0);
        for name in files() {
            let [one, two] = [0, 1].map(|at: usize| std::fs::read(dirs[at].path().join(&name)).unwrap());
            assert!(one == two, "{}", name.display());
        }
    }

    /// The sum of both parts is the gradient that the model descends.
    #[test]
    fn the_parts_add_up() {
        for objective in [OpponentObjective::Aligned, OpponentObjective::Neutralised] {
            let mut agent = agent(objective);
            coordination::train(&mut agent, 4, &mut stream(&["train"]));
            let batch = agent.learner.game.batch(0, &mut stream(&["batch"]));
            let config = agent.learner.algorithm.clone();
            let mut gradient = |weight: f64| {
                let settings = Settings {
                    opponent_entropy_weight: weight,
                    ..config.settings
                };
                let (config, rng) = (
                    tdom_ac::Config {
                        settings,
                        ..config.clone()
                    },
                    &mut stream(&["x"]),
                );
                let game = &mut agent.learner.game;
                let loss = match objective {
                    OpponentObjective::Aligned => config.aligned_loss(game, 0, (0, 1), &batch, rng),
                    OpponentObjective::Neutralised => config.neutralised_loss(game, 0, 0, &batch, rng),
                };
                gradients(game.players[0].opponents[0].network(), &mut loss.backward()).concat()
            };
            let (both, value) = (gradient(1.0), gradient(0.0));
            let difference = both
                .iter()
                .zip(&value)
                .map(|(both, value)| f64::from(both - value).powi(2))
                .sum::<f64>()
                .sqrt();
            let norms = agent.parts_of_model(0, (0, 1), &batch, &mut stream(&["x"]));
            assert!(
                (norms.1 - difference).abs() < 1e-4 * difference,
                "{norms:?} {difference}"
            );
        }
    }

    #[test]
    fn a_saved_agent_continues() {
        coordination::assert_continues(|rng| build(Config::default(), &coordination::game(), rng).unwrap());
    }
}
