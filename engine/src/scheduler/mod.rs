//! Runs what is missing: trials in worker processes, one single-threaded trial per process at a time.
//!
//! One thread per worker slot owns one child process and takes trials from a common queue. The child runs the trial, writes
//! it to the store and says how it ended; a child that dies is replaced, and only its trial is affected. Everything that
//! happens reaches the caller as an [`Event`] on one channel, so there is one owner of what is shown.

mod worker;

pub use worker::{Reply, Request, serve};

use crate::{
    Error,
    results::{EndState, TrialEnd},
    store::Store,
    trial::Trial,
};
use std::{
    collections::VecDeque,
    io::{BufRead, BufReader, Write},
    process::{Child, ChildStdin, ChildStdout, Command, ExitStatus, Stdio},
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, Ordering},
        mpsc::Sender,
    },
    time::Instant,
};

/// What happens while trials run.
#[derive(Debug, Clone)]
pub enum Event {
    /// A trial started in a slot.
    Started {
        /// Worker slot, from 0.
        slot: usize,
        /// Index into the list of trials.
        trial: usize,
    },
    /// How far a trial is.
    Progress {
        /// Worker slot.
        slot: usize,
        /// Steps done.
        done: u64,
        /// Steps in all.
        total: u64,
    },
    /// A trial ended and its end is stored.
    Ended {
        /// Worker slot.
        slot: usize,
        /// Index into the list of trials.
        trial: usize,
        /// How it ended.
        end: TrialEnd,
    },
    /// A trial was given up because the run is being stopped; it stays missing.
    Stopped {
        /// Worker slot.
        slot: usize,
    },
    /// A slot cannot go on.
    Broken {
        /// Worker slot.
        slot: usize,
        /// Why.
        problem: String,
    },
}

/// How to run trials.
#[derive(Debug, Clone)]
pub struct Workers {
    /// Number of worker processes.
    pub count: usize,
    /// Set from outside to stop: no new trial starts and running ones are ended.
    pub stop: Arc<AtomicBool>,
}

/// Runs `trials` and stores how each ended; returns when all have ended or the run was stopped.
///
/// Longer trials start first, which shortens the whole; the order cannot reach a result.
///
/// # Errors
/// [`Error::Worker`] where no worker process can be started.
pub fn run(trials: &[Trial], costs: &[u64], store: &Store, workers: &Workers, events: &Sender<Event>) -> Result<(), Error> {
    let program =
        std::env::current_exe().map_err(|source| Error::Worker { problem: format!("cannot find this program: {source}") })?;
    let mut order: Vec<usize> = (0..trials.len()).collect();
    order.sort_by_key(|&index| std::cmp::Reverse(costs.get(index).copied().unwrap_or(0)));
    let queue = Mutex::new(VecDeque::from(order));
    std::thread::scope(|scope| {
        for slot in 0..workers.count.min(trials.len()) {
            let (queue, program) = (&queue, &program);
            scope.spawn(move || {
                let mut worker = Slot { slot, program, store, stop: &workers.stop, events, process: None };
                while let Some(index) = next(queue, &workers.stop) {
                    if let Err(error) = worker.run_one(index, &trials[index]) {
                        worker.tell(Event::Broken { slot, problem: error.to_string() });
                        return;
                    }
                }
            });
        }
    });
    Ok(())
}

fn next(queue: &Mutex<VecDeque<usize>>, stop: &AtomicBool) -> Option<usize> {
    if stop.load(Ordering::SeqCst) {
        return None;
    }
    // A thread that panicked while it held the lock left the queue whole: popping cannot be half done.
    queue.lock().unwrap_or_else(PoisonError::into_inner).pop_front()
}

struct Slot<'a> {
    slot: usize,
    program: &'a std::path::Path,
    store: &'a Store,
    stop: &'a AtomicBool,
    events: &'a Sender<Event>,
    process: Option<Process>,
}

struct Process {
    child: Child,
    requests: ChildStdin,
    replies: BufReader<ChildStdout>,
}

