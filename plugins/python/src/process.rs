//! A Python process that answers one request at a time.
//!
//! Neither a crash nor a hang of the process outlives a trial. Its guard (`guard.py`) ends it, with all processes that
//! it started, when its standard input closes or the engine ends; until the guard runs, a shell does so. Signals to the
//! engine do not reach the process. Its output is hidden, except for the last lines if it ends unexpectedly.

use contract::Error;
use execution::patience::Watch;
use std::{
    io::{Read, Write},
    os::unix::process::{CommandExt as _, ExitStatusExt},
    path::Path,
    process::{Child, ChildStdin, ChildStdout, Command, ExitStatus, Stdio},
    sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel},
    time::Duration,
};

const SERVER: &str = concat!(
    include_str!("link.py"),
    include_str!("guard.py"),
    include_str!("spaces.py"),
    include_str!("returns.py"),
    include_str!("making.py"),
    include_str!("server.py"),
    include_str!("actions.py"),
    include_str!("agents.py"),
    include_str!("serving.py")
);
/// Length of the output that is kept for messages, bytes.
const LAST_WORDS: usize = 2000;
/// Signals with which people, terminals and batch systems stop programs. They are no fault of the stopped program.
const STOPS: [i32; 5] = [1, 2, 9, 10, 15];
/// Exit status of a shell that does not find the program.
const NOT_FOUND: i32 = 127;
/// Exit status of a shell that cannot run the program.
const CANNOT_RUN: i32 = 126;
/// Number of restarts after a signal that arrived before the process could ignore it.
const STARTS: usize = 3;
/// Time for the process to close its environments and end their processes.
const ENDING: Duration = Duration::from_secs(20);

/// A running process.
#[derive(Debug)]
pub struct Process {
    /// `None` once no more requests will be sent.
    requests: Option<ChildStdin>,
    answers: ChildStdout,
    ended: Receiver<ProcessExit>,
    id: u32,
    interpreter: String,
}

/// Exit of a process.
#[derive(Debug)]
struct ProcessExit {
    status: Option<ExitStatus>,
    last_words: String,
}

/// Answer to a request with a text.
#[derive(Debug)]
pub enum Answer {
    /// The result of the request.
    Done(Vec<u8>),
    /// The reason why the request is not possible.
    Cannot(String),
    /// An error in Python.
    Failed(String),
}

impl Process {
    /// Starts Python and sends the JSON `request`, which makes `what` (in words); the process removes the
    /// folder `own` when it ends. The answer to the request is returned with it.
    ///
    /// # Errors
    /// [`Error::Unavailable`] for a missing interpreter, [`Error::Config`] where it cannot be started, says
    /// nothing or takes too long, and the errors of [`ask`](Self::ask).
    pub fn start(interpreter: &str, own: &Path, what: &str, request: &[u8]) -> Result<(Self, Answer), Error> {
        let mut starts = 1;
        loop {
            match Self::attempt(interpreter, own, what, request) {
                // No work could be lost yet.
                Err(Error::Ended { .. }) if starts < STARTS => starts += 1,
                outcome => return outcome,
            }
        }
    }

    fn attempt(interpreter: &str, own: &Path, what: &str, request: &[u8]) -> Result<(Self, Answer), Error> {
        let cannot = |problem: &str| {
            let problem = format!(
                "`{interpreter}` cannot be started: {problem}. Name a Python that has the packages of the {what}, \
                 as `python3`, `.venv/bin/python`, or put one on the path"
            );
            Error::config("interpreter", problem)
        };
        let mut child = command(interpreter, own)
            .spawn()
            .map_err(|it| cannot(&it.to_string()))?;
        let id = child.id();
        let keeper = Keeper::of(id);
        let (Some(requests), Some(answers)) = (child.stdin.take(), child.stdout.take()) else {
            return Err(cannot("its pipes are missing"));
        };
        let (ending, ended) = channel();
        std::thread::spawn(move || mind(&mut child, &ending));
        let mut process = Self {
            requests: Some(requests),
            answers,
            ended,
            id,
            interpreter: interpreter.into(),
        };
        let is_awake = process.wake(&cannot)?;
        drop(keeper);
        if !is_awake {
            return Err(cannot("it is no Python: it answers otherwise"));
        }
        let answer = process.ask_within("make", &format!("making the {what}"), None, request)?;
        Ok((process, answer))
    }

