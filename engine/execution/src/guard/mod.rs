//! The process between a worker and an external program. It ends every process that the program started, no matter
//! whether the worker, the guard or the program dies first.
//!
//! ```text
//! worker --orders--> guard --starts--> program, in a group of its own
//!        <-- files with the program's output --
//! ```
//!
//! A guard gets its [`Order`] and then the word `stop` on its standard input; the end of that input means that the
//! worker is gone. In both cases the program gets its signal, and none of its processes remains after its grace period.
//! Orphans of the program become children of the guard, so that it finds them. A guard that is killed takes the program
//! with it. The end of the program is written to a file before the guard exits.

mod held;

pub use held::{Guarded, Left, end_leftover, last_ending};

/// Name of the folder of the guard's own files in the folder of its program.
pub const NOTES: &str = ".regimen";

use crate::{
    footprint,
    world::{
        clock, fs,
        process::{self, Command, ProcessState, Signal, Stdio},
    },
};
use contract::{Error, ending::Ending};
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use std::{
    io::{BufRead, BufReader, Read},
    os::unix::process::CommandExt as _,
    path::{Path, PathBuf},
    process::ExitCode,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
        mpsc::{Receiver, Sender, channel},
    },
    time::Duration,
};

/// The verb of a guard, and that of the process that becomes the program.
const VERBS: [&str; 2] = ["program-guard", "program-start"];
/// The word that asks for the end.
const STOP: &str = "stop";
/// Interval between two checks for processes that a program left behind.
const LOOK: Duration = Duration::from_millis(2);
/// The exit code of a process that could not become the program.
const UNSTARTED: u8 = 127;

/// The orders of a guard.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Order {
    /// The program and its arguments.
    pub words: Vec<String>,
    /// The folder in which it runs.
    pub folder: PathBuf,
    /// The folder for the guard's own files.
    pub notes: PathBuf,
    /// The signal that tells the program to end.
    pub signal: StopSignal,
    /// Time in which the program may end by itself after the signal, in milliseconds.
    pub grace_ms: u64,
}

/// A signal that tells a program to end.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum StopSignal {
    /// `SIGTERM`.
    #[default]
    Term,
    /// `SIGUSR1`, for programs that save their state at this signal and exit.
    Usr1,
}

impl StopSignal {
    fn sent(self) -> Signal {
        match self {
            Self::Term => Signal::Term,
            Self::Usr1 => Signal::Usr1,
        }
    }
}

/// The note of a program before it begins: the process ids of its guard and itself, each with its start time, the
/// machine and boot for which they are valid, and the program's grace. Its program is therefore known before a guard
/// can be killed.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct ProgramNote {
    place: [String; 2],
    guard: (u32, u64),
    program: (u32, u64),
    #[serde(default)]
    grace_ms: u64,
}

/// The note of a program's end, with the machine and boot on which it ended.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct EndNote {
    place: [String; 2],
    how: Ending,
    was_asked: bool,
}

/// The note of a program that could not be started.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct StartFailureNote {
    problem: String,
}

fn standing(notes: &Path) -> PathBuf {
    notes.join("guard.json")
}

fn ended(notes: &Path) -> PathBuf {
    notes.join("ended.json")
}

fn unstarted(notes: &Path) -> PathBuf {
    notes.join("unstarted.json")
}

/// Serves as a guard, or becomes a program, if the command line asks for it. The program calls this before anything
/// else.
#[must_use]
pub fn serve_if_asked() -> Option<ExitCode> {
    let words: Vec<String> = std::env::args_os()
        .skip(1)
        .map(|it| it.into_string().unwrap_or_default())
        .collect();
    match words
        .first()
        .and_then(|verb| VERBS.iter().position(|it| it == verb))?
    {
        0 => Some(guard()),
        _ => Some(become_program(&words[1..])),
    }
}

/// Replaces this process by the program: `parent, notes, grace, program, arguments`.
fn become_program(words: &[String]) -> ExitCode {
    let [parent, notes, grace_ms, program, arguments @ ..] = words else {
        return ExitCode::from(UNSTARTED);
    };
    // A program whose guard is gone must not begin.
    let parent = parent.parse().ok();
    let Some(parent) = parent.filter(|&parent| process::die_with(parent).unwrap_or(false)) else {
        return ExitCode::from(UNSTARTED);
    };
    let (notes, grace_ms) = (Path::new(notes), grace_ms.parse().unwrap_or(0));
    let problem = match note_standing(notes, parent, grace_ms) {
        Ok(()) => Command::new(program).args(arguments).exec(),
        Err(problem) => problem,
    };
    let unstarted = StartFailureNote {
        problem: problem.to_string(),
    };
    let _ = write(&self::unstarted(notes), &unstarted);
    ExitCode::from(UNSTARTED)
}

