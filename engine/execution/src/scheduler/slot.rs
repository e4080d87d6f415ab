//! Worker slots: each takes trials from the queue, under their leases, and has them run.

use super::{
    Event, Task, Workers,
    queue::{NextStep, Queue, TrialAttempt},
    readiness::{Readiness, readiness},
    worker::{Reply, Request},
};
use crate::{
    limits::Limits,
    store::{BucketLeases, Claim, Leases, Owner, Store},
    world::clock,
};
use contract::{
    Error,
    trial_end::{EndState, TrialEnd, is_missing},
};
use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
        mpsc::Sender,
    },
    time::{Duration, Instant},
};

/// First wait before a place is tried again; it doubles up to 16 times this value.
const SHORTEST_WAIT: Duration = Duration::from_secs(1);

/// Time within which a signal to a group of processes reaches all of them.
const SIGNALLED_WITHIN: Duration = Duration::from_millis(100);

/// Runner of the trials of a slot; outside tests it is a separate process.
pub(super) trait Runner {
    /// Runs a trial to its end, to its pause, or until it is stopped; `progress` receives the steps done and the total
    /// steps.
    ///
    /// # Errors
    /// [`Error::Worker`] if no trial can be run.
    fn run(
        &mut self,
        request: Request,
        limits: &Arc<Limits>,
        progress: &mut dyn FnMut(u64, u64),
    ) -> Result<RequestOutcome, Error>;

    /// Called when no trial follows for now.
    fn dismiss(&mut self);
}

impl<R: Runner + ?Sized> Runner for Box<R> {
    fn run(
        &mut self,
        request: Request,
        limits: &Arc<Limits>,
        progress: &mut dyn FnMut(u64, u64),
    ) -> Result<RequestOutcome, Error> {
        (**self).run(request, limits, progress)
    }

    fn dismiss(&mut self) {
        (**self).dismiss();
    }
}

/// Result of a request.
pub(super) enum RequestOutcome {
    /// The last message about the request.
    Said(Reply),
    /// The process that ran the trial is gone without a last message.
    Died {
        /// End state of the trial.
        state: EndState,
        /// The reason, as text.
        reason: String,
        /// Whether the process was ended because of a limit.
        by_limit: bool,
    },
    /// The result is unknown: the place of the runner cannot be reached, for this reason.
    Lost(String),
}

/// State that all slots share.
#[derive(Clone, Copy)]
pub(super) struct SlotContext<'a> {
    pub(super) tasks: &'a [Task<'a>],
    pub(super) store: &'a Store,
    pub(super) leases: &'a Leases,
    /// Leases in the bucket that shares the store, if there is one.
    pub(super) shared_leases: Option<&'a BucketLeases>,
    pub(super) workers: &'a Workers,
    pub(super) queue: &'a Queue<'a>,
    /// Set internally to stop: a failure under `fail_fast`, or a store that cannot be written.
    pub(super) halt: &'a AtomicBool,
}

/// One worker slot.
pub(super) struct Slot<'a, R> {
    number: usize,
    /// Index of the slot's machine.
    machine: usize,
    all: SlotContext<'a>,
    runner: R,
    events: &'a Sender<Event>,
    /// Beginning and number of the failed attempts to reach its place; `None` if the last one succeeded.
    lost: Option<(Instant, u32)>,
    /// Whether its place could not be reached within the patience for it.
    is_given_up: bool,
}

/// Result of an attempt.
enum AttemptOutcome {
    Ended(TrialEnd),
    Stopped,
    Paused,
    /// A source of the trial cannot be used, for this reason.
    Unready(String),
    /// The place of the slot cannot be reached, for this reason.
    Lost(String),
}

impl<'a, R: Runner> Slot<'a, R> {
    /// A slot before its first trial.
    pub(super) fn new(
        (number, machine): (usize, usize),
        all: SlotContext<'a>,
        runner: R,
        events: &'a Sender<Event>,
    ) -> Self {
        Self {
            number,
            machine,
            all,
            runner,
            events,
            lost: None,
            is_given_up: false,
        }
    }

