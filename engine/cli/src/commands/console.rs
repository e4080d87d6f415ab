//! Printing: results on standard output, progress and warnings on standard error.

use super::progress::ProgressDisplay;
use document::plain_text;
use execution::scheduler::Task;
use session::{Exit, Failure, Follower, Observer};
use std::{
    io::{IsTerminal, Write},
    sync::{Arc, OnceLock, atomic::AtomicBool},
};

/// The reason why a result could not be printed, as on a full disk.
static UNSAID: OnceLock<String> = OnceLock::new();

/// Set by a signal to this program. All runs of a command share it: a signal may come between two generations of a
/// search.
static STOP: OnceLock<Arc<AtomicBool>> = OnceLock::new();

/// Prints a result.
pub(super) fn say(text: &str) {
    put(&plain_text::printable(text.trim_end_matches('\n')));
}

/// The same with coloured verdicts on a terminal.
pub(super) fn say_summary(text: &str) {
    let text = plain_text::printable(text.trim_end_matches('\n'));
    if colour_on(&std::io::stdout()) {
        put(&report::tinted(&text));
    } else {
        put(&text);
    }
}

fn put(text: &str) {
    let written = writeln!(std::io::stdout(), "{text}");
    // A reader that closed the pipe (`| head`) needs no more output.
    if let Some(error) = written
        .err()
        .filter(|it| it.kind() != std::io::ErrorKind::BrokenPipe)
    {
        let _ = UNSAID.set(error.to_string());
    }
}

/// Fails if the results of the command could not be printed.
pub(super) fn if_said(exit: Exit) -> Result<Exit, Failure> {
    match UNSAID.get() {
        Some(problem) => Err(Failure {
            exit: if exit == Exit::Ok { Exit::Incomplete } else { exit },
            text: format!("error: standard output could not be written: {problem}"),
        }),
        None => Ok(exit),
    }
}

/// Prints progress, a warning or an error.
pub(super) fn complain(text: &str) {
    // One write for each message, so that programs that share a log do not mix their lines.
    let message = format!("{}\n", shown(text.trim_end_matches('\n')));
    let _ = std::io::stderr().write_all(message.as_bytes());
}

/// A message as the terminal shows it.
pub(super) fn shown(text: &str) -> String {
    let message = plain_text::message(text);
    if colour() {
        plain_text::coloured(&message)
    } else {
        message.into_owned()
    }
}

/// Whether messages are coloured.
pub(super) fn colour() -> bool {
    colour_on(&std::io::stderr())
}

/// Colour on a terminal, unless `NO_COLOR` is set.
#[expect(
    clippy::disallowed_methods,
    reason = "it colours what is shown, and reaches no result"
)]
fn colour_on(stream: &impl IsTerminal) -> bool {
    stream.is_terminal() && std::env::var_os("NO_COLOR").is_none()
}

/// Number of columns of the terminal, from the shell or the terminal; 100 elsewhere.
#[expect(
    clippy::disallowed_methods,
    reason = "it says how wide the summary is, and reaches no result"
)]
pub(super) fn terminal_width() -> usize {
    let told = std::env::var("COLUMNS").ok().and_then(|text| text.parse().ok());
    let asked = || {
        let size = std::io::stdout()
            .is_terminal()
            .then(ratatui::crossterm::terminal::size)?;
        size.ok().map(|(columns, _)| usize::from(columns))
    };
    told.or_else(asked).filter(|width| *width >= 40).unwrap_or(100)
}

/// A person at a terminal, who reads messages on standard error and stops a session by signals.
pub(super) struct Person;

impl Observer for Person {
    fn notice(&self, text: &str) {
        complain(text);
    }

    fn follow<'t>(&self, tasks: &'t [Task<'t>], workers: usize) -> Box<dyn Follower + 't> {
        Box::new(ProgressDisplay::new(tasks, workers))
    }

    fn stop(&self) -> Result<Arc<AtomicBool>, Failure> {
        if STOP.get().is_none() {
            let stop = Arc::default();
            listen_for_signals(&stop)?;
            let _ = STOP.set(stop);
        }
        Ok(Arc::clone(STOP.get_or_init(Arc::default)))
    }
}

/// The first Ctrl-C (or SIGTERM) stops the run in order, the second one immediately. SIGUSR1, the early warning of a
/// batch system, also stops it in order.
pub(super) fn listen_for_signals(stop: &Arc<AtomicBool>) -> Result<(), Failure> {
    use signal_hook::{
        consts::{SIGINT, SIGTERM, SIGUSR1},
        flag,
    };
    let asked = Arc::new(AtomicBool::new(false));
    let listen = || -> std::io::Result<()> {
        for signal in [SIGINT, SIGTERM] {
            flag::register_conditional_shutdown(signal, 128 + signal, Arc::clone(&asked))?;
            flag::register(signal, Arc::clone(&asked))?;
        }
        for signal in [SIGINT, SIGTERM, SIGUSR1] {
            flag::register(signal, Arc::clone(stop))?;
        }
        Ok(())
    };
    listen().map_err(|error| Failure {
        exit: Exit::Incomplete,
        text: format!("error: cannot listen for signals: {error}"),
    })
}
