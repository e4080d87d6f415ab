//! E2GAN's search: soft actor-critic that designs cell after cell, first exploring and then exploiting.
//!
//! Tian, Wang, Huang, Li, Dai, Yang, Wang and Fink 2020, "Off-policy reinforcement learning for efficient and
//! effective GAN architecture search", ECCV, algorithm 3 (chapter 5 of the thesis), and its released code.
//!
//! | thesis | here | shape |
//! |---|---|---|
//! | s | observation of the design so far, scaled | `[batch, observed]` |
//! | a | one value per option within -1 and 1; of each choice the largest decides | `[batch, options]` |
//! | R | the improvement that a step brought | `[batch, 1]` |
//! | beta | `temperature` | scalar |
//!
//! The agent samples its actions for `exploration_steps`, and takes the mean of its policy after that. Once
//! the replay buffer holds `learning_starts` transitions, each step of the first phase makes one update and
//! each of the second ten. [`SoftActorCritic`] describes the algorithm itself.
//!
//! The text and the released code differ:
//!
//! | | preset `thesis` | preset `released_code` |
//! |---|---|---|
//! | beta | a multiplier that is learned, eq. 5.8 | 0.1, its learning switched off |
//! | after each design | nothing | one more update with the whole replay buffer as the batch, from the first design on |
//! | decoding | "a softmax classifier": the most probable option, which is the largest value | the largest value |
//! | discount | 1, since eq. 5.5 adds rewards up | 1 |
//! | observations | not stated | not scaled |
//!
//! Departures
//! - The released code steps its two critics one after the other with one optimiser; here they are stepped at
//!   once.
//! - Algorithm 3 updates a target policy that nothing uses; there is none here, as in the released code.
//! - With `sees`, the policy is blind to other channels, so that the value of the state can be measured.
//!
//! Metrics: those of soft actor-critic.

use crate::shared::{
    box_seat::BoxSeat,
    scaling::ObservationScaling,
    seat_network::check_batch,
    soft_actor_critic as sac,
    soft_actor_critic::{SoftActorCritic, Temperature},
};
use contract::{
    Action, Agent, AgentTraits, Error, Feed, Interface, Mode, Observation, Preset, Recorder, Registry, Rng,
    Transition, Updates,
};
use numerics::{activation::Activation, equations::network::Network};
use plan::State;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::path::Path;

const NAME: &str = "e2gan";
const COUNTERS: &str = "search.json";

/// Hyper-parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Steps in which actions are sampled; the policy's mean is taken after that.
    #[schemars(extend("x-source" = "thesis, section 5.5.3: 70 % of 300"))]
    pub exploration_steps: u64,
    /// Number of updates after each step of that phase.
    #[schemars(range(max = 1000), extend("x-source" = "thesis, section 5.5.3"))]
    pub updates_while_exploring: u64,
    /// Number of updates after each later step.
    #[schemars(range(max = 1000), extend("x-source" = "thesis, section 5.5.3"))]
    pub updates_while_exploiting: u64,
    /// After each design, make one more update with the whole replay buffer as its batch.
    #[schemars(extend("x-source" = "released code"))]
    pub update_with_everything: bool,
    /// Number of transitions before the first update with a drawn batch.
    #[schemars(range(min = 1), extend("x-source" = "released code"))]
    pub learning_starts: u64,
    /// Number of transitions in a drawn batch; fewer while the buffer holds fewer.
    #[schemars(range(min = 1, max = 65536), extend("x-source" = "released code"))]
    pub batch_size: usize,
    /// Transitions that the replay buffer holds.
    #[schemars(range(min = 1, max = 100_000_000), extend("x-source" = "released code"))]
    pub replay_capacity: usize,
    /// Rule for the weight beta of the entropy.
    pub temperature: Temperature,
    /// Temperature before learning; a fixed temperature keeps it.
    #[schemars(range(min = 1e-9, max = 1e3), extend("x-source" = "released code"))]
    pub first_temperature: f64,
    /// Step size of Adam for policy, critics and an automatic temperature.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "released code"))]
    pub learning_rate: f64,
    /// Discount gamma.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "released code; thesis, eq. 5.5"))]
    pub discount: f64,
    /// Smoothing tau of the target critics.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "released code"))]
    pub target_smoothing: f64,
    /// Units of each of two hidden layers.
    #[schemars(range(min = 1, max = 4096), extend("x-source" = "released code"))]
    pub width: usize,
    /// Scaling of observations for the networks.
    pub observation_scaling: ObservationScaling,
    /// Beginnings of the names of the channels that the policy sees; empty for all channels.
    pub sees: Vec<String>,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            exploration_steps: 210,
            updates_while_exploring: 1,
            updates_while_exploiting: 10,
            update_with_everything: true,
            learning_starts: 64,
            batch_size: 256,
            replay_capacity: 2_560_000,
            temperature: Temperature::Fixed,
            first_temperature: 0.1,
            learning_rate: 3e-4,
            discount: 1.0,
            target_smoothing: 0.005,
            width: 128,
            observation_scaling: ObservationScaling::Typical,
            sees: Vec::new(),
        }
    }
}

