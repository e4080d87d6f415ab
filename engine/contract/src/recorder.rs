//! Records of running trials: numbers in long form, one row per value.

use crate::{Error, exact};
use serde::{Deserialize, Serialize};
use std::{collections::BTreeMap, time::Duration};

/// Part of a trial to which a row belongs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Phase {
    /// Values while learning: losses, temperatures, training returns.
    Train,
    /// A measurement during learning, for learning curves.
    Evaluate,
    /// The measurement at the end, for tables.
    Final,
    /// Step-by-step values of recorded episodes, for trajectory figures.
    Trace,
}

impl Phase {
    /// All phases, in order.
    pub const ALL: [Phase; 4] = [Phase::Train, Phase::Evaluate, Phase::Final, Phase::Trace];

    /// Name of the phase, as it is stored.
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
    /// Part of the trial.
    pub phase: Phase,
    /// Environment steps (all environments together) or examples seen at the time of recording; in a trace, the
    /// decision.
    pub step: u64,
    /// Episode inside the measurement, from 0.
    pub episode: u64,
    /// Index of the seat, from 0.
    pub seat: u16,
    /// Index into [`Recorder::names`].
    pub metric: u16,
    /// Recorded value, in the metric's unit.
    pub value: f64,
}

/// Collects the rows of one trial.
#[derive(Debug, Clone, Default)]
pub struct Recorder {
    names: Vec<String>,
    rows: Vec<Row>,
    running: Running,
    /// Index of the first row whose value is not finite.
    not_finite: Option<usize>,
    deciding: DecisionTime,
}

/// Time that the agent took for those decisions of the final measurement that were made in this process. It is a
/// measurement of the machine, and no row.
#[derive(Debug, Clone, Copy, Default)]
struct DecisionTime {
    decisions: usize,
    time: Duration,
}

