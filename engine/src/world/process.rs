//! Processes: this one, others on this machine, and those that it starts.

use super::fs;
use std::{
    hash::{BuildHasher, RandomState},
    io::ErrorKind,
    path::Path,
};

pub use std::process::{Child, ChildStdin, ChildStdout, Command, ExitStatus, Stdio};

/// Where a process stands: ids of processes mean something only there.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Place {
    /// Name of the machine.
    pub host: String,
    /// Its boot and the process namespace; empty where they are not known.
    pub boot: String,
}

/// What a look at a process id shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Look {
    /// A process that started then, in clock ticks since boot.
    Started(u64),
    /// None, or only the remains of one.
    Gone,
    /// The system does not say.
    Hidden,
}

/// The id of this process.
pub fn id() -> u32 {
    #[cfg(test)]
    if let Some(id) = super::simulated::process_id() {
        return id;
    }
    std::process::id()
}

/// Where this process stands.
pub fn place() -> Place {
    #[cfg(test)]
    if let Some(place) = super::simulated::place() {
        return place;
    }
    Place {
        host: line_of("/proc/sys/kernel/hostname").unwrap_or_else(|| "unknown".into()),
        boot: boot().unwrap_or_default(),
    }
}

/// What is seen of a process of this place.
pub fn look(pid: u32) -> Look {
    #[cfg(test)]
    if let Some(look) = super::simulated::look(pid) {
        return look;
    }
    match fs::read_to_string(format!("/proc/{pid}/stat")) {
        Ok(stat) => started_ticks(&stat).map_or(Look::Gone, Look::Started),
        // The first process always runs: where it cannot be seen, those of other users are hidden too.
        Err(source) if source.kind() == ErrorKind::NotFound && fs::exists(Path::new("/proc/1")) => Look::Gone,
        // The process ended while its file was read.
        Err(source) if source.raw_os_error() == Some(NO_SUCH_PROCESS) => Look::Gone,
        Err(_) => Look::Hidden,
    }
}

/// Ends a process that leads a group of its own, with what it started; what cannot be ended is left to itself.
pub fn end_group(child: &mut Child) {
    let group = format!("-{}", child.id());
    let mut kill = Command::new("kill");
    kill.args(["-KILL", "--", &group]).stdin(Stdio::null());
    let _ = kill.stdout(Stdio::null()).stderr(Stdio::null()).status();
    let _ = child.kill();
}

/// A number that nobody can guess, for names that nobody else takes; it is in no result.
#[expect(
    clippy::disallowed_methods,
    reason = "a name that nobody has needs the system's randomness, and is in no result"
)]
pub fn random_number() -> u64 {
    #[cfg(test)]
    if let Some(number) = super::simulated::random_number() {
        return number;
    }
    RandomState::new().hash_one(id())
}

/// `ESRCH` of Linux.
const NO_SUCH_PROCESS: i32 = 3;

fn line_of(path: &str) -> Option<String> {
    fs::read_to_string(path).ok().map(|text| text.trim().to_owned())
}

/// The boot and the process namespace; `None` where they cannot be told, or where `/proc` shows another
/// namespace.
fn boot() -> Option<String> {
    let namespace = fs::read_link("/proc/self/ns/pid").ok()?;
    let own_view = fs::read_link("/proc/self").is_ok_and(|link| link == Path::new(&id().to_string()));
    let boot = line_of("/proc/sys/kernel/random/boot_id").filter(|_| own_view)?;
    Some(format!("{boot} {}", namespace.display()))
}

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
    fn this_process_runs_and_its_remains_would_not() {
        assert!(matches!(look(id()), Look::Started(_)));
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
