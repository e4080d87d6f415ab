//! Results of a study: the frame that tables, figures and claims read.

mod origin;
mod repeats;
mod search_words;
mod searched;
mod told;

pub use origin::Origin;
pub use repeats::{Programs, RepeatCheck, sentences as repeats_in_words};
pub use search_words::{search_in_words, sentence as search_sentence};
pub use searched::{SearchResult, Sight, TriedSetting};
pub use told::{Cost, Printed, Ran, Told};

use contract::{
    drawing::Drawings,
    trial::{Combination, Purpose},
    trial_end::is_missing,
    trial_result::{Success, TrialResult},
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use statistics::{Seeds, spending::SequentialDesign};
use std::collections::{BTreeMap, BTreeSet};

/// All trials of a study, in the order of the plan.
#[derive(Debug, Clone, Default)]
pub struct Results {
    /// The trials of combinations and plays.
    pub trials: Vec<TrialResult>,
    /// The trials of `prepare`, which leave an artifact for others and are shown only as budgets.
    pub prepared: Vec<TrialResult>,
    /// The trials of settings that searches tried, which are shown only as budgets.
    pub tried: Vec<TrialResult>,
    /// Results of searches for settings.
    pub searches: Vec<SearchResult>,
    /// The looks that the study plans; `None` if its number of seeds is fixed.
    pub design: Option<SequentialDesign>,
    /// The first seed of the design.
    pub first_seed: u64,
    /// The rounds of seeds that are pooled, in order; empty if there is only one.
    pub rounds: Vec<Round>,
    /// The study's criterion of a success.
    pub success: Option<Success>,
    /// Length of the source's training.
    pub paper_budget: Option<PaperBudget>,
    /// Drawings of trials, by id, as far as figures of the study show them.
    pub drawings: BTreeMap<String, Drawings>,
    /// Sources of imported runs, which are among the trials.
    pub imported: Vec<Origin>,
    /// Programs with a trial that was computed twice.
    pub repeated: Vec<RepeatCheck>,
    /// Statements on all trials together, if the results are read from a record.
    pub told: Option<Told>,
}

/// Length of the source's training.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PaperBudget {
    /// Steps of each training, in the unit of the protocol's `steps`.
    #[schemars(range(min = 1))]
    pub steps: u64,
    /// Agents with that training; all that learned where absent.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub agents: Vec<String>,
}

/// A round of seeds: those of a study, or of a confirmation.
#[derive(Debug, Clone, PartialEq)]
pub struct Round {
    /// The seeds, rising.
    seeds: Vec<u64>,
    /// The looks that were planned; `None` if the number of seeds is fixed.
    design: Option<SequentialDesign>,
}

impl Round {
    fn of(results: &Results) -> Self {
        // Imported runs have seeds of their own.
        let own = results.trials.iter().filter(|it| !it.is_imported());
        let seeds = own.map(|it| it.trial.key.seed);
        let seeds: BTreeSet<u64> = seeds.filter(|seed| *seed >= results.first_seed).collect();
        Self {
            seeds: seeds.into_iter().collect(),
            design: results.design.clone(),
        }
    }

    /// The seeds of this round, if it is not pooled with others.
    fn alone(&self, is_complete: impl Fn(u64, (u32, u64)) -> bool) -> Seeds {
        let first = self.seeds.first().copied().unwrap_or_default();
        let Some(design) = &self.design else {
            return Seeds::default();
        };
        let complete = self
            .looks()
            .into_iter()
            .take_while(|look| is_complete(first, *look));
        Seeds {
            limits: complete.map(|(_, limit)| limit).collect(),
            design: Some(design.clone()),
            rounds: 0,
        }
    }

    /// The seeds of each look: their number, and the upper limit of the seeds.
    fn looks(&self) -> Vec<(u32, u64)> {
        let Some(first) = self.seeds.first() else {
            return Vec::new();
        };
        match &self.design {
            Some(design) => design
                .looks()
                .iter()
                .map(|most| (*most, first + u64::from(*most)))
                .collect(),
            None => {
                let last = self.seeds.last().unwrap_or(first);
                vec![(u32::try_from(self.seeds.len()).unwrap_or(u32::MAX), last + 1)]
            }
        }
    }
}

impl Results {
    /// Trials of a study with a fixed number of seeds and without a criterion of success.
    #[must_use]
    pub fn of(mut trials: Vec<TrialResult>) -> Self {
        let mut those = |is: fn(&Purpose) -> bool| {
            let found = trials.extract_if(.., |it| is(&it.trial.cell.purpose));
            found.collect()
        };
        let tried = those(|purpose| matches!(purpose, Purpose::Tried(_)));
        let prepared = those(|purpose| *purpose == Purpose::Prepared);
        Self {
            trials,
            prepared,
            tried,
            ..Self::default()
        }
    }

