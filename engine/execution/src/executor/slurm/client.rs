//! Slurm's commands: their arguments, and the meaning of their answers.

use crate::{
    executor::{Error, Stop, Task, command_output::ask},
    world::process::Command,
};
use std::{ffi::OsStr, path::Path, time::Duration};

/// States of tasks that have come to an end.
const ENDED: [&str; 10] = [
    "BOOT_FAIL",
    "CANCELLED",
    "COMPLETED",
    "DEADLINE",
    "FAILED",
    "NODE_FAIL",
    "OUT_OF_MEMORY",
    "PREEMPTED",
    "REVOKED",
    "TIMEOUT",
];

/// Reasons for waiting that are not shown: none, and that enough tasks of the same array run.
const SILENT: [&str; 3] = ["", "None", "JobArrayTaskLimit"];

/// The commands of Slurm, with their time limits.
pub struct Client<'a> {
    /// Longest time until a request is answered.
    pub answer: Duration,
    /// Longest time until a submission is answered.
    pub submit: Duration,
    /// The stop request, which ends a wait before its limit.
    pub stop: &'a Stop,
}

impl Client<'_> {
    /// The tasks of jobs with these names that Slurm knows. It forgets ended ones after some minutes.
    ///
    /// # Errors
    /// [`Error::Busy`] or [`Error::Silent`] if the controller does not answer.
    pub fn tasks(&self, names: &[String]) -> Result<Vec<Task>, Error> {
        if names.is_empty() {
            return Ok(Vec::new());
        }
        let names = format!("--name={}", names.join(","));
        let arguments = [
            "--noheader",
            "--array",
            "--states=all",
            "--format=%j|%F|%T|%r",
            &names,
        ];
        self.call("squeue", &arguments)?
            .lines()
            .filter(|line| !line.trim().is_empty())
            .map(task)
            .collect()
    }

    /// Submits a script and returns the job's id.
    ///
    /// # Errors
    /// [`Error::Refused`] if Slurm refuses, [`Error::Busy`] or [`Error::Silent`] if the controller does not answer; the
    /// job may exist even then.
    pub fn submit(&self, script: &Path) -> Result<String, Error> {
        let answer = self.call("sbatch", &[OsStr::new("--parsable"), script.as_os_str()])?;
        // A federation appends `;cluster`.
        let id = answer
            .lines()
            .last()
            .unwrap_or_default()
            .trim()
            .split(';')
            .next()
            .unwrap_or_default();
        if id.is_empty() || !id.bytes().all(|byte| byte.is_ascii_digit()) {
            return Err(Error::Unreadable {
                program: "sbatch",
                text: answer.trim().into(),
                expected: "a job id",
            });
        }
        Ok(id.into())
    }

    /// The cluster's `MaxArraySize`; `None` if its configuration does not show one.
    ///
    /// # Errors
    /// [`Error::Busy`] or [`Error::Silent`] if the controller does not answer.
    pub fn max_array_size(&self) -> Result<Option<usize>, Error> {
        let config = self.call("scontrol", &["show", "config"])?;
        Ok(setting(&config, "MaxArraySize").and_then(|text| text.parse().ok()))
    }

    /// Cancels the jobs of a submission: all, or those that have not started.
    ///
    /// # Errors
    /// The errors of [`submit`](Self::submit).
    pub fn cancel(&self, name: &str, pending_only: bool) -> Result<(), Error> {
        let name = format!("--name={name}");
        let arguments: &[&str] = if pending_only {
            &[&name, "--state=PENDING"]
        } else {
            &[&name]
        };
        self.call("scancel", arguments).map(drop)
    }

    fn call<S: AsRef<OsStr>>(&self, program: &'static str, arguments: &[S]) -> Result<String, Error> {
        let limit = if program == "sbatch" {
            self.submit
        } else {
            self.answer
        };
        let answer = ask(program, &mut command(program, arguments), limit, self.stop)?;
        if answer.status.success() {
            Ok(String::from_utf8_lossy(&answer.out).into_owned())
        } else {
            Err(complaint(program, &String::from_utf8_lossy(&answer.err)))
        }
    }
}

fn task(line: &str) -> Result<Task, Error> {
    let mut parts = line.trim().splitn(4, '|').map(str::to_owned);
    let (Some(name), Some(job), Some(state), Some(reason)) =
        (parts.next(), parts.next(), parts.next(), parts.next())
    else {
        return Err(Error::Unreadable {
            program: "squeue",
            text: line.into(),
            expected: "name|job|state|reason",
        });
    };
    let alive = !ENDED.contains(&state.as_str());
    let waits_for = (state == "PENDING" && !SILENT.contains(&reason.as_str())).then_some(reason);
    Ok(Task {
        name,
        job,
        state,
        alive,
        waits_for,
    })
}