    /// Waits for the first byte, which shows that the guard runs.
    fn wake(&mut self, cannot: &dyn Fn(&str) -> Error) -> Result<bool, Error> {
        let watch = self.watch("the start of");
        let mut byte = [0];
        let is_told = self.answers.read_exact(&mut byte).is_ok();
        if let Some(reason) = watch.end() {
            return Err(Error::config(
                "interpreter",
                format!(
                    "{reason}; it had said nothing: is it a Python, and does it answer `{} --version`?",
                    self.interpreter
                ),
            ));
        }
        if is_told {
            return Ok(byte == *b"w");
        }
        let (status, last_words) = self.end();
        match status.and_then(|status| status.code()) {
            Some(code @ (NOT_FOUND | CANNOT_RUN)) => {
                // For example `sh: 1: exec: python9: not found`.
                let why = last_words.lines().last().unwrap_or_default();
                Err(match cannot(why.rsplit(": ").next().unwrap_or(why)) {
                    Error::Config { key, problem } if code == NOT_FOUND => {
                        Error::Unavailable { key, problem }
                    }
                    error => error,
                })
            }
            _ => Err(ended(status, &last_words)),
        }
    }

    /// Watches the process while it is busy with `what` and ends it once it exceeds the limits of time or
    /// memory.
    pub fn watch(&self, what: &str) -> Watch {
        let id = self.id;
        Watch::over(id, format!("{what} `{}`", self.interpreter), move |family| {
            end_all(id, family);
        })
    }

    /// Announces requests in shared memory, and waits until their answers are there.
    ///
    /// # Errors
    /// [`Error::Model`] for an error in Python, and the errors of [`ask`](Self::ask) where the process ended.
    pub fn ring(&mut self) -> Result<(), Error> {
        let mut byte = [0];
        let told = self.send(b"s").and_then(|()| self.answers.read_exact(&mut byte));
        match (told, byte) {
            (Err(_), _) => Err(self.gone()),
            (Ok(()), [b'k']) => Ok(()),
            (Ok(()), _) => match self.text() {
                Some(problem) => Err(failed(String::from_utf8_lossy(&problem).into_owned())),
                None => Err(self.gone()),
            },
        }
    }

    /// Like [`ask`](Self::ask), but within the limits of time and memory; an error names the config key `key`.
    ///
    /// # Errors
    /// [`Error::Config`] where the process was ended at a limit, and the errors of [`ask`](Self::ask).
    pub fn ask_within(
        &mut self,
        key: &str,
        doing: &str,
        what: Option<u8>,
        text: &[u8],
    ) -> Result<Answer, Error> {
        let watch = self.watch(&format!("{doing} with"));
        let answer = self.ask(what, text);
        match watch.end() {
            Some(reason) => Err(Error::config(key, reason)),
            None => answer,
        }
    }