    /// The trials of several rounds as those of one study, judged by all of their seeds. Each round has larger seeds
    /// than the one before.
    #[must_use]
    pub fn pooled(rounds: &[&Self]) -> Self {
        let Some((first, others)) = rounds.split_first() else {
            return Self::default();
        };
        let mut all = Self {
            drawings: BTreeMap::new(),
            ..(*first).clone()
        };
        for other in others {
            all.trials.extend(other.trials.iter().cloned());
            all.prepared.extend(other.prepared.iter().cloned());
            all.tried.extend(other.tried.iter().cloned());
        }
        if !others.is_empty() {
            all.rounds = rounds.iter().map(|round| Round::of(round)).collect();
        }
        all
    }

    /// The upper limit of the seeds that count, for each planned look; empty if the number of seeds is fixed.
    #[must_use]
    pub fn limits(&self) -> Vec<u64> {
        let looks = self.design.iter().flat_map(SequentialDesign::looks);
        looks.map(|most| self.first_seed + u64::from(*most)).collect()
    }

    /// The seeds of some trials by which a statement may be decided: those of looks at which every trial has ended. A
    /// trial that was killed from outside has not ended: it runs again.
    #[must_use]
    pub fn seeds_of(&self, trials: &[&TrialResult]) -> Seeds {
        if self.design.is_none() && self.rounds.is_empty() {
            return Seeds::default();
        }
        // Seeds of a play have several trials each if all meet all.
        let mut ended: BTreeMap<Combination, BTreeMap<u64, bool>> = BTreeMap::new();
        for trial in trials.iter().filter(|it| !it.is_imported()) {
            let seeds = ended.entry(trial.combination().clone()).or_default();
            *seeds.entry(trial.trial.key.seed).or_insert(true) &= !is_missing(trial.end.as_deref());
        }
        let is_complete = |first: u64, (most, limit): (u32, u64)| {
            ended
                .values()
                .all(|seeds| seeds.range(first..limit).filter(|(_, ended)| **ended).count() == most as usize)
        };
        let has_trials = |round: &&Round| {
            let (Some(first), Some(last)) = (round.seeds.first(), round.seeds.last()) else {
                return false;
            };
            ended
                .values()
                .any(|seeds| seeds.range(first..=last).next().is_some())
        };
        let own = Round {
            seeds: vec![self.first_seed],
            design: self.design.clone(),
        };
        let rounds: Vec<&Round> = self.rounds.iter().filter(has_trials).collect();
        match rounds[..] {
            [] => own.alone(is_complete),
            [one] => one.alone(is_complete),
            _ => pooled_seeds(&rounds, is_complete),
        }
    }
}

