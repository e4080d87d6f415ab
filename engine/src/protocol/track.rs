//! Protocol `track`: an agent follows whole episodes one after the other, as an estimator follows unit after unit;
//! nothing is learned.
//!
//! Episodes are the environment's own in their order, where it has a list of them
//! ([`reset_to`](crate::Environment::reset_to)), and an agent that remembers begins anew with each. What they record
//! is the final measurement, an episode each. What the environment draws of the last one is left.

use super::{
    Protocol, Run,
    evaluation::{self, Measurement, measure_alone},
};
use crate::{Config, Error, Metric, ProductKind, Registry};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What to follow.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Track {
    /// Number of episodes.
    #[schemars(range(min = 1, max = 1_000_000))]
    pub episodes: u64,
    /// How many of them, from the first, are recorded step by step.
    pub trace_episodes: u64,
}

impl Default for Track {
    fn default() -> Self {
        Self {
            episodes: 10,
            trace_episodes: 0,
        }
    }
}

impl Config for Track {}

/// Registers the protocol.
pub(super) fn register(registry: &mut Registry) {
    registry.protocol(
        "track",
        1,
        "Follow whole episodes one after the other, as an estimator follows unit after unit; nothing is learned.",
        |config: Track| config,
        |config| Ok(Box::new(config)),
    );
}

impl Protocol for Track {
    fn metrics(&self) -> Vec<Metric> {
        evaluation::metrics()
    }

    fn leaves(&self) -> Vec<ProductKind> {
        vec![ProductKind::Graph, ProductKind::Images]
    }

    fn total_steps(&self) -> u64 {
        self.episodes
    }

    fn experience(&self) -> u64 {
        0
    }

    fn run(&self, run: &mut Run<'_>) -> Result<(), Error> {
        let all = Measurement::one_by_one(self.episodes, self.trace_episodes).with_drawings();
        measure_alone(run, std::iter::once(all), self.episodes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        Action, Agent, AgentTraits, Channel, End, Environment, Mode, NoKeeper, Observation, Phase, Rng, Seat,
        Space, Step,
        cast::Seating,
        trial::{Part, TrialKey},
    };
    use serde_json::{Value, json};

    #[derive(Debug, Default, Serialize, Deserialize, JsonSchema)]
    #[serde(default)]
    struct Nothing {}

    impl Config for Nothing {}

    /// Three steps an episode, whose number is all that is seen; the reward is what is said.
    struct Numbered {
        seats: Vec<Seat>,
        number: u64,
        steps: u64,
    }

    impl Environment for Numbered {
        fn seats(&self) -> &[Seat] {
            &self.seats
        }
        fn reset(&mut self, _: &mut Rng) -> Result<Vec<Vec<f64>>, Error> {
            panic!("episodes of a measurement have numbers")
        }
        fn reset_to(&mut self, episode: u64, _: &mut Rng) -> Result<Vec<Vec<f64>>, Error> {
            (self.number, self.steps) = (episode, 0);
            Ok(vec![vec![episode as f64]])
        }
        fn step(&mut self, actions: &[Vec<f64>], _: &mut Rng) -> Result<Step, Error> {
            self.steps += 1;
            Ok(Step {
                observations: vec![vec![self.number as f64]],
                rewards: vec![actions[0][0]],
                info: Vec::new(),
                end: (self.steps == 3).then_some(End::Truncated),
            })
        }
        fn trace_channels(&self) -> Vec<Channel> {
            Vec::new()
        }
        fn trace(&self) -> Vec<f64> {
            Vec::new()
        }
        fn snapshot(&self) -> Value {
            Value::Null
        }
        fn restore(&mut self, _: &Value) -> Result<(), Error> {
            Ok(())
        }
    }

    /// Says the sum of what it saw since it began anew.
    struct Adds {
        sum: f64,
        remembers: bool,
    }

    impl Agent for Adds {
        fn act(&mut self, seen: &[Observation], _: Mode, _: &mut Rng) -> Result<Vec<Action>, Error> {
            assert!(!self.remembers || seen.len() == 1, "{} rows", seen.len());
            self.sum += seen[0].seats[0][0];
            Ok(seen.iter().map(|_| vec![vec![self.sum]]).collect())
        }
        fn remembers(&self) -> bool {
            self.remembers
        }
        fn restart(&mut self) {
            self.sum = 0.0;
        }
    }

    fn adds(remembers: bool) -> Result<Box<dyn Agent>, Error> {
        Ok(Box::new(Adds { sum: 0.0, remembers }))
    }

    fn registry() -> Registry {
        let mut registry = Registry::default();
        crate::protocol::register(&mut registry);
        registry.environment("numbered", 1, "Numbers.", |_: Nothing| {
            let space = || Space::Box(vec![Channel::new("number", "")]);
            let seat = Seat {
                name: String::new(),
                observation: space(),
                action: space(),
            };
            Ok(Box::new(Numbered {
                seats: vec![seat],
                number: 0,
                steps: 0,
            }))
        });
        registry.agent(
            "remembers",
            1,
            "Adds.",
            AgentTraits::default(),
            |_: Nothing, _, _| adds(true),
        );
        registry.agent(
            "forgets",
            1,
            "Adds.",
            AgentTraits::default(),
            |_: Nothing, _, _| adds(false),
        );
        registry
    }

    fn returns(agent: &str, protocol: &str, config: &Value) -> Vec<f64> {
        let registry = registry();
        let entry = &registry.protocols[protocol];
        let config = (entry.without_training)(&(entry.about.resolve)(config).unwrap()).unwrap();
        let key = TrialKey {
            environment: Part::new("numbered", 1, json!({})).into(),
            agent: Seating::Agent(Part::new(agent, 1, json!({}))).into(),
            protocol: Part::new(protocol, 1, config).into(),
            seed: 0,
            numerics: 1,
            device: "cpu".into(),
        };
        let record = key.run(&registry, None, &mut |_, _| {}, &mut NoKeeper).unwrap();
        let of_returns = record
            .rows()
            .iter()
            .filter(|row| row.phase == Phase::Final && record.names()[usize::from(row.metric)] == "return");
        of_returns.map(|row| row.value).collect()
    }

    /// Episode k shows k three times, so that the sums are k, 2 k and 3 k.
    const ALONE: [f64; 4] = [0.0, 6.0, 12.0, 18.0];

    #[test]
    fn episodes_follow_each_other_whoever_plays() {
        let config = json!({ "episodes": 4 });
        assert_eq!(returns("remembers", "track", &config), ALONE);
        assert_eq!(returns("forgets", "track", &config), ALONE);
    }

    #[test]
    fn an_agent_that_remembers_plays_alone_wherever_it_is_measured() {
        let config = json!({ "steps": 0, "final_episodes": 4 });
        assert_eq!(returns("remembers", "train_evaluate", &config), ALONE);
    }
}
