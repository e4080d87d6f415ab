//! Processes that compute trials, and whether they still run.
//!
//! A process id means something only within one process namespace of one boot of one machine. Who stands in
//! the same one looks and knows. From everywhere else nothing is known: another host, but also another
//! container on this one, or a machine that has the same name or was started again.

use serde::{Deserialize, Serialize};
use std::{fs, io::ErrorKind, path::Path};

/// A process that computes trials.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Owner {
    /// Name of the machine.
    pub host: String,
    /// The machine's boot and the process namespace: process ids mean something only within them. Empty where
    /// they are not known.
    pub boot: String,
    /// Process id.
    pub pid: u32,
    /// When the process started, in clock ticks since boot; tells a process from a later one with its id.
    pub started_ticks: u64,
    /// The Slurm job and array task it runs in.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub slurm_job: Option<String>,
}

/// What a look at a process id shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Process {
    /// A process that started then.
    Started(u64),
    /// None, or only the remains of one.
    Gone,
    /// The system does not say.
    Hidden,
}

impl Owner {
    /// This process.
    #[must_use]
    #[expect(
        clippy::disallowed_methods,
        reason = "an owner is known by its job, which is in no result"
    )]
    pub fn this_process() -> Self {
        let pid = std::process::id();
        let variable = |name: &str| std::env::var(name).ok();
        let task = variable("SLURM_ARRAY_JOB_ID")
            .zip(variable("SLURM_ARRAY_TASK_ID"))
            .map(|(job, task)| format!("{job}_{task}"));
        Self {
            host: line_of("/proc/sys/kernel/hostname").unwrap_or_else(|| "unknown".into()),
            boot: this_boot().unwrap_or_default(),
            pid,
            started_ticks: if let Process::Started(ticks) = process(pid) {
                ticks
            } else {
                0
            },
            slurm_job: task.or_else(|| variable("SLURM_JOB_ID")),
        }
    }

    /// Whether the process still runs; `None` where that cannot be told from here.
    #[must_use]
    pub fn is_alive(&self) -> Option<bool> {
        self.is_alive_seen_from(&Self::this_process(), process)
    }

    /// The same from where the process `here` stands; `look` shows the process of an id there.
    fn is_alive_seen_from(&self, here: &Self, look: impl Fn(u32) -> Process) -> Option<bool> {
        if here.boot.is_empty() || (&self.host, &self.boot) != (&here.host, &here.boot) {
            return None;
        }
        match look(self.pid) {
            Process::Started(ticks) => Some(ticks == self.started_ticks),
            Process::Gone => Some(false),
            Process::Hidden => None,
        }
    }

    /// The name of the file in which the process announces itself.
    pub(super) fn token(&self) -> String {
        let identity = format!("{}/{}/{}/{}", self.host, self.boot, self.pid, self.started_ticks);
        format!(
            "{}-{}-{}",
            self.host,
            self.pid,
            &blake3::hash(identity.as_bytes()).to_hex()[..8]
        )
    }
}

fn line_of(path: &str) -> Option<String> {
    fs::read_to_string(path).ok().map(|text| text.trim().to_owned())
}

/// The boot and the process namespace; `None` where they cannot be told, or where `/proc` shows another
/// namespace.
fn this_boot() -> Option<String> {
    let namespace = fs::read_link("/proc/self/ns/pid").ok()?;
    let own_view =
        fs::read_link("/proc/self").is_ok_and(|link| link == Path::new(&std::process::id().to_string()));
    let boot = line_of("/proc/sys/kernel/random/boot_id").filter(|_| own_view)?;
    Some(format!("{boot} {}", namespace.display()))
}

fn process(pid: u32) -> Process {
    match fs::read_to_string(format!("/proc/{pid}/stat")) {
        Ok(stat) => started_ticks(&stat).map_or(Process::Gone, Process::Started),
        // The first process always runs: where it cannot be seen, those of other users are hidden too.
        Err(source) if source.kind() == ErrorKind::NotFound && Path::new("/proc/1").exists() => Process::Gone,
        // The process ended while its file was read.
        Err(source) if source.raw_os_error() == Some(NO_SUCH_PROCESS) => Process::Gone,
        Err(_) => Process::Hidden,
    }
}

/// `ESRCH` of Linux.
const NO_SUCH_PROCESS: i32 = 3;

/// When a process started, by its line in `/proc`; `None` for the remains of one.
fn started_ticks(stat: &str) -> Option<u64> {
    // The name in parentheses may hold anything; the fields after it are numbered from 3.
    let fields: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
    let gone = matches!(*fields.first()?, "Z" | "X");
    if gone { None } else { fields.get(19)?.parse().ok() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_who_stands_in_the_same_namespace_can_tell_whether_a_process_runs() {
        let here = Owner::this_process();
        let this = Owner {
            started_ticks: 7,
            ..here.clone()
        };
        let seen = |owner: &Owner, process: Process| owner.is_alive_seen_from(&here, |_| process);
        assert_eq!(seen(&this, Process::Started(7)), Some(true));
        assert_eq!(
            seen(&this, Process::Started(8)),
            Some(false),
            "a later process has its id"
        );
        assert_eq!(seen(&this, Process::Gone), Some(false));
        assert_eq!(seen(&this, Process::Hidden), None);
        let (boot, namespace) = here.boot.split_once(' ').unwrap();
        let elsewhere = [
            Owner {
                host: "another-host".into(),
                ..this.clone()
            },
            Owner {
                boot: format!("{boot} pid:[1]"),
                ..this.clone()
            },
            Owner {
                boot: format!("another-boot {namespace}"),
                ..this.clone()
            },
        ];
        for owner in elsewhere {
            assert_eq!(seen(&owner, Process::Gone), None, "{owner:?}");
        }
    }

    #[test]
    fn who_does_not_know_where_it_stands_can_tell_nothing() {
        let nowhere = Owner {
            boot: String::new(),
            ..Owner::this_process()
        };
        assert_eq!(nowhere.is_alive_seen_from(&nowhere, |_| Process::Gone), None);
    }

    #[test]
    fn this_process_runs_and_its_remains_would_not() {
        assert_eq!(Owner::this_process().is_alive(), Some(true));
        assert_eq!(
            started_ticks("7 (a) b) S 1 1 1 0 -1 0 0 0 0 0 0 0 0 0 20 0 1 0 4711 0"),
            Some(4711)
        );
        assert_eq!(
            started_ticks("7 (a) Z 1 1 1 0 -1 0 0 0 0 0 0 0 0 0 20 0 1 0 4711 0"),
            None
        );
    }
}
