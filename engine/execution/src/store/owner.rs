//! Owners: processes that compute trials, and whether they still run.
//!
//! A process id is valid only within one process namespace of one boot of one machine. A process in the same namespace
//! sees whether the owner runs. From everywhere else its state is unknown: from another host, but also from another
//! container on this one, or on a machine that has the same name or was restarted.

use crate::world::process::{self, ProcessScope, ProcessState};
use serde::{Deserialize, Serialize};

/// A process that computes trials.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Owner {
    /// Name of the machine.
    pub host: String,
    /// The machine's boot and the process namespace, within which process ids are valid. Empty if they are not known.
    pub boot: String,
    /// Process id in that namespace.
    pub pid: u32,
    /// Start of the process in clock ticks since boot, which distinguishes a process from a later one with the same id.
    pub started_ticks: u64,
    /// The Slurm job and array task of the process.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub slurm_job: Option<String>,
}

impl Owner {
    /// The owner that represents this process.
    #[must_use]
    #[expect(
        clippy::disallowed_methods,
        reason = "an owner is known by its job, which is in no result"
    )]
    pub fn this_process() -> Self {
        let variable = |name: &str| std::env::var(name).ok();
        let task = variable("SLURM_ARRAY_JOB_ID")
            .zip(variable("SLURM_ARRAY_TASK_ID"))
            .map(|(job, task)| format!("{job}_{task}"));
        let (pid, ProcessScope { host, boot }) = (process::id(), process::place());
        let started_ticks = match process::look(pid) {
            ProcessState::Started(ticks) => ticks,
            ProcessState::Gone | ProcessState::Hidden => 0,
        };
        Self {
            host,
            boot,
            pid,
            started_ticks,
            slurm_job: task.or_else(|| variable("SLURM_JOB_ID")),
        }
    }

    /// Whether the process still runs; `None` if that cannot be determined here.
    #[must_use]
    pub fn is_alive(&self) -> Option<bool> {
        self.is_alive_seen_from(&Self::this_process(), process::look)
    }

    /// Like [`is_alive`](Self::is_alive), from the place of the process `here`; `look` returns the state of a process
    /// id there.
    fn is_alive_seen_from(&self, here: &Self, look: impl Fn(u32) -> ProcessState) -> Option<bool> {
        if here.boot.is_empty() || (&self.host, &self.boot) != (&here.host, &here.boot) {
            return None;
        }
        match look(self.pid) {
            ProcessState::Started(ticks) => Some(ticks == self.started_ticks),
            ProcessState::Gone => Some(false),
            ProcessState::Hidden => None,
        }
    }

    /// File name under which the process announces itself.
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
        let seen = |owner: &Owner, look: ProcessState| owner.is_alive_seen_from(&here, |_| look);
        assert_eq!(seen(&this, ProcessState::Started(7)), Some(true));
        assert_eq!(
            seen(&this, ProcessState::Started(8)),
            Some(false),
            "a later process has its id"
        );
        assert_eq!(seen(&this, ProcessState::Gone), Some(false));
        assert_eq!(seen(&this, ProcessState::Hidden), None);
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
            assert_eq!(seen(&owner, ProcessState::Gone), None, "{owner:?}");
        }
    }

    #[test]
    fn who_does_not_know_where_it_stands_can_tell_nothing() {
        let nowhere = Owner {
            boot: String::new(),
            ..Owner::this_process()
        };
        assert_eq!(nowhere.is_alive_seen_from(&nowhere, |_| ProcessState::Gone), None);
    }

    #[test]
    fn this_process_runs() {
        assert_eq!(Owner::this_process().is_alive(), Some(true));
    }
}
