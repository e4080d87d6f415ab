//! A trial with its record.

use crate::{
    own_training::REPORTED,
    recorder::{self, Phase, Row},
    standard_metrics::{
        OWN_STEPS, SUCCESS, TIME_PER_DECISION, TIME_PER_UPDATE, UPDATES, WALL_TIME, root_of_squares,
    },
    trial::{Combination, Purpose, Trial},
    trial_end::{EndState, TrialEnd},
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::{collections::BTreeMap, sync::Arc};

/// One trial of a study with its record.
#[derive(Debug, Clone)]
pub struct TrialResult {
    /// The trial, shared with the plan.
    pub trial: Arc<Trial>,
    /// Its end; `None` if it has not run.
    pub end: Option<Box<TrialEnd>>,
    /// Metric names to which `rows` refer by index; trials with the same names share them.
    pub names: Arc<Vec<String>>,
    /// Recorded rows; empty unless it ended `ok`.
    pub rows: Vec<Row>,
}

impl TrialResult {
    /// The trial, for a modification of this result alone.
    pub fn trial_mut(&mut self) -> &mut Trial {
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

    /// Environment, agent and point of the sweep.
    #[must_use]
    pub fn combination(&self) -> &Combination {
        &self.trial.cell.combination
    }

    /// Whether it is a run of another program.
    #[must_use]
    pub fn is_imported(&self) -> bool {
        self.trial.cell.purpose == Purpose::Imported
    }

    /// Whether the trial ended `ok`.
    #[must_use]
    pub fn is_ok(&self) -> bool {
        self.end.as_deref().is_some_and(|end| end.state == EndState::Ok)
    }

    /// Number of updates that the agent had made at the end; `None` if it does not learn, or if nothing was recorded.
    #[must_use]
    pub fn updates(&self) -> Option<f64> {
        self.select(Phase::Final, UPDATES).last().map(|row| row.value)
    }

    /// Whether the agent learned in the trial: it recorded its updates, or the last step of its own training.
    #[must_use]
    pub fn trains(&self) -> bool {
        self.updates().is_some() || self.select(Phase::Final, OWN_STEPS).next().is_some()
    }

    /// Whether the values of a metric are those that a program reported of itself, and not measurements on the episodes
    /// of other agents.
    #[must_use]
    pub fn reports(&self, metric: &str) -> bool {
        let agent = self.trial.key.agent.agent();
        let reported = agent.and_then(|part| part.config.get(REPORTED));
        let trains_itself = || self.select(Phase::Final, OWN_STEPS).next().is_some();
        reported.is_some_and(|metrics| metrics.get(metric).is_some()) && trains_itself()
    }

    /// Whether the trial was a success; `None` if the study does not define success, or if nothing was recorded.
    #[must_use]
    pub fn succeeded(&self) -> Option<bool> {
        self.mean(Phase::Final, SUCCESS).map(|share| share > 0.5)
    }

    /// Adds the metric `success`, from the final measurement.
    pub fn judge_success(&mut self, success: &Success) {
        let Some(value) = self.mean(Phase::Final, &success.metric).filter(|_| self.is_ok()) else {
            return;
        };
        let last = self.select(Phase::Final, &success.metric).last().copied();
        let Some(last) = last else { return };
        self.add(SUCCESS, f64::from(u8::from(success.holds(value))), last);
    }

    /// Adds the metrics [`WALL_TIME`], [`TIME_PER_UPDATE`] if the agent made updates, and [`TIME_PER_DECISION`] if it
    /// made decisions at the end, from the end of the trial. They are measurements of the machine: no trial records
    /// them, and its numbers do not depend on them.
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
            // A metric that a plugin records under the name takes precedence.
            if let Some(value) = value.filter(|_| !self.names.iter().any(|known| known == name)) {
                self.add(name, value, last);
            }
        }
    }

    /// Adds a number of the whole trial at the step of one of its rows.
    fn add(&mut self, name: &str, value: f64, beside: Row) {
        let metric = recorder::intern(Arc::make_mut(&mut self.names), name);
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

    /// Mean of a metric over the episodes (and seats) of a phase; `None` if nothing was recorded.
    #[must_use]
    pub fn mean(&self, phase: Phase, metric: &str) -> Option<f64> {
        let (sum, count) = self
            .select(phase, metric)
            .fold((0.0, 0u32), |(sum, count), row| (sum + row.value, count + 1));
        (count > 0).then(|| sum / f64::from(count))
    }

    /// Mean of a metric over the episodes of the measurement at a step during learning; `None` if it was not made.
    #[must_use]
    pub fn measured_at(&self, metric: &str, step: u64) -> Option<f64> {
        let curve = self.curve(Phase::Evaluate, metric);
        curve
            .into_iter()
            .find(|(at, _)| *at == step)
            .map(|(_, value)| value)
    }

    /// Root of the mean square of a metric over the episodes (and seats) of a phase; `None` if nothing was recorded. In
    /// a record of means over episodes it is a metric of its own.
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

    /// The metric during learning, at each step: the measured values, or those that the agent recorded if it was never
    /// measured (a loss, a temperature).
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

/// The criterion by which a seed counts as a success, for outcomes of two kinds, which a mean over both would not
/// describe.
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
