//! The names that the tables, figures and claims of a study may use.

use contract::{
    ArtifactKind, Metric,
    part::Part,
    sweep_point::{KeyMatch, last_word, word},
};
use document::diagnostic::Diagnostic;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
};

/// Names of a study's environments, agents and settings, and of the metrics, artifacts and channels of its trials.
#[derive(Debug, Default)]
pub struct Vocabulary {
    /// Names of the environments.
    pub environments: Vec<String>,
    /// Names of the agents.
    pub agents: Vec<String>,
    /// Metrics by environment and agent; pairs without trials are absent.
    pub recorded: BTreeMap<(usize, usize), BTreeSet<String>>,
    /// Kinds of artifacts that protocols leave, by environment and agent.
    pub left: BTreeMap<(usize, usize), BTreeSet<ArtifactKind>>,
    /// Names of traced channels, by environment.
    pub traced: BTreeMap<usize, BTreeSet<String>>,
    /// Settings as texts, in order; a single empty one without a sweep.
    pub settings: Vec<Arc<str>>,
    /// The swept keys.
    pub swept: Vec<Arc<SweptKey>>,
    /// Places of the swept keys that stand together in one setting, each list once.
    pub together: BTreeSet<Vec<usize>>,
    /// Seeds of the study.
    pub seeds: Vec<u64>,
    /// The searches.
    pub searches: Vec<KnownSearch>,
    /// Everything that is recorded, each name once.
    pub metrics: Vec<Metric>,
    /// Units of recorded metrics and traced channels, by name.
    pub units: BTreeMap<String, String>,
    /// Plays among these agents.
    pub plays: Vec<Play>,
    /// Warnings about parts that can run but are probably not intended.
    pub warnings: Vec<Diagnostic>,
    /// Whether no environment was started, because the announcements of all are known.
    pub is_recalled: bool,
    /// Announcements of environments that are not built in, by id.
    pub announced: BTreeMap<String, Value>,
}

/// A swept key, as tables, figures and claims name it.
#[derive(Debug, Clone)]
pub struct SweptKey {
    /// The key as it is written.
    pub key: Arc<str>,
    /// Index of the agent to which the key belongs; `None` for a key of environment or protocol.
    pub agent: Option<usize>,
    /// Its values, in the order of the points.
    pub values: Arc<[Value]>,
}

impl SweptKey {
    fn is_called(&self, name: &str) -> bool {
        KeyMatch::of(name, std::iter::once(&*self.key)) != KeyMatch::None
    }
}

/// A search, as tables and figures name it.
#[derive(Debug, Clone)]
pub struct KnownSearch {
    /// Name of the search.
    pub name: String,
    /// The metric by which it compares settings.
    pub metric: String,
    /// The names of its keys where they appear side by side.
    pub keys: Vec<String>,
    /// Number of settings that can run to their ends.
    pub ends: usize,
}

impl Vocabulary {
    /// Whether a sweep varies any trial.
    #[must_use]
    pub fn has_sweep(&self) -> bool {
        self.settings.iter().any(|setting| !setting.is_empty())
    }

    /// Whether a sweep varies trials of one of these agents: by a key of its own, of an environment or of a protocol.
    #[must_use]
    pub fn sweeps_any(&self, agents: &[usize]) -> bool {
        let concerns = |it: &Arc<SweptKey>| it.agent.is_none_or(|agent| agents.contains(&agent));
        self.has_sweep() && self.swept.iter().any(concerns)
    }

    /// The names of swept keys: the last word of each, unless keys of one setting share it, and the whole key.
    #[must_use]
    pub fn swept_names(&self) -> Vec<&str> {
        let mut seen = BTreeSet::new();
        let keys = self.swept.iter().map(|it| &*it.key);
        keys.flat_map(|key| [last_word(key), key])
            .filter(|name| seen.insert(*name) && self.ambiguity(name).is_none())
            .collect()
    }

    /// A sentence on a name that several keys of one setting share, with the names to choose from; `None` for other
    /// names.
    #[must_use]
    pub fn ambiguity(&self, name: &str) -> Option<String> {
        self.together.iter().find_map(|together| {
            let keys: Vec<&str> = together.iter().map(|place| &*self.swept[*place].key).collect();
            match KeyMatch::of(name, keys.iter().copied()) {
                KeyMatch::Several(places) => {
                    let keys: Vec<&str> = places.into_iter().map(|place| keys[place]).collect();
                    Some(format!(
                        "`{name}` is ambiguous here: name `{}`",
                        keys.join("` or `")
                    ))
                }
                KeyMatch::None | KeyMatch::One(_) => None,
            }
        })
    }

    /// The values of the swept keys with this whole name or last word, as texts; none if no sweep varies such a key of
    /// the agent, its environments or its protocol. Keys of all agents count if `agent` is absent.
    #[must_use]
    pub fn swept_values(&self, name: &str, agent: Option<usize>) -> Vec<String> {
        let is_of_other = |it: &SweptKey| agent.is_some() && it.agent.is_some() && it.agent != agent;
        let called = self
            .swept
            .iter()
            .filter(|it| it.is_called(name) && !is_of_other(it));
        called.flat_map(|it| it.values.iter().map(word)).collect()
    }

    /// Adds the metrics that the trials of an environment and an agent record.
    pub fn record<'a>(&mut self, pair: (usize, usize), metrics: impl Iterator<Item = &'a Metric>) {
        let recorded = self.recorded.entry(pair).or_default();
        for metric in metrics {
            recorded.insert(metric.name.clone());
            self.units.insert(metric.name.clone(), metric.unit.clone());
            if !self.metrics.iter().any(|known| known.name == metric.name) {
                self.metrics.push(metric.clone());
            }
        }
    }
}

/// Choice of the seeds of agents that meet.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Pairs {
    /// Seed `k` of one agent meets seed `k` of the others.
    #[default]
    Matched,
    /// Every seed of one meets every seed of the others: `n` seeds of two roles make `n * n` trials.
    All,
}

/// Agents of one environment that meet each other after they were trained.
#[derive(Debug, Clone)]
pub struct Play {
    /// Its name, which stands for the environment in tables and claims.
    pub name: String,
    /// Name of the environment in which the agents were trained.
    pub environment: String,
    /// Roles in alphabetical order, each with its seats in the order of the environment.
    pub roles: Vec<(String, Vec<String>)>,
    /// The agents, in the order of the play.
    pub players: Vec<Player>,
    /// Metrics that its trials record.
    pub metrics: BTreeSet<String>,
    /// The environment in which they meet.
    pub arena: Part,
    /// Number of episodes of each trial.
    pub episodes: u64,
    /// Pairing of seeds.
    pub pairs: Pairs,
    /// Protocol of the measurement.
    pub protocol: Part,
    /// The keys that differ between `environment` and `arena`, as given.
    pub environment_config: Map<String, Value>,
}

/// An agent of a play.
#[derive(Debug, Clone)]
pub struct Player {
    /// Name of the agent in the study.
    pub name: String,
    /// Whether a trial trains it.
    pub learns: bool,
    /// Index of its cell, whose trials train it.
    pub cell: usize,
}

impl Play {
    /// Agents by role, for every ordered combination; the first role changes slowest.
    #[must_use]
    pub fn combinations(&self) -> Vec<Vec<&Player>> {
        let mut all: Vec<Vec<&Player>> = vec![Vec::new()];
        for _ in &self.roles {
            let longer = |head: Vec<_>| {
                self.players
                    .iter()
                    .map(move |player| [head.clone(), vec![player]].concat())
            };
            all = all.into_iter().flat_map(longer).collect();
        }
        all
    }
}