impl contract::Config for Config {
    fn presets() -> Vec<Preset> {
        let alike = json!({
            "exploration_steps": 210, "updates_while_exploring": 1, "updates_while_exploiting": 10,
            "learning_starts": 64, "batch_size": 256, "replay_capacity": 2_560_000, "learning_rate": 3e-4,
            "discount": 1.0, "target_smoothing": 0.005, "width": 128,
        });
        let with = |others: serde_json::Value| {
            let mut values = alike.clone();
            for (key, value) in others.as_object().into_iter().flatten() {
                values[key] = value.clone();
            }
            values
        };
        vec![
            Preset {
                name: "thesis",
                about: "algorithm 3: the weight of the entropy is learnt, no update with everything",
                values: with(json!({
                    "temperature": "automatic", "first_temperature": 0.1, "update_with_everything": false,
                })),
            },
            Preset {
                name: "released_code",
                about: "a fixed weight of the entropy, one more update after each design, observations as they are",
                values: with(json!({
                    "temperature": "fixed", "first_temperature": 0.1, "update_with_everything": true,
                    "observation_scaling": "none",
                })),
            },
        ]
    }
}

impl Config {
    fn of_actor_critic(&self) -> sac::Config {
        sac::Config {
            actor_learning_rate: self.learning_rate,
            critic_learning_rate: self.learning_rate,
            temperature: self.temperature,
            first_temperature: self.first_temperature,
            temperature_learning_rate: self.learning_rate,
            target_entropy: None,
            batch_size: self.batch_size,
            discount: self.discount,
            target_smoothing: self.target_smoothing,
            width: self.width,
            hidden_layers: 2,
            activation: Activation::Relu,
            replay_capacity: self.replay_capacity,
            learning_starts: self.learning_starts,
            observation_scaling: self.observation_scaling,
            ..sac::Config::default()
        }
    }
}

/// Soft actor-critic with a phase of exploration and one of exploitation.
#[derive(Debug, Clone)]
pub struct E2Gan {
    config: Config,
    actor_critic: SoftActorCritic,
    n_steps: u64,
}

/// Registers the agent.
pub(crate) fn register(registry: &mut Registry, version: u32) {
    let about =
        "E2GAN's search: soft actor-critic over designs, with a phase of exploration and one of exploitation";
    let traits = AgentTraits::learner([Feed::Decisions], sac::metrics());
    registry.agent(NAME, version, about, traits, build);
}

/// Builds the agent for one seat that observes a box and chooses among options, or acts in a box with limits -1 and 1.
///
/// # Errors
/// [`Error::Mismatch`] for any other seat; [`Error::Config`] for unknown channels and settings that
/// contradict each other.
fn build(config: Config, interface: &Interface, rng: &mut Rng) -> Result<Box<dyn Agent>, Error> {
    Ok(Box::new(E2Gan::new(config, interface, rng)?))
}

impl E2Gan {
    fn new(config: Config, interface: &Interface, rng: &mut Rng) -> Result<Self, Error> {
        check_batch(config.batch_size, config.replay_capacity)?;
        let mut seat = BoxSeat::new(NAME, config.observation_scaling, interface)?;
        seat.see_only(&config.sees)
            .map_err(|problem| Error::config("sees", problem))?;
        let of_actor_critic = config.of_actor_critic();
        let initialise = |network: &Network, _, state: &mut State<f32>| network.initialise_glorot(state, rng);
        Ok(Self {
            actor_critic: SoftActorCritic::assemble(of_actor_critic, seat, initialise),
            n_steps: 0,
            config,
        })
    }

    fn explores(&self) -> bool {
        self.n_steps < self.config.exploration_steps
    }

    /// Stores one step and makes its updates.
    fn take(&mut self, transition: &Transition, rng: &mut Rng, record: &mut Recorder) -> Result<(), Error> {
        self.actor_critic.remember(transition);
        let updates = if self.explores() {
            self.config.updates_while_exploring
        } else {
            self.config.updates_while_exploiting
        };
        self.n_steps += 1;
        if self.actor_critic.n_remembered() as u64 >= self.config.learning_starts {
            for _ in 0..updates {
                self.actor_critic.update(rng, record)?;
            }
        }
        if transition.end.is_some() && self.config.update_with_everything {
            self.actor_critic.update_with_everything(rng, record)?;
        }
        Ok(())
    }
}

impl Agent for E2Gan {
    fn act(&mut self, observations: &[Observation], mode: Mode, rng: &mut Rng) -> Result<Vec<Action>, Error> {
        let mode = if self.explores() { mode } else { Mode::Evaluate };
        self.actor_critic.act(observations, mode, rng)
    }

    fn learn(
        &mut self,
        transitions: &[Transition],
        rng: &mut Rng,
        record: &mut Recorder,
    ) -> Result<(), Error> {
        transitions
            .iter()
            .try_for_each(|transition| self.take(transition, rng, record))
    }

