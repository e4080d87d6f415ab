//! The worker's side of a guard.

use super::{
    EndNote, Order, ProgramNote, STOP, StartFailureNote, VERBS, broken, ended, here, read, standing,
    unstarted,
};
use crate::world::{
    clock, fs,
    process::{self, Child, ChildStdin, Command, ProcessState, Signal, Stdio},
};
use contract::{Error, ending::Ending};
use std::{
    collections::BTreeMap, io::Write, os::unix::process::CommandExt as _, path::Path, process::ExitStatus,
    time::Duration,
};

/// Time that a guard may take beyond the grace of its program.
const LATE: Duration = Duration::from_secs(5);
const LOOK: Duration = Duration::from_millis(20);

/// A program under a guard. It does not outlive this value.
#[derive(Debug)]
pub struct Guarded {
    guard: Child,
    /// Pipe to the guard; `None` once the guard was asked to end the program.
    orders: Option<ChildStdin>,
    order: Order,
}

/// End of a program under a guard.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Left {
    /// The program ended by itself or at a signal.
    Ended {
        /// Exit code or signal of the program.
        how: Ending,
        /// Whether the program had been told to end before.
        was_asked: bool,
    },
    /// The program was never started, for this reason.
    Unstarted(String),
    /// The guard was ended by this signal, if it is known, and the program with it.
    Unguarded(Option<i32>),
}

impl Guarded {
    /// Starts a program that sees only these environment variables. Its standard output and standard error go to files,
    /// so that its output survives the worker and the guard.
    ///
    /// # Errors
    /// [`Error::Worker`] if the guard cannot be started.
    pub fn start(
        order: Order,
        variables: &BTreeMap<String, String>,
        [output, errors]: [fs::File; 2],
    ) -> Result<Self, Error> {
        for old in [ended(&order.notes), unstarted(&order.notes)] {
            // The notes may not exist yet.
            let _ = fs::remove_file(old);
        }
        let mut command = Command::new(std::env::current_exe().map_err(broken)?);
        // Signals from the terminal do not reach the guard, and the end of the worker does not end it
        // unnoticed.
        command.arg(VERBS[0]).env_clear().envs(variables).process_group(0);
        command
            .stdin(Stdio::piped())
            .stdout(Stdio::from(output))
            .stderr(Stdio::from(errors));
        let mut guard = command.spawn().map_err(broken)?;
        let Some(mut orders) = guard.stdin.take() else {
            return Err(broken("its pipe is missing"));
        };
        let text = serde_json::to_string(&order).map_err(broken)?;
        // A guard that is gone is noticed when it is asked to end.
        let _ = writeln!(orders, "{text}");
        Ok(Self {
            guard,
            orders: Some(orders),
            order,
        })
    }

    /// Tells the program to end within its grace.
    pub fn ask_to_stop(&mut self) {
        if let Some(mut orders) = self.orders.take() {
            let _ = writeln!(orders, "{STOP}");
        }
    }

    /// Whether the guard is gone, and the program with it.
    pub fn has_left(&mut self) -> bool {
        !matches!(self.guard.try_wait(), Ok(None))
    }

    /// Waits for the end of a program that was asked to stop, or has ended.
    pub fn end(&mut self) -> Left {
        let status = self.wait();
        if let Some(StartFailureNote { problem }) = read(&unstarted(&self.order.notes)) {
            return Left::Unstarted(problem);
        }
        if let Some(left) = last_ending(&self.order.notes) {
            return left;
        }
        kill_leftover(&self.order.notes);
        use std::os::unix::process::ExitStatusExt as _;
        Left::Unguarded(status.and_then(|status| status.signal()))
    }

    /// Waits for the guard, which observes the grace period; a guard that does not is ended.
    fn wait(&mut self) -> Option<ExitStatus> {
        let begun = clock::now();
        let longest = Duration::from_millis(self.order.grace_ms) + LATE;
        loop {
            match self.guard.try_wait() {
                Ok(Some(status)) => return Some(status),
                Err(_) => return None,
                Ok(None) if self.orders.is_none() && clock::since(begun) > longest => {
                    let _ = self.guard.kill();
                    return self.guard.wait().ok();
                }
                Ok(None) => clock::sleep(Duration::from_millis(1)),
            }
        }
    }
}

impl Drop for Guarded {
    fn drop(&mut self) {
        self.ask_to_stop();
        self.end();
    }
}

/// The end of the last program that ran with these notes; `None` if none ran, or if its end was not noted. After a loss
/// of power nothing is known, since the program's own files may be lost.
#[must_use]
pub fn last_ending(notes: &Path) -> Option<Left> {
    let EndNote {
        place,
        how,
        was_asked,
    } = read(&ended(notes))?;
    (place == here()).then_some(Left::Ended { how, was_asked })
}

/// Waits for the end of a program that an earlier worker of this machine started with these notes, as long as its guard
/// may take, and then kills what is left of it.
pub fn end_leftover(notes: &Path) {
    let Some(left) = left_here(notes) else { return };
    let (begun, longest) = (clock::now(), Duration::from_millis(left.grace_ms) + LATE);
    while (lives(left.guard) || lives(left.program)) && clock::since(begun) < longest {
        clock::sleep(LOOK);
    }
    kill_leftover(notes);
}

/// Kills every process that an earlier worker of this machine started with these notes.
fn kill_leftover(notes: &Path) {
    let Some(ProgramNote { guard, program, .. }) = left_here(notes) else {
        return;
    };
    if lives(guard) {
        process::signal_group(guard.0, Signal::Kill);
    }
    // A group outlives its first process, and its number is not reused until the group is empty.
    if lives(program) || process::look(program.0) == ProcessState::Gone {
        process::signal_group(program.0, Signal::Kill);
    }
    let _ = fs::remove_file(standing(notes));
}

/// The note of a program that was started on this machine since it booted.
fn left_here(notes: &Path) -> Option<ProgramNote> {
    read(&standing(notes)).filter(|note: &ProgramNote| note.place == here())
}

fn lives((pid, since): (u32, u64)) -> bool {
    process::look(pid) == ProcessState::Started(since)
}
