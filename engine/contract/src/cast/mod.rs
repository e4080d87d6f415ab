//! Actors of a trial: an agent that is built for it, or policies that other trials left.
//!
//! A [`Cast`] assigns trained policies to seats. With one member for all seats, a policy is measured in an environment
//! other than that of its training. With one per role, agents that were trained separately meet (cross-play). The id of
//! the trial that left a policy is part of the cast's identity. It is a hash of everything that determined the policy.

mod team;

pub use team::{Team, take_up};

use crate::{
    Registry,
    artifact::{Artifact, ArtifactKind, Policy, Taken, reference_schema},
    digest,
    part::Part,
    plugin::About,
};
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::{collections::BTreeMap, sync::OnceLock};

/// Name of an agent of a study that is the policy of another trial: `{ policy: { from: NAME } }`. It is no plugin.
pub const POLICY: &str = "policy";

/// Facts about [`POLICY`], like those about plugins.
pub fn about_policy() -> &'static About {
    static ABOUT: OnceLock<About> = OnceLock::new();
    ABOUT.get_or_init(|| About {
        about: "The policy that another trial left, measured and not trained any more.",
        version: VERSION,
        defaults: json!({}).into(),
        schema: reference_schema(ArtifactKind::Policy),
        presets: Vec::new(),
        resolve: Box::new(|raw| serde_json::to_value(Artifact::<Policy>::deserialize(raw)?).map(Into::into)),
    })
}

/// Version of the code of casts, raised whenever a change affects the numbers of trials with one.
const VERSION: u32 = 2;

/// Everything that may be an agent of a study: the registered agents, and [`POLICY`].
pub fn agents(registry: &Registry) -> impl Iterator<Item = (&'static str, &About)> {
    registry
        .agents
        .iter()
        .map(|(name, entry)| (*name, &entry.about))
        .chain([(POLICY, about_policy())])
}

/// The actors of a trial.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Actors {
    /// An agent that is built for the trial and plays all seats.
    Agent(Part),
    /// Policies that were trained in other trials, beside agents that do not learn.
    Cast(Cast),
}

impl Actors {
    /// Hash of everything that determines the actions of the actors.
    #[must_use]
    pub fn id(&self) -> String {
        match self {
            Self::Agent(part) => part.id(),
            Self::Cast(cast) => cast.id(),
        }
    }

    /// The agent that is built for the trial; `None` for a cast.
    #[must_use]
    pub fn agent(&self) -> Option<&Part> {
        match self {
            Self::Agent(part) => Some(part),
            Self::Cast(_) => None,
        }
    }

    /// The cast; `None` for an agent.
    #[must_use]
    pub fn cast(&self) -> Option<&Cast> {
        match self {
            Self::Agent(_) => None,
            Self::Cast(cast) => Some(cast),
        }
    }

    /// The plugins with their configs, one per member of a cast.
    #[must_use]
    pub fn parts(&self) -> Vec<&Part> {
        match self {
            Self::Agent(part) => vec![part],
            Self::Cast(cast) => cast.roles.values().map(|member| &member.agent).collect(),
        }
    }

    /// Changes the plugins with their configs, one per member of a cast.
    pub fn each_part(&mut self, mut change: impl FnMut(&mut Part)) {
        match self {
            Self::Agent(part) => change(part),
            Self::Cast(cast) => cast
                .roles
                .values_mut()
                .for_each(|member| change(&mut member.agent)),
        }
    }

    /// Artifacts of other trials that the actors take.
    #[must_use]
    pub fn taken(&self) -> Vec<Taken> {
        let own = self
            .parts()
            .into_iter()
            .flat_map(|part| part.artifacts.values().cloned());
        own.chain(self.cast().into_iter().flat_map(Cast::policies))
            .collect()
    }
}

/// Players by role.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Cast {
    /// One member per role.
    pub roles: BTreeMap<String, Member>,
}

/// The player of one role.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Member {
    /// Names of the seats, in the order of the environment; all seats where empty.
    pub seats: Vec<String>,
    /// The agent, as in the trial that trained it.
    pub agent: Part,
    /// The trial whose final policy it plays; `None` for an agent that does not learn.
    pub trial: Option<String>,
}

impl Cast {
    /// Hash of players and their seats. Paths of data files and names of sources in a study are not part of it.
    #[must_use]
    pub fn id(&self) -> String {
        let member = |member: &Member| json!([member.seats, member.agent.id(), member.trial]);
        let roles: BTreeMap<&String, _> = self.roles.iter().map(|(role, it)| (role, member(it))).collect();
        digest::of_json(&json!(["cast", VERSION, roles]))
    }

    /// Policies that the cast takes.
    pub fn policies(&self) -> impl Iterator<Item = Taken> {
        let trials = self.roles.values().filter_map(|member| member.trial.clone());
        trials.map(|trial| Taken {
            trial,
            kind: ArtifactKind::Policy,
        })
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::trial::TrialKey;
    use serde_json::Value;

    pub(crate) fn cast(trial: &str) -> Cast {
        let member = |seat: &str, trial: Option<&str>| Member {
            seats: vec![seat.into()],
            agent: Part::new("learner", 1, json!({"width": 2})),
            trial: trial.map(Into::into),
        };
        Cast {
            roles: BTreeMap::from([
                ("prey".into(), member("a", Some(trial))),
                ("rest".into(), member("b", None)),
            ]),
        }
    }

    pub(crate) fn key(agent: Actors) -> TrialKey {
        let part = || Part::new("x", 1, Value::Null);
        TrialKey {
            environment: part().into(),
            agent: agent.into(),
            protocol: part().into(),
            seed: 0,
            numerics: 1,
        }
    }

    #[test]
    fn a_cast_comes_back_from_a_key_with_its_sources() {
        let cast = cast("0a");
        let stored: TrialKey = serde_json::from_value(json!(key(Actors::Cast(cast.clone())))).unwrap();
        assert_eq!(stored.agent.cast(), Some(&cast));
        assert_eq!(stored.sources(), ["0a"]);
        let named_alike = Part::new("learner", 1, json!({"roles": {"prey": {"trial": "0a"}}}));
        let stored: TrialKey = serde_json::from_value(json!(key(Actors::Agent(named_alike)))).unwrap();
        assert!(stored.sources().is_empty() && stored.agent.agent().is_some());
    }

    #[test]
    fn another_source_makes_another_trial_and_the_path_of_a_data_file_does_not() {
        assert_ne!(cast("0a").id(), cast("0b").id());
        let with_file = |path: &str| {
            let mut cast = cast("0a");
            let agent = &mut cast.roles.get_mut("prey").unwrap().agent;
            *agent = Part::new("learner", 1, json!({"table": {"file": path}}));
            agent.files.insert("/table/file".into(), "content".into());
            cast.id()
        };
        assert_eq!(with_file("here.csv"), with_file("there/here.csv"));
    }

    #[test]
    fn a_source_is_part_of_an_id_and_its_name_is_not() {
        let with = |name: &str, trial: &str| {
            let mut part = Part::new(
                "learner",
                1,
                json!({"start": {"from": name, "product": "networks"}}),
            );
            let taken = Taken {
                trial: trial.into(),
                kind: ArtifactKind::Networks,
            };
            part.artifacts.insert("/start".into(), taken.clone());
            let key = key(Actors::Agent(part));
            assert_eq!(
                (key.taken(), key.sources()),
                (vec![taken], vec![trial.to_string()])
            );
            key.id()
        };
        assert_eq!(with("fresh", "0a"), with("renamed", "0a"));
        assert_ne!(with("fresh", "0a"), with("fresh", "0b"));
    }
}
