//! What is known of a study's trials: the frame that tables, figures and claims read.

mod repeats;
mod searched;
mod told;

use contract::{
    standard_metrics::{OWN_STEPS, SUCCESS, UPDATES},
    trial::CellName,
};
pub use repeats::{Programs, Recorded, RepeatCheck, Repeats, sentences as repeats_in_words};
pub use searched::{SearchResult, Sight, TriedSetting};
pub use told::{Cost, Printed, Ran, Told};

use crate::{imported::Origin, store::is_missing, training_share::PaperBudget};
use contract::{
    Metric, PerEpisode,
    drawing::Drawings,
    recorder::{Phase, Row},
    trial::{Purpose, Trial},
};
use document::plain_text::read_brief;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use statistics::{Seeds, spending::Design};
use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
};

/// The metric that every trial has when results are read: how long it took, in seconds.
pub const WALL_TIME: &str = "wall_time";

/// The metric that trials of agents that learn have when results are read: how long they took over the
/// updates that they made, in seconds.
pub const TIME_PER_UPDATE: &str = "time_per_update";

/// The metric that trials which measure episodes at their end have when results are read: how long the agent
/// took for a decision there, in seconds.
pub const TIME_PER_DECISION: &str = "time_per_decision";

/// What is said wherever a time is shown.
pub const TIMES_ARE_OF_THE_MACHINE: &str = "Times are measurements of the machine that computed the trials \
                                            and of what else it did; they differ from run to run.";

/// What [`WALL_TIME`] says, for names, units and directions.
#[must_use]
pub fn wall_time_metric() -> Metric {
    Metric::new(WALL_TIME, "s", "wall-clock time of the trial")
        .lower_is_better()
        .per_episode(PerEpisode::Last)
}

/// What [`TIME_PER_UPDATE`] says, for names, units and directions.
#[must_use]
pub fn time_per_update_metric() -> Metric {
    let about = "wall-clock time of the trial over the updates that the agent made";
    Metric::new(TIME_PER_UPDATE, "s", about)
        .lower_is_better()
        .per_episode(PerEpisode::Last)
}

/// What [`TIME_PER_DECISION`] says, for names, units and directions.
#[must_use]
pub fn time_per_decision_metric() -> Metric {
    let about = "wall-clock time that the agent took for a decision of the final measurement";
    Metric::new(TIME_PER_DECISION, "s", about)
        .lower_is_better()
        .per_episode(PerEpisode::Last)
}

/// True where one of the words of `asked`, a part of a study, is the name of a time.
#[must_use]
pub fn names_times(asked: &impl Serialize) -> bool {
    serde_json::to_value(asked).is_ok_and(|asked| has_time(&asked))
}

fn has_time(asked: &Value) -> bool {
    let is_name = |letter: char| letter.is_alphanumeric() || letter == '_';
    match asked {
        Value::String(text) => text
            .split(|letter| !is_name(letter))
            .any(|word| [WALL_TIME, TIME_PER_UPDATE, TIME_PER_DECISION].contains(&word)),
        Value::Array(items) => items.iter().any(has_time),
        Value::Object(entries) => entries.values().any(has_time),
        _ => false,
    }
}

/// The metric under which a record of means over episodes holds the root of the mean square of another one.
#[must_use]
pub fn root_of_squares(metric: &str) -> String {
    format!("rms({metric})")
}

/// How a trial ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum EndState {
    /// It finished and its numbers are stored.
    Ok,
    /// A plugin reported an error.
    Failed,
    /// The code panicked.
    Panicked,
    /// It ran longer than allowed.
    Timeout,
    /// It used more memory than allowed.
    Oom,
    /// A number that must be finite was not.
    Nan,
    /// The worker process was killed from outside.
    Killed,
    /// It has come to a pause of a search, and what it recorded up to there is stored. It has not ended, and no limit
    /// names this state.
    #[schemars(skip)]
    Paused,
}

impl EndState {
    /// Every state in which a trial has ended, but `ok`.
    pub const FAILURES: [EndState; 6] = [
        EndState::Failed,
        EndState::Panicked,
        EndState::Timeout,
        EndState::Oom,
        EndState::Nan,
        EndState::Killed,
    ];

    /// The word that is stored and shown.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            EndState::Ok => "ok",
            EndState::Failed => "failed",
            EndState::Panicked => "panicked",
            EndState::Timeout => "timeout",
            EndState::Oom => "oom",
            EndState::Nan => "nan",
            EndState::Killed => "killed",
            EndState::Paused => "paused",
        }
    }
}

