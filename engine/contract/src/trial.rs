//! One trial: an environment, an agent, a protocol and a seed, with an identity computed from everything that
//! determines its numbers.

use crate::{artifact::Taken, cast::Actors, digest, part::Part, sweep_point::SweepPoint};
use serde::{Deserialize, Serialize};
use std::{
    collections::BTreeMap,
    ops::{Deref, DerefMut},
    path::Path,
    sync::Arc,
};

/// Serialisation of shared values: in the form of the value itself.
mod shared {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};
    use std::sync::Arc;

    pub(super) fn serialize<T: Serialize, S: Serializer>(
        value: &Arc<T>,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        value.as_ref().serialize(serializer)
    }

    pub(super) fn deserialize<'de, T: Deserialize<'de>, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Arc<T>, D::Error> {
        T::deserialize(deserializer).map(Arc::new)
    }
}

/// Id of a trial from the ids of its environment, agent and protocol.
#[must_use]
pub fn trial_id(parts: [&str; 3], seed: u64, numerics: u32) -> String {
    // The canonical text of `[parts, seed, numerics, "cpu"]`, written directly, since a plan has many trials. The last
    // word is a constant. Earlier versions wrote the device there, and trials that they stored keep their ids.
    let [environment, agent, protocol] = parts;
    let text = format!(r#"[["{environment}","{agent}","{protocol}",],{seed},{numerics},"cpu",]"#);
    digest::of_bytes(text.as_bytes())
}

/// Everything that determines the numbers of one trial, and nothing else. Trials of a plan that differ only in their
/// seed share the rest.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrialKey {
    /// Environment with its complete config.
    #[serde(with = "shared")]
    pub environment: Arc<Part>,
    /// The agent or the policies that act.
    #[serde(with = "shared")]
    pub agent: Arc<Actors>,
    /// Protocol with its complete config.
    #[serde(with = "shared")]
    pub protocol: Arc<Part>,
    /// Seed of the trial, which makes it a replicate of others.
    pub seed: u64,
    /// Version of the shared numerical code.
    pub numerics: u32,
}

impl TrialKey {
    /// The same key with another seed.
    #[must_use]
    pub fn with_seed(&self, seed: u64) -> Self {
        Self { seed, ..self.clone() }
    }

    /// Whether another key shares its parts in memory, so that they are equal without a comparison.
    pub fn shares_parts(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.environment, &other.environment)
            && Arc::ptr_eq(&self.agent, &other.agent)
            && Arc::ptr_eq(&self.protocol, &other.protocol)
    }

    /// The trial's id: 32 hexadecimal digits of a hash over the key.
    #[must_use]
    pub fn id(&self) -> String {
        trial_id(
            self.part_ids().each_ref().map(String::as_str),
            self.seed,
            self.numerics,
        )
    }

    /// Ids of environment, agent and protocol.
    #[must_use]
    pub fn part_ids(&self) -> [String; 3] {
        [self.environment.id(), self.agent.id(), self.protocol.id()]
    }

    /// Artifacts of other trials that the trial takes.
    #[must_use]
    pub fn taken(&self) -> Vec<Taken> {
        let of = |part: &Part| part.artifacts.values().cloned().collect();
        let mut all: Vec<Taken> = [of(&self.environment), self.agent.taken(), of(&self.protocol)].concat();
        all.sort();
        all.dedup();
        all
    }

    /// Data files that the configs name, without a leading `./`, with the hashes of their content.
    pub fn data_files(&self) -> Vec<(&Path, &str)> {
        let parts = [&*self.environment, &*self.protocol]
            .into_iter()
            .chain(self.agent.parts());
        let files = parts.flat_map(|part| part.files.iter().map(move |(key, digest)| (part, key, digest)));
        let files = files.filter_map(|(part, key, digest)| {
            let path = part.config.pointer(key)?.as_str()?;
            let path = Path::new(path);
            Some((path.strip_prefix(".").unwrap_or(path), digest.as_str()))
        });
        files.collect()
    }

    /// Whether the trial takes an artifact from another trial.
    #[must_use]
    pub fn takes(&self) -> bool {
        let takes = |part: &Part| !part.artifacts.is_empty();
        takes(&self.environment)
            || takes(&self.protocol)
            || match &*self.agent {
                Actors::Agent(part) => takes(part),
                Actors::Cast(_) => !self.agent.taken().is_empty(),
            }
    }

    /// The subset of [`taken`](Self::taken) that the trial itself names: a cast takes policies, and the artifacts
    /// behind their agents belong to their own trials.
    #[must_use]
    pub fn taken_by_name(&self) -> Vec<Taken> {
        match self.agent.cast() {
            None => self.taken(),
            Some(cast) => {
                let parts = [&self.environment, &self.protocol];
                parts
                    .into_iter()
                    .flat_map(|part| part.artifacts.values().cloned())
                    .chain(cast.policies())
                    .collect()
            }
        }
    }

    /// The plugins of its agents, as in `dirichlet_sac` or `rommeo+tdom_ac`.
    #[must_use]
    pub fn agents_by_plugin(&self) -> String {
        let plugins: Vec<&str> = self
            .agent
            .parts()
            .iter()
            .map(|part| part.plugin.as_str())
            .collect();
        plugins.join("+")
    }

    /// Ids of the trials that must have ended `ok` before it begins, each once.
    #[must_use]
    pub fn sources(&self) -> Vec<String> {
        let mut ids: Vec<String> = self.taken().into_iter().map(|taken| taken.trial).collect();
        ids.dedup();
        ids
    }
}

