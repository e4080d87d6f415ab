//! Waits for trials that the tasks of a queue compute, and keeps enough tasks for them.

use super::{Dispatch, Error, Stop, Submission, SubmissionState, Task, View};
use crate::world::clock;
use document::count::{count, either};
use std::{
    collections::BTreeSet,
    time::{Duration, Instant},
};

/// Interval between two checks of the store.
const STORE_POLL: Duration = Duration::from_secs(1);
/// Longest pause after requests that the queue did not answer, in seconds.
const LONGEST_PAUSE_S: f64 = 60.0;
/// Number of attempts at a first submission while the controller is busy.
const FIRST_TRIES: u32 = 8;

/// The waiting side, which knows the store and shows progress.
pub trait Watch {
    /// Ids of the trials that have not ended.
    fn missing(&mut self) -> BTreeSet<String>;
    /// A number that grows with every checkpoint that a missing trial saves.
    fn saved(&mut self) -> u64;
    /// The tasks that the queue holds for the trials now.
    fn queue(&mut self, tasks: &[Task]);
    /// Shows a message to the user.
    fn say(&mut self, text: &str);
}

/// End of a wait for trials.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WaitEnd {
    /// Every trial has ended.
    Ended,
    /// The wait was stopped; the jobs continue.
    Stopped,
    /// The submissions were cancelled.
    Cancelled,
}

/// Decides whether it makes sense to submit again.
#[derive(Debug, Clone)]
pub struct Patience {
    fruitless: usize,
    quick: usize,
    limit: usize,
}

impl Patience {
    /// Number of consecutive submissions that may end within [`Self::QUICK_S`] without a trial.
    const QUICK: usize = 4;
    /// Workers that exit within this time, in seconds, count as having done nothing.
    const QUICK_S: f64 = 60.0;

    /// Patience for `limit` consecutive submissions that finish nothing.
    #[must_use]
    pub fn new(limit: usize) -> Self {
        Self {
            fruitless: 0,
            quick: 0,
            limit,
        }
    }

    /// Records the last submission: whether a trial ended or advanced since, and the seconds after which it was over.
    pub fn note(&mut self, bore_fruit: bool, after_s: f64) {
        if bore_fruit {
            (self.fruitless, self.quick) = (0, 0);
            return;
        }
        self.fruitless += 1;
        self.quick = if after_s < Self::QUICK_S {
            self.quick + 1
        } else {
            0
        };
    }

    /// Number of polls to wait before the next submission. A trial whose worker's machine vanished becomes free only
    /// after a while: workers that come too early find no trial and exit.
    #[must_use]
    pub fn polls_to_wait(&self) -> u32 {
        u32::try_from(self.quick)
            .ok()
            .and_then(|quick| 3_u32.checked_pow(quick.checked_sub(1)?))
            .unwrap_or(0)
    }

    /// The number of consecutive fruitless submissions, once there are too many.
    #[must_use]
    pub fn is_over(&self) -> Option<usize> {
        (self.quick >= Self::QUICK || self.fruitless > self.limit).then_some(self.fruitless)
    }
}

