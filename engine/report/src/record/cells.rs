//! The trials of a record: their ends, and the same results as from the store.

use super::{Block, Blocks, FinalValue, Record};
use analysis::results::Results;
use contract::{
    recorder::{Phase, Row, intern},
    standard_metrics::{SUCCESS, root_of_squares},
    trial::{Combination, Purpose, Trial},
    trial_end::{EndState, TrialEnd},
    trial_result::TrialResult,
};
use serde::{Deserialize, Serialize};
use std::{
    collections::{BTreeMap, BTreeSet, VecDeque},
    sync::Arc,
};

/// Role of a trial in its study.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TrialRole {
    /// A combination or a play, which tables, figures and claims show.
    #[default]
    Shown,
    /// An entry of `prepare`, whose artifacts other trials take.
    Prepared,
    /// A setting that a search tries.
    Tried,
}

impl TrialRole {
    fn of(purpose: &Purpose) -> Option<Self> {
        match purpose {
            Purpose::Cell | Purpose::Play(_) => Some(Self::Shown),
            Purpose::Prepared => Some(Self::Prepared),
            Purpose::Tried(_) => Some(Self::Tried),
            Purpose::Imported => None,
        }
    }

    fn is_shown(&self) -> bool {
        *self == Self::Shown
    }
}

/// The trials of an environment, agent and setting.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordedCell {
    /// Environment, play or entry of `prepare`.
    pub environment: String,
    /// Agent of the trials.
    pub agent: String,
    /// Setting of the trials.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub setting: String,
    /// Role of the trials in the study.
    #[serde(default, skip_serializing_if = "TrialRole::is_shown")]
    pub part: TrialRole,
    /// Mean wall-clock time in seconds of the trials without a time of their own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mean_wall_s: Option<f64>,
    /// Number of seeds planned, where not all of them ended.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub planned: Option<u32>,
    /// Ended trials, in the order of the plan; `None` where they are alike and all ended `ok`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trials: Option<Vec<RecordedTrial>>,
}

/// The end of a trial.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordedTrial {
    /// Seed of the trial.
    pub seed: u64,
    /// Id of the trial; `None` in records without ids.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub id: Option<String>,
    /// End state other than `ok`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub failed: Option<EndState>,
    /// Reason of an end other than `ok`; empty for `ok`.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub reason: String,
    /// Wall-clock time in seconds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wall_s: Option<f64>,
    /// Mean time of a decision in the final measurement, in seconds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub decision_s: Option<f64>,
}

impl RecordedCell {
    /// Environment, agent and setting.
    #[must_use]
    pub fn name(&self) -> Combination {
        Combination::of_words(&self.environment, &self.agent, &self.setting)
    }

    /// Number of seeds, ended or planned.
    #[must_use]
    pub fn seeds(&self) -> u32 {
        let seeds: BTreeSet<u64> = self.trials.iter().flatten().map(|it| it.seed).collect();
        self.planned.unwrap_or_else(|| number_of(&seeds))
    }

    /// The trials of results, in their order.
    #[must_use]
    pub fn all(results: &Results) -> Vec<Self> {
        let mut cells: Vec<(Self, BTreeSet<u64>)> = Vec::new();
        let mut places: BTreeMap<(TrialRole, Combination), usize> = BTreeMap::new();
        let all = results
            .prepared
            .iter()
            .chain(&results.tried)
            .chain(&results.trials);
        for it in all {
            let Some(part) = TrialRole::of(&it.trial.cell.purpose) else {
                continue;
            };
            let place = *places
                .entry((part, it.combination().clone()))
                .or_insert(cells.len());
            if place == cells.len() {
                cells.push((Self::new(part, it.combination()), BTreeSet::new()));
            }
            let (cell, missing) = &mut cells[place];
            match it.end.as_deref() {
                Some(end) => cell
                    .trials
                    .get_or_insert_default()
                    .push(RecordedTrial::of(&it.trial, end)),
                None => drop(missing.insert(it.trial.key.seed)),
            }
        }
        let with_planned = |(cell, mut seeds): (Self, BTreeSet<u64>)| {
            let is_whole = seeds.is_empty();
            seeds.extend(cell.trials.iter().flatten().map(|it| it.seed));
            Self {
                planned: (!is_whole).then(|| number_of(&seeds)),
                ..cell
            }
        };
        cells.into_iter().map(with_planned).collect()
    }

    fn new(part: TrialRole, of: &Combination) -> Self {
        Self {
            environment: of.environment.clone(),
            agent: of.agent.clone(),
            setting: of.point.words().to_owned(),
            part,
            trials: Some(Vec::new()),
            ..Self::default()
        }
    }
}

fn number_of(seeds: &BTreeSet<u64>) -> u32 {
    u32::try_from(seeds.len()).unwrap_or(u32::MAX)
}

impl RecordedTrial {
    fn of(trial: &Trial, end: &TrialEnd) -> Self {
        Self {
            seed: trial.key.seed,
            id: Some(trial.id.clone()),
            failed: Some(end.state).filter(|state| *state != EndState::Ok),
            reason: end.reason.clone(),
            wall_s: Some(end.wall_s),
            decision_s: end.decision_s,
        }
    }

