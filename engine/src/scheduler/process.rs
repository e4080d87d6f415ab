//! Runs trials in a worker process, which the slot that talks to it and the thread that watches it share.

use super::{
    slot::{Answer, Runner},
    worker::{Message, Reply, Request},
};
use crate::{
    Error,
    footprint::exceeded,
    input_file,
    limits::Limits,
    results::EndState,
    world::{
        clock,
        process::{Child, ChildStdin, ChildStdout, Command, ExitStatus, Stdio},
    },
};
use std::{
    io::{self, BufRead, BufReader, Write},
    path::Path,
    sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError},
    time::{Duration, Instant},
};

/// How long a signal to a run may take to reach the process that schedules, once it reached one that computes.
const TOLD: Duration = Duration::from_millis(300);

/// Runs the trials of one slot in a process, which is replaced where it dies.
pub(super) struct Worker<'a> {
    program: &'a Path,
    process: &'a Shared,
    replies: Option<BufReader<ChildStdout>>,
}

impl<'a> Worker<'a> {
    /// No process yet; `program` will be started.
    pub(super) fn new(program: &'a Path, process: &'a Shared) -> Self {
        Self {
            program,
            process,
            replies: None,
        }
    }
}

impl Runner for Worker<'_> {
    fn run(
        &mut self,
        request: Request,
        limits: &Arc<Limits>,
        progress: &mut dyn FnMut(u64, u64),
    ) -> Result<Answer, Error> {
        let message = serde_json::to_string(&Message::Run(Box::new(request)));
        let message = message.map_err(|source| Error::Worker {
            problem: source.to_string(),
        })?;
        let mut replies = match self.replies.take() {
            Some(replies) => replies,
            None => self.process.start(&mut worker(self.program))?,
        };
        self.process.begin(&message, limits);
        let Some(reply) = listen(&mut replies, progress) else {
            let (status, exceeded) = self.process.bury();
            let by_limit = exceeded.is_some();
            if is_stop(status) {
                // Who stops all processes of a run tells the one that schedules, too: it decides what follows.
                clock::sleep(TOLD);
            }
            let (state, reason) = exceeded.unwrap_or_else(|| explain(status));
            return Ok(Answer::Died {
                state,
                reason,
                by_limit,
            });
        };
        // A process whose trial panicked leaves after saying so.
        if matches!(&reply, Reply::Ended { end } if end.state == EndState::Panicked) {
            self.process.dismiss();
        } else if self.process.end() {
            self.replies = Some(replies);
        }
        Ok(Answer::Said(reply))
    }

    fn dismiss(&mut self) {
        self.process.dismiss();
    }
}

/// The command of a worker process.
fn worker(program: &Path) -> Command {
    let mut command = Command::new(program);
    command
        .arg("trial-worker")
        .envs(input_file::asked().map(|size| (input_file::VARIABLE, size.to_string())));
    command
}

/// Passes on what the process says, until its last word; `None` where it died without one.
fn listen(replies: &mut BufReader<ChildStdout>, progress: &mut dyn FnMut(u64, u64)) -> Option<Reply> {
    loop {
        let mut line = String::new();
        if replies.read_line(&mut line).unwrap_or(0) == 0 {
            return None;
        }
        match serde_json::from_str(&line) {
            Ok(Reply::Progress { done, total }) => progress(done, total),
            Ok(last) => return Some(last),
            // Whatever else a plugin prints on standard output is not for us.
            Err(_) => {}
        }
    }
}

/// The process of one slot, where it has one.
#[derive(Default)]
pub(super) struct Shared {
    process: Mutex<Option<Process>>,
}

struct Process {
    child: Child,
    requests: ChildStdin,
    busy: Option<Busy>,
}

struct Busy {
    since: Instant,
    limits: Arc<Limits>,
    told_to_stop: bool,
    /// Set before the process is ended for it.
    exceeded: Option<(EndState, String)>,
}

