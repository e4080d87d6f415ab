//! Workers as tasks of HyperQueue, which uses machines of its own, or those of PBS and Slurm by its automatic
//! allocation.
//!
//! The client of its package submits and counts; it neither lists jobs by name nor cancels them. The number that the
//! server gave is therefore stored beside the record, with the server's own name, since a server without a journal
//! starts again at 1. Tasks find out themselves whether they are cancelled: a worker that belongs to a submission reads
//! its record, does not begin if its trials are no longer needed, and exits once the submission is cancelled.

mod client;
mod options;
mod request;

pub use options::HyperQueueOptions;

use super::{Array, Error, Executor, ExecutorKind, Queue, Stop, Submission, Task, Wanted, Way, kind};
use client::{Client, Count, Counts};
use request::{Job, Request};
use serde_json::Value;
use std::{num::NonZeroUsize, path::Path, time::Duration};

/// Name of the executor in the list of executors.
const NAME: &str = "hyperqueue";

/// HyperQueue, with the options of `[hyperqueue]`.
#[derive(Debug, Clone, Default)]
pub struct HyperQueue {
    /// The table `[hyperqueue]`.
    pub options: HyperQueueOptions,
}

/// Entry of the executor in the list of executors.
#[must_use]
pub fn kind() -> ExecutorKind {
    let options = kind::ExecutorOptions::of(|options: HyperQueueOptions| {
        options.check()?;
        Ok(Box::new(HyperQueue { options }))
    });
    ExecutorKind {
        name: NAME,
        title: "HyperQueue",
        about: "workers as tasks of HyperQueue, submitted through its Python package and followed",
        way: Way::Queue(options),
    }
}

/// A job of a submission, and its array.
struct AcceptedJob<'a> {
    submission: &'a Submission,
    array: usize,
    job: Job,
}

impl HyperQueue {
    fn client<'a>(&'a self, stop: &'a Stop) -> Client<'a> {
        Client {
            python: self.options.python(),
            directory: self.options.directory(),
            limit: self.options.answer(),
            stop,
        }
    }

    fn request(&self, submission: &Submission, array: usize) -> String {
        // Numbers, words and paths can all be written as JSON; paths were words of a command line.
        let request = Request::of(submission, array, &self.options);
        serde_json::to_string_pretty(&request).unwrap_or_default() + "\n"
    }
}

impl Executor for HyperQueue {
    fn cpus_per_task(&self) -> NonZeroUsize {
        self.options.cpus_per_task()
    }

    fn gpus_per_task(&self) -> Option<usize> {
        Some(self.options.gpus_per_task.map_or(0, NonZeroUsize::get))
    }

    fn trials_per_task(&self) -> NonZeroUsize {
        self.options.trials_per_task()
    }

    fn shares_paths(&self) -> bool {
        true
    }

    /// The request that would be submitted.
    fn written(&self, wanted: &Wanted<'_>) -> Result<String, Error> {
        let tasks = super::tasks_for(wanted.trials, self.trials_per_task()).max(1);
        let most = self.options.max_tasks();
        let arrays = Array::divide(tasks.min(most), most, most);
        Ok(self.request(&Submission::sample(wanted.store, wanted.work, self, arrays), 0))
    }

    fn queue(&self) -> Option<&dyn Queue> {
        Some(self)
    }
}

impl Queue for HyperQueue {
    fn name(&self) -> &'static str {
        NAME
    }

    fn options(&self) -> Value {
        // Options are numbers, strings and lists of strings, which JSON can represent.
        serde_json::to_value(&self.options).unwrap_or_default()
    }

    fn largest_array(&self, _: &Stop) -> Result<usize, Error> {
        Ok(self.options.max_tasks())
    }

    /// Time for one count and one submission.
    fn patience(&self) -> Duration {
        self.options.answer() * 2
    }

    fn max_tasks(&self) -> usize {
        self.options.max_tasks()
    }

    /// HyperQueue runs every task as soon as there are machines, and restarts those of lost machines.
    fn most_tasks(&self) -> usize {
        self.options.max_tasks()
    }

    fn poll_s(&self) -> f64 {
        self.options.poll_s()
    }

    fn resubmissions(&self) -> usize {
        self.options.resubmissions()
    }

    fn script(&self, submission: &Submission, array: usize) -> String {
        self.request(submission, array)
    }

    fn script_ending(&self) -> &'static str {
        "json"
    }

    fn tasks(&self, submissions: &[Submission], stop: &Stop) -> Result<Vec<Task>, Error> {
        let handed = handed(submissions)?;
        if handed.is_empty() {
            return Ok(Vec::new());
        }
        let jobs: Vec<u64> = handed.iter().map(|one| one.job.job).collect();
        let counts = self.client(stop).count(&jobs)?;
        Ok(handed.iter().flat_map(|one| living(one, &counts)).collect())
    }

    fn submit(&self, script: &Path, stop: &Stop) -> Result<String, Error> {
        Ok(self.client(stop).submit(script)?.text())
    }

    /// Nothing is sent to the server: tasks read the record of their submission, which is marked as cancelled next.
    fn cancel(&self, _: &str, _: bool, _: &Stop) -> Result<(), Error> {
        Ok(())
    }
}