/// What is stored when a trial has ended.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrialEnd {
    /// How it ended.
    pub state: EndState,
    /// Why, for everything but `ok`; one line.
    #[serde(deserialize_with = "read_brief")]
    pub reason: String,
    /// Wall-clock time it took.
    pub wall_s: f64,
    /// Mean wall-clock time of a decision of the final measurement, where one was made.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub decision_s: Option<f64>,
    /// Hash of the metrics file, empty where there is none.
    pub digest: String,
}

/// One trial of a study with what it recorded.
#[derive(Debug, Clone)]
pub struct TrialResult {
    /// The trial, which the plan has as well.
    pub trial: Arc<Trial>,
    /// How it ended; `None` where it has not run.
    pub end: Option<Box<TrialEnd>>,
    /// Metric names that `rows` point into; trials with the same ones share them.
    pub names: Arc<Vec<String>>,
    /// What it recorded; empty unless it ended `ok`.
    pub rows: Vec<Row>,
}

impl TrialResult {
    /// The trial, to be changed for this result alone.
    #[cfg(test)]
    pub(crate) fn trial_mut(&mut self) -> &mut Trial {
        Arc::make_mut(&mut self.trial)
    }

    /// A trial that has not run.
    #[must_use]
    pub fn missing(trial: Arc<Trial>) -> Self {
        Self {
            trial,
            end: None,
            names: Arc::default(),
            rows: Vec::new(),
        }
    }

    /// Names of environment, agent and setting.
    #[must_use]
    pub fn cell(&self) -> CellName {
        self.trial.cell.names()
    }

    /// True for a run of another program.
    #[must_use]
    pub fn is_imported(&self) -> bool {
        self.trial.cell.purpose == Purpose::Imported
    }

    /// True where the trial ended `ok`.
    #[must_use]
    pub fn is_ok(&self) -> bool {
        self.end.as_deref().is_some_and(|end| end.state == EndState::Ok)
    }

    /// How many updates the agent had made at the end; `None` where it does not learn, and where nothing was
    /// recorded.
    #[must_use]
    pub fn updates(&self) -> Option<f64> {
        self.select(Phase::Final, UPDATES).last().map(|row| row.value)
    }

    /// True where the agent learned in the trial: it recorded its updates, or how far it trained itself.
    #[must_use]
    pub fn trains(&self) -> bool {
        self.updates().is_some() || self.select(Phase::Final, OWN_STEPS).next().is_some()
    }

    /// Whether the trial was a success; `None` where the study does not say what that is, and where nothing
    /// was recorded.
    #[must_use]
    pub fn succeeded(&self) -> Option<bool> {
        self.mean(Phase::Final, SUCCESS).map(|share| share > 0.5)
    }

    /// Adds the metric `success`, from what the trial measured at the end.
    pub fn judge_success(&mut self, success: &Success) {
        let Some(value) = self.mean(Phase::Final, &success.metric).filter(|_| self.is_ok()) else {
            return;
        };
        let last = self.select(Phase::Final, &success.metric).last().copied();
        let Some(last) = last else { return };
        self.add(SUCCESS, f64::from(u8::from(success.holds(value))), last);
    }

    /// Adds the metrics [`WALL_TIME`], [`TIME_PER_UPDATE`] where the agent made updates, and
    /// [`TIME_PER_DECISION`] where it made decisions at the end, from how the trial ended. They are measurements
    /// of the machine: no trial records them, and its numbers do not depend on them.
    pub fn add_times(&mut self) {
        let Some(end) = self.end.as_deref().filter(|_| self.is_ok()) else {
            return;
        };
        let (wall_s, per_decision) = (end.wall_s, end.decision_s);
        let Some(last) = self.rows.iter().rfind(|row| row.phase == Phase::Final).copied() else {
            return;
        };
        let per_update = self
            .updates()
            .filter(|made| *made > 0.0)
            .map(|made| wall_s / made);
        let times = [
            (WALL_TIME, Some(wall_s)),
            (TIME_PER_UPDATE, per_update),
            (TIME_PER_DECISION, per_decision),
        ];
        for (name, value) in times {
            // What a plugin records under the name is what the name means then.
            if let Some(value) = value.filter(|_| !self.names.iter().any(|known| known == name)) {
                self.add(name, value, last);
            }
        }
    }