/// The looks of several rounds as those of one design: the complete ones of each, and the rest of the last.
fn pooled_seeds(rounds: &[&Round], is_complete: impl Fn(u64, (u32, u64)) -> bool) -> Seeds {
    let (mut numbers, mut limits, mut so_far) = (Vec::new(), Vec::new(), 0);
    for (index, round) in rounds.iter().enumerate() {
        let first = round.seeds.first().copied().unwrap_or_default();
        let looks = round.looks();
        let complete = looks.iter().take_while(|look| is_complete(first, **look)).count();
        let is_last = index + 1 == rounds.len();
        // A look has at least two seeds.
        let counted = |(number, _): &(u32, u64)| so_far + number >= 2;
        let shown = if is_last { looks.len() } else { complete };
        let ended = looks[..complete].iter().filter(|look| counted(look));
        limits.extend(ended.map(|(_, limit)| *limit));
        let shown = looks[..shown].iter().filter(|look| counted(look));
        numbers.extend(shown.map(|(number, _)| so_far + number));
        so_far += complete.checked_sub(1).map_or(0, |last| looks[last].0);
    }
    Seeds {
        design: SequentialDesign::try_from(numbers).ok(),
        limits,
        rounds: rounds.len(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use contract::{
        Phase,
        standard_metrics::{TIME_PER_DECISION, TIME_PER_UPDATE, UPDATES, WALL_TIME},
        trial_end::EndState,
    };
    use std::sync::Arc;
    use testing::synthetic::{ended, trial};

    #[test]
    fn a_look_is_complete_when_all_its_trials_ended_and_none_has_to_run_again() {
        let complete = |last: Option<EndState>| {
            let mut trials: Vec<TrialResult> = (0..3)
                .map(|seed| trial("cells", "equal", "", seed, &Vec::new()))
                .collect();
            trials[2] = match last {
                Some(state) => ended(trials[2].clone(), state, "told"),
                None => TrialResult {
                    end: None,
                    ..trials[2].clone()
                },
            };
            let results = Results {
                design: Some(SequentialDesign::new(vec![3, 6])),
                ..Results::of(trials)
            };
            results
                .seeds_of(&results.trials.iter().collect::<Vec<_>>())
                .complete()
        };
        assert_eq!(
            [EndState::Ok, EndState::Nan, EndState::Timeout].map(|state| complete(Some(state))),
            [1, 1, 1]
        );
        assert_eq!([complete(Some(EndState::Killed)), complete(None)], [0, 0]);
    }

    #[test]
    fn a_look_counts_the_seeds_from_the_first_of_its_design_on() {
        let trials = (100..103).map(|seed| trial("cells", "equal", "", seed, &Vec::new()));
        let complete = |first_seed| {
            let results = Results {
                design: Some(SequentialDesign::new(vec![3, 6])),
                first_seed,
                ..Results::of(trials.clone().collect())
            };
            let seeds = results.seeds_of(&results.trials.iter().collect::<Vec<_>>());
            (seeds.complete(), seeds.limits())
        };
        assert_eq!(complete(100), (1, vec![103]));
        assert_eq!((complete(0).0, complete(101).0), (0, 0));
    }

    #[test]
    fn rounds_are_looks_at_one_growing_sample() {
        let trials = |agent: &str, seeds: &[u64]| -> Vec<TrialResult> {
            let one = |seed: &u64| trial("cells", agent, "", *seed, &Vec::new());
            seeds.iter().map(one).collect()
        };
        let study = Results::of([trials("equal", &[0, 1, 2]), trials("other", &[0, 1, 2])].concat());
        let round = |seeds: &[u64]| Results {
            design: Some(SequentialDesign::new(vec![3, 6])),
            first_seed: 100,
            ..Results::of(trials("equal", seeds))
        };
        let last = Results::of(trials("equal", &[200, 201]));
        let of = |results: &Results, agent: &str| {
            let trials: Vec<_> = results
                .trials
                .iter()
                .filter(|it| it.trial.cell.agent == agent)
                .collect();
            let seeds = results.seeds_of(&trials);
            (seeds.design.map(Vec::from), seeds.limits, seeds.rounds)
        };
        // The first look of the round is complete; its other looks never ran.
        let all = Results::pooled(&[&study, &round(&[100, 101, 102, 103]), &last]);
        assert_eq!(of(&all, "equal"), (Some(vec![3, 6, 8]), vec![3, 103, 202], 3));
        // A look of the last round is still to come.
        let two = Results::pooled(&[&study, &round(&[100, 101, 102])]);
        assert_eq!(of(&two, "equal"), (Some(vec![3, 6, 9]), vec![3, 103], 2));
        // A combination with trials in only one round has the looks of that round.
        assert_eq!(of(&two, "other"), (None, vec![], 0));
        let alone = Results::pooled(&[&round(&[100, 101, 102])]);
        assert_eq!(of(&alone, "equal"), (Some(vec![3, 6]), vec![103], 0));
    }

    #[test]
    fn times_are_those_of_the_end_and_over_the_updates() {
        let mut learner = trial(
            "cells",
            "learner",
            "",
            0,
            &vec![(Phase::Final, 8, 0, UPDATES, 20.0)],
        );
        learner.add_times();
        // A synthetic trial took a second.
        assert_eq!(learner.mean(Phase::Final, WALL_TIME), Some(1.0));
        assert_eq!(learner.mean(Phase::Final, TIME_PER_UPDATE), Some(0.05));
        assert!(
            learner
                .select(Phase::Final, TIME_PER_UPDATE)
                .all(|row| row.step == 8)
        );
        assert_eq!(learner.mean(Phase::Final, TIME_PER_DECISION), None);
        let mut rule = trial("cells", "rule", "", 0, &vec![(Phase::Final, 0, 0, "return", 1.0)]);
        if let Some(end) = &mut rule.end {
            end.decision_s = Some(0.25);
        }
        rule.add_times();
        assert_eq!(rule.mean(Phase::Final, WALL_TIME), Some(1.0));
        assert_eq!(rule.mean(Phase::Final, TIME_PER_UPDATE), None);
        assert_eq!(rule.mean(Phase::Final, TIME_PER_DECISION), Some(0.25));
        let mut failed = ended(rule, EndState::Failed, "told");
        (failed.names, failed.rows) = (Arc::default(), Vec::new());
        failed.add_times();
        assert!(failed.rows.is_empty());
    }
}