impl Dispatch<'_> {
    /// Submits the tasks to add, retries while the controller is busy, and returns the state from which the wait
    /// begins.
    ///
    /// # Errors
    /// The errors of [`Dispatch::ensure`], and [`Error::Busy`] or [`Error::Silent`] after some minutes.
    pub fn begin(&self, missing: &BTreeSet<String>, watch: &mut dyn Watch) -> Result<View, Error> {
        let mut pause_s = 1.0;
        for _ in 1..FIRST_TRIES {
            match self.ensure(missing, &mut |text| watch.say(text)) {
                Err(error) if error.is_passing() && !self.stop.is_asked() => {
                    watch.say(&format!("{error}; trying again in {pause_s} s"));
                    rest(Duration::from_secs_f64(pause_s), &self.stop);
                    pause_s = (pause_s * 2.0).min(LONGEST_PAUSE_S);
                }
                other => return other,
            }
        }
        self.ensure(missing, &mut |text| watch.say(text))
    }

    /// Waits until every trial has ended; submits again while there are too few tasks for the missing trials.
    ///
    /// # Errors
    /// [`Error::Fruitless`] if submissions end again and again without finishing a trial, and the errors of
    /// [`Dispatch::ensure`] for a submission that is refused. If a controller does not answer, the wait continues.
    pub fn follow(&self, begun: View, watch: &mut dyn Watch) -> Result<WaitEnd, Error> {
        let followed = begun.live.into_iter().map(|holding| holding.submission).collect();
        let mut follower = Follower {
            dispatch: self,
            followed,
            patience: Patience::new(self.queue.resubmissions()),
            submitted: clock::now(),
            missing_then: None,
            saved_then: watch.saved(),
            lacking: false,
            pause_s: self.queue.poll_s(),
        };
        let mut asked = clock::now();
        loop {
            let looked = clock::now();
            let missing = watch.missing();
            let look = clock::since(looked);
            if missing.is_empty() {
                follower.finish();
                return Ok(WaitEnd::Ended);
            }
            if self.stop.is_asked() {
                return Ok(WaitEnd::Stopped);
            }
            if clock::since(asked).as_secs_f64() >= follower.pause_s {
                if let Some(outcome) = follower.ask(&missing, watch)? {
                    return Ok(outcome);
                }
                asked = clock::now();
            }
            // A slow check of a large store is not repeated at once.
            rest(STORE_POLL.max(look * 5), &self.stop);
        }
    }
}

struct Follower<'a> {
    dispatch: &'a Dispatch<'a>,
    followed: Vec<Submission>,
    patience: Patience,
    submitted: Instant,
    /// Number of missing trials when tasks were last submitted.
    missing_then: Option<usize>,
    /// The count of checkpoints ([`Watch::saved`]) at that time.
    saved_then: u64,
    /// Whether the last view of the queue showed too few tasks.
    lacking: bool,
    pause_s: f64,
}

impl Follower<'_> {
    /// Asks the queue, and submits if there are too few tasks twice in succession: a task that is being restarted, or a
    /// controller that has just started, may be between two states.
    fn ask(&mut self, missing: &BTreeSet<String>, watch: &mut dyn Watch) -> Result<Option<WaitEnd>, Error> {
        let before = *self.missing_then.get_or_insert(missing.len());
        let view = match self.look(missing) {
            Ok(Some(view)) => view,
            Ok(None) => return Ok(Some(WaitEnd::Cancelled)),
            Err(error) => {
                self.not_answered(&error, watch);
                return Ok(None);
            }
        };
        self.pause_s = self.dispatch.queue.poll_s();
        watch.queue(
            &view
                .live
                .iter()
                .flat_map(|holding| holding.tasks.clone())
                .collect::<Vec<_>>(),
        );
        if view.need == 0 || !std::mem::replace(&mut self.lacking, true) {
            self.lacking = view.need > 0;
            return Ok(None);
        }
        self.lacking = false;
        let bore_fruit = missing.len() < before || watch.saved() > self.saved_then;
        self.patience
            .note(bore_fruit, clock::since(self.submitted).as_secs_f64());
        match self.patience.is_over() {
            // No task is added while some are alive; their end will be recorded.
            Some(_) if view.alive() > 0 => Ok(None),
            Some(rounds) => Err(Error::Fruitless {
                rounds,
                log: self.log(),
            }),
            None => {
                let pause_s = self.dispatch.queue.poll_s() * f64::from(self.patience.polls_to_wait());
                rest(Duration::from_secs_f64(pause_s), &self.dispatch.stop);
                self.submit(&watch.missing(), view.alive(), watch)
            }
        }
    }

    /// Tasks that the queue holds; `None` if the followed submissions were cancelled.
    fn look(&self, missing: &BTreeSet<String>) -> Result<Option<View>, Error> {
        let ours = |one: &Submission| self.followed.iter().any(|followed| followed.id == one.id);
        if Submission::all(&self.dispatch.store)?
            .iter()
            .any(|one| one.state == SubmissionState::Cancelled && ours(one))
        {
            return Ok(None);
        }
        self.dispatch.look(missing).map(Some)
    }

    fn submit(
        &mut self,
        missing: &BTreeSet<String>,
        alive: usize,
        watch: &mut dyn Watch,
    ) -> Result<Option<WaitEnd>, Error> {
        if missing.is_empty() || self.dispatch.stop.is_asked() {
            return Ok(None);
        }
        match self.dispatch.ensure(missing, &mut |text| watch.say(text)) {
            Ok(view) => {
                let added = view
                    .live
                    .iter()
                    .filter(|holding| self.followed.iter().all(|one| one.id != holding.submission.id));
                added.for_each(|holding| {
                    watch.say(&format!("submitted again: {}", describe(&holding.submission)));
                });
                self.followed = view.live.into_iter().map(|holding| holding.submission).collect();
                (self.submitted, self.missing_then) = (clock::now(), Some(missing.len()));
                self.saved_then = watch.saved();
            }
            Err(error) if error.is_refusal() && alive == 0 => return Err(error),
            Err(error) => self.not_answered(&error, watch),
        }
        Ok(None)
    }

    fn not_answered(&mut self, error: &Error, watch: &mut dyn Watch) {
        if self.dispatch.stop.is_asked() {
            return;
        }
        self.pause_s = (self.pause_s * 2.0).min(LONGEST_PAUSE_S.max(self.dispatch.queue.poll_s()));
        watch.say(&format!("{error}; asking again in {:.0} s", self.pause_s));
    }

    fn log(&self) -> String {
        self.followed
            .last()
            .map_or_else(String::new, |submission| submission.log_tail(10))
    }

    /// Ends the wait after every trial has ended, since waiting tasks would find no trial. A submission that cannot be
    /// closed now ends by itself.
    fn finish(self) {
        for mut submission in self.followed {
            if submission.trials.is_subset(&self.dispatch.trials) {
                let _ = self
                    .dispatch
                    .queue
                    .cancel(&submission.job_name(), true, &self.dispatch.stop);
                let _ = submission.close(SubmissionState::Ended);
            }
        }
    }
}

