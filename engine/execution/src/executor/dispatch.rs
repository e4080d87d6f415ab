//! Keeps the number of tasks in a queue that the missing trials need.
//!
//! The decision depends on three things: the trials that are missing in the store, the submissions in the store that
//! are meant to compute them, and their tasks as the queue shows them. It therefore makes no difference whether a task
//! was cancelled, timed out, lost its node, or was forgotten by a controller that crashed: if too few tasks are left
//! for the missing trials, more are submitted. Outcomes come only from the store; no accounting database is read.

use super::{
    Array, Error, Executor, Queue, Stop, Submission, SubmissionState, Task, Wait, Way, Work, find, lock,
    tasks_for,
};
use crate::store::write_durably;
use contract::Registry;
use std::{
    collections::{BTreeMap, BTreeSet},
    num::NonZeroUsize,
    path::{Path, PathBuf},
    time::Duration,
};

/// One run that computes its trials through a queue.
pub struct Dispatch<'a> {
    /// The registry, which contains the executors that took earlier submissions.
    pub registry: &'a Registry,
    /// Folder of the store, under a path that all machines see.
    pub store: PathBuf,
    /// The command that a worker runs.
    pub work: Work,
    /// The queue that takes submissions.
    pub queue: &'a dyn Queue,
    /// Number of missing trials for each task.
    pub trials_per_task: NonZeroUsize,
    /// Ids of all trials of the run, whether they are missing or not.
    pub trials: BTreeSet<String>,
    /// The stop request, which ends a wait for the queue.
    pub stop: Stop,
}

/// A submission and those of its tasks that its queue knows.
#[derive(Debug, Clone)]
pub struct Holding {
    /// The record of the submission in the store.
    pub submission: Submission,
    /// Its tasks as the queue last showed them.
    pub tasks: Vec<Task>,
}

impl Holding {
    /// Number of tasks that have not ended.
    #[must_use]
    pub fn alive(&self) -> usize {
        self.tasks.iter().filter(|task| task.alive).count()
    }

    fn covers(&self, missing: &BTreeSet<String>) -> bool {
        !self.submission.trials.is_disjoint(missing)
    }
}

/// State of the work on the missing trials.
#[derive(Debug, Clone, Default)]
pub struct View {
    /// Open submissions with living tasks that are meant to compute some of them.
    pub live: Vec<Holding>,
    /// Open submissions without a living task.
    pub dead: Vec<Submission>,
    /// Number of tasks to add.
    pub need: usize,
}

impl View {
    /// Number of living tasks.
    #[must_use]
    pub fn alive(&self) -> usize {
        self.live.iter().map(Holding::alive).sum()
    }
}

/// The open submissions of a store with their tasks; no queue is asked if there are none.
///
/// # Errors
/// [`Error::Engine`] if a record cannot be read, and the errors of queues.
pub fn holdings(registry: &Registry, store: &Path, stop: &Stop) -> Result<Vec<Holding>, Error> {
    holdings_with(registry, store, None, stop)
}

/// Like [`holdings`]; `own` is asked for the submissions that it took itself.
fn holdings_with(
    registry: &Registry,
    store: &Path,
    own: Option<&dyn Queue>,
    stop: &Stop,
) -> Result<Vec<Holding>, Error> {
    let mut by_executor: BTreeMap<String, Vec<Submission>> = BTreeMap::new();
    for submission in open(store)? {
        by_executor
            .entry(submission.executor.clone())
            .or_default()
            .push(submission);
    }
    let mut all = Vec::new();
    for (executor, submissions) in by_executor {
        let tasks = match own.filter(|queue| queue.name() == executor) {
            Some(queue) => queue.tasks(&submissions, stop)?,
            None => asked(registry, &submissions[0], |queue| queue.tasks(&submissions, stop))?,
        };
        all.extend(submissions.into_iter().map(|submission| held(submission, &tasks)));
    }
    all.sort_by(|one, other| one.submission.id.cmp(&other.submission.id));
    Ok(all)
}

fn held(submission: Submission, tasks: &[Task]) -> Holding {
    let name = submission.job_name();
    Holding {
        submission,
        tasks: tasks.iter().filter(|task| task.name == name).cloned().collect(),
    }
}

/// Asks the queue that took a submission.
fn asked<T>(
    registry: &Registry,
    submission: &Submission,
    ask: impl Fn(&dyn Queue) -> Result<T, Error>,
) -> Result<T, Error> {
    let Some(Way::Queue(options)) = find(registry, &submission.executor).map(|kind| kind.way) else {
        let (id, executor) = (submission.id.clone(), submission.executor.clone());
        return Err(Error::Unknown { id, executor });
    };
    let executor: Box<dyn Executor> = options.build(&submission.options)?;
    match executor.queue() {
        Some(queue) => ask(queue),
        None => Err(Error::Unknown {
            id: submission.id.clone(),
            executor: submission.executor.clone(),
        }),
    }
}

