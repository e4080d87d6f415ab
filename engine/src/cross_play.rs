//! Cross-play: agents that were trained in different trials meet in one environment, each in a role of its
//! own.
//!
//! A *play* of a study names an environment, *roles* (every seat belongs to one) and agents. Each ordered
//! combination of agents over roles and each seed make one trial that measures and learns nothing: its
//! [`Cast`](crate::cast::Cast) names by role the trial whose final policy is played. Seed `k` of one agent
//! meets seed `k` of the others.

use crate::{
    Phase,
    results::{Results, TrialResult},
    trial::Purpose,
};
use std::collections::{BTreeMap, BTreeSet};

/// The name of an encounter: `ROLE:AGENT` words.
#[must_use]
pub fn title(roles: &BTreeMap<String, String>) -> String {
    roles
        .iter()
        .map(|(role, agent)| format!("{role}:{agent}"))
        .collect::<Vec<_>>()
        .join(" ")
}

/// The trials of one play, in the order of the plan.
#[derive(Debug, Clone)]
pub struct Encounters<'a> {
    trials: Vec<(&'a BTreeMap<String, String>, &'a TrialResult)>,
    floors: BTreeSet<&'a str>,
}

impl<'a> Encounters<'a> {
    /// The trials of the play called `play`; none where the results know no such play.
    #[must_use]
    pub fn of(results: &'a Results, play: &str) -> Self {
        let of_play = |it: &'a TrialResult| match &it.trial.purpose {
            Purpose::Play(roles) if it.trial.environment == play => Some((roles, it)),
            _ => None,
        };
        let trials: Vec<_> = results.trials.iter().filter_map(of_play).collect();
        let untrained = |(roles, it): &(&'a BTreeMap<String, String>, &'a TrialResult)| {
            let members = it.trial.key.agent.cast().into_iter().flat_map(|cast| &cast.roles);
            let floors = members.filter(|(_, member)| member.trial.is_none());
            floors
                .filter_map(|(role, _)| roles.get(role).map(String::as_str))
                .collect::<Vec<_>>()
        };
        let floors = trials.iter().flat_map(untrained).collect();
        Self { trials, floors }
    }

    /// True where the results know no trial of the play.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.trials.is_empty()
    }

    /// The agents that play a role, in the order of the plan.
    #[must_use]
    pub fn players(&self, role: &str) -> Vec<&'a str> {
        let mut names = Vec::new();
        for name in self
            .trials
            .iter()
            .filter_map(|(roles, _)| roles.get(role).map(String::as_str))
        {
            if !names.contains(&name) {
                names.push(name);
            }
        }
        names
    }

    /// True for an agent that was not trained: a floor, which has no part in means over the others.
    #[must_use]
    pub fn is_floor(&self, agent: &str) -> bool {
        self.floors.contains(agent)
    }

    /// The trials in which the given roles are played by the given agents, and all other roles by agents that
    /// were trained.
    #[must_use]
    pub fn trials(&self, cast: &[(&str, &str)]) -> Vec<&'a TrialResult> {
        let fits = |(role, agent): (&String, &String)| match cast.iter().find(|(fixed, _)| fixed == role) {
            Some((_, wanted)) => *wanted == agent.as_str(),
            None => !self.is_floor(agent),
        };
        self.trials
            .iter()
            .filter(|(roles, _)| roles.iter().all(fits))
            .map(|(_, trial)| *trial)
            .collect()
    }

    /// The mean of a metric over those trials, by seed. A seed without one of its trials has no value: means
    /// over different opponents cannot be compared.
    #[must_use]
    pub fn by_seed(&self, cast: &[(&str, &str)], metric: &str) -> BTreeMap<u64, f64> {
        let mut seeds: BTreeMap<u64, Vec<Option<f64>>> = BTreeMap::new();
        for it in self.trials(cast) {
            let value = if it.is_ok() {
                it.mean(Phase::Final, metric)
            } else {
                None
            };
            seeds.entry(it.trial.key.seed).or_default().push(value);
        }
        let mean = |values: Vec<Option<f64>>| {
            let values: Vec<f64> = values.into_iter().collect::<Option<_>>()?;
            Some(crate::statistics::estimators::mean(&values))
        };
        seeds
            .into_iter()
            .filter_map(|(seed, values)| Some((seed, mean(values)?)))
            .collect()
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::{
        cast::{Cast, Member, Seating},
        report::synthetic::trial,
        trial::Part,
    };

    /// A trial of the play `pursuit`; the agent `still` was not trained.
    pub(crate) fn encounter(prey: &str, predators: &str, seed: u64, score: f64) -> TrialResult {
        let roles = BTreeMap::from(
            [("predators", predators), ("prey", prey)].map(|(role, it)| (role.to_string(), it.to_string())),
        );
        let mut result = trial(
            "pursuit",
            &title(&roles),
            "",
            seed,
            &vec![(Phase::Final, 0, 0, "score", score)],
        );
        let member = |agent: &str| Member {
            seats: Vec::new(),
            agent: Part::new("x", 1, serde_json::Value::Null),
            trial: (agent != "still").then(|| format!("{agent}-{seed}")),
        };
        let cast = Cast {
            roles: [
                ("predators".into(), member(predators)),
                ("prey".into(), member(prey)),
            ]
            .into(),
        };
        result.trial.key.agent = Seating::Cast(cast);
        result.trial.purpose = Purpose::Play(roles);
        result
    }

    #[test]
    fn means_are_over_trained_opponents_and_need_all_of_them() {
        let mut trials = vec![trial(
            "tag",
            "a",
            "",
            0,
            &vec![(Phase::Final, 0, 0, "score", 100.0)],
        )];
        for (seed, shift) in [(0, 0.0), (1, 10.0)] {
            trials.push(encounter("a", "a", seed, 1.0 + shift));
            trials.push(encounter("a", "b", seed, 3.0 + shift));
            trials.push(encounter("a", "still", seed, 50.0));
        }
        trials.push(encounter("a", "a", 2, 1.0));
        let mut unrun = encounter("a", "b", 2, 1.0);
        unrun.end = None;
        trials.push(unrun);
        let results = Results::of(trials);
        let encounters = Encounters::of(&results, "pursuit");
        assert_eq!(encounters.players("predators"), ["a", "b", "still"]);
        assert!(encounters.is_floor("still") && !encounters.is_floor("a"));
        assert_eq!(
            encounters.by_seed(&[("prey", "a")], "score"),
            BTreeMap::from([(0, 2.0), (1, 12.0)])
        );
        assert_eq!(
            encounters
                .by_seed(&[("prey", "a"), ("predators", "still")], "score")
                .len(),
            2
        );
        assert!(Encounters::of(&results, "tag").is_empty());
    }
}
