//! Messages between this program and the one that it starts on a host: lines of JSON, some of them followed
//! by the bytes of files.

use crate::{
    limits::Limits,
    scheduler::worker::{Reply, Request},
    store::Manifest,
};
use contract::{Error, trial_end::EndState};
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use std::{
    io::{self, BufRead, Write},
    time::Duration,
};

/// A message to a host.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum ToHost {
    /// Whether the host has the trial with this id, which is a source of others.
    Has(String),
    /// The files of a trial follow, which is a source of others.
    Trial(Manifest),
    /// The bytes of a file of the study follow.
    File(StudyFile),
    /// Run a trial.
    Run(Box<Order>),
    /// The trial has arrived and can be removed from the host.
    Arrived(String),
    /// Save a checkpoint of the running trial and leave it. Worker processes have the same message.
    Stop,
}

/// A message from a host.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum FromHost {
    /// The program runs; holds its version and source code.
    Ready(String),
    /// Whether the host has the trial.
    Has(bool),
    /// Progress of the trial, or its last message; the end of a trial is followed by its files.
    Said(Reply),
    /// The process that ran the trial is gone without a last message.
    Died {
        /// End state of the trial.
        state: EndState,
        /// The reason, as text.
        reason: String,
        /// Whether the process was ended because of a limit.
        by_limit: bool,
    },
    /// Another program on the host has the trial.
    Held(String),
    /// The files of a trial that has ended follow.
    Trial(Manifest),
    /// The trial that has arrived at the other side is removed from the host.
    Removed,
    /// The request cannot be carried out on the host, for this reason.
    Refused(String),
    /// Sign of life without news.
    Alive,
}

/// Interval between two signs of life of a program on a host.
pub(super) const ALIVE_EVERY: Duration = Duration::from_secs(2);
/// Silence after which a host that owes an answer counts as lost; `ssh` has the same limit.
pub(super) const SILENT_FOR: Duration = Duration::from_secs(30);

/// Order to run a trial.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Order {
    /// The trial; its store is the host's own.
    pub(super) request: Request,
    /// Limits of the trial.
    pub(super) limits: Limits,
}

/// A file that a study names, whose bytes follow.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct StudyFile {
    /// Path of the file, relative to the folder in which the run was started.
    pub(super) path: String,
    /// Hash of its content.
    pub(super) digest: String,
    /// Length of the file in bytes.
    pub(super) length: u64,
}

/// Writes a message as one line.
pub(super) fn say(output: &mut impl Write, line: &impl Serialize) -> io::Result<()> {
    writeln!(output, "{}", serde_json::to_string(line)?)
}

/// The next line that is a message; `None` at the end. Other output of the host is skipped.
pub(super) fn hear<T: DeserializeOwned>(input: &mut impl BufRead) -> io::Result<Option<T>> {
    loop {
        let mut line = Vec::new();
        if input.read_until(b'\n', &mut line)? == 0 {
            return Ok(None);
        }
        if let Ok(heard) = serde_json::from_slice(&line) {
            return Ok(Some(heard));
        }
    }
}

/// The error for a broken conversation.
pub(super) fn broken(problem: impl ToString) -> Error {
    Error::Worker {
        problem: problem.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::Bundle;

    #[test]
    fn lines_and_files_arrive_in_their_order_and_other_lines_are_passed_over() {
        let files: Bundle = vec![
            ("policy.safetensors".into(), b"\n{\"has\":true}\n".to_vec()),
            ("trial.json".into(), Vec::new()),
        ];
        let mut wire = b"Welcome to node 7\n".to_vec();
        say(&mut wire, &FromHost::Trial(Manifest::of("ab", &files))).unwrap();
        files.iter().for_each(|(_, bytes)| wire.extend(bytes));
        say(&mut wire, &FromHost::Has(false)).unwrap();
        let mut input = &wire[..];
        let Some(FromHost::Trial(manifest)) = hear(&mut input).unwrap() else {
            panic!("no trial")
        };
        assert_eq!(manifest.read(&mut input).unwrap(), files);
        assert!(matches!(hear(&mut input).unwrap(), Some(FromHost::Has(false))));
        assert!(hear::<FromHost>(&mut input).unwrap().is_none());
    }

    #[test]
    fn the_word_to_stop_is_that_of_a_worker_process() {
        let worker = serde_json::to_string(&crate::scheduler::worker::Message::Stop).unwrap();
        assert_eq!(serde_json::to_string(&ToHost::Stop).unwrap(), worker);
    }
}
