//! Commands of a batch system: their answers, their time limits, and the stop request that interrupts them.

use super::Error;
use crate::world::{
    clock,
    process::{Child, Command, ExitStatus, Stdio, end_group},
};
use std::{
    io::Read,
    os::unix::process::CommandExt as _,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
        mpsc::{Receiver, RecvTimeoutError, channel},
    },
    time::{Duration, Instant},
};

/// Interval between two checks of whether a command has ended.
const LOOK: Duration = Duration::from_millis(20);
/// Time that a command may still take after a stop request: an answer that is being given is still read.
const GRACE: Duration = Duration::from_millis(300);

/// Flag with which the caller asks every wait for an answer to stop.
#[derive(Debug, Clone, Default)]
pub struct Stop(Arc<AtomicBool>);

impl Stop {
    /// The stop request that is active once `flag` is set.
    #[must_use]
    pub fn on(flag: &Arc<AtomicBool>) -> Self {
        Self(Arc::clone(flag))
    }

    /// Whether the caller has asked to stop.
    #[must_use]
    pub fn is_asked(&self) -> bool {
        self.0.load(Ordering::SeqCst)
    }
}

/// Output of a command, and its exit status.
pub(crate) struct CommandOutput {
    pub(crate) status: ExitStatus,
    pub(crate) out: Vec<u8>,
    pub(crate) err: Vec<u8>,
}

/// Runs a command to its end. A command that takes longer than `limit`, or is running when `stop` is raised, is ended
/// with everything that it started.
///
/// # Errors
/// [`Error::NoProgram`], [`Error::Silent`] after the limit and [`Error::Interrupted`].
pub(super) fn ask(
    program: &'static str,
    command: &mut Command,
    limit: Duration,
    stop: &Stop,
) -> Result<CommandOutput, Error> {
    tell(program, command.stdin(Stdio::null()), limit, stop)
}

/// Like [`ask`], for a command whose standard input is already set.
///
/// # Errors
/// The errors of [`ask`].
pub(crate) fn tell(
    program: &'static str,
    command: &mut Command,
    limit: Duration,
    stop: &Stop,
) -> Result<CommandOutput, Error> {
    let missing = |source| Error::NoProgram { program, source };
    // The command has a process group of its own: Ctrl-C reaches only this program, which reports what follows, and
    // everything that the command starts can be ended with it.
    command.process_group(0);
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().map_err(missing)?;
    let (out, err) = (heard(child.stdout.take()), heard(child.stderr.take()));
    let mut patience = Patience {
        begun: clock::now(),
        limit,
        stopped: None,
    };
    let answered = patience
        .until_heard(&out, stop)
        .zip(patience.until_heard(&err, stop))
        .and_then(|(out, err)| Some((out, err, patience.until_ended(&mut child, stop)?)));
    match answered {
        Some((out, err, status)) => Ok(CommandOutput { status, out, err }),
        None => {
            end(&mut child);
            Err(patience.error(program))
        }
    }
}

/// The bytes of a pipe, once it ends. The reader is a thread that is never joined, since a process that outlives its
/// command may hold the pipe.
fn heard(pipe: Option<impl Read + Send + 'static>) -> Receiver<Vec<u8>> {
    let (tell, told) = channel();
    std::thread::spawn(move || {
        let mut bytes = Vec::new();
        if let Some(mut pipe) = pipe {
            let _ = pipe.read_to_end(&mut bytes);
        }
        let _ = tell.send(bytes);
    });
    told
}

/// Limits of one wait for an answer.
struct Patience {
    begun: Instant,
    limit: Duration,
    /// Moment at which the stop request was noticed.
    stopped: Option<Instant>,
}

impl Patience {
    fn is_over(&mut self, stop: &Stop) -> bool {
        if stop.is_asked() && self.stopped.is_none() {
            self.stopped = Some(clock::now());
        }
        clock::since(self.begun) >= self.limit || self.stopped.is_some_and(|then| clock::since(then) >= GRACE)
    }

    fn until_heard(&mut self, pipe: &Receiver<Vec<u8>>, stop: &Stop) -> Option<Vec<u8>> {
        loop {
            match pipe.recv_timeout(LOOK) {
                Ok(bytes) => return Some(bytes),
                Err(RecvTimeoutError::Disconnected) => return Some(Vec::new()),
                Err(RecvTimeoutError::Timeout) if self.is_over(stop) => return None,
                Err(RecvTimeoutError::Timeout) => {}
            }
        }
    }

    fn until_ended(&mut self, child: &mut Child, stop: &Stop) -> Option<ExitStatus> {
        loop {
            match child.try_wait() {
                Ok(Some(status)) => return Some(status),
                Ok(None) if !self.is_over(stop) => clock::sleep(LOOK / 10),
                Ok(None) | Err(_) => return None,
            }
        }
    }

    fn error(&self, program: &'static str) -> Error {
        if self.stopped.is_some() {
            Error::Interrupted { program }
        } else {
            let after_s = self.limit.as_secs_f64();
            Error::Silent { program, after_s }
        }
    }
}

/// Ends a command and everything that it started.
fn end(child: &mut Child) {
    end_group(child);
    let _ = child.wait();
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shell(script: &str, limit_s: u64, stop: &Stop) -> Result<CommandOutput, Error> {
        let mut command = Command::new("sh");
        ask(
            "sh",
            command.args(["-c", script]),
            Duration::from_secs(limit_s),
            stop,
        )
    }

    #[test]
    fn a_command_that_answers_is_heard_to_its_end() {
        let script = "head -c 200000 /dev/zero; echo no >&2; exit 3";
        let answer = shell(script, 60, &Stop::default()).ok().unwrap();
        assert_eq!((answer.out.len(), answer.err.as_slice()), (200_000, &b"no\n"[..]));
        assert_eq!(answer.status.code(), Some(3));
    }

    #[test]
    fn a_command_that_never_ends_is_ended_with_what_it_started() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("late");
        let script = format!("(sleep 3; touch {}) & sleep 600", file.display());
        let began = clock::now();
        let silent = shell(&script, 1, &Stop::default()).err().unwrap();
        assert_eq!(silent.to_string(), "sh gave no answer within 1 s and was ended");
        assert!(clock::since(began) < Duration::from_secs(100));
        clock::sleep(Duration::from_secs(4));
        assert!(!file.exists());
    }

    #[test]
    fn who_stops_waiting_does_not_wait_for_the_limit() {
        let flag = Arc::new(AtomicBool::new(true));
        let began = clock::now();
        let stopped = shell("sleep 600", 600, &Stop::on(&flag)).err().unwrap();
        assert!(matches!(stopped, Error::Interrupted { program: "sh" }));
        assert!(clock::since(began) < Duration::from_secs(100));
        assert!(
            shell("echo 7", 600, &Stop::on(&flag)).is_ok(),
            "a quick answer is heard"
        );
    }
}
