//! Client of HyperQueue: a small program in Python that sends requests to the server. The Python package is used
//! because every user can install it; it contains client, server and worker.

use super::request::Job;
use crate::{
    executor::{Error, Stop, command_output::ask},
    world::process::Command,
};
use serde::{Deserialize, de::DeserializeOwned};
use std::{collections::BTreeMap, ffi::OsStr, path::Path, time::Duration};

const PROGRAM: &str = include_str!("client.py");
/// Name of the client in messages.
const NAME: &str = "HyperQueue's client";

/// The Python program that talks to the server, with its time limit.
pub struct Client<'a> {
    /// The interpreter that has the package.
    pub python: &'a str,
    /// The server's directory; empty for the default one.
    pub directory: &'a str,
    /// Longest time until an answer.
    pub limit: Duration,
    /// The stop request, which ends a wait before its limit.
    pub stop: &'a Stop,
}

/// Tasks of jobs, as the server of the directory counts them.
#[derive(Debug, Deserialize)]
pub struct Counts {
    /// The server's own name, which distinguishes it from a later server of the same directory.
    pub server: String,
    /// Jobs by their numbers; a job that the server does not know is absent.
    pub jobs: BTreeMap<u64, Count>,
}

/// Ended tasks of a job, by end state.
#[derive(Debug, Clone, Copy, Deserialize)]
pub struct Count {
    total: usize,
    finished: usize,
    failed: usize,
    /// Whether no task of the job will run any more.
    completed: bool,
}

impl Count {
    /// Tasks that have not ended. The client does not count cancelled ones; a job that was cancelled as a whole is
    /// completed.
    #[must_use]
    pub fn alive(self) -> usize {
        if self.completed {
            0
        } else {
            self.total.saturating_sub(self.ended())
        }
    }

    /// Tasks that ran and ended.
    #[must_use]
    pub fn ended(self) -> usize {
        self.finished + self.failed
    }
}

#[derive(Deserialize)]
#[serde(rename_all = "snake_case")]
enum ServerReply<T> {
    Done(T),
    Busy(String),
    Refused(String),
}

impl Client<'_> {
    /// Submits a request. A request that the server already took is not submitted again.
    ///
    /// # Errors
    /// [`Error::Refused`] if there is no package or no server, or the server refuses; [`Error::Busy`] or
    /// [`Error::Silent`] if it does not answer.
    pub fn submit(&self, request: &Path) -> Result<Job, Error> {
        self.call("submit", request.as_os_str())
    }

    /// Counts of ended tasks of these jobs.
    ///
    /// # Errors
    /// The errors of [`submit`](Self::submit).
    pub fn count(&self, jobs: &[u64]) -> Result<Counts, Error> {
        self.call("count", format!("{jobs:?}").as_ref())
    }

    fn call<T: DeserializeOwned>(&self, verb: &str, argument: &OsStr) -> Result<T, Error> {
        let mut command = Command::new(self.python);
        command.args(["-c", PROGRAM, verb, self.directory]).arg(argument);
        let answer = ask(NAME, &mut command, self.limit, self.stop).map_err(|error| match error {
            Error::NoProgram { source, .. } => no_python(self.python, &source),
            other => other,
        })?;
        let out = String::from_utf8_lossy(&answer.out);
        match out.lines().last().map(serde_json::from_str) {
            Some(Ok(ServerReply::Done(done))) => Ok(done),
            Some(Ok(ServerReply::Busy(said))) => Err(Error::Busy { program: NAME, said }),
            Some(Ok(ServerReply::Refused(said))) => Err(Error::Refused { program: NAME, said }),
            Some(Err(_)) | None => Err(unreadable(&out, &answer.err)),
        }
    }
}

fn no_python(python: &str, source: &std::io::Error) -> Error {
    let problem =
        format!("`{python}` cannot be started: {source}; name a Python that has the package `hyperqueue`");
    Error::Option {
        key: "python",
        problem,
    }
}

/// The error about the answer of a client that ended prematurely.
fn unreadable(out: &str, err: &[u8]) -> Error {
    let err = String::from_utf8_lossy(err);
    let mut lines = err.lines().chain(out.lines());
    let last = lines.rfind(|line| !line.trim().is_empty());
    Error::Unreadable {
        program: NAME,
        text: last.unwrap_or_default().trim().into(),
        expected: "an answer in JSON",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn client<'a>(python: &'a str, directory: &'a str, stop: &'a Stop) -> Client<'a> {
        let limit = Duration::from_secs(60);
        Client {
            python,
            directory,
            limit,
            stop,
        }
    }

    #[test]
    fn counts_are_read_and_a_completed_job_has_no_living_task() {
        let text = r#"{"done": {"server": "QjNQVn", "jobs": {
            "1": {"total": 5, "finished": 1, "failed": 1, "completed": false},
            "2": {"total": 5, "finished": 0, "failed": 1, "completed": true}}}}"#;
        let Ok(ServerReply::Done(counts)) = serde_json::from_str::<ServerReply<Counts>>(text) else {
            panic!("{text}");
        };
        let alive: Vec<usize> = counts.jobs.values().map(|count| count.alive()).collect();
        assert_eq!((counts.server.as_str(), alive), ("QjNQVn", vec![3, 0]));
    }

    #[test]
    fn no_interpreter_and_no_answer_are_told_apart() {
        let stop = Stop::default();
        let text = |python: &str| {
            client(python, "/nowhere", &stop)
                .count(&[7])
                .unwrap_err()
                .to_string()
        };
        let none = text("/nowhere/python");
        assert!(
            none.starts_with("`python`: `/nowhere/python` cannot be started: "),
            "{none}"
        );
        assert!(text("true").contains("which is not an answer in JSON"));
    }

    #[test]
    fn a_directory_without_a_server_is_named() {
        let stop = Stop::default();
        let none = client("python3", "/nowhere", &stop).count(&[7]).unwrap_err();
        assert!(matches!(none, Error::Refused { .. }), "{none}");
        assert!(
            none.to_string().contains("has its directory at `/nowhere`"),
            "{none}"
        );
    }
}
