//! Past one machine: the same `worker` command, started by something that owns more machines.
//!
//! An executor starts *workers*, not trials. Each worker pulls missing trials from the shared store until
//! none is left, so how many of them run, where, and how often they die cannot reach a result: what is
//! missing is started again. Short trials do not become jobs of their own, and limits on the number of jobs
//! do not limit the number of trials.
//!
//! - An [`Executor`] says what a task is and writes what is handed over for it.
//! - Where it has a [`Queue`], [`Dispatch`] keeps as many tasks in it as the missing trials are worth, and
//!   waits.
//! - [`all`] is the list of executors; [`slurm`] and [`hyperqueue`] have queues, [`kubernetes`] writes a manifest and
//!   starts nothing, and [`ssh`] names hosts whose trials the scheduler of this machine runs itself.
//!
//! A [`Submission`] is identified by a name of our own, which the jobs carry. A queue may give a job id again
//! after a crash of its controller, and an accepted job may be forgotten by one: job ids are kept to be
//! shown, never to decide, where jobs can be found by their names.

mod answer;
mod dispatch;
mod follow;
pub mod hyperqueue;
mod kind;
pub mod kubernetes;
mod lock;
mod queue;
pub mod slurm;
pub mod ssh;
mod submission;
mod work;

pub use answer::Stop;
pub(crate) use answer::tell;
pub use dispatch::{Dispatch, Holding, View, cancel, holdings, open};
pub use follow::{Outcome, Patience, Watch, describe};
pub use kind::{Kind, LOCAL, Options, Way, all, find};
pub use lock::{Wait, lock};
pub use queue::{Queue, Task, counts, summary};
pub use ssh::Access;
pub use submission::{Array, State, Submission, damaged, heal};
pub use work::{Work, quoted};

use std::{
    fmt::Debug,
    num::NonZeroUsize,
    path::{Path, PathBuf},
};

/// Something that starts workers on other machines, with its options.
pub trait Executor: Debug {
    /// Cores of a task, each with a worker process.
    fn cpus_per_task(&self) -> NonZeroUsize;

    /// Graphics cards of a task; `None` where none can be asked for.
    fn gpus_per_task(&self) -> Option<usize> {
        None
    }

    /// Missing trials that are worth a task.
    fn trials_per_task(&self) -> NonZeroUsize;

    /// True where workers see the files of this machine under the paths that they have here.
    fn shares_paths(&self) -> bool;

    /// What would be handed over; nobody is asked.
    ///
    /// # Errors
    /// [`Error::Option`] where an option is missing that nothing can stand for.
    fn written(&self, wanted: &Wanted<'_>) -> Result<String, Error>;

    /// Hosts that the program reaches itself; `None` where something else owns the machines.
    fn access(&self) -> Option<&Access> {
        None
    }

    /// What takes submissions and shows their tasks; `None` where a person hands over what is written.
    fn queue(&self) -> Option<&dyn Queue> {
        None
    }
}

/// What workers are wanted for.
#[derive(Debug, Clone, Copy)]
pub struct Wanted<'a> {
    /// Name of the study, or names.
    pub study: &'a str,
    /// The store, as workers find it.
    pub store: &'a Path,
    /// What each of them runs.
    pub work: &'a Work,
    /// Number of missing trials.
    pub trials: usize,
}

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
    /// A program of the executor did not end within its time; what it was to do may have been done.
    #[error("{program} gave no answer within {after_s} s and was ended")]
    Silent {
        /// The program.
        program: &'static str,
        /// How long it was waited for.
        after_s: f64,
    },
    /// The wait for an answer was stopped by whoever waited.
    #[error("{program} had not answered when it was stopped")]
    Interrupted {
        /// The program.
        program: &'static str,
    },
    /// Another process decides about the submissions of the store, and does not come to an end.
    #[error(
        "{by} holds `{}` for more than {after_s} s: if it hangs, end it, and run this again",
        path.display()
    )]
    Held {
        /// The lock's file.
        path: PathBuf,
        /// Who holds it.
        by: String,
        /// How long it was waited for.
        after_s: f64,
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
    /// A submission was handed to an executor that has no queue in this program.
    #[error("submission {id} was handed to `{executor}`, which takes no submissions in this program")]
    Unknown {
        /// The submission.
        id: String,
        /// The executor that its record names.
        executor: String,
    },
    /// The options in the record of a submission cannot be read.
    #[error("the options of the record cannot be read: {problem}")]
    Record {
        /// What is wrong with them.
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
    Engine(#[from] contract::Error),
}

impl Error {
    /// True where nothing was taken, and nothing will be before a person has changed something.
    fn is_refusal(&self) -> bool {
        matches!(
            self,
            Self::Refused { .. } | Self::NoProgram { .. } | Self::Option { .. }
        )
    }

    /// True where the same question may be answered later.
    fn is_passing(&self) -> bool {
        matches!(self, Self::Busy { .. } | Self::Silent { .. })
    }
}

/// How many tasks `trials` are worth: one for every `per_task`.
fn tasks_for(trials: usize, per_task: NonZeroUsize) -> usize {
    trials.div_ceil(per_task.get())
}

/// What a task is worth where nothing is said: four trials for each of its cores.
fn four_each(cpus_per_task: NonZeroUsize) -> NonZeroUsize {
    cpus_per_task.saturating_mul(NonZeroUsize::MIN.saturating_add(3))
}