    /// Adds a number of the whole trial at the step of one of its rows.
    fn add(&mut self, name: &str, value: f64, beside: Row) {
        let metric = contract::recorder::intern(Arc::make_mut(&mut self.names), name);
        self.rows.push(Row {
            episode: 0,
            seat: 0,
            metric,
            value,
            ..beside
        });
    }

    /// The rows of one metric in one phase, in the order of recording.
    pub fn select<'a>(&'a self, phase: Phase, metric: &str) -> impl Iterator<Item = &'a Row> + 'a + use<'a> {
        let index = self.names.iter().position(|name| name == metric);
        self.rows
            .iter()
            .filter(move |row| row.phase == phase && Some(usize::from(row.metric)) == index)
    }

    /// Mean of a metric over the episodes (and seats) of a phase; `None` where nothing was recorded.
    #[must_use]
    pub fn mean(&self, phase: Phase, metric: &str) -> Option<f64> {
        let (sum, count) = self
            .select(phase, metric)
            .fold((0.0, 0u32), |(sum, count), row| (sum + row.value, count + 1));
        (count > 0).then(|| sum / f64::from(count))
    }

    /// Mean of a metric over the episodes of the measurement at a step while learning; `None` where it was not made.
    pub(crate) fn measured_at(&self, metric: &str, step: u64) -> Option<f64> {
        let curve = self.curve(Phase::Evaluate, metric);
        curve
            .into_iter()
            .find(|(at, _)| *at == step)
            .map(|(_, value)| value)
    }

    /// Root of the mean square of a metric over the episodes (and seats) of a phase; `None` where nothing was
    /// recorded. A record that holds means over episodes has it as a metric of its own.
    #[must_use]
    pub fn root_mean_square(&self, phase: Phase, metric: &str) -> Option<f64> {
        let recorded = root_of_squares(metric);
        if self.names.contains(&recorded) {
            return self.mean(phase, &recorded);
        }
        let (sum, count) = self.select(phase, metric).fold((0.0, 0u32), |(sum, count), row| {
            (sum + row.value * row.value, count + 1)
        });
        (count > 0).then(|| (sum / f64::from(count)).sqrt())
    }

    /// The metric while learning, at each step: as it was measured; or as the agent recorded it, where it was
    /// never measured (a loss, a temperature).
    #[must_use]
    pub fn while_learning(&self, metric: &str) -> Vec<(u64, f64)> {
        let measured = self.curve(Phase::Evaluate, metric);
        if measured.is_empty() {
            self.curve(Phase::Train, metric)
        } else {
            measured
        }
    }

    /// Mean of a metric over episodes (and seats) at each step of a phase, in the order of steps.
    #[must_use]
    pub fn curve(&self, phase: Phase, metric: &str) -> Vec<(u64, f64)> {
        let mut points: BTreeMap<u64, (f64, u32)> = BTreeMap::new();
        for row in self.select(phase, metric) {
            let point = points.entry(row.step).or_default();
            *point = (point.0 + row.value, point.1 + 1);
        }
        points
            .into_iter()
            .map(|(step, (sum, count))| (step, sum / f64::from(count)))
            .collect()
    }
}

/// What counts as a success of a seed, for outcomes that come in two kinds: a mean over both describes
/// neither.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Success {
    /// The metric, whose mean over the final episodes decides.
    pub metric: String,
    /// A success lies above this value.
    pub above: Option<f64>,
    /// A success lies below this value.
    pub below: Option<f64>,
}

impl Success {
    fn holds(&self, value: f64) -> bool {
        self.above.is_none_or(|limit| value > limit) && self.below.is_none_or(|limit| value < limit)
    }
}

impl std::fmt::Display for Success {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let limits = [("above", self.above), ("below", self.below)];
        let limits: Vec<String> = limits
            .iter()
            .filter_map(|(word, limit)| Some(format!("{word} {}", (*limit)?)))
            .collect();
        write!(f, "{} {}", self.metric, limits.join(" and "))
    }
}

