//! Cross-play: agents that were trained in different trials meet in one environment, each in a role of its
//! own.
//!
//! A *play* of a study names an environment, *roles* (every seat belongs to one) and agents. Each ordered combination
//! of agents over roles and each seed make one trial that measures but learns nothing. Its
//! [`Cast`](contract::cast::Cast) names, by role, the trial whose final policy is played. Seed `k` of one agent meets
//! seed `k` of the others, or every seed of theirs with `pairs: all`.
//!
//! If all meet all, values that share a policy are not independent, and n * n of them are no sample of that size. The
//! value of seed k is then the sum of its effects in every role that it plays:
//!
//! | symbol | here |
//! |---|---|
//! | y(i, j) | value of the meeting of seed i in the first role and seed j in the second |
//! | m, m_r(k) | the mean of all meetings, and of those in which seed k plays role r |
//! | v(k) = m + sum over r of (m_r(k) - m) | the value of seed k; their mean is m |
//!
//! With y(i, j) = mu + a_i + b_j the v(k) are mu + a_k + b_k up to a constant. Their spread over k is therefore that of
//! m, even if a_k and b_k come from one training and depend on each other.

use crate::results::Results;
use contract::{Phase, trial::Purpose, trial_result::TrialResult};
use statistics::estimators::mean;
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
    /// Seeds of the trials that trained a player, by id.
    seeds: BTreeMap<&'a str, u64>,
}

impl<'a> Encounters<'a> {
    /// The trials of the play called `play`; none if the results contain no such play.
    #[must_use]
    pub fn of(results: &'a Results, play: &str) -> Self {
        let of_play = |it: &'a TrialResult| match &it.trial.cell.purpose {
            Purpose::Play(roles) if it.trial.cell.environment == play => Some((roles, it)),
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
        let seeds = results.trials.iter();
        let seeds = seeds
            .map(|it| (it.trial.id.as_str(), it.trial.key.seed))
            .collect();
        Self {
            trials,
            floors,
            seeds,
        }
    }

    /// Whether the results have no trial of the play.
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

    /// Whether an agent was not trained. Such a floor is left out of means over the others.
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

    /// The mean of a metric over those trials, by seed; if all seeds meet all, the value v(k) of the module. A seed
    /// without one of its trials has no value, since means over different opponents cannot be compared.
    #[must_use]
    pub fn by_seed(&self, cast: &[(&str, &str)], metric: &str) -> BTreeMap<u64, f64> {
        let mut of_combinations: BTreeMap<&str, Vec<MatchupValue<'_>>> = BTreeMap::new();
        for it in self.trials(cast) {
            let meetings = of_combinations.entry(&it.trial.cell.agent).or_default();
            meetings.push(self.meeting(it, metric));
        }
        let mut seeds: BTreeMap<u64, Vec<Option<f64>>> = BTreeMap::new();
        for meetings in of_combinations.values() {
            for (seed, value) in of_seeds(meetings) {
                seeds.entry(seed).or_default().push(value);
            }
        }
        let mean_of_known = |values: Vec<Option<f64>>| {
            let values: Vec<f64> = values.into_iter().collect::<Option<_>>()?;
            Some(mean(&values))
        };
        seeds
            .into_iter()
            .filter_map(|(seed, values)| Some((seed, mean_of_known(values)?)))
            .collect()
    }

    /// The same play with seeds below a number, as it was before later seeds had run.
    #[must_use]
    pub fn until(&self, limit: u64) -> Self {
        // The seed of a meeting is the latest of those that meet.
        let is_early = |(_, it): &&(_, &TrialResult)| it.trial.key.seed < limit;
        Self {
            trials: self.trials.iter().filter(is_early).copied().collect(),
            ..self.clone()
        }
    }

    /// Whether seeds meet seeds other than their own.
    #[must_use]
    pub fn is_crossed(&self) -> bool {
        self.trials
            .iter()
            .any(|(_, it)| self.meeting(it, "").is_crossed())
    }

