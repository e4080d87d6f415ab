//! Drafts of studies, made from a program's command or from the file of a sweep.

use std::{path::Path, time::Duration};

/// Reason why no study can be made; the message names the possible sources.
pub type DraftError = Box<dyn std::error::Error + Send + Sync>;

/// The command or sweep from which a study is made.
#[derive(Debug, Clone, Copy)]
pub struct Given<'a> {
    /// A command line, or the name of a file.
    pub from: &'a str,
    /// The folder of the study, in which the program lies.
    pub folder: &'a Path,
    /// Further files of the program that the command names, as patterns.
    pub sources: &'a [String],
    /// Longest time for which the program runs.
    pub runs_for: Duration,
}

/// A study that is being drafted.
pub trait Draft {
    /// The commands that have to run before it can be written.
    fn starts(&self) -> Vec<Vec<String>>;

    /// Runs the commands, and reads what they write.
    ///
    /// # Errors
    /// A command fails, or writes nothing that can be read.
    fn look(&mut self) -> Result<(), DraftError>;

    /// The study, in YAML with comments.
    fn text(&self, name: &str) -> String;

    /// Sentences on the parts that the user should check.
    fn told(&self) -> Vec<String>;
}

/// Begins a study; runs no command yet.
pub type BeginDraft = fn(&Given<'_>) -> Result<Box<dyn Draft>, DraftError>;