fn setting<'a>(config: &'a str, name: &str) -> Option<&'a str> {
    config.lines().find_map(|line| {
        line.split_once('=')
            .filter(|(key, _)| key.trim() == name)
            .map(|(_, value)| value.trim())
    })
}

#[expect(
    clippy::disallowed_methods,
    reason = "variables that stand for options of the commands are left out"
)]
fn command<S: AsRef<OsStr>>(program: &'static str, arguments: &[S]) -> Command {
    let mut command = Command::new(program);
    command.args(arguments);
    // These variables set options that would hide the jobs, or replace the name by which they are found.
    let ours = |name: &str| name.starts_with("SQUEUE_") || name.starts_with("SCANCEL_");
    for (name, _) in std::env::vars_os().filter(|(name, _)| name.to_str().is_some_and(ours)) {
        command.env_remove(name);
    }
    for name in [
        "SBATCH_ARRAY_INX",
        "SBATCH_JOB_NAME",
        "SBATCH_OPEN_MODE",
        "SBATCH_SIGNAL",
    ] {
        command.env_remove(name);
    }
    command
}

/// The error for the complaint of a command.
fn complaint(program: &'static str, said: &str) -> Error {
    const PASSING: [&str; 12] = [
        "unexpected message received",
        "socket timed out",
        "unable to contact slurm controller",
        "connection refused",
        "connection reset",
        "communication connection failure",
        "zero bytes were transmitted",
        "transport endpoint",
        "temporarily un",
        "standby mode",
        "too many requests",
        "try again",
    ];
    let lines: Vec<&str> = said
        .lines()
        .map(|line| line.trim().trim_start_matches(&format!("{program}: ")))
        .collect();
    let said = lines
        .iter()
        .map(|line| line.trim_start_matches("error: "))
        .collect::<Vec<_>>()
        .join("; ");
    let lower = said.to_lowercase();
    if PASSING.iter().any(|text| lower.contains(text)) {
        Error::Busy { program, said }
    } else {
        Error::Refused { program, said }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tasks_are_read_and_known_to_live_or_not() {
        let read = |line: &str| task(line).unwrap();
        let running = read("regimen-1a|7|RUNNING|None");
        assert_eq!((running.name.as_str(), running.job.as_str()), ("regimen-1a", "7"));
        assert_eq!(running.waits_for, None);
        let pending = read("regimen-1a|7|PENDING|Nodes required for job are DOWN, DRAINED or reserved");
        let reason = "Nodes required for job are DOWN, DRAINED or reserved";
        assert_eq!(pending.waits_for.as_deref(), Some(reason));
        assert_eq!(read("regimen-1a|7|PENDING|JobArrayTaskLimit").waits_for, None);
        assert!(running.alive && pending.alive && read("a|7|COMPLETING|None").alive);
        let ended = read("a|7|TIMEOUT|TimeLimit");
        assert!(!ended.alive && ended.waits_for.is_none() && !read("a|7|NODE_FAIL|None").alive);
        assert!(matches!(task("slurm_load_jobs"), Err(Error::Unreadable { .. })));
    }

    #[test]
    fn a_setting_is_found_in_the_configuration() {
        let config =
            "Configuration data as of 2026\nMaxArrayTasks           = 5\nMaxArraySize            = 1001\n";
        assert_eq!(setting(config, "MaxArraySize"), Some("1001"));
        assert_eq!(setting(config, "MaxArray"), None);
    }

    #[test]
    fn a_busy_controller_is_told_from_a_refusal() {
        let busy = [
            "sbatch: error: Batch job submission failed: Unable to contact slurm controller (connect \
             failure)",
            "slurm_load_jobs error: Unexpected message received",
            "sbatch: error: Batch job submission failed: Socket timed out on send/recv operation",
            "sbatch: error: Slurm temporarily unable to accept job, sleeping and retrying",
        ];
        assert!(
            busy.iter()
                .all(|said| matches!(complaint("sbatch", said), Error::Busy { .. }))
        );
        let refused = "sbatch: error: invalid partition specified: nope\n\
                       sbatch: error: Batch job submission failed: Invalid partition name specified";
        let text = complaint("sbatch", refused).to_string();
        let expected = "sbatch refuses: invalid partition specified: nope; Batch job submission failed: \
                        Invalid partition name specified";
        assert_eq!(text, expected);
    }
}
