//! Hosts that are reached with `ssh` and share no folder with this machine.
//!
//! Each slot of a run holds a connection to a host. It sends the host the sources of a trial and the files that the
//! study names, has the trial run, fetches its artifacts, compares every file with its hash and writes it as if it had
//! been computed here. All of this happens under the lease in the store of this machine. No file that is needed exists
//! only on a host: if a host dies, only the trials that it was running are lost, and they are given to the others.
//!
//! | file | contents |
//! |---|---|
//! | `wire` | the messages of a connection |
//! | `remote` | the near side: a slot whose trials run on a host |
//! | `relay` | the far side: the same program, which runs one trial at a time |

mod relay;
mod remote;
mod wire;

pub use relay::Relay;
pub(super) use remote::Remote;

use crate::{
    executor::{Access, Stop, quoted, tell},
    world::{
        fs::File,
        process::{self, Command, Stdio},
    },
};
use contract::{Error, resources::Capacity};
use document::input_file;
use std::{
    ffi::OsString,
    num::NonZeroUsize,
    os::unix::process::CommandExt as _,
    path::{Path, PathBuf},
    time::Duration,
};

/// A host that was reached and has the program.
#[derive(Debug, Clone)]
pub struct Host {
    name: String,
    /// Cores of the host, each with a worker process, and its cards.
    capacity: Capacity,
    /// Command that runs a line of shell on the host, without the line.
    shell: Vec<OsString>,
    /// Line of shell that starts the program on the host.
    line: String,
    /// Version and source code of this program, which the host's program must report too.
    program: String,
}

/// The hosts on which a run works; none if it works on this machine.
#[derive(Debug, Clone, Default)]
pub struct Hosts {
    /// The hosts that were reached.
    pub all: Vec<Host>,
    /// Time for which a host that cannot be reached is tried again.
    pub patience: Duration,
}

/// The hosts that were reached, and those that were not.
#[derive(Debug, Clone, Default)]
pub struct HostReachability {
    /// The hosts that were reached.
    pub hosts: Hosts,
    /// Names of the other hosts, each with the reason.
    pub left_out: Vec<(String, String)>,
}

/// Options of every call of `ssh`: it must not prompt, and a silent host counts as dead.
const ALWAYS: [&str; 4] = [
    "BatchMode=yes",
    "ConnectTimeout=10",
    "ServerAliveInterval=10",
    "ServerAliveCountMax=3",
];

/// Longest time until a host answers the first request.
const LOOKED_AT_WITHIN: Duration = Duration::from_secs(60);
/// Longest time in which the program is copied to a host.
const BROUGHT_WITHIN: Duration = Duration::from_secs(900);

impl Host {
    /// Cores of the host, each with a worker process, and its cards.
    #[must_use]
    pub fn capacity(&self) -> &Capacity {
        &self.capacity
    }

    /// Name of the host, as `ssh` knows it.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Command that starts the program on the host.
    fn relay(&self) -> Command {
        let mut command = Command::new(&self.shell[0]);
        command
            .args(&self.shell[1..])
            .arg(&self.line)
            .stderr(Stdio::null())
            // Ctrl-C must reach only this program, which lets trials save their checkpoints over the connection.
            .process_group(0);
        command
    }
}

