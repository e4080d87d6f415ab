//! Past one machine: the same `worker` command, started by something that owns more machines.
//!
//! An executor starts *workers*, not trials. Each worker pulls missing trials from the shared store until none is left, so how
//! many of them run, where, and how often they die cannot reach a result: what is missing is started again. Short trials do
//! not become jobs of their own, and limits on the number of jobs do not limit the number of trials.
//!
//! - [`slurm`] drives stock `sbatch`, `squeue` and `scancel`, and follows what it submitted.
//! - [`kubernetes`] writes an Indexed Job and starts nothing.
//!
//! A [`Submission`] is identified by a name of our own, which the jobs carry. Slurm gives a job id again after a crash of its
//! controller, and an accepted job may be forgotten by one: job ids are kept to be shown, never to decide.

pub mod kubernetes;
pub mod slurm;
mod submission;
mod work;

pub use submission::{Array, State, Submission, lock};
pub use work::{Work, quoted};

use std::num::NonZeroUsize;

/// What can go wrong between this program and an executor.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A program of the executor cannot be started here.
    #[error("cannot start `{program}`: {source}; run this where Slurm's commands are installed")]
    NoProgram {
        /// The program.
        program: &'static str,
        /// What the system said.
        source: std::io::Error,
    },
    /// The executor is there but cannot answer now; the same question may be answered later.
    #[error("{program} gets no answer: {said}")]
    Busy {
        /// The program that asked.
        program: &'static str,
        /// What it said.
        said: String,
    },
    /// The executor answered no.
    #[error("{program} refuses: {said}")]
    Refused {
        /// The program that asked.
        program: &'static str,
        /// What it said.
        said: String,
    },
    /// What a program printed is not what its manual says.
    #[error("{program} printed `{text}`, which is not {expected}")]
    Unreadable {
        /// The program.
        program: &'static str,
        /// What it printed.
        text: String,
        /// What was expected.
        expected: &'static str,
    },
    /// An option of the executor cannot be used.
    #[error("`{key}`: {problem}")]
    Option {
        /// Its key inside the executor's table.
        key: &'static str,
        /// What is wrong and what to write instead.
        problem: String,
    },
    /// Workers die again and again without finishing a trial.
    #[error("{rounds} submissions in a row ended without finishing a trial{log}")]
    Fruitless {
        /// How many submissions.
        rounds: usize,
        /// The end of a worker's log, where there is one.
        log: String,
    },
    /// The submission's own files cannot be read or written.
    #[error(transparent)]
    Engine(#[from] crate::Error),
}

/// How many workers `trials` are worth: one for every `per_task`, and at least one.
fn tasks_for(trials: usize, per_task: NonZeroUsize) -> usize {
    trials.div_ceil(per_task.get())
}
