//! Results of searches for settings, as far as trials have run.

use crate::search::{Next, Point, Progress, Search, Tried, lineage};
use contract::{
    recorder::Phase,
    trial::Purpose,
    trial_end::{EndState, is_missing},
    trial_result::TrialResult,
};
use serde::{Deserialize, Serialize};
use serde_json::json;
use statistics::estimators::mean;
use std::collections::{BTreeMap, BTreeSet};

/// Result of a search for a setting.
#[derive(Debug, Clone)]
pub struct SearchResult {
    /// The search, as the study defines it.
    pub search: Search,
    /// The settings that were tried, in order.
    pub tried: Vec<TriedSetting>,
    /// The place of the chosen setting; `None` as long as the search goes on, or if every setting failed.
    pub chosen: Option<usize>,
}

/// A setting with the values of its metric.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TriedSetting {
    /// The setting, as `key=value` words.
    pub setting: String,
    /// The setting as values, one for each key.
    pub point: Point,
    /// The step at which its trials pause or, in a population, end; `None` if they run to the end of the protocol.
    pub stop: Option<u64>,
    /// The place of the setting whose learning it continues.
    pub parent: Option<usize>,
    /// The values by seed; failed trials have none.
    pub values: BTreeMap<u64, f64>,
    /// The values by pause and seed; `None` for a trial that makes the setting rank last.
    pub at_pauses: BTreeMap<u64, BTreeMap<u64, Option<f64>>>,
    /// Number of trials that ended in a state other than `ok`.
    pub failed: usize,
    /// States in which they ended.
    pub failures: BTreeSet<EndState>,
    /// Number of failed trials that say nothing about the setting, and for which the search waits.
    pub unseen: usize,
    /// Number of trials that have not ended.
    pub missing: usize,
}

/// Result of a setting for its search, up to the step that the search asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sight {
    /// It has its value at this step.
    Valued,
    /// It ranks last, since one of its trials ended unsuccessfully.
    Last,
    /// Some of its trials failed and have to run again.
    Failed,
    /// Its trials have not reached that step.
    Open,
}

impl TriedSetting {
    fn of(search: &Search, point: &Point, stop: Option<u64>, trials: &[&TrialResult]) -> Self {
        let mut tried = Self {
            point: point.clone(),
            stop,
            missing: search.seeds.len(),
            ..Self::default()
        };
        for trial in trials {
            let seed = trial.trial.key.seed;
            tried.setting = trial.trial.cell.point.words().to_owned();
            let end = trial.end.as_deref().filter(|end| !is_missing(Some(end)));
            let failure = end.map(|end| end.state).filter(|state| *state != EndState::Ok);
            let is_last = failure.is_some_and(|state| search.ranks_last(state));
            let is_seen = trial.is_ok() || is_last;
            tried.failures.extend(failure);
            tried.failed += usize::from(failure.is_some());
            tried.unseen += usize::from(failure.is_some() && !is_last);
            let value = trial.mean(Phase::Final, &search.metric).filter(|_| trial.is_ok());
            let mut at_pause =
                |pause: u64, value| tried.at_pauses.entry(pause).or_default().insert(seed, value);
            match stop.filter(|_| search.is_population()) {
                // A stretch of a schedule ends where it is compared, and its member continues in other trials.
                Some(pause) if is_seen => drop(at_pause(pause, value)),
                Some(_) => {}
                None => {
                    for pause in search.pauses() {
                        match trial.measured_at(&search.metric, *pause) {
                            Some(value) => drop(at_pause(*pause, Some(value))),
                            None if is_last => drop(at_pause(*pause, None)),
                            None if trial.is_ok() => {
                                if let Some(value) = last_before(trial, &search.metric, *pause).or(value) {
                                    at_pause(*pause, Some(value));
                                }
                            }
                            None => {}
                        }
                    }
                    tried.missing -= usize::from(end.is_some());
                    tried.values.extend(value.map(|value| (seed, value)));
                }
            }
        }
        tried
    }

    /// The value that the search finally compares; `None` if a trial has not ended successfully.
    #[must_use]
    pub fn value(&self) -> Option<f64> {
        let values: Vec<f64> = self.values.values().copied().collect();
        (self.failed + self.missing == 0 && !values.is_empty()).then(|| mean(&values))
    }

    fn known(&self, n_seeds: usize) -> Tried {
        let at_pause = |(pause, values): (&u64, &BTreeMap<u64, Option<f64>>)| {
            let all: Option<Vec<f64>> = values.values().copied().collect();
            (values.len() == n_seeds).then(|| (*pause, all.map(|all| mean(&all))))
        };
        Tried {
            point: self.point.clone(),
            parent: self.parent,
            value: self.value(),
            ended: self.missing + self.unseen == 0,
            pauses: self.at_pauses.iter().filter_map(at_pause).collect(),
        }
    }

    /// Its result for a search with this number of seeds.
    fn sight(&self, n_seeds: usize) -> Sight {
        let known = self.known(n_seeds);
        let value = match self.stop {
            Some(pause) => known.pauses.get(&pause).copied(),
            None => known.ended.then_some(known.value),
        };
        match value {
            Some(None) if self.failed > 0 => Sight::Last,
            Some(_) => Sight::Valued,
            None if self.unseen > 0 => Sight::Failed,
            None => Sight::Open,
        }
    }
}