impl HostReachability {
    /// Reaches every host, copies the program to hosts that lack it, and asks for the number of cores.
    /// `store` is the store of this machine, whose trials have a folder of their own on each host; `version`
    /// identifies this program.
    ///
    /// # Errors
    /// [`Error::File`] if this program cannot be read.
    pub fn reach(
        access: &Access,
        store: &Path,
        version: &str,
        lease_expiry: Duration,
    ) -> Result<Self, Error> {
        let program = std::env::current_exe().map_err(wire::broken)?;
        let bytes = File::open(&program).and_then(contract::digest::of_file);
        let digest = bytes.map_err(Error::file("read", &program))?;
        let whose = format!("{} {}", process::place().host, absolute(store).display());
        let asked = HostInquiry {
            access,
            program: &program,
            name: format!("regimen-{}", &digest[..16]),
            store: contract::digest::of_bytes(whose.as_bytes())[..16].to_owned(),
            version,
            lease_expiry,
        };
        let mut found = Self::default();
        found.hosts.patience = access.patience;
        let answers: Vec<Result<Host, String>> = std::thread::scope(|scope| {
            let asked = &asked;
            let ask = |host: &'_ String| {
                let host = host.clone();
                scope.spawn(move || asked.host(&host))
            };
            let asking: Vec<_> = access.hosts.iter().map(ask).collect();
            let join = |it: std::thread::ScopedJoinHandle<'_, _>| {
                it.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
            };
            asking.into_iter().map(join).collect()
        });
        for (name, answer) in access.hosts.iter().zip(answers) {
            match answer {
                Ok(host) => found.hosts.all.push(host),
                Err(problem) => found.left_out.push((name.clone(), problem)),
            }
        }
        Ok(found)
    }
}

/// Request that every host gets.
struct HostInquiry<'a> {
    access: &'a Access,
    program: &'a Path,
    /// File name of the program on a host, by its content.
    name: String,
    /// Folder name on a host for the trials of this store.
    store: String,
    version: &'a str,
    lease_expiry: Duration,
}

impl HostInquiry<'_> {
    fn host(&self, host: &str) -> Result<Host, String> {
        let folder = quoted(&self.access.folder);
        let look = format!(
            "mkdir -p {folder} && cd {folder} && uname -sm && getconf _NPROCESSORS_ONLN && \
             {{ ls /proc/driver/nvidia/gpus 2>/dev/null || true; }} | wc -l && \
             if test -x {name}; then echo there; else echo absent; fi",
            name = self.name
        );
        let said = self.run(host, &look, Stdio::null(), LOOKED_AT_WITHIN)?;
        let lines: Vec<&str> = said.lines().map(str::trim).rev().collect();
        let [has, gpus, cores, system, ..] = lines[..] else {
            return Err(format!("it said `{}`", said.trim()));
        };
        if self.access.program.is_none() {
            if !is_of(system) {
                return Err(format!(
                    "it is {system}, for which this program is not made: build it there and write `program`"
                ));
            }
            if has != "there" {
                self.bring(host)?;
            }
        }
        let number = |text: &str| {
            text.parse::<usize>()
                .map_err(|_| format!("it said `{}`", said.trim()))
        };
        let (cores, gpus) = (number(cores)?, number(gpus)?);
        Ok(Host {
            name: host.to_owned(),
            capacity: Capacity {
                cores: self.access.workers.map_or(cores, NonZeroUsize::get),
                gpus: (0..gpus).map(|card| card.to_string()).collect(),
            },
            shell: self.shell(host),
            line: in_shell(&self.line()),
            program: self.version.to_owned(),
        })
    }

    /// Copies this program to a host, where it appears completely or not at all.
    fn bring(&self, host: &str) -> Result<(), String> {
        let (folder, name) = (quoted(&self.access.folder), &self.name);
        let program = File::open(self.program).map_err(|error| error.to_string())?;
        let line = format!(
            "cd {folder} && cat > .{name}.$$.tmp && chmod 755 .{name}.$$.tmp && mv .{name}.$$.tmp {name}"
        );
        self.run(host, &line, Stdio::from(program), BROUGHT_WITHIN)
            .map(drop)
    }

    /// Line of shell that starts the far side, in the folder that corresponds to the one in which the run was started.
    fn line(&self) -> String {
        let (folder, store) = (quoted(&self.access.folder), &self.store);
        let own = format!("\"$here\"/{}", self.name);
        let program = self.access.program.as_deref().map_or(own, quoted);
        let files = input_file::asked().map_or_else(String::new, |size| format!(" --input-mb {size}"));
        format!(
            "cd {folder} && here=$(pwd) && mkdir -p {store}/files && cd {store}/files && exec {program} relay ../store \
             --lease-expiry-s {}{files}",
            self.lease_expiry.as_secs_f64()
        )
    }

    /// Runs a line on a host within a time limit; returns its standard output.
    fn run(&self, host: &str, line: &str, input: Stdio, limit: Duration) -> Result<String, String> {
        let shell = self.shell(host);
        let mut command = Command::new(&shell[0]);
        command.args(&shell[1..]).arg(in_shell(line)).stdin(input);
        let answer = tell("ssh", &mut command, limit, &Stop::default()).map_err(|error| error.to_string())?;
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).trim().to_owned();
        if answer.status.success() {
            return Ok(text(&answer.out));
        }
        let said = text(&answer.err);
        Err(if said.is_empty() {
            format!("`ssh` ended with {}", answer.status)
        } else {
            said.lines().last().unwrap_or_default().to_owned()
        })
    }

    fn shell(&self, host: &str) -> Vec<OsString> {
        let always = ALWAYS.iter().flat_map(|option| ["-o", option]);
        let command = self.access.command.iter().map(String::as_str);
        let words = command.chain(always).chain(["--", host]);
        words.map(OsString::from).collect()
    }
}