impl Slot<'_> {
    fn run_one(&mut self, index: usize, trial: &Trial) -> Result<(), Error> {
        self.tell(Event::Started { slot: self.slot, trial: index });
        let started = started_now();
        let end = match self.converse(trial)? {
            Some(end) => end,
            None if self.stop.load(Ordering::SeqCst) => {
                self.tell(Event::Stopped { slot: self.slot });
                return Ok(());
            }
            None => self.died(trial, started.elapsed().as_secs_f64())?,
        };
        self.tell(Event::Ended { slot: self.slot, trial: index, end });
        Ok(())
    }

    /// Sends the trial to the child and passes on what it says; `None` where the child died or was stopped.
    fn converse(&mut self, trial: &Trial) -> Result<Option<TrialEnd>, Error> {
        let request = Request { trial: trial.clone(), store: self.store.root().to_path_buf() };
        let line = serde_json::to_string(&request).map_err(|source| Error::Worker { problem: source.to_string() })?;
        let mut process = match self.process.take() {
            Some(process) => process,
            None => start(self.program)?,
        };
        let _ = writeln!(process.requests, "{line}");
        let mut end = None;
        while end.is_none() {
            let mut reply = String::new();
            let length = process.replies.read_line(&mut reply).unwrap_or(0);
            if length == 0 {
                break;
            }
            match serde_json::from_str(&reply) {
                Ok(Reply::Progress { done, total }) => self.tell(Event::Progress { slot: self.slot, done, total }),
                Ok(Reply::Ended { end: told }) => end = Some(told),
                // Whatever else a plugin prints on standard output is not for us.
                Err(_) => {}
            }
            if self.stop.load(Ordering::SeqCst) {
                let _ = process.child.kill();
            }
        }
        self.process = Some(process);
        Ok(end)
    }

    /// Finds out how the child died and stores it.
    fn died(&mut self, trial: &Trial, wall_s: f64) -> Result<TrialEnd, Error> {
        let status = self.process.take().and_then(|mut process| process.child.wait().ok());
        let (state, reason) = explain(status);
        let end = TrialEnd { state, reason, wall_s, digest: String::new() };
        self.store.acknowledge(trial, &end)?;
        Ok(end)
    }

    fn tell(&self, event: Event) {
        // A caller that no longer listens has stopped caring; the trials go on.
        let _ = self.events.send(event);
    }
}

impl Drop for Slot<'_> {
    fn drop(&mut self) {
        if let Some(Process { mut child, requests, .. }) = self.process.take() {
            // The end of its input tells the child to leave.
            drop(requests);
            let _ = child.wait();
        }
    }
}

#[allow(clippy::disallowed_methods, reason = "wall time is reported, it reaches no result")]
fn started_now() -> Instant {
    Instant::now()
}

fn start(program: &std::path::Path) -> Result<Process, Error> {
    let mut child = Command::new(program)
        .arg("trial-worker")
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .map_err(|source| Error::Worker { problem: format!("cannot start `{}`: {source}", program.display()) })?;
    let (Some(requests), Some(replies)) = (child.stdin.take(), child.stdout.take()) else {
        return Err(Error::Worker { problem: "its pipes are missing".into() });
    };
    Ok(Process { child, requests, replies: BufReader::new(replies) })
}

fn explain(status: Option<ExitStatus>) -> (EndState, String) {
    use std::os::unix::process::ExitStatusExt;
    let Some(status) = status else {
        return (EndState::Killed, "the worker process vanished".into());
    };
    match (status.signal(), status.code()) {
        // SIGABRT is how a Rust program that cannot unwind ends itself.
        (Some(6), _) => (EndState::Panicked, "the worker process aborted".into()),
        (Some(signal), _) => (EndState::Killed, format!("the worker process was ended by signal {signal}")),
        (None, code) => (EndState::Killed, format!("the worker process left with exit code {}", code.unwrap_or(-1))),
    }
}