    /// Works until no trial is left or the run is stopped.
    pub(super) fn work(&mut self) -> Result<(), Error> {
        while !self.stopping() && !self.is_given_up {
            match self.all.queue.next(self.machine) {
                NextStep::Try(turn) => {
                    let (trial, store) = (turn.task, self.all.store);
                    let id = &self.all.tasks[trial].trial.id;
                    if let Some(obstacle) = store.obstacle(id) {
                        self.pass_over(trial, &obstacle);
                    } else if let Err(error) = self.take(turn) {
                        if let Some(obstacle) = store.obstacle_to_writing(id) {
                            self.pass_over(trial, &obstacle);
                            continue;
                        }
                        // The other slots cannot write to the store either: no new trial begins.
                        self.all.halt.store(true, Ordering::SeqCst);
                        self.all.queue.done(trial);
                        self.tell(Event::Broken {
                            slot: self.number,
                            problem: error.to_string(),
                        });
                        self.runner.dismiss();
                        return Err(error);
                    }
                }
                NextStep::Wait => {}
                NextStep::Done => break,
            }
        }
        self.runner.dismiss();
        Ok(())
    }

    /// Reports an obstacle at the place of one trial; it affects no other trial.
    fn pass_over(&self, trial: usize, obstacle: &Error) {
        let reason = obstacle.to_string();
        self.tell(Event::Obstructed { trial, reason });
        self.all.queue.done(trial);
    }

    fn stopping(&self) -> bool {
        self.all.workers.stop.load(Ordering::SeqCst) || self.all.halt.load(Ordering::SeqCst)
    }

    /// Whether the run is being stopped, by a signal that may have reached another process of the group before this
    /// one.
    fn is_stopped_too(&self) -> bool {
        let died = clock::now();
        while !self.stopping() && clock::since(died) < SIGNALLED_WITHIN {
            clock::sleep(Duration::from_millis(10));
        }
        self.stopping()
    }

    /// Begins a trial, unless one of its sources is absent.
    fn take(&mut self, turn: TrialAttempt) -> Result<(), Error> {
        let (index, task) = (turn.task, &self.all.tasks[turn.task]);
        match readiness(&task.after, self.all.store) {
            Readiness::Ready => return self.claim(turn),
            Readiness::Elsewhere(source, owner) if self.all.workers.wait_for_others => {
                self.tell(Event::Awaits {
                    trial: index,
                    source,
                    owner,
                });
                self.all.queue.held(turn);
            }
            Readiness::Elsewhere(source, owner) => {
                let reason = format!("trial {source} is with process {} on {}", owner.pid, owner.host);
                self.give_up(index, reason);
            }
            Readiness::Unready(reason) => self.give_up(index, reason),
        }
        Ok(())
    }

    fn give_up(&self, trial: usize, reason: String) {
        self.tell(Event::Unready { trial, reason });
        self.all.queue.done(trial);
    }

    /// Claims a trial and runs it, unless another program has it or has ended it.
    fn claim(&mut self, turn: TrialAttempt) -> Result<(), Error> {
        let task = &self.all.tasks[turn.task];
        match self.all.leases.claim(&task.trial.id)? {
            Claim::Held(owner) => self.leave_to(owner, turn),
            Claim::Mine => {
                let outcome = self.under_shared_lease(turn);
                self.all.leases.release(&task.trial.id)?;
                return outcome;
            }
        }
        Ok(())
    }

