//! Workers in Slurm job arrays, through the stock commands `sbatch`, `squeue`, `scontrol` and `scancel`.

mod client;
mod options;
mod script;

pub use options::SlurmOptions;

use super::{Array, Error, Executor, ExecutorKind, Queue, Stop, Submission, Task, Wanted, Way, kind};
use client::Client;
use serde_json::Value;
use std::{num::NonZeroUsize, path::Path, time::Duration};

/// Name of the executor in the list of executors.
const NAME: &str = "slurm";
/// Slurm's default of `MaxArraySize`.
const USUAL_MAX_ARRAY_SIZE: usize = 1001;

/// Slurm, with the options of `[slurm]`.
#[derive(Debug, Clone, Default)]
pub struct Slurm {
    /// The table `[slurm]`.
    pub options: SlurmOptions,
}

/// Entry of the executor in the list of executors.
#[must_use]
pub fn kind() -> ExecutorKind {
    let options = kind::ExecutorOptions::of(|options: SlurmOptions| {
        options.check()?;
        Ok(Box::new(Slurm { options }))
    });
    let about = "workers in Slurm job arrays, submitted with sbatch and followed";
    ExecutorKind {
        name: NAME,
        title: "Slurm",
        about,
        way: Way::Queue(options),
    }
}

impl Slurm {
    fn client<'a>(&self, stop: &'a Stop) -> Client<'a> {
        Client {
            answer: self.options.answer(),
            submit: self.options.submit(),
            stop,
        }
    }
}

impl Executor for Slurm {
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

    /// The first script that would be submitted.
    fn written(&self, wanted: &Wanted<'_>) -> Result<String, Error> {
        let tasks = super::tasks_for(wanted.trials, self.trials_per_task()).max(1);
        let arrays = Array::divide(tasks, USUAL_MAX_ARRAY_SIZE, self.options.max_tasks());
        Ok(script::render(
            &Submission::sample(wanted.store, wanted.work, self, arrays),
            0,
            &self.options,
        ))
    }

    fn queue(&self) -> Option<&dyn Queue> {
        Some(self)
    }
}

impl Queue for Slurm {
    fn name(&self) -> &'static str {
        NAME
    }

    fn options(&self) -> Value {
        // Options are numbers, strings and lists of strings, which JSON can represent.
        serde_json::to_value(&self.options).unwrap_or_default()
    }

    fn largest_array(&self, stop: &Stop) -> Result<usize, Error> {
        Ok(self
            .client(stop)
            .max_array_size()?
            .unwrap_or(USUAL_MAX_ARRAY_SIZE))
    }

    /// Time for one request to the queue, one to the configuration and one submission.
    fn patience(&self) -> Duration {
        self.options.answer() * 2 + self.options.submit()
    }

    fn max_tasks(&self) -> usize {
        self.options.max_tasks()
    }

    fn poll_s(&self) -> f64 {
        self.options.poll_s()
    }

    fn resubmissions(&self) -> usize {
        self.options.resubmissions()
    }

    fn script(&self, submission: &Submission, array: usize) -> String {
        script::render(submission, array, &self.options)
    }

    fn script_ending(&self) -> &'static str {
        "sbatch"
    }

    fn tasks(&self, submissions: &[Submission], stop: &Stop) -> Result<Vec<Task>, Error> {
        let names: Vec<String> = submissions.iter().map(Submission::job_name).collect();
        self.client(stop).tasks(&names)
    }

    fn submit(&self, script: &Path, stop: &Stop) -> Result<String, Error> {
        self.client(stop).submit(script)
    }

    fn cancel(&self, name: &str, waiting_only: bool, stop: &Stop) -> Result<(), Error> {
        self.client(stop).cancel(name, waiting_only)
    }
}
