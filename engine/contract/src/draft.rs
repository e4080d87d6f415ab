//! Drafts of studies, made from a program's command or from the file of a sweep.

use std::{path::Path, time::Duration};

/// Why no study can be made; the message says what it can be made from.
pub type DraftError = Box<dyn std::error::Error + Send + Sync>;

/// The command or sweep that a study is made from.
#[derive(Debug, Clone, Copy)]
pub struct Given<'a> {
    /// A command line, or the name of a file.
    pub from: &'a str,
    /// The folder of the study, in which the program lies.
    pub folder: &'a Path,
    /// Further files of the program that the command names, as patterns.
    pub sources: &'a [String],
    /// How long the program runs at most.
    pub runs_for: Duration,
}

/// A study in the making.
pub trait Draft {
    /// The commands that have to run before it can be written.
    fn starts(&self) -> Vec<Vec<String>>;

    /// Runs the commands, and reads what they write.
    ///
    /// # Errors
    /// Where a command fails, or writes nothing that can be read.
    fn look(&mut self) -> Result<(), DraftError>;

    /// The study, in YAML with comments.
    fn text(&self, name: &str) -> String;

    /// Sentences on the parts that the person should look at.
    fn told(&self) -> Vec<String>;
}

/// Begins a study; nothing runs yet.
pub type BeginDraft = fn(&Given<'_>) -> Result<Box<dyn Draft>, DraftError>;
