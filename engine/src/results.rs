//! What is known of a study's trials: the frame that tables, figures and claims read.

use crate::{
    Metric, PerEpisode,
    recorder::{Phase, Row},
    trial::Trial,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The metric of agents that learn: the number of updates made so far. Agents that do not learn record none.
pub const UPDATES: &str = "updates";

/// What [`UPDATES`] says, for names, units and directions.
#[must_use]
pub fn updates_metric() -> Metric {
    Metric::new(UPDATES, "", "updates that the agent made so far").per_episode(PerEpisode::Last)
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
}

impl EndState {
    /// Every state but `ok`.
    pub const FAILURES: [EndState; 6] =
        [EndState::Failed, EndState::Panicked, EndState::Timeout, EndState::Oom, EndState::Nan, EndState::Killed];

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
        }
    }
}

/// What is stored when a trial has ended.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrialEnd {
    /// How it ended.
    pub state: EndState,
    /// Why, for everything but `ok`; one line.
    pub reason: String,
    /// Wall-clock time it took.
    pub wall_s: f64,
    /// Hash of the metrics file, empty where there is none.
    pub digest: String,
}

/// One trial of a study with what it recorded.
#[derive(Debug, Clone)]
pub struct TrialResult {
    /// The trial.
    pub trial: Trial,
    /// How it ended; `None` where it has not run.
    pub end: Option<TrialEnd>,
    /// Metric names that `rows` point into.
    pub names: Vec<String>,
    /// What it recorded; empty unless it ended `ok`.
    pub rows: Vec<Row>,
}

impl TrialResult {
    /// True where the trial ended `ok`.
    #[must_use]
    pub fn is_ok(&self) -> bool {
        self.end.as_ref().is_some_and(|end| end.state == EndState::Ok)
    }

    /// How many updates the agent had made at the end; `None` where it does not learn, and where nothing was recorded.
    #[must_use]
    pub fn updates(&self) -> Option<f64> {
        self.select(Phase::Final, UPDATES).last().map(|row| row.value)
    }

    /// The rows of one metric in one phase, in the order of recording.
    pub fn select<'a>(&'a self, phase: Phase, metric: &str) -> impl Iterator<Item = &'a Row> + 'a + use<'a> {
        let index = self.names.iter().position(|name| name == metric);
        self.rows.iter().filter(move |row| row.phase == phase && Some(usize::from(row.metric)) == index)
    }

    /// Mean of a metric over the episodes (and seats) of a phase; `None` where nothing was recorded.
    #[must_use]
    pub fn mean(&self, phase: Phase, metric: &str) -> Option<f64> {
        let (sum, count) = self.select(phase, metric).fold((0.0, 0u32), |(sum, count), row| (sum + row.value, count + 1));
        (count > 0).then(|| sum / f64::from(count))
    }

    /// Mean of a metric over episodes (and seats) at each step of a phase, in the order of steps.
    #[must_use]
    pub fn curve(&self, phase: Phase, metric: &str) -> Vec<(u64, f64)> {
        let mut points: std::collections::BTreeMap<u64, (f64, u32)> = std::collections::BTreeMap::new();
        for row in self.select(phase, metric) {
            let point = points.entry(row.step).or_default();
            *point = (point.0 + row.value, point.1 + 1);
        }
        points.into_iter().map(|(step, (sum, count))| (step, sum / f64::from(count))).collect()
    }
}

/// All trials of a study, in the order of the plan.
#[derive(Debug, Clone, Default)]
pub struct Results {
    /// The trials.
    pub trials: Vec<TrialResult>,
}
