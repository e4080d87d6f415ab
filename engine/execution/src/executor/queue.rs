//! Queues, which take submissions and show the state of their tasks.

use super::{Error, Stop, Submission};
use serde_json::Value;
use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
    time::Duration,
};

/// A batch system that takes job arrays and reports which of their tasks are alive.
///
/// The caller decides how a wait for an answer is stopped; an answer that takes too long is [`Error::Silent`].
///
/// If possible, jobs are found by the name that they carry, [`Submission::job_name`]: an id may be lost, or may be
/// given twice.
pub trait Queue {
    /// Name of the executor in the list of [`all`](super::all).
    fn name(&self) -> &'static str;

    /// Options of the executor as they are recorded; [`ExecutorOptions::build`](super::ExecutorOptions::build) makes
    /// the executor from them again.
    fn options(&self) -> Value;

    /// Largest number of tasks in one array.
    ///
    /// # Errors
    /// [`Error::Busy`] if it does not answer.
    fn largest_array(&self, stop: &Stop) -> Result<usize, Error>;

    /// Longest time that all answers to one submission may take; a process that decides about a submission for longer
    /// is assumed to hang.
    fn patience(&self) -> Duration;

    /// Number of tasks that may run at a time.
    fn max_tasks(&self) -> usize;

    /// Largest number of tasks that are submitted and have not ended; in most queues, those that may not run yet wait.
    fn most_tasks(&self) -> usize {
        usize::MAX
    }

    /// Seconds between two requests about tasks.
    fn poll_s(&self) -> f64;

    /// Number of consecutive submissions that may end without finishing a trial.
    fn resubmissions(&self) -> usize;

    /// The script of one array of a submission.
    fn script(&self, submission: &Submission, array: usize) -> String;

    /// Ending of the file name of a script.
    fn script_ending(&self) -> &'static str;

    /// Those tasks of these submissions that the queue knows; it may forget ended ones after a while.
    ///
    /// # Errors
    /// [`Error::Busy`] if it does not answer.
    fn tasks(&self, submissions: &[Submission], stop: &Stop) -> Result<Vec<Task>, Error>;

    /// Submits a script and returns the job's id.
    ///
    /// # Errors
    /// [`Error::Refused`] if it refuses, [`Error::Busy`] if it does not answer; the job may exist even then.
    fn submit(&self, script: &Path, stop: &Stop) -> Result<String, Error>;

    /// Cancels the jobs with a name: all, or those that have not started.
    ///
    /// # Errors
    /// The errors of [`submit`](Self::submit).
    fn cancel(&self, name: &str, waiting_only: bool, stop: &Stop) -> Result<(), Error>;
}

/// A task of a job that a queue knows of.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Task {
    /// Name of its job, which is that of a submission.
    pub name: String,
    /// The job id of its array.
    pub job: String,
    /// Its state in the queue's terms, such as `RUNNING`.
    pub state: String,
    /// Whether the task may still run: false after an end of any kind.
    pub alive: bool,
    /// Reason why the task has not started, if the queue gives one.
    pub waits_for: Option<String>,
}

/// Numbers of living tasks by state.
#[must_use]
pub fn counts(tasks: &[Task]) -> BTreeMap<&str, usize> {
    let mut counts = BTreeMap::new();
    tasks
        .iter()
        .filter(|task| task.alive)
        .for_each(|task| *counts.entry(task.state.as_str()).or_default() += 1);
    counts
}

/// Numbers of living tasks by state, in one line for users.
#[must_use]
pub fn summary(tasks: &[Task]) -> String {
    let counts = counts(tasks);
    if counts.is_empty() {
        return "no task".into();
    }
    // In descending order of their names, so that running comes before pending.
    let parts: Vec<String> = counts
        .iter()
        .rev()
        .map(|(state, count)| format!("{count} {}", state.to_lowercase()))
        .collect();
    let reasons: BTreeSet<&str> = tasks
        .iter()
        .filter_map(|task| task.waits_for.as_deref())
        .collect();
    let reasons = reasons.into_iter().collect::<Vec<_>>().join(", ");
    parts.join(", ")
        + &if reasons.is_empty() {
            String::new()
        } else {
            format!(" ({reasons})")
        }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_queue_is_summed_up_by_state_and_reason() {
        let of = |state: &str, waits_for: Option<&str>, alive: bool| Task {
            name: "regimen-1a".into(),
            job: "7".into(),
            state: state.into(),
            alive,
            waits_for: waits_for.map(Into::into),
        };
        let tasks = [
            of("PENDING", Some("Resources"), true),
            of("PENDING", None, true),
            of("RUNNING", None, true),
            of("TIMEOUT", None, false),
        ];
        assert_eq!(summary(&tasks), "1 running, 2 pending (Resources)");
        assert_eq!(summary(&tasks[3..]), "no task");
    }
}
