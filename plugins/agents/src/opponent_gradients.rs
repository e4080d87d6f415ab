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
//! both have become exact. The measurement does not affect learning: it changes a copy of the running moments.
//!
//! Metrics: means over the models, of the latest update. Both parts are taken with the same draws.

use crate::shared::opponent_modelling::{Learner, SeatUpdate, Settings};
use crate::tdom_ac::{self, OpponentObjective};
use contract::{
    Action, Agent, AgentTraits, Config as _, Error, Feed, Interface, Metric, Mode, Observation, Recorder,
    Registry, Rng, Transition, Updates,
};
use plan::{Expression, Plans};
use rand::RngCore;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;

const NAME: &str = "opponent_gradients";

/// Hyper-parameters of the learning: a preset of `tdom_ac`.
const PRESET: &str = "differential_game";

/// Parts of a gradient, as metrics and as outputs of the measurement.
const PARTS: [&str; 2] = ["value_gradient", "entropy_gradient"];

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
            PARTS[0],
            "norm of the critics' part of the gradient of an opponent model, mean over the models",
        ),
        norm(
            PARTS[1],
            "norm of the entropy's part of the gradient of an opponent model, mean over the models",
        ),
    ]
}

/// TDOM-AC with a measurement of its gradients.
#[derive(Debug, Clone)]
pub struct OpponentGradients {
    learner: Learner<tdom_ac::Config>,
    measuring: Plans,
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
    Ok(Box::new(OpponentGradients::new(config, interface, rng)?))
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
    fn new(config: Config, interface: &Interface, rng: &mut Rng) -> Result<Self, Error> {
        Ok(Self {
            learner: Learner::new(learning(config)?, interface, rng)?,
            measuring: Plans::default(),
        })
    }

    /// Norms of both parts, mean over all opponent models.
    fn parts(&mut self, rng: &mut Rng) -> [f64; 2] {
        let (learner, batches) = (&self.learner, self.learner.batches(rng));
        let plan = self.measuring.of_rows(batches.n_rows, |equations| {
            let game = &learner.game;
            let updates = game.updates(&learner.config, equations, batches.n_rows, false);
            equations.routine("parts");
            let of_seats = updates
                .iter()
                .flat_map(|update| norms(&learner.algorithm, *update));
            let of_models: Vec<[Expression<'_>; 2]> = of_seats.collect();
            for (at, part) in PARTS.into_iter().enumerate() {
                let norms: Vec<_> = of_models.iter().map(|norms| norms[at]).collect();
                equations.output(part, equations.join(&norms).mean_columns());
            }
        });
        batches.write(plan);
        plan.run_seeded("parts", &mut learner.state.clone(), rng.next_u64());
        PARTS.map(|part| plan.number(part))
    }
}

/// Norms of both parts `[1, 1]` for each opponent model of a seat, with the same draws.
fn norms<'e>(algorithm: &tdom_ac::Config, update: SeatUpdate<'_, 'e>) -> Vec<[Expression<'e>; 2]> {
    let norms = |(at, other)| {
        let parts = algorithm.opponent_objective(update, at, other);
        [-parts.value.mean(), parts.log_density.mean()].map(|loss| {
            let (equations, model) = (loss.equations(), update.player().opponents[at].network());
            let gradients = equations.gradients(loss, &model.parameters(equations));
            let squares: Vec<_> = gradients.iter().map(|g| g.square().sum()).collect();
            equations.join(&squares).sum().sqrt()
        })
    };
    update.opponents().map(norms).collect()
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
        if self.learner.replay.len() as u64 >= self.learner.config.learning_starts {
            for (part, norm) in PARTS.into_iter().zip(self.parts(rng)) {
                record.latest(part, norm);
            }
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
    use crate::shared::{coordination, opponent_modelling::trials};
    use contract::random::stream;

    fn agent(opponent_objective: OpponentObjective) -> OpponentGradients {
        let config = Config {
            opponent_objective,
            width: 16,
            batch_size: 32,
            ..Config::default()
        };
        OpponentGradients::new(config, &coordination::game(), &mut stream(&["learner"])).unwrap()
    }

    #[test]
    fn measuring_changes_nothing_that_is_learnt_from() {
        let mut agent = agent(OpponentObjective::Neutralised);
        coordination::train(&mut agent, 4, &mut stream(&["train"]));
        let dirs = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
        agent.save(dirs[0].path()).unwrap();
        let [value, entropy] = agent.parts(&mut stream(&["measure"]));
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
            let learner = &agent.learner;
            let batch = learner.batches(&mut stream(&["batch"])).of_seats.remove(0);
            let gradient = |weight: f64| {
                let model = &learner.game.players[0].opponents[0];
                trials::gradient(learner, model, &batch, |update| {
                    learner.algorithm.opponent_objective(update, 0, 1).loss(weight)
                })
            };
            let (both, value) = (gradient(1.0), gradient(0.0));
            let norms = trials::computed(learner, 0, &batch, |update| {
                let norms = norms(&learner.algorithm, update).remove(0);
                norms[0].equations().join(&norms)
            });
            for (norm, part) in norms
                .iter()
                .zip([trials::norm(&value), trials::distance(&both, &value)])
            {
                assert!((norm - part).abs() < 1e-4 * part, "{norms:?} {part}");
            }
        }
    }

    #[test]
    fn a_saved_agent_continues() {
        coordination::assert_continues(|rng| build(Config::default(), &coordination::game(), rng).unwrap());
    }
}