/// Reads the order, and guards its program.
fn guard() -> ExitCode {
    let mut orders = BufReader::new(std::io::stdin());
    let mut line = String::new();
    let order = orders.read_line(&mut line).ok();
    let order = order.and_then(|_| serde_json::from_str::<Order>(&line).ok());
    match order.map(|order| serve(&order, orders)) {
        Some(Ok(())) => ExitCode::SUCCESS,
        _ => ExitCode::FAILURE,
    }
}

/// Starts the program and waits for its end and that of its descendants. The program does not survive the end of the
/// thread that starts it, so this must be the main thread.
fn serve(order: &Order, orders: impl Read + Send + 'static) -> std::io::Result<()> {
    process::adopt_orphans()?;
    let program = start(order)?;
    let (told, gone) = channel();
    let asked = Arc::new(AtomicBool::new(false));
    let noted = Arc::clone(&asked);
    let (signal, grace) = (order.signal.sent(), Duration::from_millis(order.grace_ms));
    std::thread::spawn(move || {
        listen(orders);
        noted.store(true, Ordering::SeqCst);
        process::signal_group(program, signal);
        // A stopped program would not receive the signal.
        process::signal_group(program, Signal::Continue);
        after(grace, &gone, end_all);
    });
    let how = process::wait_for(program)?;
    let was_asked = asked.load(Ordering::SeqCst);
    drop::<Sender<()>>(told);
    end_all();
    let place = here();
    write(
        &ended(&order.notes),
        &EndNote {
            place,
            how,
            was_asked,
        },
    )
}

fn start(order: &Order) -> std::io::Result<u32> {
    let own = std::env::current_exe()?;
    let mut command = Command::new(own);
    command
        .arg(VERBS[1])
        .arg(process::id().to_string())
        .arg(&order.notes)
        .arg(order.grace_ms.to_string())
        .args(&order.words)
        .current_dir(&order.folder)
        .stdin(Stdio::null())
        .process_group(0);
    Ok(command.spawn()?.id())
}

/// Writes the note of this process, which becomes the program of a guard.
fn note_standing(notes: &Path, guard: u32, grace_ms: u64) -> std::io::Result<()> {
    let since = |pid| match process::look(pid) {
        ProcessState::Started(ticks) => ticks,
        ProcessState::Gone | ProcessState::Hidden => 0,
    };
    let own = process::id();
    let standing = ProgramNote {
        place: here(),
        guard: (guard, since(guard)),
        program: (own, since(own)),
        grace_ms,
    };
    write(&self::standing(notes), &standing)
}

fn here() -> [String; 2] {
    let process::ProcessScope { host, boot } = process::place();
    [host, boot]
}

/// Returns when the program must end, because the worker asked for it or is gone.
fn listen(orders: impl Read) {
    for line in BufReader::new(orders).lines() {
        if line.is_err() || line.is_ok_and(|line| line == STOP) {
            return;
        }
    }
}

/// Runs `then` once the grace is over, unless the other end of `gone` was dropped before.
fn after(grace: Duration, gone: &Receiver<()>, then: impl FnOnce()) {
    use std::sync::mpsc::RecvTimeoutError::Timeout;
    if gone.recv_timeout(grace) == Err(Timeout) {
        then();
    }
}

/// Ends all descendants of this process. They are stopped first, so that they start no process while others
/// are ended.
fn end_all() {
    let lives = |pid: &u32| matches!(process::look(*pid), ProcessState::Started(_));
    loop {
        let others: Vec<u32> = footprint::family(process::id())[1..].to_vec();
        let others: Vec<u32> = others.into_iter().filter(lives).collect();
        if others.is_empty() {
            return;
        }
        for told in [Signal::Stop, Signal::Kill] {
            others.iter().for_each(|pid| process::signal(*pid, told));
        }
        clock::sleep(LOOK);
    }
}

/// Writes a file completely or not at all. It is meaningless after a loss of power, and need not survive one.
fn write(path: &Path, what: &impl Serialize) -> std::io::Result<()> {
    let beside = path.with_extension("new");
    fs::write(&beside, serde_json::to_vec(what)?)?;
    fs::rename(&beside, path)
}

fn read<T: DeserializeOwned>(path: &Path) -> Option<T> {
    let text = fs::read(path).ok()?;
    serde_json::from_slice(&text).ok()
}

/// The error of a guard that cannot do its work.
fn broken(problem: impl std::fmt::Display) -> Error {
    Error::Worker {
        problem: format!("the guard of a program: {problem}"),
    }
}
