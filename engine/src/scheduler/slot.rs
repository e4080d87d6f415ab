//! One worker slot: takes trials from the queue, under their leases, and has its process run them.

use super::{
    Event, Task, Workers, process,
    queue::{Next, Queue, Turn},
    readiness::{Readiness, readiness},
    worker::{Message, Reply, Request},
};
use crate::{
    Error,
    results::{EndState, TrialEnd},
    store::{Claim, Leases, Store, is_missing},
    world::{
        clock,
        process::{ChildStdout, ExitStatus},
    },
};
use std::{
    io::{BufRead, BufReader},
    path::Path,
    sync::{
        atomic::{AtomicBool, Ordering},
        mpsc::Sender,
    },
    time::Duration,
};

/// What all slots share.
#[derive(Clone, Copy)]
pub(super) struct Shared<'a> {
    pub(super) program: &'a Path,
    pub(super) tasks: &'a [Task<'a>],
    pub(super) store: &'a Store,
    pub(super) leases: &'a Leases,
    pub(super) workers: &'a Workers,
    pub(super) queue: &'a Queue<'a>,
    /// Set from within to stop: a failure under `fail_fast`, or a store that cannot be written.
    pub(super) halt: &'a AtomicBool,
}

/// One slot.
pub(super) struct Slot<'a> {
    number: usize,
    all: Shared<'a>,
    process: &'a process::Shared,
    replies: Option<BufReader<ChildStdout>>,
    events: &'a Sender<Event>,
}

/// What became of an attempt.
enum Attempt {
    Ended(TrialEnd),
    Stopped,
    Paused,
    /// Something that it takes cannot be used, for this reason.
    Unready(String),
}

impl<'a> Slot<'a> {
    /// A slot without a process yet.
    pub(super) fn new(
        number: usize,
        all: Shared<'a>,
        process: &'a process::Shared,
        events: &'a Sender<Event>,
    ) -> Self {
        Self {
            number,
            all,
            process,
            replies: None,
            events,
        }
    }

    /// Works until nothing is left or the run is stopped.
    pub(super) fn work(&mut self) -> Result<(), Error> {
        while !self.stopping() {
            match self.all.queue.next() {
                Next::Try(turn) => {
                    let (trial, store) = (turn.task, self.all.store);
                    let id = &self.all.tasks[trial].trial.id;
                    if let Some(obstacle) = store.obstacle(id) {
                        self.pass_over(trial, &obstacle);
                    } else if let Err(error) = self.take(turn) {
                        if let Some(obstacle) = store.obstacle_to_writing(id) {
                            self.pass_over(trial, &obstacle);
                            continue;
                        }
                        // What cannot be written now cannot be written by the other slots either: nothing new
                        // begins.
                        self.all.halt.store(true, Ordering::SeqCst);
                        self.all.queue.done(id);
                        self.tell(Event::Broken {
                            slot: self.number,
                            problem: error.to_string(),
                        });
                        self.process.dismiss();
                        return Err(error);
                    }
                }
                Next::Wait(wait) => clock::sleep(wait.min(Duration::from_millis(50))),
                Next::Done => break,
            }
        }
        self.process.dismiss();
        Ok(())
    }

    /// What lies at the place of one trial concerns no other one.
    fn pass_over(&self, trial: usize, obstacle: &Error) {
        let reason = obstacle.to_string();
        self.tell(Event::Obstructed { trial, reason });
        self.all.queue.done(&self.all.tasks[trial].trial.id);
    }

    fn stopping(&self) -> bool {
        self.all.workers.stop.load(Ordering::SeqCst) || self.all.halt.load(Ordering::SeqCst)
    }

    /// Takes a trial up, unless it takes what is not there.
    fn take(&mut self, turn: Turn) -> Result<(), Error> {
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
        self.all.queue.done(&self.all.tasks[trial].trial.id);
    }

    /// Claims a trial and runs it, unless another program has it or has ended it.
    fn claim(&mut self, turn: Turn) -> Result<(), Error> {
        let task = &self.all.tasks[turn.task];
        match self.all.leases.claim(&task.trial.id)? {
            Claim::Held(_) if !self.all.workers.wait_for_others => self.all.queue.done(&task.trial.id),
            Claim::Held(owner) => {
                self.tell(Event::Held {
                    trial: turn.task,
                    owner,
                });
                self.all.queue.held(turn);
            }
            Claim::Mine => {
                let outcome = self.under_lease(turn);
                self.all.leases.release(&task.trial.id)?;
                return outcome;
            }
        }
        Ok(())
    }

