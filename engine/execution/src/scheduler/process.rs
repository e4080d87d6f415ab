//! Worker processes, each shared by the slot that talks to it and the thread that watches it.

use super::{
    silence::{Silence, WatchedReader},
    worker::Message,
};
use crate::{
    footprint::{exceeded, family},
    limits::Limits,
    world::{
        clock,
        process::{Child, ChildStdin, ChildStdout, Command, ExitStatus, Signal, Stdio, end_group, signal},
    },
};
use contract::{Error, trial_end::EndState};
use std::{
    io::{self, BufReader, Write},
    sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError},
    time::{Duration, Instant},
};

/// Messages of a process.
pub(super) type Replies = BufReader<WatchedReader<ChildStdout>>;

/// Time in which an idle process must exit once its input has ended.
const LEAVES_WITHIN: Duration = Duration::from_secs(5);
/// Silence that is allowed to a process that was told to stop, if silence is limited.
const STOPS_WITHIN: Duration = Duration::from_secs(10);
/// Largest piece that is written at once, in bytes; a process that accepts one is not silent.
const PIECE: usize = 1 << 16;

/// The process of one slot, if it has one.
#[derive(Default)]
pub(super) struct WorkerProcess {
    process: Mutex<Option<Process>>,
}

pub(super) struct Process {
    child: Child,
    /// Pipe to the process. It has its own lock, which is held while writing, so that a process that accepts no input
    /// can still be ended.
    requests: Arc<Mutex<ChildStdin>>,
    silence: Silence,
    /// Silence after which a process that owes an answer counts as lost.
    patience: Option<Duration>,
    busy: Option<ActiveRequest>,
}

struct ActiveRequest {
    since: Instant,
    limits: Arc<Limits>,
    told_to_stop: bool,
    /// The exceeded limit, set before the process is ended because of it.
    exceeded: Option<(EndState, String)>,
}

impl Process {
    /// Whether the process has not ended yet.
    pub(super) fn is_alive(&mut self) -> bool {
        matches!(self.child.try_wait(), Ok(None))
    }

    /// Lets an idle process exit by ending its input. A process that does not exit is ended.
    pub(super) fn dismiss(self) {
        let Self {
            mut child, requests, ..
        } = self;
        drop(requests);
        let asked = clock::now();
        while matches!(child.try_wait(), Ok(None)) {
            if clock::since(asked) > LEAVES_WITHIN {
                let _ = child.kill();
                let _ = child.wait();
                return;
            }
            clock::sleep(Duration::from_millis(2));
        }
    }
}

impl WorkerProcess {
    /// Starts a process, and returns the reader of its messages. A process that owes an answer and is silent for longer
    /// than `patience` is ended with all its descendants; it has its own process group.
    pub(super) fn start(&self, command: &mut Command, patience: Option<Duration>) -> Result<Replies, Error> {
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
        let silence = Silence::default();
        *self.lock() = Some(Process {
            child,
            requests: Arc::new(Mutex::new(requests)),
            silence: silence.clone(),
            patience,
            busy: None,
        });
        let pipe = replies;
        Ok(BufReader::new(WatchedReader { pipe, silence }))
    }

    /// Takes over a process that serves no other slot.
    pub(super) fn adopt(&self, process: Process) {
        *self.lock() = Some(process);
    }

    /// Gives the process away.
    pub(super) fn release(&self) -> Option<Process> {
        self.lock().take()
    }

    /// Sends bytes to an idle process. A process that accepts none blocks only its slot.
    pub(super) fn write(&self, bytes: &[u8]) -> io::Result<()> {
        let process = self
            .lock()
            .as_ref()
            .map(|it| (Arc::clone(&it.requests), it.silence.clone()));
        let Some((requests, silence)) = process else {
            return Err(io::ErrorKind::BrokenPipe.into());
        };
        let mut requests = requests.lock().unwrap_or_else(PoisonError::into_inner);
        let mut pieces = bytes.chunks(PIECE);
        pieces.try_for_each(|piece| silence.during(|| requests.write_all(piece)))
    }

    /// Sends a message; the process is busy with a trial from now on. If the process is gone, that is noticed when its
    /// answer is read.
    pub(super) fn begin(&self, message: &str, limits: &Arc<Limits>) {
        let _ = self.write(format!("{message}\n").as_bytes());
        if let Some(process) = self.lock().as_mut() {
            let limits = Arc::clone(limits);
            process.busy = Some(ActiveRequest {
                since: clock::now(),
                limits,
                told_to_stop: false,
                exceeded: None,
            });
        }
    }

    /// Records the answer of the process; false if it can no longer serve, because it was ended for a limit at that
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

    /// Reaps a process that has ended: returns its exit status and the limit for which it was ended.
    pub(super) fn bury(&self) -> (Option<ExitStatus>, Option<(EndState, String)>) {
        let process = self.lock().take();
        match process {
            Some(Process { mut child, busy, .. }) => {
                // The process closed its output; if it is still alive, it is useless.
                let _ = child.kill();
                (child.wait().ok(), busy.and_then(|busy| busy.exceeded))
            }
            None => (None, None),
        }
    }

    /// Lets an idle process exit.
    pub(super) fn dismiss(&self) {
        self.release().into_iter().for_each(Process::dismiss);
    }