    /// Like [`under_lease`](Self::under_lease), if machines share trials by a bucket: also claims the trial there, and
    /// fetches it if another machine has ended it.
    fn under_shared_lease(&mut self, turn: TrialAttempt) -> Result<(), Error> {
        let (Some(leases), Some(bucket)) = (self.all.shared_leases, self.all.store.bucket()) else {
            return self.under_lease(turn);
        };
        let id = &self.all.tasks[turn.task].trial.id;
        match leases.claim(id)? {
            Claim::Held(owner) => self.leave_to(owner, turn),
            Claim::Mine => {
                // For a trial that runs again although it has ended, the bucket has that end, or a newer one.
                let fetched = bucket.fetch_missing(self.all.store, id);
                let outcome = fetched.and_then(|()| self.under_lease(turn));
                leases.release(id)?;
                return outcome;
            }
        }
        Ok(())
    }

    /// Leaves a trial to the program that has it: waits for it, or continues without it.
    fn leave_to(&self, owner: Owner, turn: TrialAttempt) {
        if !self.all.workers.wait_for_others {
            self.all.queue.done(turn.task);
            return;
        }
        self.tell(Event::Held {
            trial: turn.task,
            owner,
        });
        self.all.queue.held(turn);
    }

    fn under_lease(&mut self, turn: TrialAttempt) -> Result<(), Error> {
        let (index, task) = (turn.task, &self.all.tasks[turn.task]);
        // The end may have been stored after the list of missing trials was made.
        if let Some(end) = self.new_end(task, &turn) {
            self.tell(Event::EndedElsewhere { trial: index, end });
            self.all.queue.done(index);
            return Ok(());
        }
        // Another program may meanwhile have run it to its pause.
        let measured = || self.all.store.measured_until(&task.trial.id);
        if task
            .until
            .is_some_and(|until| measured().is_some_and(|step| step >= until))
        {
            self.all.queue.done(index);
            return Ok(());
        }
        self.tell(Event::Started {
            slot: self.number,
            trial: index,
        });
        match self.attempt(task, &turn)? {
            AttemptOutcome::Stopped => {
                self.tell(Event::Stopped { slot: self.number });
                self.all.queue.done(index);
            }
            AttemptOutcome::Paused => {
                self.tell(Event::Paused {
                    slot: self.number,
                    trial: index,
                });
                self.all.queue.done(index);
                if let Some(bucket) = self.all.store.bucket() {
                    bucket.bring(self.all.store, &task.trial.id)?;
                }
            }
            AttemptOutcome::Unready(reason) => self.give_up(index, reason),
            AttemptOutcome::Lost(problem) => self.lose(turn, problem),
            AttemptOutcome::Ended(end) => self.ended(turn, end)?,
        }
        Ok(())
    }

    /// Puts the trial back for other slots; the slot's place is tried again later.
    fn lose(&mut self, turn: TrialAttempt, problem: String) {
        self.all.queue.retry(turn, Duration::ZERO);
        let (since, times) = self.lost.unwrap_or((clock::now(), 0));
        self.lost = Some((since, times + 1));
        let wait = SHORTEST_WAIT * 2u32.pow(times.min(4));
        let wait = (clock::since(since) + wait < self.all.workers.hosts.patience).then_some(wait);
        self.is_given_up = wait.is_none();
        self.tell(Event::Lost {
            slot: self.number,
            problem,
            wait,
        });
        let begun = clock::now();
        while wait.is_some_and(|wait| clock::since(begun) < wait) && !self.stopping() {
            clock::sleep(Duration::from_millis(50));
        }
    }

