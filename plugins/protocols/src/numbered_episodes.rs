//! For tests of protocols: episodes that show their number, and agents that act by it.

use contract::{
    Action, Agent, AgentTraits, Channel, Config, End, Environment, Error, Mode, NoKeeper, Observation,
    Recorder, Registry, Rng, Seat, Space, Step, cast::Actors, part::Part, trial::TrialKey,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
struct NoConfig {}

impl Config for NoConfig {}

/// Episodes of three steps. The first observed number is that of the episode, the second that of the decision;
/// the reward is the action.
struct NumberedEpisodes {
    seats: Vec<Seat>,
    number: u64,
    steps: u64,
}

impl NumberedEpisodes {
    fn seen(&self) -> Vec<Vec<f64>> {
        vec![vec![self.number as f64, self.steps as f64]]
    }
}

impl Environment for NumberedEpisodes {
    fn seats(&self) -> &[Seat] {
        &self.seats
    }
    fn reset(&mut self, _: &mut Rng) -> Result<Vec<Vec<f64>>, Error> {
        panic!("episodes of a measurement have numbers")
    }
    fn reset_to(&mut self, episode: u64, _: &mut Rng) -> Result<Vec<Vec<f64>>, Error> {
        (self.number, self.steps) = (episode, 0);
        Ok(self.seen())
    }
    fn step(&mut self, actions: &[Vec<f64>], _: &mut Rng) -> Result<Step, Error> {
        self.steps += 1;
        let end = (self.steps == 3).then_some(End::Truncated);
        Ok(Step::new(self.seen(), vec![actions[0][0]], end))
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

/// Acts with the sum of the episode numbers that it has observed since it was restarted.
struct SummingAgent {
    sum: f64,
    remembers: bool,
}

impl Agent for SummingAgent {
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

/// Acts with the episode number that it observes.
struct EchoAgent;

impl Agent for EchoAgent {
    fn act(&mut self, seen: &[Observation], _: Mode, _: &mut Rng) -> Result<Vec<Action>, Error> {
        Ok(seen.iter().map(|it| vec![vec![it.seats[0][0]]]).collect())
    }
}

fn adds(remembers: bool) -> Result<Box<dyn Agent>, Error> {
    Ok(Box::new(SummingAgent { sum: 0.0, remembers }))
}

fn registry() -> Registry {
    let mut registry = Registry::default();
    super::register(&mut registry);
    registry.environment("numbered", 1, "Numbers.", |_: NoConfig| {
        let below_forty = |name: &str| Channel::new(name, "").within(0.0, 40.0);
        let seat = Seat {
            name: String::new(),
            observation: Space::Box(vec![below_forty("number"), below_forty("decision")]),
            action: Space::Box(vec![below_forty("said")]),
        };
        Ok(Box::new(NumberedEpisodes {
            seats: vec![seat],
            number: 0,
            steps: 0,
        }))
    });
    let traits = AgentTraits::default;
    registry.agent("remembers", 1, "Adds.", traits(), |_: NoConfig, _, _| adds(true));
    registry.agent("forgets", 1, "Adds.", traits(), |_: NoConfig, _, _| adds(false));
    registry.agent("repeats", 1, "Repeats.", traits(), |_: NoConfig, _, _| {
        Ok(Box::new(EchoAgent))
    });
    registry
}

/// The record of a trial of an agent that does not learn.
pub(super) fn recorded(agent: &str, protocol: &str, config: &Value, seed: u64) -> Result<Recorder, Error> {
    let registry = registry();
    let entry = &registry.protocols[protocol];
    let config = (entry.without_training)(&(entry.about.resolve)(config).unwrap()).unwrap();
    let key = TrialKey {
        environment: Part::new("numbered", 1, json!({})).into(),
        agent: Actors::Agent(Part::new(agent, 1, json!({}))).into(),
        protocol: Part::new(protocol, 1, config).into(),
        seed,
        numerics: 1,
    };
    key.run(&registry, None, &mut |_, _| {}, &mut NoKeeper)
}