impl Shared {
    /// Starts a process; what it says is read from what is given back.
    pub(super) fn start(&self, command: &mut Command) -> Result<BufReader<ChildStdout>, Error> {
        let piped = command.stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = piped.spawn().map_err(|source| Error::Worker {
            problem: format!(
                "cannot start `{}`: {source}",
                command.get_program().to_string_lossy()
            ),
        })?;
        let (Some(requests), Some(replies)) = (child.stdin.take(), child.stdout.take()) else {
            return Err(Error::Worker {
                problem: "its pipes are missing".into(),
            });
        };
        *self.lock() = Some(Process {
            child,
            requests,
            busy: None,
        });
        Ok(BufReader::new(replies))
    }

    /// Sends bytes to an idle process. One that takes none in holds up nobody but its slot.
    pub(super) fn write(&self, bytes: &[u8]) -> io::Result<()> {
        match self.lock().as_mut() {
            Some(process) => process.requests.write_all(bytes),
            None => Err(io::ErrorKind::BrokenPipe.into()),
        }
    }

    /// Sends a message; the process is busy with a trial from now on. A process that is gone shows when its
    /// answer is read.
    pub(super) fn begin(&self, message: &str, limits: &Arc<Limits>) {
        if let Some(process) = self.lock().as_mut() {
            let _ = writeln!(process.requests, "{message}");
            let limits = Arc::clone(limits);
            process.busy = Some(Busy {
                since: clock::now(),
                limits,
                told_to_stop: false,
                exceeded: None,
            });
        }
    }

    /// The process has answered; false where it can serve no more, because it was ended for a limit in that
    /// moment.
    pub(super) fn end(&self) -> bool {
        let doomed = match self.lock().as_mut() {
            Some(process) => process.busy.take().is_none_or(|busy| busy.exceeded.is_some()),
            None => true,
        };
        if doomed {
            self.bury();
        }
        !doomed
    }

    /// Takes in a process that has ended: its exit status and the limit for which it was ended.
    pub(super) fn bury(&self) -> (Option<ExitStatus>, Option<(EndState, String)>) {
        match self.lock().take() {
            Some(Process { mut child, busy, .. }) => {
                // It closed its output; one that still lives is of no use.
                let _ = child.kill();
                (child.wait().ok(), busy.and_then(|busy| busy.exceeded))
            }
            None => (None, None),
        }
    }

    /// Lets an idle process leave: the end of its input tells it to.
    pub(super) fn dismiss(&self) {
        if let Some(Process {
            mut child, requests, ..
        }) = self.lock().take()
        {
            drop(requests);
            let _ = child.wait();
        }
    }

    /// Tells a busy process, once, to save a checkpoint and stop.
    pub(super) fn ask_to_stop(&self) {
        if let Some(Process {
            requests,
            busy: Some(busy),
            ..
        }) = self.look().as_deref_mut().and_then(Option::as_mut)
            && !std::mem::replace(&mut busy.told_to_stop, true)
            && let Ok(text) = serde_json::to_string(&Message::Stop)
        {
            let _ = writeln!(requests, "{text}");
        }
    }

    /// Ends a process that is over a limit.
    pub(super) fn hold_limits(&self) {
        if let Some(Process {
            child,
            busy: Some(busy),
            ..
        }) = self.look().as_deref_mut().and_then(Option::as_mut)
            && busy.exceeded.is_none()
        {
            busy.exceeded = exceeded(&busy.limits, clock::since(busy.since), child.id());
            if busy.exceeded.is_some() {
                let _ = child.kill();
            }
        }
    }

    /// The process, unless its slot is talking to it: whoever watches all of them looks again.
    fn look(&self) -> Option<MutexGuard<'_, Option<Process>>> {
        match self.process.try_lock() {
            Ok(process) => Some(process),
            Err(TryLockError::Poisoned(poisoned)) => Some(poisoned.into_inner()),
            Err(TryLockError::WouldBlock) => None,
        }
    }

    fn lock(&self) -> MutexGuard<'_, Option<Process>> {
        // What is shared is replaced as a whole, so that it is whole after a panic elsewhere.
        self.process.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// True for a process that was ended by a signal by which people, terminals and batch systems stop programs.
fn is_stop(status: Option<ExitStatus>) -> bool {
    use std::os::unix::process::ExitStatusExt;
    status
        .and_then(|status| status.signal())
        .is_some_and(|signal| [1, 2, 10, 15].contains(&signal))
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