    fn end(&self, mean_wall_s: Option<f64>) -> TrialEnd {
        TrialEnd {
            state: self.failed.unwrap_or(EndState::Ok),
            reason: self.reason.clone(),
            device: None,
            wall_s: self.wall_s.or(mean_wall_s).unwrap_or_default(),
            decision_s: self.decision_s,
            digest: String::new(),
        }
    }
}

/// A trial of a record that is not matched with a planned trial yet.
struct UnmatchedTrial {
    ended: RecordedTrial,
    mean_wall_s: Option<f64>,
    block: Option<Block>,
}

/// The results of planned trials, by environment, agent, setting and seed.
pub struct ResultIndex {
    left: BTreeMap<(TrialRole, Combination, u64), VecDeque<UnmatchedTrial>>,
    /// Wall-clock time in seconds of trials that the record does not list one by one, by environment and agent.
    alike: BTreeMap<(TrialRole, [String; 2]), Option<f64>>,
    measured: BTreeMap<(Combination, u64), Vec<FinalValue>>,
}

impl ResultIndex {
    /// The trials of a record with their measurements.
    #[must_use]
    pub fn of(record: &Record, mut blocks: Blocks) -> Self {
        let mut source = Self {
            left: BTreeMap::new(),
            alike: BTreeMap::new(),
            measured: BTreeMap::new(),
        };
        for cell in &record.cells {
            let (name, part, mean_wall_s) = (cell.name(), cell.part, cell.mean_wall_s);
            let Some(trials) = &cell.trials else {
                source
                    .alike
                    .insert((part, [name.environment, name.agent]), mean_wall_s);
                continue;
            };
            for ended in trials {
                let is_measured = part == TrialRole::Shown && ended.failed.is_none();
                let block = is_measured.then(|| blocks.take(&name, ended.seed)).flatten();
                let key = (part, name.clone(), ended.seed);
                source.left.entry(key).or_default().push_back(UnmatchedTrial {
                    ended: ended.clone(),
                    mean_wall_s,
                    block,
                });
            }
        }
        for it in &record.measured {
            let name = Combination::of_words(&it.environment, &it.agent, &it.setting);
            let values = source.measured.entry((name, it.seed)).or_default();
            values.push(it.clone());
        }
        source
    }

    /// The results of planned trials; trials without a record count as missing.
    #[must_use]
    pub fn results(&mut self, trials: &[Arc<Trial>]) -> Vec<TrialResult> {
        let ids: BTreeSet<&str> = trials.iter().map(|trial| trial.id.as_str()).collect();
        trials.iter().map(|trial| self.result(trial, &ids)).collect()
    }

    fn result(&mut self, trial: &Arc<Trial>, ids: &BTreeSet<&str>) -> TrialResult {
        let mut result = TrialResult::missing(Arc::clone(trial));
        let Some(part) = TrialRole::of(&trial.cell.purpose) else {
            return result;
        };
        let name = result.combination().clone();
        let alike = (part, [name.environment.clone(), name.agent.clone()]);
        if let Some(mean_wall_s) = self.alike.get(&alike) {
            result.end = Some(RecordedTrial::default().end(*mean_wall_s).into());
            return result;
        }
        let Some(left) = self.take((part, name.clone(), trial.key.seed), &trial.id, ids) else {
            return result;
        };
        result.end = Some(left.ended.end(left.mean_wall_s).into());
        if let Some(block) = left.block {
            (result.names, result.rows) = (block.names, block.rows);
            let measured = self.measured.get(&(name, trial.key.seed));
            measured.into_iter().flatten().for_each(|it| add(&mut result, it));
            mark_means(&mut result);
        }
        result
    }

    /// Takes the trial with this id if the record has the ids of the plan, otherwise the next one. Meetings may share
    /// all names and their seed.
    fn take(
        &mut self,
        key: (TrialRole, Combination, u64),
        id: &str,
        ids: &BTreeSet<&str>,
    ) -> Option<UnmatchedTrial> {
        let left = self.left.get_mut(&key)?;
        let has = |it: &UnmatchedTrial, id: &str| it.ended.id.as_deref() == Some(id);
        if let Some(place) = left.iter().position(|it| has(it, id)) {
            return left.remove(place);
        }
        let is_of_another = |it: &UnmatchedTrial| it.ended.id.as_deref().is_some_and(|id| ids.contains(id));
        let place = left.iter().position(|it| !is_of_another(it))?;
        left.remove(place)
    }
}

/// Adds a value at the step of the last row of the final measurement.
fn add(result: &mut TrialResult, measured: &FinalValue) {
    let last = result.rows.iter().rfind(|row| row.phase == Phase::Final).copied();
    let Some(last) = last else { return };
    let metric = intern(Arc::make_mut(&mut result.names), &measured.metric);
    result.rows.push(Row {
        metric,
        value: measured.value,
        ..last
    });
}

/// Marks the root of the mean square of every metric, so that none is computed from means if the record has none.
fn mark_means(result: &mut TrialResult) {
    let marked: Vec<String> = result.names.iter().map(|name| root_of_squares(name)).collect();
    let names = Arc::make_mut(&mut result.names);
    let unknown: Vec<String> = marked.into_iter().filter(|name| !names.contains(name)).collect();
    names.extend(unknown);
}

/// Removes the success values of a trial, which the study's rule computes again.
pub fn forget_success(result: &mut TrialResult) {
    let place = result.names.iter().position(|name| name == SUCCESS);
    result.rows.retain(|row| Some(usize::from(row.metric)) != place);
}