    fn plan(&mut self, n_rows: usize) -> Option<String> {
        self.actor_critic.plan(n_rows)
    }

    fn updates(&self) -> Option<Updates> {
        let first_after = if self.config.update_with_everything {
            1
        } else {
            self.config.learning_starts
        };
        Some(Updates {
            made: self.actor_critic.n_updates(),
            first_after,
        })
    }

    fn save(&self, dir: &Path) -> Result<(), Error> {
        self.actor_critic.save(dir)?;
        let path = dir.join(COUNTERS);
        std::fs::write(&path, json!({ "n_steps": self.n_steps }).to_string())
            .map_err(Error::file("write", &path))
    }

    fn load(&mut self, dir: &Path) -> Result<(), Error> {
        self.actor_critic.load(dir)?;
        let path = dir.join(COUNTERS);
        let text = std::fs::read(&path).map_err(Error::file("read", &path))?;
        let counters: Option<serde_json::Value> = serde_json::from_slice(&text).ok();
        self.n_steps = counters
            .and_then(|counters| counters["n_steps"].as_u64())
            .ok_or_else(|| Error::Checkpoint {
                what: NAME,
                problem: format!("`{COUNTERS}` does not say how many steps were made"),
            })?;
        Ok(())
    }

    fn export(&self, dir: &Path) -> Result<bool, Error> {
        self.actor_critic.export(dir)
    }

    fn import(&mut self, dir: &Path) -> Result<bool, Error> {
        self.actor_critic.import(dir)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shared::designs::tests::{interface, scored, search};

    fn agent(config: Config, seed: &str) -> E2Gan {
        E2Gan::new(
            config,
            &interface(),
            &mut contract::random::stream(&["e2gan", seed]),
        )
        .unwrap()
    }

    fn quick() -> Config {
        Config {
            exploration_steps: 400,
            learning_starts: 32,
            learning_rate: 3e-3,
            width: 32,
            first_temperature: 0.02,
            ..Config::default()
        }
    }

    /// The mean value of random designs is 2.83, that of the best design is 6.
    #[test]
    fn it_learns_to_design_and_then_exploits() {
        for (seed, preset) in [("one", true), ("two", false)] {
            let mut agent = agent(
                Config {
                    update_with_everything: preset,
                    ..quick()
                },
                seed,
            );
            let mut rng = contract::random::stream(&["search", seed]);
            let values = search(&mut agent, 260, &mut rng);
            let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
            assert!(mean(&values[..30]) < 4.0, "{seed}: {values:?}");
            assert!(mean(&values[230..]) >= 5.0, "{seed}: {values:?}");
            assert!(scored(&mut agent, &mut rng) >= 5.0, "{seed}");
        }
    }

    #[test]
    fn updates_follow_the_phases() {
        let phases = Config {
            exploration_steps: 8,
            learning_starts: 4,
            updates_while_exploring: 1,
            updates_while_exploiting: 10,
            update_with_everything: false,
            ..quick()
        };
        let made = |config: Config, designs: usize| {
            let mut agent = agent(config, "phases");
            search(&mut agent, designs, &mut contract::random::stream(&["phases"]));
            agent.updates().unwrap().made
        };
        // Steps 4 to 8 make one update each, the two later ones ten.
        assert_eq!(made(phases.clone(), 5), 5 + 20);
        let with_everything = Config {
            update_with_everything: true,
            ..phases
        };
        assert_eq!(made(with_everything.clone(), 5), 5 + 20 + 5);
        assert_eq!(made(with_everything, 1), 1);
    }

    #[test]
    fn channels_that_are_not_named_are_hidden() {
        let blind = Config {
            sees: vec!["ste".into()],
            ..quick()
        };
        let mut two = interface();
        let contract::Space::Box(channels) = &mut two.seats[0].observation else {
            unreachable!()
        };
        channels.push(contract::Channel::new("score", "").typical(1.0, 2.0));
        let mut rng = contract::random::stream(&["blind"]);
        let mut agent = E2Gan::new(blind.clone(), &two, &mut rng).unwrap();
        let act = |agent: &mut E2Gan, seen: [f64; 2]| {
            let seen = Observation {
                seats: vec![seen.to_vec()],
                state: Vec::new(),
            };
            agent
                .act(&[seen], Mode::Evaluate, &mut contract::random::stream(&[]))
                .unwrap()
        };
        assert_eq!(act(&mut agent, [1.0, 0.0]), act(&mut agent, [1.0, 900.0]));
        assert_ne!(act(&mut agent, [1.0, 0.0]), act(&mut agent, [2.0, 0.0]));
        let unknown = Config {
            sees: vec!["depth".into()],
            ..blind
        };
        let text = E2Gan::new(unknown, &two, &mut rng).unwrap_err().to_string();
        assert!(text.contains("`sees`") && text.contains("`depth`"), "{text}");
    }
}
