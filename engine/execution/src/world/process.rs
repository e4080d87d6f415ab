//! Processes: this one, others on this machine, and those that it starts.

use super::fs;
use contract::ending::Ending;
use std::{
    hash::{BuildHasher, RandomState},
    io::ErrorKind,
    path::Path,
};

pub use std::process::{Child, ChildStdin, ChildStdout, Command, ExitStatus, Stdio};

/// Scope of a process id; outside of it the id may refer to another process.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ProcessScope {
    /// Host name of the machine.
    pub host: String,
    /// Boot id and process namespace; empty if they are not known.
    pub boot: String,
}

/// State of a process, as a probe of its id finds it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ProcessState {
    /// A process with this start time, in clock ticks since boot.
    Started(u64),
    /// No process, or only the remains of one.
    Gone,
    /// The system does not report it.
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

/// Place of this process.
pub fn place() -> ProcessScope {
    #[cfg(test)]
    if let Some(place) = super::simulated::place() {
        return place;
    }
    ProcessScope {
        host: line_of("/proc/sys/kernel/hostname").unwrap_or_else(|| "unknown".into()),
        boot: boot().unwrap_or_default(),
    }
}

/// Probes a process id of this place.
pub fn look(pid: u32) -> ProcessState {
    #[cfg(test)]
    if let Some(look) = super::simulated::look(pid) {
        return look;
    }
    match fs::read_to_string(format!("/proc/{pid}/stat")) {
        Ok(stat) => started_ticks(&stat).map_or(ProcessState::Gone, ProcessState::Started),
        // The first process always runs: if it cannot be seen, those of other users are hidden too.
        Err(source) if source.kind() == ErrorKind::NotFound && fs::exists(Path::new("/proc/1")) => {
            ProcessState::Gone
        }
        // The process ended while its file was read.
        Err(source) if source.raw_os_error() == Some(NO_SUCH_PROCESS) => ProcessState::Gone,
        Err(_) => ProcessState::Hidden,
    }
}

/// Ends a process that leads its own process group, with its descendants; a process that cannot be ended is left alone.
pub fn end_group(child: &mut Child) {
    signal_group(child.id(), Signal::Kill);
    let _ = child.kill();
}

/// A signal to a process.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Signal {
    /// Asks for an orderly end.
    Term,
    /// A signal for free use; many programs save their state on it.
    Usr1,
    /// Stops the process.
    Stop,
    /// Continues a stopped process.
    Continue,
    /// Kills the process.
    Kill,
}

impl Signal {
    fn of_system(self) -> rustix::process::Signal {
        use rustix::process::Signal as Of;
        match self {
            Self::Term => Of::TERM,
            Self::Usr1 => Of::USR1,
            Self::Stop => Of::STOP,
            Self::Continue => Of::CONT,
            Self::Kill => Of::KILL,
        }
    }
}

/// Sends a signal to a process, unless it is gone.
pub fn signal(pid: u32, signal: Signal) {
    if let Some(pid) = named(pid) {
        let _ = rustix::process::kill_process(pid, signal.of_system());
    }
}

/// Sends a signal to the group that a process leads, unless it is gone.
pub fn signal_group(leader: u32, signal: Signal) {
    if let Some(leader) = named(leader) {
        let _ = rustix::process::kill_process_group(leader, signal.of_system());
    }
}

/// Makes orphaned descendants children of this process from now on.
///
/// # Errors
/// The error of the system.
pub fn adopt_orphans() -> std::io::Result<()> {
    rustix::process::set_child_subreaper(named(std::process::id())).map_err(Into::into)
}

/// Causes this process, and the program that replaces it, to be ended when the thread that started it ends. False if
/// that thread is already gone: `parent` is no longer the parent.
///
/// # Errors
/// The error of the system.
pub fn die_with(parent: u32) -> std::io::Result<bool> {
    rustix::process::set_parent_process_death_signal(Some(Signal::Kill.of_system()))?;
    Ok(rustix::process::getppid() == named(parent))
}

/// Waits for a child, and reaps all others that end meanwhile.
///
/// # Errors
/// The error of the system, for example if there is no such child.
pub fn wait_for(pid: u32) -> std::io::Result<Ending> {
    use rustix::process::{WaitOptions, wait};
    loop {
        let (ended, status) = match wait(WaitOptions::empty()) {
            Ok(Some(ended)) => ended,
            Ok(None) | Err(rustix::io::Errno::INTR) => continue,
            Err(error) => return Err(error.into()),
        };
        if Some(ended) != named(pid) {
            continue;
        }
        match (status.exit_status(), status.terminating_signal()) {
            (Some(code), _) => return Ok(Ending::Code(code)),
            (None, Some(signal)) => return Ok(Ending::Signal(signal)),
            (None, None) => {}
        }
    }
}

fn named(pid: u32) -> Option<rustix::process::Pid> {
    i32::try_from(pid).ok().and_then(rustix::process::Pid::from_raw)
}

/// A random number that cannot be guessed, for unique names; it is not part of any result.
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

/// The boot and the process namespace; `None` if they cannot be determined, or if `/proc` shows another namespace.
fn boot() -> Option<String> {
    let namespace = fs::read_link("/proc/self/ns/pid").ok()?;
    let own_view = fs::read_link("/proc/self").is_ok_and(|link| link == Path::new(&id().to_string()));
    let boot = line_of("/proc/sys/kernel/random/boot_id").filter(|_| own_view)?;
    Some(format!("{boot} {}", namespace.display()))
}

/// Start time of a process in clock ticks since boot, from its line in `/proc`; `None` for the remains of
/// one.
fn started_ticks(stat: &str) -> Option<u64> {
    // The name in parentheses may contain any character; the fields after it are numbered from 3.
    let fields: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
    let gone = matches!(*fields.first()?, "Z" | "X");
    if gone { None } else { fields.get(19)?.parse().ok() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn this_process_runs_and_its_remains_would_not() {
        assert!(matches!(look(id()), ProcessState::Started(_)));
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
