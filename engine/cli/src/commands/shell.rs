//! Completions for shells and the manual page, made of the command line itself.

use super::{Command, say};
use clap::CommandFactory as _;
use clap_complete::Shell;
use session::{Exit, Failure};

const NAME: &str = "regimen";

/// Prints a script that completes the command line in a shell.
pub(super) fn completions(shell: Shell) -> Result<Exit, Failure> {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut Command::command(), NAME, &mut script);
    say(&String::from_utf8_lossy(&script));
    Ok(Exit::Ok)
}

/// Prints the manual page.
pub(super) fn manual() -> Result<Exit, Failure> {
    let mut page = Vec::new();
    let written = clap_mangen::Man::new(Command::command()).render(&mut page);
    written.map_err(|source| Failure {
        exit: Exit::Incomplete,
        text: format!("error: the manual page could not be made: {source}"),
    })?;
    say(&String::from_utf8_lossy(&page));
    Ok(Exit::Ok)
}