/// Wraps a line so that it works in any shell of the user on the host.
fn in_shell(line: &str) -> String {
    format!("exec sh -c {}", quoted(line))
}

/// Whether this program runs on a system, given by its name from `uname -sm`.
fn is_of(system: &str) -> bool {
    let own = format!("{} {}", std::env::consts::OS, std::env::consts::ARCH);
    system.eq_ignore_ascii_case(&own)
}

fn absolute(path: &Path) -> PathBuf {
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Access to this machine as a host: `ssh` is a shell that skips its options and the name.
    fn access(folder: &Path, command: &str) -> Access {
        let script = folder.join("ssh");
        std::fs::write(&script, command).unwrap();
        Access {
            hosts: vec!["near".into(), "far".into()],
            workers: NonZeroUsize::new(3),
            folder: folder.join("a folder").to_string_lossy().into_owned(),
            program: None,
            command: vec!["sh".into(), script.to_string_lossy().into_owned()],
            patience: Duration::from_secs(1),
        }
    }

    /// The last word is the line, the one before it the host.
    const NEAR_ALONE: &str = "while [ $# -gt 2 ]; do shift; done
        if [ \"$1\" = far ]; then echo 'no route to host' >&2; exit 255; fi
        echo Welcome; eval \"$2\"";

    #[test]
    fn hosts_get_the_program_once_and_those_that_are_not_reached_are_named() {
        let dir = tempfile::tempdir().unwrap();
        let access = access(dir.path(), NEAR_ALONE);
        let reach = || {
            HostReachability::reach(&access, Path::new("store"), "regimen 1", Duration::from_secs(30))
                .unwrap()
        };
        let found = reach();
        let names: Vec<_> = found
            .hosts
            .all
            .iter()
            .map(|host| (host.name(), host.capacity().cores))
            .collect();
        assert_eq!(names, [("near", 3)]);
        assert_eq!(
            found.left_out,
            [("far".to_owned(), "no route to host".to_owned())]
        );
        let programs = || -> Vec<_> {
            let folder = std::fs::read_dir(dir.path().join("a folder")).unwrap();
            folder
                .map(|entry| entry.unwrap())
                .map(|entry| (entry.file_name(), entry.metadata().unwrap().modified().unwrap()))
                .collect()
        };
        let first = programs();
        assert_eq!(first.len(), 1);
        assert!(first[0].0.to_string_lossy().starts_with("regimen-"));
        reach();
        assert_eq!(programs(), first);
    }

    #[test]
    fn a_host_of_another_kind_is_told_what_to_write() {
        let dir = tempfile::tempdir().unwrap();
        let other = "echo 'Darwin arm64'; echo 8; echo 0; echo absent";
        let access = access(dir.path(), other);
        let found =
            HostReachability::reach(&access, Path::new("store"), "regimen 1", Duration::from_secs(30))
                .unwrap();
        assert!(found.hosts.all.is_empty());
        assert!(found.left_out[0].1.contains("`program`"), "{found:?}");
    }
}