/// A trial of a study: its key and its names in tables and figures. A worker receives only the id and the key.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Trial {
    /// Hash of `key`, as 32 hexadecimal digits.
    pub id: String,
    /// Place of the trial in the study; the trials of all seeds share it.
    #[serde(skip)]
    pub cell: Arc<TrialCell>,
    /// Everything that determines the numbers.
    pub key: TrialKey,
}

/// Environment, agent and point of the sweep; seeds are replicates of a combination.
#[derive(Debug, Clone, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Combination {
    /// Name of the environment in the study.
    pub environment: String,
    /// Name of the agent in the study.
    pub agent: String,
    /// Point of the sweep; empty without a sweep.
    pub point: SweepPoint,
}

/// Place of a trial in its study, without its seed: a combination and a purpose.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TrialCell {
    /// Environment, agent and point of the sweep.
    pub combination: Combination,
    /// Purpose of the trial.
    pub purpose: Purpose,
}

impl Deref for TrialCell {
    type Target = Combination;

    fn deref(&self) -> &Combination {
        &self.combination
    }
}

impl DerefMut for TrialCell {
    fn deref_mut(&mut self) -> &mut Combination {
        &mut self.combination
    }
}

impl From<Combination> for TrialCell {
    fn from(combination: Combination) -> Self {
        Self {
            combination,
            purpose: Purpose::default(),
        }
    }
}

impl Combination {
    /// A combination at a point known only by its words; without a sweep they are empty.
    #[must_use]
    pub fn of_words(environment: &str, agent: &str, words: &str) -> Self {
        Self {
            environment: environment.into(),
            agent: agent.into(),
            point: SweepPoint::of_words(words),
        }
    }
}

impl TrialCell {
    /// An environment and an agent that no sweep affects.
    #[must_use]
    pub fn of(environment: impl Into<String>, agent: impl Into<String>) -> Self {
        let combination = Combination {
            environment: environment.into(),
            agent: agent.into(),
            ..Combination::default()
        };
        combination.into()
    }
}

/// The purpose of a trial in its study.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub enum Purpose {
    /// It belongs to a combination of environment, agent and setting, which tables, figures and claims show.
    #[default]
    Cell,
    /// It leaves artifacts that other trials take: an entry of the section `prepare`, whose name replaces that of the
    /// environment.
    Prepared,
    /// It measures a setting for the search with this name.
    Tried(String),
    /// It is an encounter of a play, whose name replaces that of the environment; holds the agents by role.
    Play(BTreeMap<String, String>),
    /// It is a run of another program, which tables, figures and claims show beside the study's own trials.
    Imported,
}

impl Purpose {
    /// Whether the trial measures a setting for a search.
    #[must_use]
    pub fn is_tried(&self) -> bool {
        matches!(self, Self::Tried(_))
    }
}

impl Trial {
    /// Place of the trial in the study, for a modification of this trial alone.
    pub fn cell_mut(&mut self) -> &mut TrialCell {
        Arc::make_mut(&mut self.cell)
    }

    /// Environment, agent, setting and seed as text.
    #[must_use]
    pub fn title(&self) -> String {
        let setting = if self.cell.point.is_empty() {
            String::new()
        } else {
            format!(" [{}]", self.cell.point)
        };
        format!(
            "{} {}{setting} seed {}",
            self.cell.environment, self.cell.agent, self.key.seed
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn the_id_of_a_trial_is_the_hash_of_its_canonical_text() {
        let parts = ["0a", "1b", "2c"];
        assert_eq!(
            trial_id(parts, 7, 3),
            digest::of_json(&json!([parts, 7, 3, "cpu"]))
        );
    }
}
