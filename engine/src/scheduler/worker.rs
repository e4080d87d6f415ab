//! The inside of a worker process: one request a line, one trial a request.

use crate::{
    Error, Registry,
    results::{EndState, TrialEnd},
    store::Store,
    trial::Trial,
};
use serde::{Deserialize, Serialize};
use std::{
    io::{BufRead, Write},
    panic::{AssertUnwindSafe, catch_unwind},
    path::PathBuf,
    time::{Duration, Instant},
};

/// What a worker is asked.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Request {
    /// The trial to run.
    pub trial: Trial,
    /// The store's folder.
    pub store: PathBuf,
}

/// What a worker says.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Reply {
    /// How far the trial is.
    Progress {
        /// Steps done.
        done: u64,
        /// Steps in all.
        total: u64,
    },
    /// The trial ended and its end is stored.
    Ended {
        /// How.
        end: TrialEnd,
    },
}

/// Answers requests until the input ends.
///
/// # Errors
/// Where the store cannot be written or the other side is gone.
pub fn serve(registry: &Registry, requests: impl BufRead, mut replies: impl Write) -> Result<(), Error> {
    for line in requests.lines() {
        let broken = |problem: String| Error::Worker { problem };
        let line = line.map_err(|source| broken(source.to_string()))?;
        let request: Request = serde_json::from_str(&line).map_err(|source| broken(source.to_string()))?;
        let end = run(registry, &request, &mut replies)?;
        let panicked = end.state == EndState::Panicked;
        say(&mut replies, &Reply::Ended { end })?;
        if panicked {
            // Code that panicked may have left its memory in any state: the next trial gets a fresh process.
            return Ok(());
        }
    }
    Ok(())
}

fn run(registry: &Registry, request: &Request, replies: &mut impl Write) -> Result<TrialEnd, Error> {
    let store = Store::at(&request.store);
    let trial = &request.trial;
    let started = now();
    let mut told = started;
    let mut progress = |done, total| {
        if told.elapsed() > Duration::from_millis(200) {
            told = now();
            // A scheduler that is gone shows when the end is told.
            let _ = say(replies, &Reply::Progress { done, total });
        }
    };
    let folder = store.folder(&trial.id);
    std::fs::create_dir_all(&folder).map_err(Error::file("create", &folder))?;
    let outcome = catch_unwind(AssertUnwindSafe(|| trial.key.run(registry, Some(&folder), &mut progress, &mut crate::NoKeeper)));
    let wall_s = started.elapsed().as_secs_f64();
    let (state, reason) = match outcome {
        Ok(Ok(record)) => return store.finish(trial, &record, wall_s),
        Ok(Err(error @ Error::NotFinite { .. })) => (EndState::Nan, error.to_string()),
        Ok(Err(error)) => (EndState::Failed, error.to_string()),
        Err(panic) => (EndState::Panicked, message(&*panic)),
    };
    let end = TrialEnd { state, reason: one_line(&reason), wall_s, digest: String::new() };
    store.acknowledge(trial, &end)?;
    Ok(end)
}

fn say(replies: &mut impl Write, reply: &Reply) -> Result<(), Error> {
    let broken = |problem: String| Error::Worker { problem };
    let line = serde_json::to_string(reply).map_err(|source| broken(source.to_string()))?;
    writeln!(replies, "{line}").and_then(|()| replies.flush()).map_err(|source| broken(source.to_string()))
}

fn message(panic: &(dyn std::any::Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
    text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_else(|| "a panic without a message".into())
}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

#[allow(clippy::disallowed_methods, reason = "wall time is reported, it reaches no result")]
fn now() -> Instant {
    Instant::now()
}