    /// Decides whether the end is final; a final end is copied to the other machines.
    fn ended(&self, turn: TrialAttempt, end: TrialEnd) -> Result<(), Error> {
        let index = turn.task;
        match self.all.tasks[index].limits.retry_after(end.state, turn.attempt) {
            Some(wait) if !self.stopping() => {
                self.tell(Event::Retried {
                    slot: self.number,
                    trial: index,
                    end: end.clone(),
                    wait,
                });
                self.all.queue.retry(
                    TrialAttempt {
                        attempt: turn.attempt + 1,
                        before: Some(end),
                        ..turn
                    },
                    wait,
                );
            }
            _ => {
                if self.all.workers.fail_fast && end.state != EndState::Ok {
                    self.all.halt.store(true, Ordering::SeqCst);
                }
                if end.state == EndState::Ok {
                    self.all.queue.note_pace(index, end.wall_s);
                }
                self.tell(Event::Ended {
                    slot: self.number,
                    trial: index,
                    end,
                });
                let (id, store) = (&self.all.tasks[index].trial.id, self.all.store);
                self.all.queue.done(index);
                if let Some(bucket) = store.bucket() {
                    bucket.bring(store, id)?;
                }
            }
        }
        Ok(())
    }

    fn attempt(&mut self, task: &Task<'_>, turn: &TrialAttempt) -> Result<AttemptOutcome, Error> {
        let request = Request {
            trial: task.trial.clone(),
            store: self.all.store.root().to_path_buf(),
            checkpoint_every_s: self.all.workers.checkpoint_every.as_secs_f64(),
            until: task.until,
            stalled_after_s: task.limits.stalled_after_s,
            share: turn.share.clone(),
        };
        let (slot, events, started) = (self.number, self.events, clock::now());
        let mut progress = |done, total| {
            let _ = events.send(Event::Progress { slot, done, total });
        };
        let answer = self.runner.run(request, &task.limits, &mut progress)?;
        if !matches!(answer, RequestOutcome::Lost(_)) {
            self.lost = None;
        }
        match answer {
            RequestOutcome::Lost(_) if self.stopping() => Ok(AttemptOutcome::Stopped),
            RequestOutcome::Lost(problem) => Ok(AttemptOutcome::Lost(problem)),
            RequestOutcome::Said(Reply::Ended { end }) => Ok(AttemptOutcome::Ended(end)),
            RequestOutcome::Said(Reply::Paused) => Ok(AttemptOutcome::Paused),
            RequestOutcome::Said(Reply::Unready { reason }) => Ok(AttemptOutcome::Unready(reason)),
            RequestOutcome::Said(Reply::StoreRefused { problem }) => Err(Error::Store { problem }),
            RequestOutcome::Said(Reply::DeviceLost { problem }) => Err(Error::Device { problem }),
            RequestOutcome::Said(Reply::Stopped | Reply::Progress { .. }) => Ok(AttemptOutcome::Stopped),
            RequestOutcome::Died { by_limit: false, .. } if self.is_stopped_too() => {
                Ok(AttemptOutcome::Stopped)
            }
            RequestOutcome::Died { state, reason, .. } => {
                self.died(task, turn, state, reason, clock::since(started).as_secs_f64())
            }
        }
    }

    /// Stores the death of the process as the end of its trial.
    fn died(
        &self,
        task: &Task<'_>,
        turn: &TrialAttempt,
        state: EndState,
        reason: String,
        wall_s: f64,
    ) -> Result<AttemptOutcome, Error> {
        let end = TrialEnd {
            state,
            reason,
            wall_s,
            decision_s: None,
            device: None,
            digest: String::new(),
        };
        // The process may have stored its trial and died before it could report it.
        if let Some(stored) = self.new_end(task, turn) {
            return Ok(AttemptOutcome::Ended(stored));
        }
        Ok(AttemptOutcome::Ended(
            self.all.store.acknowledge(task.trial, end)?,
        ))
    }

    /// The stored end of a trial, if it differs from the known one.
    fn new_end(&self, task: &Task<'_>, turn: &TrialAttempt) -> Option<TrialEnd> {
        let stored = self.all.store.end(&task.trial.id).unwrap_or(None);
        stored.filter(|end| !is_missing(Some(end)) && turn.before.as_ref() != Some(end))
    }

    fn tell(&self, event: Event) {
        // A caller that no longer receives events needs none; the trials continue.
        let _ = self.events.send(event);
    }
}
