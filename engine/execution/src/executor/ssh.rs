//! Hosts that are reached with `ssh`, without a shared folder: their names, and requests to them.

use super::{Error, Executor, ExecutorKind, Wanted, Way, kind};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::{
    num::{NonZeroU32, NonZeroUsize},
    time::Duration,
};

/// The table `[ssh]` in `regimen.toml`.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "a table of options")]
pub struct SshOptions {
    /// Hosts, as `ssh` knows them: `["node1", "me@node2"]`, or names in its configuration, which sets ports and keys;
    /// needed.
    pub hosts: Option<Vec<String>>,
    /// Number of worker processes of a host; as many as it has cores.
    pub workers: Option<NonZeroUsize>,
    /// Working folder on a host, relative to the home; `.cache/regimen`. It may be removed while nothing runs.
    pub folder: Option<String>,
    /// The program on a host; where absent this one is copied there.
    pub program: Option<String>,
    /// The command that reaches a host, with its options; `["ssh"]`.
    pub command: Option<Vec<String>>,
    /// Time for which a host that cannot be reached is tried again, in seconds; 300.
    pub patience_s: Option<NonZeroU32>,
}

/// Access to hosts: the way to reach them, and the resources that are used on them.
#[derive(Debug, Clone)]
pub struct Access {
    /// Names of the hosts, as `ssh` knows them.
    pub hosts: Vec<String>,
    /// Number of worker processes of each host; as many as it has cores where absent.
    pub workers: Option<NonZeroUsize>,
    /// Working folder on each host, relative to the home.
    pub folder: String,
    /// Path of the program on each host; where absent this program is copied there.
    pub program: Option<String>,
    /// Command that reaches a host, with its options: `ssh`, or a replacement.
    pub command: Vec<String>,
    /// Time for which a host that cannot be reached is tried again.
    pub patience: Duration,
}

/// Hosts, with the options of `[ssh]`.
#[derive(Debug, Clone)]
struct Ssh(Access);

/// Entry of the executor in the list of executors.
#[must_use]
pub fn kind() -> ExecutorKind {
    let options = kind::ExecutorOptions::of(|options: SshOptions| Ok(Box::new(Ssh(access(options)?))));
    ExecutorKind {
        name: "ssh",
        title: "ssh",
        about: "worker processes on hosts that share no folder; trials are brought home as they end",
        way: Way::Hosts(options),
    }
}

fn access(options: SshOptions) -> Result<Access, Error> {
    let wrong = |key, problem: &str| Error::Option {
        key,
        problem: problem.into(),
    };
    let hosts = options.hosts.unwrap_or_default();
    if let Some(host) = hosts.iter().find(|host| host.is_empty() || host.starts_with('-')) {
        return Err(wrong("hosts", &format!("`{host}` is no name of a host")));
    }
    if let Some(host) = (1..hosts.len()).find(|&place| hosts[..place].contains(&hosts[place])) {
        let problem = format!(
            "`{}` is named twice; write `workers` for more processes",
            hosts[host]
        );
        return Err(wrong("hosts", &problem));
    }
    let command = options.command.unwrap_or_else(|| vec!["ssh".into()]);
    if command.is_empty() {
        return Err(wrong(
            "command",
            "write the program and its options, as in `[\"ssh\"]`",
        ));
    }
    Ok(Access {
        hosts,
        workers: options.workers,
        folder: options.folder.unwrap_or_else(|| ".cache/regimen".into()),
        program: options.program,
        command,
        patience: Duration::from_secs(options.patience_s.map_or(300, |seconds| seconds.get().into())),
    })
}

impl Executor for Ssh {
    fn cpus_per_task(&self) -> NonZeroUsize {
        self.0.workers.unwrap_or(NonZeroUsize::MIN)
    }

    fn trials_per_task(&self) -> NonZeroUsize {
        NonZeroUsize::MIN
    }

    fn shares_paths(&self) -> bool {
        false
    }

    fn written(&self, _: &Wanted<'_>) -> Result<String, Error> {
        Err(Error::Option {
            key: "hosts",
            problem: "`run --executor ssh` reaches them itself; nothing is handed over".into(),
        })
    }

    fn access(&self) -> Option<&Access> {
        Some(&self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_cannot_be_meant_is_refused_with_what_to_write() {
        let with = |hosts: &[&str]| {
            let hosts = hosts.iter().map(|host| (*host).to_owned()).collect();
            let options = SshOptions {
                hosts: Some(hosts),
                ..SshOptions::default()
            };
            access(options).map_err(|error| error.to_string())
        };
        assert_eq!(with(&["a", "me@b"]).unwrap().command, ["ssh"]);
        for (hosts, says) in [
            (&["a", "-oProxyCommand=x"][..], "is no name of a host"),
            (&["a", "b", "a"], "named twice"),
        ] {
            let said = with(hosts).unwrap_err();
            assert!(said.starts_with("`hosts`: ") && said.contains(says), "{said}");
        }
    }
}