/// All trials of a study, in the order of the plan.
#[derive(Debug, Clone, Default)]
pub struct Results {
    /// The trials of combinations and plays.
    pub trials: Vec<TrialResult>,
    /// The trials of `prepare`, which leave something for others and are shown as budgets alone.
    pub prepared: Vec<TrialResult>,
    /// The trials of settings that searches tried, which are shown as budgets alone.
    pub tried: Vec<TrialResult>,
    /// What searches for settings came to.
    pub searches: Vec<SearchResult>,
    /// The looks that the study plans; `None` where its number of seeds is fixed.
    pub design: Option<Design>,
    /// The first seed of the design.
    pub first_seed: u64,
    /// The rounds of seeds that are taken together, in order; none where there is one.
    pub rounds: Vec<Round>,
    /// What the study counts as a success.
    pub success: Option<Success>,
    /// How long the source trained.
    pub paper_budget: Option<PaperBudget>,
    /// What trials left to be shown, by id, as far as figures of the study show it.
    pub drawings: BTreeMap<String, Drawings>,
    /// Where imported runs come from, which are among the trials.
    pub imported: Vec<Origin>,
    /// Programs of which a trial was computed twice.
    pub repeated: Vec<RepeatCheck>,
    /// Statements on all trials together, where the results are read from a record.
    pub told: Option<Told>,
}

/// A round of seeds: those of a study, or of a confirmation.
#[derive(Debug, Clone, PartialEq)]
pub struct Round {
    /// The seeds, rising.
    seeds: Vec<u64>,
    /// The looks that were planned; `None` where the number of seeds is fixed.
    design: Option<Design>,
}

impl Round {
    fn of(results: &Results) -> Self {
        // Runs of others have seeds of their own.
        let own = results.trials.iter().filter(|it| !it.is_imported());
        let seeds = own.map(|it| it.trial.key.seed);
        let seeds: BTreeSet<u64> = seeds.filter(|seed| *seed >= results.first_seed).collect();
        Self {
            seeds: seeds.into_iter().collect(),
            design: results.design.clone(),
        }
    }

    /// The seeds of this round, where no other is taken together with it.
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

    /// The seeds of each look: their number, and the number below which they lie.
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
    /// Trials of a study with a fixed number of seeds, which does not say what a success is.
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

    /// The trials of several rounds as those of one study, to be judged by all of their seeds. Each round has
    /// larger seeds than the one before.
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

    /// The number below which seeds count, for each look that the study plans; none where their number is fixed.
    #[must_use]
    pub fn limits(&self) -> Vec<u64> {
        let looks = self.design.iter().flat_map(Design::looks);
        looks.map(|most| self.first_seed + u64::from(*most)).collect()
    }

    /// Which seeds of some trials a statement may be decided on: those of looks for which every trial has
    /// ended. One that was killed from outside has not: it runs again.
    #[must_use]
    pub fn seeds_of(&self, trials: &[&TrialResult]) -> Seeds {
        if self.design.is_none() && self.rounds.is_empty() {
            return Seeds::default();
        }
        // Seeds of a play have several trials each, where all meet all.
        let mut ended: BTreeMap<CellName, BTreeMap<u64, bool>> = BTreeMap::new();
        for trial in trials.iter().filter(|it| !it.is_imported()) {
            let seeds = ended.entry(trial.cell()).or_default();
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

/// The looks of several rounds as those of one design: the complete ones of each, and what is left of the last.
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
        design: Design::try_from(numbers).ok(),
        limits,
        rounds: rounds.len(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::synthetic::{ended, trial};

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
                design: Some(Design::new(vec![3, 6])),
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
                design: Some(Design::new(vec![3, 6])),
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
            design: Some(Design::new(vec![3, 6])),
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
        // The first look of the round is complete; what it planned besides never ran.
        let all = Results::pooled(&[&study, &round(&[100, 101, 102, 103]), &last]);
        assert_eq!(of(&all, "equal"), (Some(vec![3, 6, 8]), vec![3, 103, 202], 3));
        // A look of the last round is still to come.
        let two = Results::pooled(&[&study, &round(&[100, 101, 102])]);
        assert_eq!(of(&two, "equal"), (Some(vec![3, 6, 9]), vec![3, 103], 2));
        // A combination with trials in one round alone has the looks of that round.
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
        // A made trial took a second.
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

    #[test]
    fn times_are_found_by_their_whole_names() {
        let asked = |text: &str| names_times(&serde_json::json!({ "claims": [{ "claim": text }] }));
        assert!(asked("pr2.time_per_update > rommeo.time_per_update") && asked("a.wall_time < 3"));
        assert!(!asked("a.lifetime_per_update > b.wall_times"));
    }
}