    fn under_lease(&mut self, turn: Turn) -> Result<(), Error> {
        let (index, task) = (turn.task, &self.all.tasks[turn.task]);
        // The end may have been stored after the list of missing trials was made.
        if let Some(end) = self.new_end(task, &turn) {
            self.tell(Event::EndedElsewhere { trial: index, end });
            self.all.queue.done(&task.trial.id);
            return Ok(());
        }
        self.tell(Event::Started {
            slot: self.number,
            trial: index,
        });
        match self.attempt(task, &turn)? {
            Attempt::Stopped => {
                self.tell(Event::Stopped { slot: self.number });
                self.all.queue.done(&task.trial.id);
            }
            Attempt::Paused => {
                self.tell(Event::Paused {
                    slot: self.number,
                    trial: index,
                });
                self.all.queue.done(&task.trial.id);
            }
            Attempt::Unready(reason) => self.give_up(index, reason),
            Attempt::Ended(end) => self.ended(turn, end),
        }
        Ok(())
    }

    /// Decides whether the end is final.
    fn ended(&self, turn: Turn, end: TrialEnd) {
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
                    Turn {
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
                self.all.queue.done(&self.all.tasks[index].trial.id);
            }
        }
    }

    /// One attempt at a trial in the slot's process.
    fn attempt(&mut self, task: &Task<'_>, turn: &Turn) -> Result<Attempt, Error> {
        let request = Request {
            trial: task.trial.clone(),
            store: self.all.store.root().to_path_buf(),
            checkpoint_every_s: self.all.workers.checkpoint_every.as_secs_f64(),
            until: task.until,
        };
        let line =
            serde_json::to_string(&Message::Run(Box::new(request))).map_err(|source| Error::Worker {
                problem: source.to_string(),
            })?;
        let mut replies = match self.replies.take() {
            Some(replies) => replies,
            None => self.process.start(self.all.program)?,
        };
        let started = clock::now();
        self.process.begin(&line, &task.limits);
        let answer = self.listen(&mut replies);
        // A process whose trial panicked leaves after saying so.
        let panicked = matches!(&answer, Some(Reply::Ended { end }) if end.state == EndState::Panicked);
        if panicked {
            self.process.dismiss();
        } else if answer.is_some() && self.process.end() {
            self.replies = Some(replies);
        }
        match answer {
            Some(Reply::Ended { end }) => Ok(Attempt::Ended(end)),
            Some(Reply::Stopped) => Ok(Attempt::Stopped),
            Some(Reply::Paused) => Ok(Attempt::Paused),
            Some(Reply::Unready { reason }) => Ok(Attempt::Unready(reason)),
            Some(Reply::StoreRefused { problem }) => Err(Error::Store { problem }),
            _ => self.died(task, turn, clock::since(started).as_secs_f64()),
        }
    }

    /// Passes on what the process says, until its last word; `None` where it died without one.
    fn listen(&self, replies: &mut BufReader<ChildStdout>) -> Option<Reply> {
        loop {
            let mut line = String::new();
            if replies.read_line(&mut line).unwrap_or(0) == 0 {
                return None;
            }
            match serde_json::from_str(&line) {
                Ok(Reply::Progress { done, total }) => self.tell(Event::Progress {
                    slot: self.number,
                    done,
                    total,
                }),
                Ok(last) => return Some(last),
                // Whatever else a plugin prints on standard output is not for us.
                Err(_) => {}
            }
        }
    }

    /// Finds out how the process died and stores it.
    fn died(&mut self, task: &Task<'_>, turn: &Turn, wall_s: f64) -> Result<Attempt, Error> {
        let (status, exceeded) = self.process.bury();
        if exceeded.is_none() && self.stopping() {
            return Ok(Attempt::Stopped);
        }
        let (state, reason) = exceeded.unwrap_or_else(|| explain(status));
        let end = TrialEnd {
            state,
            reason,
            wall_s,
            decision_s: None,
            digest: String::new(),
        };
        // The process may have stored its trial and died before it could say so.
        if let Some(stored) = self.new_end(task, turn) {
            return Ok(Attempt::Ended(stored));
        }
        self.all.store.acknowledge(task.trial, &end)?;
        Ok(Attempt::Ended(end))
    }

    /// The stored end of a trial, where it is one and not the one that is known.
    fn new_end(&self, task: &Task<'_>, turn: &Turn) -> Option<TrialEnd> {
        let stored = self.all.store.end(&task.trial.id).unwrap_or(None);
        stored.filter(|end| !is_missing(Some(end)) && turn.before.as_ref() != Some(end))
    }

    fn tell(&self, event: Event) {
        // A caller that no longer listens has stopped caring; the trials go on.
        let _ = self.events.send(event);
    }
}

fn explain(status: Option<ExitStatus>) -> (EndState, String) {
    use std::os::unix::process::ExitStatusExt;
    let Some(status) = status else {
        return (EndState::Killed, "the worker process vanished".into());
    };
    match (status.signal(), status.code()) {
        // SIGABRT is how a Rust program that cannot unwind ends itself.
        (Some(6), _) => (EndState::Panicked, "the worker process aborted".into()),
        (Some(signal), _) => (
            EndState::Killed,
            format!("the worker process was ended by signal {signal}"),
        ),
        (None, code) => (
            EndState::Killed,
            format!("the worker process left with exit code {}", code.unwrap_or(-1)),
        ),
    }
}
