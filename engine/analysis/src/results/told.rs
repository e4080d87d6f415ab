//! Sentences of a report on all trials together: computed from the trials, or read from the record of an earlier report
//! if the trials are not available.

use super::{RepeatCheck, Results};
use contract::{trial_end::EndState, trial_result::TrialResult};
use document::count::{count, duration};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Facts on all trials of a study that no verdict depends on.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Told {
    /// Budgets of every agent as printed; `None` if the study has no trial or no budget is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub budgets: Option<Printed>,
    /// Computing time of all trials.
    pub cost: Cost,
    /// Number of trials by end state.
    pub ran: Ran,
    /// Programs with a trial that was computed twice.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub repeated: Vec<RepeatCheck>,
}

/// A table as printed, without its looks.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Printed {
    /// Headings, one for each column.
    pub head: Vec<String>,
    /// Number of columns, from the left, that hold text.
    pub words: usize,
    /// Texts of the cells, row by row.
    pub rows: Vec<Vec<String>>,
    /// Sentences under the table.
    pub notes: Vec<String>,
}

/// The cost of all trials of a study.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Cost {
    /// Seconds of all trials that ended.
    pub seconds: f64,
    /// Number of trials that ended, each counted once.
    pub trials: usize,
}

impl Cost {
    /// Equal trials that occur in several settings were computed once; imported runs were computed by other programs.
    pub fn of<'a>(trials: impl Iterator<Item = &'a TrialResult>) -> Self {
        let trials = trials.filter(|trial| !trial.is_imported());
        let ended = trials.filter_map(|trial| Some((trial.trial.id.as_str(), trial.end.as_ref()?.wall_s)));
        let seconds: BTreeMap<&str, f64> = ended.collect();
        Self {
            seconds: seconds.values().sum(),
            trials: seconds.len(),
        }
    }

    /// Mean seconds of one trial; `None` before the first trial has ended.
    #[must_use]
    pub fn mean(self) -> Option<f64> {
        #[allow(clippy::cast_precision_loss, reason = "a study has at most a million trials")]
        let trials = self.trials as f64;
        (self.trials > 0).then(|| self.seconds / trials)
    }

    /// The same as [`sentence`](Self::sentence); `None` before the first trial has ended.
    #[must_use]
    pub fn known(self) -> Option<String> {
        (self.trials > 0).then(|| self.sentence())
    }

    /// Time and number of trials, as text.
    #[must_use]
    pub fn sentence(self) -> String {
        format!("{} in {}", duration(self.seconds), count(self.trials, "trial"))
    }
}

/// End states of the shown trials and of those that others take from.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ran {
    /// Number of trials by state.
    pub ended: BTreeMap<EndState, usize>,
    /// Number of trials that have not run.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub not_run: usize,
    /// Trials that did not end `ok`, a line each.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub failures: Vec<String>,
}

fn is_zero(number: &usize) -> bool {
    *number == 0
}

impl Ran {
    /// From the record, or else from the trials; imported runs are not counted.
    #[must_use]
    pub fn of(results: &Results) -> Self {
        if let Some(told) = &results.told {
            return told.ran.clone();
        }
        let mut ran = Self::default();
        let all = results.prepared.iter().chain(&results.trials);
        for trial in all.filter(|trial| !trial.is_imported()) {
            match &trial.end {
                None => ran.not_run += 1,
                Some(end) => *ran.ended.entry(end.state).or_default() += 1,
            }
            if trial.end.is_some() && !trial.is_ok() {
                ran.failures.push(failure(trial));
            }
        }
        ran
    }

    /// The number of trials with each end state, as text.
    #[must_use]
    pub fn sentence(&self) -> String {
        let ended = self
            .ended
            .iter()
            .map(|(state, n)| format!("{n} {}", state.name()));
        let not_run = (self.not_run > 0).then(|| format!("{} not run", self.not_run));
        let words: Vec<String> = ended.chain(not_run).collect();
        let all = self.ended.values().sum::<usize>() + self.not_run;
        format!("{}: {}", count(all, "trial"), words.join(", "))
    }
}

/// A failed trial in one line.
fn failure(trial: &TrialResult) -> String {
    let (it, end) = (&trial.trial, trial.end.as_ref());
    let setting = if it.cell.point.is_empty() {
        String::new()
    } else {
        format!(", {}", it.cell.point)
    };
    let state = end.map_or("", |end| end.state.name());
    let reason = end.map_or("", |end| &end.reason);
    format!(
        "{}, {}{setting}, seed {}: {state}: {reason}",
        it.cell.environment, it.cell.agent, it.key.seed
    )
}