    /// Sends a request with a text and waits for the text of the answer.
    ///
    /// # Errors
    /// [`Error::Model`] where Python ended by itself, [`Error::Ended`] where it was ended from outside.
    pub fn ask(&mut self, what: Option<u8>, text: &[u8]) -> Result<Answer, Error> {
        let mut message: Vec<u8> = what.into_iter().collect();
        message.extend((text.len() as u64).to_le_bytes());
        message.extend(text);
        let mut byte = [0];
        let told = self
            .send(&message)
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

    fn send(&mut self, message: &[u8]) -> std::io::Result<()> {
        match &mut self.requests {
            Some(requests) => requests.write_all(message),
            None => Err(std::io::ErrorKind::BrokenPipe.into()),
        }
    }

    /// Reads a text after its length; `None` if the process ended.
    fn text(&mut self) -> Option<Vec<u8>> {
        let mut length = [0; 8];
        self.answers.read_exact(&mut length).ok()?;
        let length = u64::from_le_bytes(length);
        let mut text = Vec::new();
        let read = (&mut self.answers).take(length).read_to_end(&mut text).ok()?;
        (read as u64 == length).then_some(text)
    }

    /// The error of a process that ended, with its last words.
    fn gone(&mut self) -> Error {
        let (status, last_words) = self.end();
        ended(status, &last_words)
    }

    /// Lets the process end with all processes that it started; kills those that remain.
    fn end(&mut self) -> (Option<ExitStatus>, String) {
        drop(self.requests.take());
        let mut ended = self.ended.recv_timeout(ENDING);
        if ended
            .as_ref()
            .is_err_and(|error| *error == RecvTimeoutError::Timeout)
        {
            end_all(self.id, &[]);
            ended = self.ended.recv_timeout(ENDING);
        }
        ended.map_or((None, String::new()), |it| (it.status, it.last_words))
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        self.end();
    }
}

pub fn failed(problem: String) -> Error {
    Error::Model {
        model: "python",
        problem,
    }
}

/// The error of a trial whose process ended.
fn ended(status: Option<ExitStatus>, last_words: &str) -> Error {
    let how = match status.map(|status| (status.signal(), status.code())) {
        Some((Some(signal), _)) if STOPS.contains(&signal) => {
            let what = "the Python process";
            return Error::Ended { what, signal };
        }
        Some((Some(signal), _)) => format!("was ended by signal {signal}"),
        Some((None, Some(code))) => format!("left with exit code {code}"),
        _ => "answers no more".into(),
    };
    let said = if last_words.is_empty() {
        String::new()
    } else {
        format!("; it said last: {}", document::plain_text::last_words(last_words))
    };
    failed(format!("the Python process {how}{said}"))
}

fn command(interpreter: &str, own: &Path) -> Command {
    // Signals that are ignored before Python runs are ignored from its first moment on.
    let mut command = shell(r#"trap "" HUP INT TERM USR1; exec "$0" "$@""#);
    command.args([interpreter, "-u", "-c", SERVER]).arg(own);
    // Hash order of sets and dictionaries must be the same everywhere, and a trial has one thread.
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

/// A shell in a process group of its own, which signals from the terminal do not reach.
fn shell(script: &str) -> Command {
    let mut command = Command::new("sh");
    command.args(["-c", script]).process_group(0);
    command
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    command
}

/// Ends the group of a process whose guard does not run yet, should the engine end meanwhile.
struct Keeper(Option<Child>);

impl Keeper {
    fn of(id: u32) -> Self {
        let mut command = shell(r#"trap "" HUP INT TERM USR1; read -r _ || kill -s KILL -- "-$0""#);
        Self(command.arg(id.to_string()).stdin(Stdio::piped()).spawn().ok())
    }
}

impl Drop for Keeper {
    fn drop(&mut self) {
        if let Some(child) = &mut self.0 {
            let _ = child.stdin.take().map(|mut stdin| stdin.write_all(b"\n"));
            let _ = child.wait();
        }
    }
}

/// Ends a process with all processes that it started. The guard is asked first, even if it was stopped; the remaining
/// processes are ended by group and family.
fn end_all(id: u32, family: &[u32]) {
    let script = r#"kill -s USR2 "$0"; kill -s CONT -- "-$0"; n=0
        while kill -s 0 "$0" && [ "$n" -lt 100 ]; do sleep 0.1; n=$((n + 1)); done
        kill -s KILL -- "-$0"; for it in "$@"; do kill -s KILL "$it"; done"#;
    let ids = [id].iter().chain(family).map(u32::to_string).collect::<Vec<_>>();
    let _ = shell(script).args(ids).status();
}

/// Keeps the last words of a process and reports its exit.
fn mind(child: &mut Child, ended: &Sender<ProcessExit>) {
    let (tell, told) = channel();
    if let Some(errors) = child.stderr.take() {
        std::thread::spawn(move || last_words(errors, &tell));
    }
    let status = child.wait().ok();
    // A process that it started may outlive it and keep its output open.
    let mut words = Vec::new();
    while let Ok(piece) = told.recv_timeout(Duration::from_secs(1)) {
        words = piece;
    }
    // Sending fails if the receiver is gone, which then needs no answer.
    let _ = ended.send(ProcessExit {
        status,
        last_words: String::from_utf8_lossy(&words).trim().to_owned(),
    });
}

/// Sends the last bytes of the output after each write.
fn last_words(mut errors: impl Read, tell: &Sender<Vec<u8>>) {
    let (mut kept, mut piece) = (Vec::new(), [0; 4096]);
    while let Ok(read @ 1..) = errors.read(&mut piece) {
        kept.extend(&piece[..read]);
        let surplus = kept.len().saturating_sub(LAST_WORDS);
        kept.drain(..surplus);
        let _ = tell.send(kept.clone());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn problem_of(interpreter: &str) -> String {
        let own = tempfile::tempdir().unwrap();
        Process::start(interpreter, own.path(), "environment", b"{}")
            .unwrap_err()
            .to_string()
    }

    #[test]
    fn a_missing_interpreter_is_refused_with_a_remedy() {
        let problem = problem_of("/nowhere/python3");
        assert!(
            problem.contains("`/nowhere/python3` cannot be started: not found")
                || problem.contains("`/nowhere/python3` cannot be started: No such file"),
            "{problem}"
        );
        assert!(problem.contains(".venv/bin/python"), "{problem}");
    }

    #[test]
    fn a_process_that_ends_is_told_with_its_last_words() {
        // These programs are not Python.
        let problem = problem_of("false");
        assert!(
            problem.contains("the Python process left with exit code 1"),
            "{problem}"
        );
        let problem = problem_of("echo");
        assert!(problem.contains("it is no Python"), "{problem}");
    }
}