/// One line about a submission, for users.
#[must_use]
pub fn describe(submission: &Submission) -> String {
    let jobs: Vec<&str> = submission
        .arrays
        .iter()
        .map(|array| array.job.as_deref().unwrap_or("?"))
        .collect();
    let tasks = submission.tasks();
    let at_once: usize = submission.arrays.iter().map(|array| array.at_once).sum();
    format!(
        "{} ({} {}), {}, {at_once} at a time",
        submission.id,
        either(&jobs.len(), "job", "jobs"),
        jobs.join(", "),
        count(tasks, "task")
    )
}

fn rest(pause: Duration, stop: &Stop) {
    let started = clock::now();
    while clock::since(started) < pause && !stop.is_asked() {
        clock::sleep(Duration::from_millis(50));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn workers_that_die_at_once_are_not_started_for_ever() {
        let mut patience = Patience::new(20);
        let mut waits = vec![patience.polls_to_wait()];
        for _ in 0..3 {
            assert_eq!(patience.is_over(), None);
            patience.note(false, 2.0);
            waits.push(patience.polls_to_wait());
        }
        assert_eq!(waits, [0, 1, 3, 9]);
        patience.note(false, 2.0);
        assert_eq!(patience.is_over(), Some(4));
    }

    #[test]
    fn long_tasks_that_hit_their_limit_may_come_back_until_the_limit() {
        let mut patience = Patience::new(2);
        patience.note(false, 3600.0);
        patience.note(false, 3600.0);
        assert_eq!(patience.is_over(), None);
        patience.note(false, 3600.0);
        assert_eq!(patience.is_over(), Some(3));
    }

    #[test]
    fn one_trial_that_gets_further_renews_the_patience() {
        let mut patience = Patience::new(20);
        patience.note(false, 2.0);
        patience.note(false, 2.0);
        patience.note(false, 2.0);
        patience.note(true, 2.0);
        patience.note(false, 2.0);
        assert_eq!(patience.is_over(), None);
    }
}