/// Means and latest values that have not become rows yet.
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
    /// A recorder that continues another one.
    #[must_use]
    pub fn resumed(names: Vec<String>, rows: Vec<Row>, running: Running) -> Self {
        let not_finite = rows.iter().position(|row| !row.value.is_finite());
        Self {
            names,
            rows,
            running,
            not_finite,
            deciding: DecisionTime::default(),
        }
    }

    /// Records one value.
    pub fn add(&mut self, phase: Phase, step: u64, episode: u64, seat: usize, metric: &str, value: f64) {
        let metric = intern(&mut self.names, metric);
        if !value.is_finite() && self.not_finite.is_none() {
            self.not_finite = Some(self.rows.len());
        }
        self.rows.push(Row {
            phase,
            step,
            episode,
            seat: u16::try_from(seat).unwrap_or(u16::MAX),
            metric,
            value,
        });
    }

    /// The rows from a place on, as a record of their own.
    #[must_use]
    pub fn since(&self, place: usize) -> Self {
        let mut record = Self::default();
        record.add_rows(self.rows.get(place..).unwrap_or_default(), &self.names);
        record
    }

    /// Adds the rows of another record.
    pub fn append(&mut self, other: &Self) {
        self.add_rows(&other.rows, &other.names);
    }

    /// Takes over the decision times of another record.
    pub fn decided_as(&mut self, other: &Self) {
        self.deciding = other.deciding;
    }

    fn add_rows(&mut self, rows: &[Row], names: &[String]) {
        for row in rows {
            let name = &names[usize::from(row.metric)];
            self.add(
                row.phase,
                row.step,
                row.episode,
                usize::from(row.seat),
                name,
                row.value,
            );
        }
    }

    /// Adds to the running mean of a training metric; the protocol records all means at its next measurement.
    pub fn mean(&mut self, metric: &str, value: f64) {
        if let Some(mean) = self.running.means.get_mut(metric) {
            mean.sum += value;
            mean.count += 1;
        } else {
            self.running
                .means
                .insert(metric.into(), Mean { sum: value, count: 1 });
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

    /// Records the running means at `step` and restarts them.
    pub fn flush_means(&mut self, step: u64) {
        for (metric, Mean { sum, count }) in std::mem::take(&mut self.running.means) {
            #[allow(clippy::cast_precision_loss, reason = "a count of updates is far below 2^52")]
            self.add(Phase::Train, step, 0, 0, &metric, sum / count as f64);
        }
    }

    /// Refuses a record with a number that is not finite, whichever plugin recorded it: its means would not be finite
    /// either.
    ///
    /// # Errors
    /// [`Error::NotFinite`] for the first such row, and [`Error::Config`] for more metrics than rows can number.
    pub fn all_finite(&self) -> Result<(), Error> {
        if self.names.len() > MOST_METRICS {
            let problem = format!("a trial records at most {MOST_METRICS} metrics");
            return Err(Error::config("metrics", problem));
        }
        let Some(row) = self.not_finite.map(|index| self.rows[index]) else {
            return Ok(());
        };
        let what = format!(
            "{} (phase {})",
            self.names[usize::from(row.metric)],
            row.phase.name()
        );
        Err(Error::NotFinite {
            what,
            step: row.step,
            value: row.value,
        })
    }

    /// Adds decisions of the final measurement and the time that the agent took for them.
    pub fn decided(&mut self, decisions: usize, time: Duration) {
        self.deciding.decisions += decisions;
        self.deciding.time += time;
    }

    /// Mean time of a decision in the final measurement, in seconds; `None` if none was made.
    #[must_use]
    #[allow(
        clippy::cast_precision_loss,
        reason = "a count of decisions is far below 2^52"
    )]
    pub fn decision_s(&self) -> Option<f64> {
        let DecisionTime { decisions, time } = self.deciding;
        (decisions > 0).then(|| time.as_secs_f64() / decisions as f64)
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

/// Largest number of metrics of a trial, since rows refer to them by number.
pub const MOST_METRICS: usize = u16::MAX as usize;

/// Index of a name in a list of names; a new name is appended.
pub fn intern(names: &mut Vec<String>, name: &str) -> u16 {
    let index = names.iter().position(|known| known == name).unwrap_or_else(|| {
        names.push(name.into());
        names.len() - 1
    });
    u16::try_from(index).unwrap_or(u16::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reason(record: &Recorder) -> String {
        record
            .all_finite()
            .map_or_else(|error| error.to_string(), |()| String::new())
    }

    #[test]
    fn more_metrics_than_rows_can_name_are_refused() {
        let names = |count: usize| (0..count).map(|name| name.to_string()).collect::<Vec<_>>();
        let record = |count| Recorder::resumed(names(count), Vec::new(), Running::default());
        assert_eq!(reason(&record(MOST_METRICS)), "");
        assert!(reason(&record(MOST_METRICS + 1)).contains("at most 65535 metrics"));
    }

    #[test]
    fn a_part_of_a_record_can_be_added_to_another() {
        let (mut whole, mut other) = (Recorder::default(), Recorder::default());
        whole.add(Phase::Train, 1, 0, 0, "loss", 1.0);
        whole.add(Phase::Final, 5, 2, 1, "return", f64::NAN);
        whole.decided(4, Duration::from_secs(2));
        other.add(Phase::Final, 5, 0, 0, "length", 3.0);
        other.append(&whole.since(1));
        other.decided_as(&whole);
        assert_eq!(other.names(), ["length", "return"]);
        let row = other.rows()[1];
        assert_eq!(
            (row.phase, row.step, row.episode, row.seat, row.metric),
            (Phase::Final, 5, 2, 1, 1)
        );
        assert_eq!((other.rows().len(), other.decision_s()), (2, Some(0.5)));
        assert!(reason(&other).contains("return (phase final)"));
    }

    #[test]
    fn the_first_value_that_is_no_number_is_named_in_every_phase() {
        for phase in Phase::ALL {
            let mut record = Recorder::default();
            record.add(phase, 10, 0, 0, "return", 1.0);
            assert_eq!(reason(&record), "");
            record.add(phase, 20, 0, 0, "voltage", f64::INFINITY);
            record.add(phase, 30, 0, 0, "return", f64::NAN);
            let expected = format!("voltage (phase {}) is not finite at step 20: inf", phase.name());
            assert_eq!(reason(&record), expected);
            let Recorder {
                names, rows, running, ..
            } = record;
            assert_eq!(reason(&Recorder::resumed(names, rows, running)), expected);
        }
    }

    #[test]
    fn means_and_estimates_count_once_they_are_recorded() {
        let mut record = Recorder::default();
        record.mean("loss", f64::NAN);
        record.latest("bias", f64::INFINITY);
        assert_eq!(reason(&record), "");
        let mut estimates = record.clone();
        record.flush_means(5);
        estimates.record_latest(Phase::Final, 7);
        assert_eq!(reason(&record), "loss (phase train) is not finite at step 5: NaN");
        assert_eq!(
            reason(&estimates),
            "bias (phase final) is not finite at step 7: inf"
        );
    }
}
