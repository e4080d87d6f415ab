//! A Python process that is asked and answers in turn.
//!
//! Neither a crash nor a hang of it outlives a trial: it ends when its standard input does, and with the process
//! that started it. Nothing it prints is shown, but for its last lines where it ends unexpectedly.

use engine::Error;
use std::{
    io::{self, Read, Write},
    os::unix::process::ExitStatusExt,
    process::{Child, ChildStdin, ChildStdout, Command, ExitStatus, Stdio},
    sync::mpsc::{Receiver, Sender, channel},
    time::Duration,
};

const SERVER: &str = include_str!("server.py");
/// How much of what it printed last is kept, bytes.
const LAST_WORDS: usize = 2000;
/// The signal of an alarm, by which it ends where its start or a rehearsal takes too long.
const ALARM: i32 = 14;

/// A running process.
#[derive(Debug)]
pub struct Process {
    requests: ChildStdin,
    answers: ChildStdout,
    ended: Receiver<Ended>,
}

/// How one ended.
#[derive(Debug)]
struct Ended {
    status: Option<ExitStatus>,
    last_words: String,
}

/// What was answered to a request with a text.
#[derive(Debug)]
pub enum Answer {
    /// What was asked for.
    Done(Vec<u8>),
    /// Why it cannot be had.
    Cannot(String),
    /// What went wrong in Python.
    Failed(String),
}

impl Process {
    /// Starts Python.
    ///
    /// # Errors
    /// [`Error::Unavailable`] where there is no such interpreter, and [`Error::Config`] where it cannot be started.
    pub fn start(interpreter: &str) -> Result<Self, Error> {
        let (started, starting) = channel();
        let (ending, ended) = channel();
        let mut command = command(interpreter);
        // A process ends with the thread that started it, so this one stays as long as it does.
        std::thread::spawn(move || mind(&mut command, &started, &ending));
        let pipes = starting
            .recv()
            .unwrap_or_else(|_| Err(io::Error::other("it was lost")));
        let (requests, answers) = pipes.map_err(|source| {
            let problem = format!(
                "`{interpreter}` cannot be started: {source}. Name a Python that has the packages of the environment, \
                 as `python3`, `.venv/bin/python`, or put one on the path"
            );
            if source.kind() == io::ErrorKind::NotFound {
                let key = "interpreter".into();
                return Error::Unavailable { key, problem };
            }
            Error::config("interpreter", problem)
        })?;
        Ok(Self {
            requests,
            answers,
            ended,
        })
    }

    /// Says that requests lie in shared memory, and waits until their answers do.
    ///
    /// # Errors
    /// [`Error::Model`] for what went wrong in Python, and where it ended.
    pub fn ring(&mut self) -> Result<(), Error> {
        let mut byte = [0];
        let told = self
            .requests
            .write_all(b"s")
            .and_then(|()| self.answers.read_exact(&mut byte));
        match (told, byte) {
            (Err(_), _) => Err(self.gone()),
            (Ok(()), [b'k']) => Ok(()),
            (Ok(()), _) => match self.text() {
                Some(problem) => Err(failed(String::from_utf8_lossy(&problem).into_owned())),
                None => Err(self.gone()),
            },
        }
    }

    /// Asks with a text and waits for the text of the answer.
    ///
    /// # Errors
    /// [`Error::Model`] where Python ended.
    pub fn ask(&mut self, what: Option<u8>, text: &[u8]) -> Result<Answer, Error> {
        let mut message: Vec<u8> = what.into_iter().collect();
        message.extend((text.len() as u64).to_le_bytes());
        message.extend(text);
        let mut byte = [0];
        let told = self
            .requests
            .write_all(&message)
            .and_then(|()| self.answers.read_exact(&mut byte));
        let Some(text) = told.ok().and_then(|()| self.text()) else {
            return Err(self.gone());
        };
        let in_words = |text: Vec<u8>| String::from_utf8_lossy(&text).into_owned();
        Ok(match byte {
            [b'k'] => Answer::Done(text),
            [b'n'] => Answer::Cannot(in_words(text)),
            _ => Answer::Failed(in_words(text)),
        })
    }

