//! A protocol made of the engine's parts: learn from whole episodes, then measure.
//!
//! The trial can stop before every episode. Each has random streams of its own, so the number of episodes so
//! far is all that learning needs to go on.

use engine::{
    Config, Error, Metric, Mode, Phase, Protocol, Registry, Transition,
    protocol::{Measurement, Position, Run, measure, measurement_metrics, observe},
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How long to learn and how much to measure.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
struct Episodes {
    /// Episodes to learn from.
    episodes: u64,
    /// Episodes of the measurement at the end.
    #[schemars(range(min = 1))]
    final_episodes: u64,
}

impl Default for Episodes {
    fn default() -> Self {
        Self {
            episodes: 400,
            final_episodes: 600,
        }
    }
}

impl Config for Episodes {}

pub fn register(registry: &mut Registry) {
    let alone = |config: Episodes| Episodes {
        episodes: 0,
        ..config
    };
    registry.protocol(
        "episodes",
        1,
        "learn from whole episodes, then measure",
        alone,
        |config| Ok(Box::new(config)),
    );
}

impl Protocol for Episodes {
    fn metrics(&self) -> Vec<Metric> {
        measurement_metrics()
    }

    fn total_steps(&self) -> u64 {
        self.episodes
    }

    fn experience(&self) -> u64 {
        self.episodes
    }

    fn run(&self, run: &mut Run<'_>) -> Result<(), Error> {
        let (learnt, measuring) = match run.resume()? {
            None => (0, None),
            Some(Position { learning, measuring }) => (learning.unwrap_or(self.episodes), measuring),
        };
        for episode in learnt..self.episodes {
            run.checkpoint(|| Position {
                learning: Some(episode),
                measuring: None,
            })?;
            play(run, episode)?;
            (run.progress)(episode + 1, self.episodes);
        }
        let last = Measurement::at_the_end(self.episodes, self.final_episodes, 0);
        measure(run, &last, measuring, || None::<u64>)?;
        run.record.record_latest(Phase::Final, self.episodes);
        run.record_updates(Phase::Final, self.episodes);
        Ok(())
    }
}

fn play(run: &mut Run<'_>, episode: u64) -> Result<(), Error> {
    let mut environment = (run.make_environment)()?;
    let mut rng = run.streams.environment("train", episode);
    let [mut act, mut learn] =
        ["act", "learn"].map(|purpose| run.streams.agent(&format!("{purpose} {episode}")));
    let seats = environment.reset(&mut rng)?;
    let mut observation = observe(&*run.agent, &*environment, seats);
    loop {
        let mut actions = run
            .agent
            .act(std::slice::from_ref(&observation), Mode::Train, &mut act)?;
        let action = actions
            .pop()
            .ok_or_else(|| Error::config("agent", "it gives no action"))?;
        let step = environment.step(&action, &mut rng)?;
        let next_observation = observe(&*run.agent, &*environment, step.observations);
        let (rewards, end) = (step.rewards, step.end);
        let following = next_observation.clone();
        let transition = Transition {
            observation,
            action,
            rewards,
            next_observation,
            end,
        };
        run.agent.learn(&[transition], &mut learn, &mut run.record)?;
        if end.is_some() {
            return Ok(());
        }
        observation = following;
    }
}
