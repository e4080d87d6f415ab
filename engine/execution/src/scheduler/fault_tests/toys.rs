//! Small plugins whose trials save after every step and leave a policy.

use super::ledger::Ledger;
use crate::world::{fs, process};
use contract::{
    Action, Agent, AgentTraits, Channel, Config, End, Environment, Error, Feed, Interface, Metric, Mode,
    Observation, PerEpisode, Recorder, Registry, Rng, Seat, Space, Step, Transition, Updates, artifact,
};
use rand::Rng as _;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::path::Path;

#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
struct DiceConfig {}

impl Config for DiceConfig {}

/// One throw.
struct Throw {
    seats: Vec<Seat>,
    metrics: Vec<Metric>,
    start: f64,
}

impl Environment for Throw {
    fn seats(&self) -> &[Seat] {
        &self.seats
    }
    fn metrics(&self) -> &[Metric] {
        &self.metrics
    }
    fn reset(&mut self, rng: &mut Rng) -> Result<Vec<Vec<f64>>, Error> {
        self.start = rng.random();
        Ok(vec![vec![self.start]])
    }
    fn step(&mut self, actions: &[Vec<f64>], _: &mut Rng) -> Result<Step, Error> {
        let end = Some(End::Terminated);
        Ok(Step::new(vec![vec![self.start]], vec![actions[0][0]], end).record("start", self.start))
    }
    fn trace_channels(&self) -> Vec<Channel> {
        Vec::new()
    }
    fn trace(&self) -> Vec<f64> {
        Vec::new()
    }
    fn snapshot(&self) -> Value {
        json!(self.start)
    }
    fn restore(&mut self, snapshot: &Value) -> Result<(), Error> {
        self.start = snapshot.as_f64().unwrap();
        Ok(())
    }
}

/// Counts its learning steps; it may continue from the policy of another trial.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
struct TallyConfig {
    /// Artifact from which it continues.
    from: Option<artifact::Artifact<artifact::Policy>>,
    /// Whether its learning fails in the end.
    fails: bool,
    /// Whether it leaves nothing, so that its trial can be packed.
    leaves_nothing: bool,
    /// The swept value of a search; 0 in other trials.
    #[serde(skip_serializing_if = "is_zero")]
    rate: f64,
    /// Whether its learning fails at random, through no fault of its own.
    #[serde(skip_serializing_if = "is_false")]
    falls: bool,
}

impl Config for TallyConfig {}

#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
fn is_zero(rate: &f64) -> bool {
    *rate == 0.0
}

#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
fn is_false(falls: &bool) -> bool {
    !falls
}

struct Tally {
    began_with: f64,
    count: u64,
    fails: bool,
    leaves_nothing: bool,
    rate: f64,
    falls: bool,
}

impl Tally {
    const POLICY: &str = "policy.safetensors";

    fn new(config: TallyConfig) -> Result<Self, Error> {
        let began_with = match &config.from {
            Some(artifact) => number(&artifact.folder()?.join(Self::POLICY))?,
            None => 0.0,
        };
        Ok(Self {
            began_with,
            count: 0,
            fails: config.fails,
            leaves_nothing: config.leaves_nothing,
            rate: config.rate,
            falls: config.falls,
        })
    }
}

fn number(path: &Path) -> Result<f64, Error> {
    let text = fs::read_to_string(path).map_err(Error::file("read", path))?;
    text.parse().map_err(|_| Error::Checkpoint {
        what: "tally",
        problem: text,
    })
}

impl Agent for Tally {
    fn act(&mut self, observations: &[Observation], _: Mode, rng: &mut Rng) -> Result<Vec<Action>, Error> {
        Ok(observations
            .iter()
            .map(|_| {
                let learned = self.rate * (self.count as f64 - 3.0).powi(2);
                vec![vec![rng.random::<f64>() + self.began_with + learned]]
            })
            .collect())
    }

    fn learn(&mut self, _: &[Transition], _: &mut Rng, record: &mut Recorder) -> Result<(), Error> {
        // A step that was saved before this one is promised to persist.
        Ledger::of_this_trial(|ledger, trial| ledger.goes_on(trial, self.count));
        self.count += 1;
        if self.fails && self.count == 3 {
            return Err(Error::Worker {
                problem: "as it should".into(),
            });
        }
        if self.falls && process::random_number().is_multiple_of(12) {
            return Err(Error::Worker {
                problem: "through no fault of its own".into(),
            });
        }
        record.mean("loss", self.count as f64);
        Ok(())
    }

    fn updates(&self) -> Option<Updates> {
        Some(Updates {
            made: self.count,
            first_after: 1,
        })
    }

    fn save(&self, dir: &Path) -> Result<(), Error> {
        let path = dir.join("count");
        fs::write(&path, self.count.to_string()).map_err(Error::file("write", &path))
    }

    fn load(&mut self, dir: &Path) -> Result<(), Error> {
        self.count = number(&dir.join("count"))? as u64;
        Ok(())
    }

    fn export(&self, dir: &Path) -> Result<bool, Error> {
        if self.leaves_nothing {
            return Ok(false);
        }
        let path = dir.join(Self::POLICY);
        let left = (self.count as f64 + self.began_with).to_string();
        fs::write(&path, &left).map_err(Error::file("write", &path))?;
        // Datasets lie deeper than any other artifact of a trial.
        let folder = dir.join("dataset/data");
        fs::create_dir_all(&folder).map_err(Error::file("create", &folder))?;
        let path = folder.join("part.parquet");
        fs::write(&path, &left).map_err(Error::file("write", &path))?;
        Ok(true)
    }
}

pub fn registry() -> Registry {
    let mut registry = Registry::default();
    protocols::register(&mut registry);
    registry.environment("throw", 1, "One throw.", |_: DiceConfig| {
        let channel = || Space::Box(vec![Channel::new("number", "")]);
        let seat = Seat {
            name: String::new(),
            observation: channel(),
            action: channel(),
        };
        Ok(Box::new(Throw {
            seats: vec![seat],
            metrics: vec![Metric::new("start", "", "the number").per_episode(PerEpisode::Last)],
            start: 0.0,
        }))
    });
    let traits = AgentTraits::learner([Feed::Decisions], vec![Metric::new("loss", "", "the count")]);
    registry.agent(
        "tally",
        1,
        "Counts.",
        traits,
        |config: TallyConfig, _: &Interface, _: &mut Rng| Ok(Box::new(Tally::new(config)?)),
    );
    registry
}