    /// Tells a busy process, once, to save a checkpoint and stop. From now on a shorter silence is allowed, even if it
    /// is not busy yet, while a connection is made or a trial is sent.
    pub(super) fn ask_to_stop(&self) {
        let mut process = self.look();
        let Some(process) = process.as_deref_mut().and_then(Option::as_mut) else {
            return;
        };
        process.patience = process.patience.map(|patience| patience.min(STOPS_WITHIN));
        if let Some(busy) = process.busy.as_mut()
            && !busy.told_to_stop
            && let Ok(text) = serde_json::to_string(&Message::Stop)
            && let Ok(mut requests) = process.requests.try_lock()
        {
            let _ = writeln!(requests, "{text}");
            busy.told_to_stop = true;
        }
    }

    /// Excludes the time for which this program was suspended from every limit.
    pub(super) fn was_suspended(&self, away: Duration) {
        if let Some(Process { busy: Some(busy), .. }) = self.look().as_deref_mut().and_then(Option::as_mut) {
            busy.since += away;
        }
    }

    /// Ends a process that exceeds a limit, or its allowed silence.
    pub(super) fn hold_limits(&self) {
        if let Some(process) = self.look().as_deref_mut().and_then(Option::as_mut)
            && let Some(patience) = process.patience
            && process.silence.lasts().is_some_and(|silent| silent > patience)
        {
            end_group(&mut process.child);
            process.patience = None;
        }
        if let Some(Process {
            child,
            busy: Some(busy),
            ..
        }) = self.look().as_deref_mut().and_then(Option::as_mut)
            && busy.exceeded.is_none()
        {
            busy.exceeded = exceeded(&busy.limits, clock::since(busy.since), child.id());
            match &busy.exceeded {
                // The memory is held by descendants, which do not notice the end of the worker for a while.
                Some((EndState::Oom, _)) => {
                    let family = family(child.id());
                    family.into_iter().rev().for_each(|pid| signal(pid, Signal::Kill));
                }
                Some(_) => drop(child.kill()),
                None => {}
            }
        }
    }

    /// Whether the process was ended because it was silent.
    pub(super) fn fell_silent(&self) -> bool {
        self.lock()
            .as_ref()
            .is_some_and(|process| process.patience.is_none())
    }

    /// The process, unless its slot is talking to it; the watching thread then tries again later.
    fn look(&self) -> Option<MutexGuard<'_, Option<Process>>> {
        match self.process.try_lock() {
            Ok(process) => Some(process),
            Err(TryLockError::Poisoned(poisoned)) => Some(poisoned.into_inner()),
            Err(TryLockError::WouldBlock) => None,
        }
    }

    fn lock(&self) -> MutexGuard<'_, Option<Process>> {
        // The shared value is replaced as a whole, so that it is consistent after a panic elsewhere.
        self.process.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::BufRead;

    /// A process that is silent on both pipes and has descendants that hold them.
    fn silent(shared: &WorkerProcess, patience: Duration) -> Replies {
        use std::os::unix::process::CommandExt as _;
        let mut command = Command::new("sh");
        command.args(["-c", "sleep 600 & sleep 600"]).process_group(0);
        shared.start(&mut command, Some(patience)).unwrap()
    }

    #[test]
    fn who_says_nothing_for_longer_than_it_may_is_ended_and_its_reader_goes_on() {
        let shared = WorkerProcess::default();
        let mut replies = silent(&shared, Duration::from_millis(300));
        let begun = clock::now();
        std::thread::scope(|scope| {
            let reader = scope.spawn(|| replies.read_line(&mut String::new()));
            while !reader.is_finished() {
                assert!(clock::since(begun) < Duration::from_secs(100));
                shared.hold_limits();
                clock::sleep(Duration::from_millis(5));
            }
            assert_eq!(reader.join().unwrap().unwrap(), 0);
        });
        assert!(shared.fell_silent() && clock::since(begun) >= Duration::from_millis(300));
        shared.bury();
    }

    #[test]
    fn who_takes_nothing_in_is_ended_too() {
        let shared = WorkerProcess::default();
        let _replies = silent(&shared, Duration::from_millis(300));
        let begun = clock::now();
        std::thread::scope(|scope| {
            let writer = scope.spawn(|| shared.write(&vec![0; 1 << 24]));
            while !writer.is_finished() {
                assert!(clock::since(begun) < Duration::from_secs(100));
                shared.hold_limits();
                clock::sleep(Duration::from_millis(5));
            }
            assert!(writer.join().unwrap().is_err());
        });
        shared.bury();
    }

    #[test]
    fn whoever_stops_waits_less_for_one_that_is_silent_before_it_was_asked_anything() {
        let shared = WorkerProcess::default();
        let mut replies = silent(&shared, STOPS_WITHIN * 100);
        let begun = clock::now();
        std::thread::scope(|scope| {
            let reader = scope.spawn(|| replies.read_line(&mut String::new()));
            while !reader.is_finished() {
                assert!(clock::since(begun) < STOPS_WITHIN * 10);
                shared.ask_to_stop();
                shared.hold_limits();
                clock::sleep(Duration::from_millis(5));
            }
        });
        assert!(shared.fell_silent() && clock::since(begun) >= STOPS_WITHIN);
        shared.bury();
    }

    #[test]
    fn one_that_is_not_waited_for_may_be_silent() {
        let shared = WorkerProcess::default();
        let _replies = silent(&shared, Duration::from_millis(10));
        clock::sleep(Duration::from_millis(50));
        shared.hold_limits();
        assert!(!shared.fell_silent());
        // Its descendants must not outlive the test.
        if let Some(process) = shared.lock().as_mut() {
            end_group(&mut process.child);
        }
        shared.bury();
    }
}
