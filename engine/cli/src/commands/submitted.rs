//! Workers of a submission whose queue cannot cancel them: they read the record of the submission themselves.

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

/// Time between two checks whether the submission was cancelled.
const LOOK: Duration = Duration::from_secs(2);

/// Whether the submission of this worker is still open. It is watched from then on: once it is cancelled, trials save a
/// checkpoint and the worker leaves.
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

/// Watches the submission and stops this process by the signal of a batch system's early warning. The signal is
/// repeated until the process has left, since it may come between two runs.
fn mind(store: PathBuf, id: &str) {
    loop {
        clock::sleep(LOOK);
        if is_cancelled(&store, id) {
            // A signal that cannot be sent now is sent at the next check.
            let _ = raise(SIGUSR1);
        }
    }
}

/// Whether the submission was cancelled; false if its record cannot be read at the moment.
fn is_cancelled(store: &Path, id: &str) -> bool {
    let found = Submission::find(store, id).unwrap_or(None);
    found.is_some_and(|found| found.state == SubmissionState::Cancelled)
}
