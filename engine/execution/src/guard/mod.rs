//! The process between a worker and a program that is not ours: it ends all that the program started, whoever
//! dies first.
//!
//! ```text
//! worker --orders--> guard --starts--> program, in a group of its own
//!        <-- files with the program's output --
//! ```
//!
//! A guard gets its [`Order`] and after that the word `stop` on its standard input; the end of that input means
//! that the worker is gone. Either way the program gets its signal, and after its grace nothing of it stays. What
//! the program started, and left to itself, becomes the guard's own, so that it is found. A guard that is killed
//! takes the program with it. How the program ended lies in a file before the guard leaves.

mod held;

pub use held::{Guarded, Left, end_leftover, last_ending};

use crate::{
    footprint,
    world::{
        clock, fs,
        process::{self, Command, Look, Signal, Stdio},
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

/// The verb of a guard, and the one of the process that becomes the program.
const VERBS: [&str; 2] = ["program-guard", "program-start"];
/// The word that asks for the end.
const STOP: &str = "stop";
/// Time between two looks for what a program left behind.
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
    /// How long it may take for that, in milliseconds.
    pub grace_ms: u64,
}

/// A signal that tells a program to end.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum StopSignal {
    /// `SIGTERM`.
    #[default]
    Term,
    /// `SIGUSR1`, for programs that save their state at it and leave.
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

/// The note of a program before it begins: the process id of its guard and its own, each with the time of its start,
/// and the machine and boot in which they mean something. So no guard can be killed before its program is known.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Standing {
    place: [String; 2],
    guard: (u32, u64),
    program: (u32, u64),
}

/// How a program ended, with the machine and boot on which it did.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Ended {
    place: [String; 2],
    how: Ending,
    was_asked: bool,
}

/// Why a program was not started.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Unstarted {
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

/// Serves as a guard, or becomes a program, where the command line asks for it: the first thing that the program does,
/// before it looks at anything else.
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

/// Takes the place of this process: `parent, notes, program, arguments`.
fn become_program(words: &[String]) -> ExitCode {
    let [parent, notes, program, arguments @ ..] = words else {
        return ExitCode::from(UNSTARTED);
    };
    // Whose guard is gone must not begin.
    let parent = parent.parse().ok();
    let Some(parent) = parent.filter(|&parent| process::die_with(parent).unwrap_or(false)) else {
        return ExitCode::from(UNSTARTED);
    };
    let notes = Path::new(notes);
    let problem = match note_standing(notes, parent) {
        Ok(()) => Command::new(program).args(arguments).exec(),
        Err(problem) => problem,
    };
    let unstarted = Unstarted {
        problem: problem.to_string(),
    };
    let _ = write(&self::unstarted(notes), &unstarted);
    ExitCode::from(UNSTARTED)
}

/// Reads its order, and guards.
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

/// Starts the program and sees it end, with all that it started. The thread that starts it is the one whose end
/// the program does not survive, so that it is the main one.
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
        // A program that stands still would not hear it.
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
        &Ended {
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
        .args(&order.words)
        .current_dir(&order.folder)
        .stdin(Stdio::null())
        .process_group(0);
    Ok(command.spawn()?.id())
}

/// Notes this process, which becomes the program of a guard.
fn note_standing(notes: &Path, guard: u32) -> std::io::Result<()> {
    let since = |pid| match process::look(pid) {
        Look::Started(ticks) => ticks,
        Look::Gone | Look::Hidden => 0,
    };
    let own = process::id();
    let standing = Standing {
        place: here(),
        guard: (guard, since(guard)),
        program: (own, since(own)),
    };
    write(&self::standing(notes), &standing)
}

fn here() -> [String; 2] {
    let process::Place { host, boot } = process::place();
    [host, boot]
}

/// Returns where the program is to end: it was asked for, or nobody is there any more to ask.
fn listen(orders: impl Read) {
    for line in BufReader::new(orders).lines() {
        if line.is_err() || line.is_ok_and(|line| line == STOP) {
            return;
        }
    }
}

/// Does something once the grace is over, unless the other end of `gone` was dropped before.
fn after(grace: Duration, gone: &Receiver<()>, then: impl FnOnce()) {
    use std::sync::mpsc::RecvTimeoutError::Timeout;
    if gone.recv_timeout(grace) == Err(Timeout) {
        then();
    }
}

/// Ends all that comes from this process. Processes that stand still start nothing more while the others are ended.
fn end_all() {
    let lives = |pid: &u32| matches!(process::look(*pid), Look::Started(_));
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

/// A file that is there whole or not at all. It means nothing after a loss of power, and need not outlive one.
fn write(path: &Path, what: &impl Serialize) -> std::io::Result<()> {
    let beside = path.with_extension("new");
    fs::write(&beside, serde_json::to_vec(what)?)?;
    fs::rename(&beside, path)
}

fn read<T: DeserializeOwned>(path: &Path) -> Option<T> {
    let text = fs::read(path).ok()?;
    serde_json::from_slice(&text).ok()
}

/// A guard that cannot do its work.
fn broken(problem: impl std::fmt::Display) -> Error {
    Error::Worker {
        problem: format!("the guard of a program: {problem}"),
    }
}
