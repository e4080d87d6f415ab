//! What a running trial records: numbers in long form, one row per value.

use crate::checkpoint::exact;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Which part of a trial a row belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Phase {
    /// While learning: losses, temperatures, training returns.
    Train,
    /// A measurement during learning; what learning curves show.
    Evaluate,
    /// The measurement at the end; what tables show.
    Final,
    /// Step-by-step values of recorded episodes; what trajectory figures show.
    Trace,
}

impl Phase {
    /// All phases, in order.
    pub const ALL: [Phase; 4] = [Phase::Train, Phase::Evaluate, Phase::Final, Phase::Trace];

    /// The word that is stored.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Phase::Train => "train",
            Phase::Evaluate => "evaluate",
            Phase::Final => "final",
            Phase::Trace => "trace",
        }
    }
}

/// One recorded value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row {
    /// The part of the trial.
    pub phase: Phase,
    /// Environment steps (all environments together) or examples seen when it was recorded; in a trace, the decision.
    pub step: u64,
    /// Episode inside the measurement, from 0.
    pub episode: u64,
    /// Seat, from 0.
    pub seat: u16,
    /// Index into [`Recorder::names`].
    pub metric: u16,
    /// The value.
    pub value: f64,
}

/// Collects the rows of one trial.
#[derive(Debug, Clone, Default)]
pub struct Recorder {
    names: Vec<String>,
    rows: Vec<Row>,
    running: Running,
}

/// What has not become rows yet.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Running {
    means: BTreeMap<String, Mean>,
    #[serde(with = "exact")]
    latest: BTreeMap<String, f64>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Mean {
    #[serde(with = "exact")]
    sum: f64,
    count: u64,
}

impl Recorder {
    /// A recorder that goes on where another one was.
    #[must_use]
    pub fn resumed(names: Vec<String>, rows: Vec<Row>, running: Running) -> Self {
        Self { names, rows, running }
    }

    /// Records one value.
    pub fn add(&mut self, phase: Phase, step: u64, episode: u64, seat: usize, metric: &str, value: f64) {
        let metric = intern(&mut self.names, metric);
        self.rows.push(Row { phase, step, episode, seat: u16::try_from(seat).unwrap_or(u16::MAX), metric, value });
    }

    /// Adds to the running mean of a training metric; the protocol records all means at its next measurement.
    pub fn mean(&mut self, metric: &str, value: f64) {
        if let Some(mean) = self.running.means.get_mut(metric) {
            mean.sum += value;
            mean.count += 1;
        } else {
            self.running.means.insert(metric.into(), Mean { sum: value, count: 1 });
        }
    }

    /// Replaces the latest value of a running estimate; `estimator_tracking` records it when due.
    pub fn latest(&mut self, metric: &str, value: f64) {
        self.running.latest.insert(metric.into(), value);
    }

    /// Records the latest value of every running estimate.
    pub fn record_latest(&mut self, phase: Phase, step: u64) {
        for (metric, value) in self.running.latest.clone() {
            self.add(phase, step, 0, 0, &metric, value);
        }
    }

    /// Records the running means at `step` and starts them anew.
    pub fn flush_means(&mut self, step: u64) {
        for (metric, Mean { sum, count }) in std::mem::take(&mut self.running.means) {
            #[allow(clippy::cast_precision_loss, reason = "a count of updates is far below 2^52")]
            self.add(Phase::Train, step, 0, 0, &metric, sum / count as f64);
        }
    }

    /// Metric names in the order of their first use.
    #[must_use]
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// The rows in the order of recording.
    #[must_use]
    pub fn rows(&self) -> &[Row] {
        &self.rows
    }

    /// Running means and latest values that are not recorded yet.
    #[must_use]
    pub fn running(&self) -> &Running {
        &self.running
    }
}

/// Index of a name in a list of names, which grows by it where it is new.
pub(crate) fn intern(names: &mut Vec<String>, name: &str) -> u16 {
    let index = names.iter().position(|known| known == name).unwrap_or_else(|| {
        names.push(name.into());
        names.len() - 1
    });
    u16::try_from(index).unwrap_or(u16::MAX)
}