/// The last value that a trial measured before a step. A program may end early, or measure at other steps.
fn last_before(trial: &TrialResult, metric: &str, step: u64) -> Option<f64> {
    let curve = trial.curve(Phase::Evaluate, metric);
    let before = curve.into_iter().rev().find(|(at, _)| *at < step);
    before.map(|(_, value)| value)
}

impl SearchResult {
    /// The result of a search so far; `trials` are all trials of its study.
    #[must_use]
    pub fn of(search: &Search, progress: &Progress, trials: &[TrialResult]) -> Self {
        let purpose = Purpose::Tried(search.name.clone());
        let own = trials.iter().filter(|it| it.trial.cell.purpose == purpose);
        let setting = |((place, point), trials): ((usize, &Point), Vec<&TrialResult>)| {
            let stop = progress.stops.get(place).copied().flatten();
            let stop = search.compared_at(place).or(stop);
            TriedSetting {
                parent: progress.parents.get(place).copied().flatten(),
                ..TriedSetting::of(search, point, stop, &trials)
            }
        };
        let of_settings = trials_of_settings(search, progress, own.collect());
        Self {
            tried: progress
                .points
                .iter()
                .enumerate()
                .zip(of_settings)
                .map(setting)
                .collect(),
            search: search.clone(),
            chosen: progress.chosen,
        }
    }

    /// The settings that lead to the chosen member of a population, including its own; none for other searches.
    #[must_use]
    pub fn schedule(&self) -> Vec<String> {
        let Some(chosen) = self.chosen.filter(|_| self.search.is_population()) else {
            return Vec::new();
        };
        let parents: Vec<Option<usize>> = self.tried.iter().map(|it| it.parent).collect();
        let way = lineage(&parents, chosen);
        way.into_iter()
            .map(|place| self.tried[place].setting.clone())
            .collect()
    }

    /// The place of the best setting of those that the search tries to their ends, as far as these have ended
    /// successfully.
    #[must_use]
    pub fn best(&self) -> Option<usize> {
        self.search
            .best(&self.known(), |place| self.tried[place].stop.is_none())
    }

    /// The trials that measure the chosen setting on seeds that the search has not used: none before it is chosen, or
    /// if other keys of the agent are also swept.
    #[must_use]
    pub fn fresh_trials<'t>(&self, trials: &'t [TrialResult]) -> Vec<&'t TrialResult> {
        let is_own = |it: &&TrialResult| {
            let cell = &it.trial.cell;
            cell.purpose == Purpose::Cell
                && cell.agent == self.search.agent
                && cell.environment == self.search.environment
        };
        let own: Vec<&TrialResult> = trials.iter().filter(is_own).collect();
        let setting = |it: &&TrialResult| it.trial.cell.point.words().to_owned();
        let is_one = own.windows(2).all(|pair| setting(&pair[0]) == setting(&pair[1]));
        if self.chosen.is_some() && is_one {
            own
        } else {
            Vec::new()
        }
    }

    /// Settings that the search tries to their ends and that have a result there, the best first.
    #[must_use]
    pub fn ranked(&self) -> Vec<&TriedSetting> {
        let ranking = self.search.ranking(&self.known());
        let seen =
            |it: &&TriedSetting| it.stop.is_none() && matches!(self.sight(it), Sight::Valued | Sight::Last);
        ranking
            .into_iter()
            .map(|place| &self.tried[place])
            .filter(seen)
            .collect()
    }

    /// Result of a setting for the search.
    #[must_use]
    pub fn sight(&self, tried: &TriedSetting) -> Sight {
        tried.sight(self.search.seeds.len())
    }

    /// The settings with this result, in order.
    #[must_use]
    pub fn seen_so(&self, sight: Sight) -> Vec<&TriedSetting> {
        self.tried.iter().filter(|it| self.sight(it) == sight).collect()
    }

    /// Whether every setting was tried as far as planned and none can be chosen.
    #[must_use]
    pub fn found_nothing(&self) -> bool {
        // A setting with a value can be chosen, and the next step takes time.
        self.chosen.is_none()
            && self.best().is_none()
            && matches!(self.search.next(&self.known()), Next::Chosen(None, _))
    }

    /// The tried settings with their values, by which the search decides the next ones.
    #[must_use]
    pub fn known(&self) -> Vec<Tried> {
        let seeds = self.search.seeds.len();
        self.tried.iter().map(|it| it.known(seeds)).collect()
    }
}

/// The trials of each setting of a search; `own` are all of its trials in the order of the plan.
fn trials_of_settings<'t>(
    search: &Search,
    progress: &Progress,
    own: Vec<&'t TrialResult>,
) -> Vec<Vec<&'t TrialResult>> {
    if search.is_population() {
        // A setting may occur several times, each time continuing from another one.
        let mut of_place = own.chunks(search.seeds.len()).map(<[_]>::to_vec);
        return progress
            .points
            .iter()
            .map(|_| of_place.next().unwrap_or_default())
            .collect();
    }
    // If trials pause, those that are set aside come first in the plan.
    let mut by_point: BTreeMap<String, BTreeMap<u64, &TrialResult>> = BTreeMap::new();
    for it in own {
        let point = json!(it.trial.cell.point.values()).to_string();
        by_point.entry(point).or_default().insert(it.trial.key.seed, it);
    }
    let of_point = |point: &Point| by_point.get(&json!(point).to_string());
    let all = progress.points.iter().map(of_point);
    all.map(|seeds| seeds.into_iter().flat_map(BTreeMap::values).copied().collect())
        .collect()
}

#[cfg(test)]
#[path = "searched_tests.rs"]
mod tests;
