//! Executors, which start workers on other machines with the same `worker` command as on this one.
//!
//! An executor starts *workers*, not trials. Each worker pulls missing trials from the shared store until none is left.
//! Results therefore do not depend on the number of workers, on their machines or on their deaths: a missing trial is
//! started again. Short trials do not become jobs of their own, and limits on the number of jobs do not limit the
//! number of trials.
//!
//! - An [`Executor`] defines a task and writes the text to submit for it.
//! - If it has a [`Queue`], [`Dispatch`] keeps the number of tasks in it that the missing trials need, and waits.
//! - [`all`] is the list of executors, to which other crates add theirs by [`RegisterExecutor`]; [`slurm`] and
//!   [`hyperqueue`] have queues, [`kubernetes`] writes a manifest and
//!   starts nothing, and [`ssh`] names hosts whose trials the scheduler of this machine runs itself.
//!
//! A [`Submission`] is identified by a name that this program chooses and its jobs carry. A queue may reuse a job id
//! after a crash of its controller, and a controller may forget an accepted job. If jobs can be found by their names,
//! job ids are therefore kept only for display and decide nothing.

mod command_output;
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

pub use command_output::Stop;
pub(crate) use command_output::tell;
pub use dispatch::{Dispatch, Holding, View, cancel, holdings, open};
pub use follow::{Patience, WaitEnd, Watch, describe};
pub use kind::{ExecutorKind, ExecutorOptions, LOCAL, RegisterExecutor, Way, all, find};
pub use lock::{Wait, lock};
pub use queue::{Queue, Task, counts, summary};
pub use ssh::Access;
pub use submission::{Array, Submission, SubmissionState, damaged, heal};
pub use work::{Work, quoted};

use std::{
    fmt::Debug,
    num::NonZeroUsize,
    path::{Path, PathBuf},
};

/// The executors of the engine, each by the function that makes its entry.
const OWN: &[fn() -> ExecutorKind] = &[
    kind::local,
    ssh::kind,
    slurm::kind,
    hyperqueue::kind,
    kubernetes::kind,
];

/// An executor: a batch system or a set of hosts that starts workers on other machines, with its options.
pub trait Executor: Debug {
    /// Cores of a task, each with a worker process.
    fn cpus_per_task(&self) -> NonZeroUsize;

    /// Graphics cards of a task; `None` if none can be requested.
    fn gpus_per_task(&self) -> Option<usize> {
        None
    }

    /// Number of missing trials for each task.
    fn trials_per_task(&self) -> NonZeroUsize;

    /// Whether workers see the files of this machine under the paths that they have here.
    fn shares_paths(&self) -> bool;

    /// The text that would be submitted; no queue is asked.
    ///
    /// # Errors
    /// [`Error::Option`] for a missing option that has no default.
    fn written(&self, wanted: &Wanted<'_>) -> Result<String, Error>;

    /// Hosts that the program reaches itself; `None` if the executor owns the machines.
    fn access(&self) -> Option<&Access> {
        None
    }

    /// The queue that takes submissions and shows their tasks; `None` if the user submits the text.
    fn queue(&self) -> Option<&dyn Queue> {
        None
    }
}

/// Request for workers: the study, its store and the number of missing trials.
#[derive(Debug, Clone, Copy)]
pub struct Wanted<'a> {
    /// Name of the study, or names.
    pub study: &'a str,
    /// Path of the store as seen by workers.
    pub store: &'a Path,
    /// The command that each worker runs.
    pub work: &'a Work,
    /// Number of missing trials.
    pub trials: usize,
}

/// Errors between this program and an executor.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A program of the executor cannot be started here.
    #[error("cannot start `{program}`: {source}; run this where Slurm's commands are installed")]
    NoProgram {
        /// Name of the program.
        program: &'static str,
        /// The error of the system.
        source: std::io::Error,
    },
    /// The executor is available but cannot answer now; a later attempt may succeed.
    #[error("{program} gets no answer: {said}")]
    Busy {
        /// Name of the program that asked.
        program: &'static str,
        /// Its output.
        said: String,
    },
    /// A program of the executor did not end within its time; its request may have been carried out.
    #[error("{program} gave no answer within {after_s} s and was ended")]
    Silent {
        /// Name of the program.
        program: &'static str,
        /// Length of the wait in seconds.
        after_s: f64,
    },
    /// The wait for an answer was stopped by the caller.
    #[error("{program} had not answered when it was stopped")]
    Interrupted {
        /// Name of the program that was waited for.
        program: &'static str,
    },
    /// Another process holds the lock on submissions of the store and does not finish.
    #[error(
        "{by} holds `{}` for more than {after_s} s: if it hangs, end it, and run this again",
        path.display()
    )]
    Held {
        /// File of the lock.
        path: PathBuf,
        /// Name of the holder.
        by: String,
        /// Length of the wait in seconds.
        after_s: f64,
    },
    /// The executor refused the request.
    #[error("{program} refuses: {said}")]
    Refused {
        /// Name of the program that asked.
        program: &'static str,
        /// Its output.
        said: String,
    },
    /// The output of a program differs from its manual.
    #[error("{program} printed `{text}`, which is not {expected}")]
    Unreadable {
        /// Name of the program.
        program: &'static str,
        /// The output.
        text: String,
        /// The expected form.
        expected: &'static str,
    },
    /// An option of the executor cannot be used.
    #[error("`{key}`: {problem}")]
    Option {
        /// The key inside the executor's table.
        key: &'static str,
        /// The problem, and the value to write instead.
        problem: String,
    },
    /// A submission was handed to an executor that has no queue in this program.
    #[error("submission {id} was handed to `{executor}`, which takes no submissions in this program")]
    Unknown {
        /// Id of the submission.
        id: String,
        /// Name of the executor in the record.
        executor: String,
    },
    /// The options in the record of a submission cannot be read.
    #[error("the options of the record cannot be read: {problem}")]
    Record {
        /// The problem with them.
        problem: String,
    },
    /// Workers die again and again without finishing a trial.
    #[error("{rounds} submissions in a row ended without finishing a trial{log}")]
    Fruitless {
        /// Number of submissions in a row.
        rounds: usize,
        /// The end of a worker's log, if there is one.
        log: String,
    },
    /// The submission's own files cannot be read or written.
    #[error(transparent)]
    Engine(#[from] contract::Error),
}

impl Error {
    /// Whether the executor took nothing, and will take nothing until the user has changed something.
    fn is_refusal(&self) -> bool {
        matches!(
            self,
            Self::Refused { .. } | Self::NoProgram { .. } | Self::Option { .. }
        )
    }

    /// Whether the same request may be answered later.
    fn is_passing(&self) -> bool {
        matches!(self, Self::Busy { .. } | Self::Silent { .. })
    }
}

/// Number of tasks for `trials` missing trials: one for every `per_task`.
fn tasks_for(trials: usize, per_task: NonZeroUsize) -> usize {
    trials.div_ceil(per_task.get())
}

/// Default number of trials per task: four for each of its cores.
fn four_each(cpus_per_task: NonZeroUsize) -> NonZeroUsize {
    cpus_per_task.saturating_mul(NonZeroUsize::MIN.saturating_add(3))
}
