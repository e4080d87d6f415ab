//! Cross-play: agents that were trained in different trials meet in one environment, each in a role of its own.
//!
//! A *play* of a study names an environment, *roles* (every seat belongs to one) and agents. Each ordered combination of agents
//! over roles and each seed make one trial that measures and learns nothing. Its agent is a [`Cast`], which names by role the
//! trial whose final policy is played: the id of that trial hashes everything that determined the policy, so that a
//! cross-play trial is a new one exactly where one of its policies is. Seed `k` of one agent meets seed `k` of the others.

mod encounters;
mod team;

pub use encounters::Encounters;
#[cfg(test)]
pub(crate) use encounters::tests as encounters_for_tests;
pub(crate) use team::{Team, take_up};

use crate::trial::{Part, TrialKey};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;

/// What agent and protocol of a cross-play trial are called in its key; neither is registered, since studies write plays.
pub const NAME: &str = "cross_play";
/// Raised whenever a change of code moves the numbers of cross-play trials.
pub const VERSION: u32 = 1;

/// Who plays which role.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Cast {
    /// One member per role.
    pub roles: BTreeMap<String, Member>,
}

/// Who plays one role.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Member {
    /// Names of the seats, in the order of the environment.
    pub seats: Vec<String>,
    /// The agent, as in the trial that trained it.
    pub agent: Part,
    /// The trial whose final policy it plays; `None` for an agent that does not learn.
    pub trial: Option<String>,
}

impl Cast {
    /// The cast as the agent of a trial's key.
    ///
    /// # Panics
    /// Never: a struct of texts and JSON values serialises.
    #[must_use]
    pub fn part(&self) -> Part {
        let of = |(role, member): (&String, &Member)| {
            let at = format!("/roles/{role}/agent/config");
            member.agent.files.clone().into_iter().map(move |(pointer, content)| (format!("{at}{pointer}"), content))
        };
        let config = serde_json::to_value(self).expect("a cast serialises");
        Part { files: self.roles.iter().flat_map(of).collect(), ..Part::new(NAME, VERSION, config) }
    }

    /// The cast of a trial; `None` for a trial of another kind.
    #[must_use]
    pub fn of(key: &TrialKey) -> Option<Self> {
        is_cross_play(key).then(|| Self::deserialize(&*key.agent.config).ok()).flatten()
    }
}

/// True for a trial of a play.
#[must_use]
pub fn is_cross_play(key: &TrialKey) -> bool {
    key.agent.plugin == NAME
}

/// Ids of the trials whose policies a trial plays, each once; empty for a trial of another kind.
#[must_use]
pub fn sources(key: &TrialKey) -> Vec<String> {
    let members = key.agent.config.get("roles").and_then(Value::as_object).filter(|_| is_cross_play(key));
    let ids = members.into_iter().flat_map(|roles| roles.values()).filter_map(|member| member["trial"].as_str());
    let mut ids: Vec<String> = ids.map(Into::into).collect();
    ids.sort_unstable();
    ids.dedup();
    ids
}

/// The name of a cast: `ROLE:AGENT` words. No agent of a study has such a name.
#[must_use]
pub fn title<'a>(roles: impl IntoIterator<Item = (&'a str, &'a str)>) -> String {
    roles.into_iter().map(|(role, agent)| format!("{role}:{agent}")).collect::<Vec<_>>().join(" ")
}

/// Agents by role, from the name that [`title`] made.
#[must_use]
pub fn roles(title: &str) -> BTreeMap<&str, &str> {
    title.split(' ').filter_map(|word| word.split_once(':')).collect()
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use serde_json::json;

    pub(crate) fn cast(trial: &str) -> Cast {
        let member = |seat: &str, trial: Option<&str>| Member {
            seats: vec![seat.into()],
            agent: Part::new("learner", 1, json!({"width": 2})),
            trial: trial.map(Into::into),
        };
        Cast { roles: BTreeMap::from([("prey".into(), member("a", Some(trial))), ("rest".into(), member("b", None))]) }
    }

    fn key(agent: Part) -> TrialKey {
        let part = || Part::new("x", 1, Value::Null);
        TrialKey { environment: part(), agent, protocol: part(), seed: 0, numerics: 1, device: "cpu".into() }
    }

    #[test]
    fn a_cast_comes_back_from_a_key_with_its_sources() {
        let cast = cast("0a");
        let stored: TrialKey = serde_json::from_value(json!(key(cast.part()))).unwrap();
        assert_eq!(Cast::of(&stored), Some(cast));
        assert_eq!(sources(&stored), ["0a"]);
        assert!(sources(&key(Part::new("learner", 1, json!({"roles": {"prey": {"trial": "0a"}}})))).is_empty());
    }

    #[test]
    fn another_source_makes_another_trial_and_the_path_of_a_data_file_does_not() {
        assert_ne!(key(cast("0a").part()).id(), key(cast("0b").part()).id());
        let with_file = |path: &str| {
            let mut cast = cast("0a");
            let agent = &mut cast.roles.get_mut("prey").unwrap().agent;
            *agent = Part::new("learner", 1, json!({"table": {"file": path}}));
            agent.files.insert("/table/file".into(), "content".into());
            key(cast.part()).id()
        };
        assert_eq!(with_file("here.csv"), with_file("there/here.csv"));
    }

    #[test]
    fn a_title_is_read_back() {
        let title = title([("predators", "pr2"), ("prey", "tdom_ac")]);
        assert_eq!(title, "predators:pr2 prey:tdom_ac");
        assert_eq!(roles(&title), BTreeMap::from([("predators", "pr2"), ("prey", "tdom_ac")]));
    }
}