    fn meeting(&self, it: &'a TrialResult, metric: &str) -> MatchupValue<'a> {
        let members = it.trial.key.agent.cast().into_iter().flat_map(|cast| &cast.roles);
        let seed = |id: &String| self.seeds.get(id.as_str()).copied();
        let trained =
            members.filter_map(|(role, member)| Some((role.as_str(), seed(member.trial.as_ref()?)?)));
        MatchupValue {
            seed: it.trial.key.seed,
            roles: trained.collect(),
            value: it.is_ok().then(|| it.mean(Phase::Final, metric)).flatten(),
        }
    }
}

/// The value of one trial of a play and the seeds that met in it.
struct MatchupValue<'a> {
    /// Seed of the trial itself.
    seed: u64,
    /// Seed of every trained player, by role.
    roles: BTreeMap<&'a str, u64>,
    value: Option<f64>,
}

impl MatchupValue<'_> {
    fn is_crossed(&self) -> bool {
        self.roles.values().any(|seed| *seed != self.seed)
    }

    fn has(&self, seed: u64) -> bool {
        self.roles.values().any(|it| *it == seed)
    }
}

/// The value v(k) of each seed; `None` if one of its trials has no value.
fn of_seeds(meetings: &[MatchupValue<'_>]) -> Vec<(u64, Option<f64>)> {
    if !meetings.iter().any(MatchupValue::is_crossed) {
        return meetings.iter().map(|it| (it.seed, it.value)).collect();
    }
    let seeds: BTreeSet<u64> = meetings
        .iter()
        .flat_map(|it| it.roles.values().copied())
        .collect();
    let incomplete = |seed: u64| meetings.iter().any(|it| it.value.is_none() && it.has(seed));
    let (gone, complete): (Vec<u64>, Vec<u64>) = seeds.into_iter().partition(|seed| incomplete(*seed));
    let counted: Vec<(&MatchupValue<'_>, f64)> = meetings
        .iter()
        .filter(|it| !gone.iter().any(|seed| it.has(*seed)))
        .filter_map(|it| Some((it, it.value?)))
        .collect();
    let mean_where = |fits: &dyn Fn(&MatchupValue<'_>) -> bool| {
        let fitting = counted.iter().filter(|(it, _)| fits(it));
        mean(&fitting.map(|(_, value)| *value).collect::<Vec<_>>())
    };
    let whole = mean_where(&|_| true);
    let roles: BTreeSet<&str> = meetings.iter().flat_map(|it| it.roles.keys().copied()).collect();
    let value = |seed: u64| {
        let added =
            |role: &&str| mean_where(&|it: &MatchupValue<'_>| it.roles.get(role) == Some(&seed)) - whole;
        whole + roles.iter().map(added).sum::<f64>()
    };
    let known = complete.iter().map(|seed| (*seed, Some(value(*seed))));
    known.chain(gone.iter().map(|seed| (*seed, None))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use testing::{
        encounters::{crossed, encounter, trained},
        synthetic::trial,
    };

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

    #[test]
    fn a_seed_that_meets_all_stands_for_what_it_adds_on_both_sides() {
        let cast = [("prey", "a"), ("predators", "b")];
        let of = |unrun: Option<usize>| {
            let mut meetings = crossed(["a", "b"], [&[0.0, 3.0, 6.0], &[-1.0, 0.0, 1.0]]);
            if let Some(index) = unrun {
                meetings[index].end = None;
            }
            let results = Results::of(trained(3).chain(meetings).collect());
            let encounters = Encounters::of(&results, "pursuit");
            assert!(encounters.is_crossed());
            encounters.by_seed(&cast, "score")
        };
        // mu + a_k + b_k of an additive table, whose mean is that of the nine values.
        assert_eq!(of(None), BTreeMap::from([(0, 0.0), (1, 4.0), (2, 8.0)]));
        // Both seeds of the missing meeting are left out, and the third met only itself.
        assert_eq!(of(Some(1)), BTreeMap::from([(2, 8.0)]));
    }
}