    /// A text with its length before it; `None` where the process ended.
    fn text(&mut self) -> Option<Vec<u8>> {
        let mut length = [0; 8];
        self.answers.read_exact(&mut length).ok()?;
        let length = u64::from_le_bytes(length);
        let mut text = Vec::new();
        let read = (&mut self.answers).take(length).read_to_end(&mut text).ok()?;
        (read as u64 == length).then_some(text)
    }

    /// How it ended, and what it said last.
    fn gone(&self) -> Error {
        // What it started may hold its output open after it.
        let ended = self.ended.recv_timeout(Duration::from_secs(5)).ok();
        let Some(Ended { status, last_words }) = ended else {
            return failed("the Python process answers no more".into());
        };
        let how = match status.map(|status| (status.signal(), status.code())) {
            Some((Some(ALARM), _)) => "did not answer within 300 s".into(),
            Some((Some(signal), _)) => format!("was ended by signal {signal}"),
            Some((None, Some(code))) => format!("left with exit code {code}"),
            _ => "vanished".into(),
        };
        let said = if last_words.is_empty() {
            String::new()
        } else {
            format!("; it said last: {last_words}")
        };
        failed(format!("the Python process {how}{said}"))
    }
}

pub fn failed(problem: String) -> Error {
    Error::Model {
        model: "python",
        problem,
    }
}

fn command(interpreter: &str) -> Command {
    let mut command = Command::new(interpreter);
    command.args(["-u", "-c", SERVER]);
    // The order of sets and dictionaries by hashes must be the same everywhere, and a trial has one thread.
    command
        .env("PYTHONHASHSEED", "0")
        .env("PYTHONDONTWRITEBYTECODE", "1");
    for library in ["OMP", "OPENBLAS", "MKL", "NUMEXPR"] {
        command.env(format!("{library}_NUM_THREADS"), "1");
    }
    command
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    command
}

type Pipes = io::Result<(ChildStdin, ChildStdout)>;

/// Starts a process, hands its pipes over, keeps its last words and sees it end.
fn mind(command: &mut Command, started: &Sender<Pipes>, ended: &Sender<Ended>) {
    let mut child = match command.spawn() {
        Ok(child) => child,
        Err(source) => {
            let _ = started.send(Err(source));
            return;
        }
    };
    let pipes = child.stdin.take().zip(child.stdout.take());
    // Nobody waits any more where the receiver is gone; the pipes are closed then, and the process ends.
    let _ = started.send(pipes.ok_or_else(|| io::Error::other("its pipes are missing")));
    let last_words = last_words(&mut child);
    let _ = ended.send(Ended {
        status: child.wait().ok(),
        last_words,
    });
}

/// The last lines that a process writes before its standard error closes.
fn last_words(child: &mut Child) -> String {
    let (mut kept, mut piece) = (Vec::new(), [0; 4096]);
    let Some(errors) = &mut child.stderr else {
        return String::new();
    };
    while let Ok(read @ 1..) = errors.read(&mut piece) {
        kept.extend(&piece[..read]);
        let surplus = kept.len().saturating_sub(LAST_WORDS);
        kept.drain(..surplus);
    }
    String::from_utf8_lossy(&kept).trim().to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_interpreter_is_refused_with_what_to_name() {
        let problem = Process::start("/nowhere/python3").unwrap_err().to_string();
        assert!(
            problem.contains("`/nowhere/python3` cannot be started: No such file"),
            "{problem}"
        );
        assert!(problem.contains(".venv/bin/python"), "{problem}");
    }

    #[test]
    fn a_process_that_ends_is_told_with_its_last_words() {
        // A program that is no Python answers nothing.
        let mut process = Process::start("false").unwrap();
        let problem = process.ask(None, b"{}").unwrap_err().to_string();
        assert!(
            problem.contains("the Python process left with exit code 1"),
            "{problem}"
        );
    }
}
