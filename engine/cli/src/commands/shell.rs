//! Shell completions and the manual page, generated from the command line itself.

use super::{command, say};
use clap_complete::Shell;
use contract::Registry;
use session::{Exit, Failure};

const NAME: &str = "regimen";

/// Prints a script that completes the command line in a shell.
pub(super) fn completions(registry: &Registry, shell: Shell) -> Result<Exit, Failure> {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut command(registry), NAME, &mut script);
    say(&String::from_utf8_lossy(&script));
    Ok(Exit::Ok)
}

/// Prints the manual page.
pub(super) fn manual(registry: &Registry) -> Result<Exit, Failure> {
    let mut page = Vec::new();
    let written = clap_mangen::Man::new(command(registry)).render(&mut page);
    written.map_err(|source| Failure {
        exit: Exit::Incomplete,
        text: format!("error: the manual page could not be made: {source}"),
    })?;
    say(&String::from_utf8_lossy(&page));
    Ok(Exit::Ok)
}