/// The submissions of a store whose jobs may be queued or running.
///
/// # Errors
/// [`Error::Engine`] if a record cannot be read.
pub fn open(store: &Path) -> Result<Vec<Submission>, Error> {
    Ok(Submission::all(store)?
        .into_iter()
        .filter(|submission| submission.state == SubmissionState::Open)
        .collect())
}

/// Longest time that a cancellation waits for the lock on submissions.
const LONGEST_WAIT: Duration = Duration::from_secs(600);

/// Cancels every open submission that is meant to compute one of these trials and returns them.
///
/// # Errors
/// The errors of queues; the submission then stays open.
pub fn cancel(
    registry: &Registry,
    store: &Path,
    trials: &BTreeSet<String>,
    stop: &Stop,
    say: &mut dyn FnMut(&str),
) -> Result<Vec<Submission>, Error> {
    let limit = LONGEST_WAIT;
    let _held = lock(store, Wait { limit, stop, say })?;
    let mut cancelled = Vec::new();
    for mut submission in open(store)? {
        if !submission.trials.is_disjoint(trials) {
            asked(registry, &submission, |queue| {
                queue.cancel(&submission.job_name(), false, stop)
            })?;
            submission.close(SubmissionState::Cancelled)?;
            cancelled.push(submission);
        }
    }
    Ok(cancelled)
}

impl Dispatch<'_> {
    /// State of the work on `missing`, and the number of tasks to add.
    ///
    /// # Errors
    /// The errors of [`holdings`].
    pub fn look(&self, missing: &BTreeSet<String>) -> Result<View, Error> {
        let (live, dead): (Vec<_>, Vec<_>) =
            holdings_with(self.registry, &self.store, Some(self.queue), &self.stop)?
                .into_iter()
                .partition(|holding| holding.alive() > 0);
        let live: Vec<Holding> = live
            .into_iter()
            .filter(|holding| holding.covers(missing))
            .collect();
        let covered = |id: &&String| live.iter().any(|holding| holding.submission.trials.contains(*id));
        let uncovered = missing.iter().filter(|id| !covered(id)).count();
        let mut view = View {
            live,
            dead: dead.into_iter().map(|holding| holding.submission).collect(),
            need: 0,
        };
        let wanted = tasks_for(missing.len(), self.trials_per_task);
        let need = tasks_for(uncovered, self.trials_per_task).max(wanted.saturating_sub(view.alive()));
        view.need = need.min(self.queue.most_tasks().saturating_sub(view.alive()));
        Ok(view)
    }

    /// Submits the tasks to add, so that the missing trials are being computed. Calling it twice, or in two processes
    /// at a time, submits once: a living submission is found by its name.
    ///
    /// # Errors
    /// The errors of [`holdings`]; [`Error::Refused`] if the queue does not take the jobs.
    pub fn ensure(&self, missing: &BTreeSet<String>, say: &mut dyn FnMut(&str)) -> Result<View, Error> {
        let (limit, stop) = (self.queue.patience(), &self.stop);
        let _held = lock(&self.store, Wait { limit, stop, say })?;
        let mut view = self.look(missing)?;
        let mut unsent = None;
        for mut submission in view.dead.drain(..) {
            // A submission that no controller has confirmed is sent again under its name, unless it has more tasks than
            // are needed by now; all others are closed.
            if unsent.is_none() && self.is_unsent(&submission) && submission.tasks() <= view.need {
                unsent = Some(submission);
            } else {
                submission.close(SubmissionState::Ended)?;
            }
        }
        if view.need > 0 {
            let submission = match unsent {
                Some(submission) => submission,
                None => self.prepare(missing, &view)?,
            };
            let submission = self.send(submission)?;
            view.live.push(Holding {
                submission,
                tasks: Vec::new(),
            });
        }
        Ok(view)
    }

    fn is_unsent(&self, submission: &Submission) -> bool {
        submission.work == self.work
            && submission.executor == self.queue.name()
            && submission.options == self.queue.options()
            && submission.arrays.iter().all(|array| array.job.is_none())
    }

    fn prepare(&self, missing: &BTreeSet<String>, view: &View) -> Result<Submission, Error> {
        let at_once = self.queue.max_tasks().saturating_sub(view.alive());
        let arrays = Array::divide(view.need, self.queue.largest_array(&self.stop)?, at_once);
        let mut submission = Submission::sample(&self.store, &self.work, self.queue, arrays);
        submission.trials = missing.clone();
        submission.enter()?;
        Ok(submission)
    }

    /// Submits the arrays and records each job id as it arrives. Scripts are written here instead of with the record,
    /// since a process that died after the record may not have written them.
    fn send(&self, mut submission: Submission) -> Result<Submission, Error> {
        for array in 0..submission.arrays.len() {
            let script = self.queue.script(&submission, array);
            let path = submission.script(array, self.queue.script_ending());
            write_durably(&path, script.as_bytes())?;
            match self.queue.submit(&path, &self.stop) {
                Ok(job) => submission.arrays[array].job = Some(job),
                Err(error) => {
                    if error.is_refusal() && array == 0 {
                        submission.close(SubmissionState::Refused)?;
                    }
                    return Err(error);
                }
            }
            submission.save()?;
        }
        Ok(submission)
    }
}