/// The jobs that a server took for these submissions.
fn handed(submissions: &[Submission]) -> Result<Vec<AcceptedJob<'_>>, Error> {
    let mut all = Vec::new();
    for submission in submissions {
        for array in 0..submission.arrays.len() {
            let job = request::job(submission, array)?;
            all.extend(job.map(|job| AcceptedJob {
                submission,
                array,
                job,
            }));
        }
    }
    Ok(all)
}

/// The living tasks of a job; tasks of another server ended with that server.
fn living(handed: &AcceptedJob<'_>, counts: &Counts) -> Vec<Task> {
    let known = counts.jobs.get(&handed.job.job);
    let Some(count) = known.filter(|_| handed.job.server == counts.server) else {
        return Vec::new();
    };
    let begun = request::begun(handed.submission, handed.array);
    let task = |state: &str| Task {
        name: handed.submission.job_name(),
        job: handed.job.text(),
        state: state.into(),
        alive: true,
        waits_for: None,
    };
    states(*count, begun).map(task).collect()
}

/// States of living tasks. The client does not report which of them run; running tasks are those that have begun and
/// not ended.
fn states(count: Count, begun: usize) -> impl Iterator<Item = &'static str> {
    let running = begun.saturating_sub(count.ended());
    (0..count.alive()).map(move |place| if place < running { "RUNNING" } else { "PENDING" })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        executor::{Work, summary},
        world::fs,
    };

    fn submission(store: &Path) -> Submission {
        let work = Work {
            specs: vec!["a.yaml".into()],
            program: "regimen".into(),
            arguments: vec!["worker".into()],
            folder: "/".into(),
        };
        let arrays = Array::divide(4, 16, 16);
        let mut submission = Submission::sample(store, &work, &HyperQueue::default(), arrays);
        submission.enter().unwrap();
        submission
    }

    fn counts(server: &str) -> Counts {
        serde_json::from_value(serde_json::json!({
            "server": server, "jobs": { "7": { "total": 4, "finished": 1, "failed": 0, "completed": false } }
        }))
        .unwrap()
    }

    #[test]
    fn a_job_lives_on_the_server_that_took_it_only() {
        let store = tempfile::tempdir().unwrap();
        let submissions = [submission(store.path())];
        assert!(handed(&submissions).unwrap().is_empty());
        let folder = submissions[0].folder();
        fs::write(folder.join("array-0.job"), r#"{"server": "one", "job": 7}"#).unwrap();
        for task in 0..3 {
            fs::write(folder.join(format!("array-0-task-{task}.log")), "").unwrap();
        }
        let handed = handed(&submissions).unwrap();
        let tasks = living(&handed[0], &counts("one"));
        assert_eq!(summary(&tasks), "2 running, 1 pending");
        assert_eq!(tasks[0].name, submissions[0].job_name());
        assert!(living(&handed[0], &counts("other")).is_empty());
    }

    #[test]
    fn who_was_not_handed_over_needs_no_server() {
        let store = tempfile::tempdir().unwrap();
        let nowhere: HyperQueueOptions = toml::from_str("python = \"/nowhere/python\"").unwrap();
        let queue = HyperQueue { options: nowhere };
        assert!(
            queue
                .tasks(&[submission(store.path())], &Stop::default())
                .unwrap()
                .is_empty()
        );
        assert!(queue.cancel("regimen-1a", false, &Stop::default()).is_ok());
    }
}
