//! Seeds and time that would decide an open verdict.

use analysis::results::Results;
use contract::{trial::Combination, trial_result::TrialResult};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};

/// Approximate effort that would decide an open verdict with a power of 80 %, on unseen seeds, if mean and spread
/// stay as they are.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Effort {
    /// Number of seeds in all, without those that have run.
    pub seeds: u32,
    /// Wall-clock time of their trials in seconds, one after another, including trials that they take artifacts from;
    /// rounded to tenths.
    pub trial_time_s: f64,
}

impl Effort {
    /// The effort of this many seeds of these combinations.
    pub(super) fn of(seeds: u32, rests_on: &BTreeSet<Combination>, results: &Results) -> Self {
        let seconds = f64::from(seeds) * seconds_per_seed(rests_on, results);
        Self {
            seeds,
            trial_time_s: (10.0 * seconds).round() / 10.0,
        }
    }
}

/// Time of all ended trials of these combinations and of their source trials, each once, divided by the number of
/// their seeds.
fn seconds_per_seed(rests_on: &BTreeSet<Combination>, results: &Results) -> f64 {
    let own: Vec<&TrialResult> = results
        .trials
        .iter()
        .filter(|trial| rests_on.contains(&trial.combination().clone()) && trial.end.is_some())
        .collect();
    let seeds: BTreeSet<u64> = own.iter().map(|trial| trial.trial.key.seed).collect();
    let seconds: f64 = with_sources(own, results).values().sum();
    #[allow(clippy::cast_precision_loss, reason = "a study has at most a million seeds")]
    let seeds = seeds.len().max(1) as f64;
    seconds / seeds
}

/// Seconds by id, of these trials and of all their source trials.
fn with_sources<'a>(trials: Vec<&'a TrialResult>, results: &'a Results) -> BTreeMap<&'a str, f64> {
    let all = [&results.prepared, &results.tried, &results.trials];
    let by_id: BTreeMap<&str, &TrialResult> = all
        .into_iter()
        .flatten()
        .map(|it| (it.trial.id.as_str(), it))
        .collect();
    let mut seconds = BTreeMap::new();
    let mut left = trials;
    while let Some(trial) = left.pop() {
        let took = trial.end.as_ref().map_or(0.0, |end| end.wall_s);
        if seconds.insert(trial.trial.id.as_str(), took).is_none() {
            let sources = trial.trial.key.sources();
            left.extend(sources.iter().filter_map(|id| by_id.get(id.as_str()).copied()));
        }
    }
    seconds
}

#[cfg(test)]
mod tests {
    use super::*;
    use contract::{
        artifact::{ArtifactKind, Taken},
        trial::Purpose,
    };
    use testing::synthetic::trial;

    #[test]
    fn a_seed_costs_its_trials_and_what_they_take_from_each_once() {
        let mut teacher = trial("school", "teacher", "", 0, &Vec::new());
        teacher.trial_mut().cell_mut().purpose = Purpose::Prepared;
        teacher.end.as_mut().unwrap().wall_s = 10.0;
        let mut trials = vec![teacher];
        for seed in 0..2 {
            for agent in ["pupil", "other", "third"] {
                trials.push(trial("work", agent, "", seed, &Vec::new()));
            }
        }
        let taken = Taken {
            trial: "school-teacher-0".into(),
            kind: ArtifactKind::Policy,
        };
        for pupil in trials.iter_mut().filter(|it| it.trial.cell.agent == "pupil") {
            let mut part = (*pupil.trial.key.environment).clone();
            part.artifacts.insert("/from".into(), taken.clone());
            pupil.trial_mut().key.environment = part.into();
        }
        let results = Results::of(trials);
        let name = |agent: &str| Combination::of_words("work", agent, "");
        let both: BTreeSet<Combination> = [name("pupil"), name("other")].into();
        // Two seeds: two trials of a second each, and ten seconds that both share.
        assert_eq!(
            Effort::of(4, &both, &results),
            Effort {
                seeds: 4,
                trial_time_s: 28.0
            }
        );
        let other: BTreeSet<Combination> = [name("other")].into();
        assert_eq!(Effort::of(3, &other, &results).trial_time_s, 3.0);
        // Trials that have not run have no known time.
        assert_eq!(
            Effort::of(3, &[name("nobody")].into(), &results).trial_time_s,
            0.0
        );
    }
}
