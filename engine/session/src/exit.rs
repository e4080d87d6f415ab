//! Exits of commands.

use contract::Error;
use document::diagnostic::{self, Diagnostic};
use std::fmt::Display;

/// The exit of a command, from best to worst. The exit of several commands is their maximum.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Exit {
    /// Everything went well.
    Ok,
    /// The command line or a study is wrong.
    BadStudy,
    /// This machine lacks something that studies need, so they could not be checked; no other problem was found.
    Unchecked,
    /// Nothing matched the selection.
    NothingSelected,
    /// Some trials failed.
    TrialsFailed,
    /// A published value or claim differs under `--strict`, or stored numbers differ where they should be equal.
    Differs,
    /// A table or figure of a report could not be made.
    NotMade,
    /// Trials are missing.
    Incomplete,
}

impl Exit {
    /// All exits, from best to worst.
    pub const ALL: [Self; 8] = [
        Self::Ok,
        Self::BadStudy,
        Self::Unchecked,
        Self::NothingSelected,
        Self::TrialsFailed,
        Self::Differs,
        Self::NotMade,
        Self::Incomplete,
    ];

    /// The exit code of a process.
    #[must_use]
    pub fn code(self) -> u8 {
        match self {
            Self::Ok => 0,
            Self::BadStudy => 2,
            Self::Unchecked => 3,
            Self::NothingSelected => 4,
            Self::TrialsFailed => 100,
            Self::Differs => 101,
            Self::NotMade => 102,
            Self::Incomplete => 106,
        }
    }
}

/// A command that could not be carried out.
#[derive(Debug)]
pub struct Failure {
    /// The exit of the command.
    pub exit: Exit,
    /// The message; it begins with `error: ` if it is an error.
    pub text: String,
}

impl Failure {
    /// A request that cannot be fulfilled; the message is `error: ` and the problem.
    pub fn refusal(problem: impl Display) -> Self {
        Self {
            exit: Exit::BadStudy,
            text: format!("error: {problem}"),
        }
    }

    /// A study that is wrong.
    #[must_use]
    pub fn study(problems: &[Diagnostic]) -> Self {
        Self {
            exit: Exit::BadStudy,
            text: diagnostic::render_first(problems),
        }
    }

    /// All problems of studies; `None` if there is none.
    pub fn studies<'p>(refused: impl IntoIterator<Item = &'p Vec<Diagnostic>>) -> Option<Self> {
        let texts: Vec<String> = refused
            .into_iter()
            .map(|problems| diagnostic::render_first(problems))
            .collect();
        (!texts.is_empty()).then(|| Self {
            exit: Exit::BadStudy,
            text: texts.join("\n"),
        })
    }

    /// A selection without trials.
    #[must_use]
    pub fn nothing_selected() -> Self {
        Self {
            exit: Exit::NothingSelected,
            text: "no trial matches what was selected".into(),
        }
    }
}

impl Display for Failure {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        out.write_str(&self.text)
    }
}

impl std::error::Error for Failure {}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        let exit = match error {
            Error::File { .. } | Error::Store { .. } => Exit::Incomplete,
            _ => Exit::BadStudy,
        };
        Self {
            exit,
            text: format!("error: {error}"),
        }
    }
}
