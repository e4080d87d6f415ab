//! Workers in Slurm job arrays, through the stock commands.
//!
//! What is to be done follows from three things: the trials that are missing in the store, the submissions in the store that
//! are meant to compute them, and the tasks of these that the queue shows. So it makes no difference whether a task was
//! cancelled, timed out, lost its node, or was forgotten by a controller that crashed: where too few tasks are left for what is
//! missing, more are submitted. Outcomes come from the store alone; no accounting database is asked.

mod client;
mod follow;
mod options;
mod script;

pub use client::{Task, counts, summary};
pub use follow::{Outcome, Patience, Watch, describe};
pub use options::Options;
pub use script::{divide, render};

use super::{Error, State, Submission, Work, lock, tasks_for};
use crate::store::write_durably;
use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
};

/// One run that computes its trials through Slurm.
#[derive(Debug, Clone)]
pub struct Slurm {
    /// The store, under a path that all machines see.
    pub store: PathBuf,
    /// What a worker runs.
    pub work: Work,
    /// How workers are asked for.
    pub options: Options,
    /// Ids of all trials of the run, whether they are missing or not.
    pub trials: BTreeSet<String>,
}

/// A submission and the tasks of it that Slurm knows of.
#[derive(Debug, Clone)]
pub struct Holding {
    /// The submission.
    pub submission: Submission,
    /// Its tasks.
    pub tasks: Vec<Task>,
}

impl Holding {
    /// Number of tasks that have not ended.
    #[must_use]
    pub fn alive(&self) -> usize {
        self.tasks.iter().filter(|task| task.is_alive()).count()
    }

    fn covers(&self, missing: &BTreeSet<String>) -> bool {
        !self.submission.trials.is_disjoint(missing)
    }
}

/// What is being done about the missing trials.
#[derive(Debug, Clone, Default)]
pub struct View {
    /// Open submissions with living tasks that are meant to compute some of them.
    pub live: Vec<Holding>,
    /// Open submissions without a living task.
    pub dead: Vec<Submission>,
    /// How many tasks should be added.
    pub need: usize,
}

impl View {
    /// Number of living tasks.
    #[must_use]
    pub fn alive(&self) -> usize {
        self.live.iter().map(Holding::alive).sum()
    }
}

/// The open submissions of a store with their tasks; Slurm is not asked where there is none.
///
/// # Errors
/// Where a record cannot be read or Slurm cannot be asked.
pub fn holdings(store: &Path) -> Result<Vec<Holding>, Error> {
    let open: Vec<Submission> = open(store)?;
    let names: Vec<String> = open.iter().map(Submission::job_name).collect();
    let tasks = client::tasks(&names)?;
    let holding = |submission: Submission| {
        let name = submission.job_name();
        Holding { submission, tasks: tasks.iter().filter(|task| task.name == name).cloned().collect() }
    };
    Ok(open.into_iter().map(holding).collect())
}

/// The submissions of a store whose jobs may be queued or running.
///
/// # Errors
/// Where a record cannot be read.
pub fn open(store: &Path) -> Result<Vec<Submission>, Error> {
    Ok(Submission::all(store)?.into_iter().filter(|submission| submission.state == State::Open).collect())
}

/// Cancels every open submission that is meant to compute one of these trials and returns them.
///
/// # Errors
/// Where Slurm cannot be asked; the submission stays open then.
pub fn cancel(store: &Path, trials: &BTreeSet<String>) -> Result<Vec<Submission>, Error> {
    let _held = lock(store)?;
    let mut cancelled = Vec::new();
    for mut submission in open(store)? {
        if !submission.trials.is_disjoint(trials) {
            client::cancel(&submission.job_name(), false)?;
            submission.close(State::Cancelled)?;
            cancelled.push(submission);
        }
    }
    Ok(cancelled)
}

impl Slurm {
    /// What is being done about `missing`, and what lacks.
    ///
    /// # Errors
    /// As [`holdings`].
    pub fn look(&self, missing: &BTreeSet<String>) -> Result<View, Error> {
        let (live, dead): (Vec<_>, Vec<_>) = holdings(&self.store)?.into_iter().partition(|holding| holding.alive() > 0);
        let live: Vec<Holding> = live.into_iter().filter(|holding| holding.covers(missing)).collect();
        let covered = |id: &&String| live.iter().any(|holding| holding.submission.trials.contains(*id));
        let uncovered = missing.iter().filter(|id| !covered(id)).count();
        let mut view = View { live, dead: dead.into_iter().map(|holding| holding.submission).collect(), need: 0 };
        let per_task = self.options.trials_per_task();
        view.need = tasks_for(uncovered, per_task).max(tasks_for(missing.len(), per_task).saturating_sub(view.alive()));
        Ok(view)
    }

    /// Submits what lacks, so that the missing trials are being computed. Doing it twice, or in two processes at a time, submits
    /// once: a submission that lives is found by its name.
    ///
    /// # Errors
    /// As [`holdings`]; [`Error::Refused`] where Slurm does not take the jobs.
    pub fn ensure(&self, missing: &BTreeSet<String>) -> Result<View, Error> {
        let _held = lock(&self.store)?;
        let mut view = self.look(missing)?;
        let mut unsent = None;
        for mut submission in view.dead.drain(..) {
            // A submission that no controller has confirmed is sent again under its name; all others are over.
            if unsent.is_none() && self.is_unsent(&submission) {
                unsent = Some(submission);
            } else {
                submission.close(State::Ended)?;
            }
        }
        if view.need > 0 {
            let submission = match unsent {
                Some(submission) => submission,
                None => self.prepare(missing, &view)?,
            };
            let submission = send(submission)?;
            view.live.push(Holding { submission, tasks: Vec::new() });
        }
        Ok(view)
    }

    fn is_unsent(&self, submission: &Submission) -> bool {
        submission.work == self.work
            && submission.options == self.options
            && submission.arrays.iter().all(|array| array.job.is_none())
    }

    fn prepare(&self, missing: &BTreeSet<String>, view: &View) -> Result<Submission, Error> {
        let at_once = self.options.max_tasks().saturating_sub(view.alive());
        let arrays = divide(view.need, client::max_array_size()?, at_once);
        let submission = Submission::create(&self.store, &self.work, &self.options, arrays, missing.clone())?;
        for array in 0..submission.arrays.len() {
            write_durably(&submission.script(array), render(&submission, array).as_bytes())?;
        }
        Ok(submission)
    }
}

/// Hands the arrays to `sbatch`; ids are noted as they come.
fn send(mut submission: Submission) -> Result<Submission, Error> {
    for array in 0..submission.arrays.len() {
        match client::submit(&submission.script(array)) {
            Ok(job) => submission.arrays[array].job = Some(job),
            Err(error) => {
                if matches!(error, Error::Refused { .. } | Error::NoProgram { .. }) && array == 0 {
                    submission.close(State::Refused)?;
                }
                return Err(error);
            }
        }
        submission.save()?;
    }
    Ok(submission)
}
