//! Workers of a submission whose queue cannot be told to cancel them: they read the record themselves.

use super::complain;
use execution::{
    executor::{Submission, SubmissionState},
    world::clock,
};
use session::{Failure, Settings};
use signal_hook::{consts::SIGUSR1, low_level::raise};
use std::{
    path::{Path, PathBuf},
    time::Duration,
};

/// How often a worker looks whether its submission was cancelled.
const LOOK: Duration = Duration::from_secs(2);

/// Whether somebody waits for what this worker would do. The submission is minded from then on: once it is cancelled,
/// trials save a checkpoint and the worker leaves.
pub(super) fn is_wanted(submission: Option<&str>, settings: &Settings) -> Result<bool, Failure> {
    let Some(id) = submission else { return Ok(true) };
    let store = settings.store.clone();
    let open = Submission::find(&store, id)?.is_some_and(|found| found.state == SubmissionState::Open);
    if open {
        let id = id.to_owned();
        std::thread::spawn(move || mind(store, &id));
    } else {
        complain(&format!(
            "nobody waits for submission {id} any more; nothing runs"
        ));
    }
    Ok(open)
}

/// Stops this process as the early warning of a batch system does. That is said again until it has left, since it may
/// be between two runs.
fn mind(store: PathBuf, id: &str) {
    loop {
        clock::sleep(LOOK);
        if is_cancelled(&store, id) {
            // A signal that cannot be sent now is sent at the next look.
            let _ = raise(SIGUSR1);
        }
    }
}

/// A record that cannot be read in this moment says nothing.
fn is_cancelled(store: &Path, id: &str) -> bool {
    let found = Submission::find(store, id).unwrap_or(None);
    found.is_some_and(|found| found.state == SubmissionState::Cancelled)
}
