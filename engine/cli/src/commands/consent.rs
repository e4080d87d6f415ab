//! External programs start only with the consent of the person who runs them.
//!
//! The author of a study names its programs. Consent is stored by the project's folder, the words of the command and its
//! variables, in a file of the person, outside of every project and store, so that neither a project nor a store can grant it. The
//! list of folders with trusted programs is such a file too.

use super::complain;
use clap::Args;
use contract::Error;
use execution::{store::write_durably, world::fs};
use serde::Deserialize;
use session::{Failure, Planned, Program, Session, of_commands};
use std::{
    collections::BTreeSet,
    io::{BufRead, IsTerminal},
    path::{Path, PathBuf},
};

/// The name of the folder of a person's own files of this program.
const OWN: &str = "regimen";

/// Consent on the command line.
#[derive(Debug, Clone, Default, Args)]
pub(super) struct Consent {
    /// Start the programs of these studies without a question.
    #[arg(long)]
    yes: bool,
}

/// A person's own settings.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct OwnSettings {
    /// Folders whose programs start without a question.
    trusted: Vec<String>,
}

impl Consent {
    /// Asks for consent to the programs that would start and have none yet.
    ///
    /// # Errors
    /// Fails if the person does not agree, or cannot be asked.
    pub(super) fn ask(&self, session: &Session<'_>, planned: &[Planned]) -> Result<(), Failure> {
        self.ask_for(session.missing_programs(planned)?)
    }

    /// Like [`ask`](Self::ask), for commands that are started in the current folder.
    pub(super) fn ask_for_commands(&self, commands: Vec<Vec<String>>) -> Result<(), Failure> {
        self.ask_for(of_commands(commands))
    }

    /// Like [`ask`](Self::ask), for a given set of programs.
    pub(super) fn ask_for(&self, wanted: BTreeSet<Program>) -> Result<(), Failure> {
        if wanted.is_empty() {
            return Ok(());
        }
        let trusted = trusted()?;
        let known = agreed();
        let is_new = |it: &&Program| {
            !known.contains(it) && !trusted.iter().any(|folder| it.folder.starts_with(folder))
        };
        let new: Vec<&Program> = wanted.iter().filter(is_new).collect();
        if new.is_empty() {
            return Ok(());
        }
        if !self.yes && !answers_yes(&new)? {
            return Err(Failure::refusal("nothing was started"));
        }
        keep(known.into_iter().chain(new.into_iter().cloned()).collect())
    }
}

/// Asks on a terminal.
fn answers_yes(new: &[&Program]) -> Result<bool, Failure> {
    let lines = new
        .iter()
        .map(|it| format!("  {} (in {})\n", it.in_words(), it.folder.display()));
    let list: String = lines.collect();
    let (ask, hear) = (std::io::stderr(), std::io::stdin());
    if !ask.is_terminal() || !hear.is_terminal() {
        let text = format!(
            "these programs would be started, and you have not run them here before:\n{list}help: `--yes` starts \
             them, once and from then on"
        );
        return Err(Failure::refusal(text));
    }
    complain(&format!(
        "these programs would be started, and you have not run them here before:\n{list}Start them? [y/N]"
    ));
    let mut line = String::new();
    // A missing answer counts as a refusal.
    let _ = hear.lock().read_line(&mut line);
    Ok(matches!(line.trim(), "y" | "Y" | "yes"))
}

/// A folder for the person's own files: the one in the environment variable, or one below the home folder.
#[expect(
    clippy::disallowed_methods,
    reason = "where a person's own files lie says nothing of a result"
)]
fn own_folder(variable: &str, below_home: &str) -> Option<PathBuf> {
    let named = std::env::var_os(variable)
        .map(PathBuf::from)
        .filter(|it| it.is_absolute());
    let home = || Some(Path::new(&std::env::var_os("HOME")?).join(below_home));
    named.or_else(home).map(|folder| folder.join(OWN))
}

fn agreements() -> Option<PathBuf> {
    own_folder("XDG_STATE_HOME", ".local/state").map(|folder| folder.join("programs.json"))
}

/// Earlier consent; empty if the file cannot be read.
fn agreed() -> BTreeSet<Program> {
    let text = agreements().and_then(|path| fs::read(path).ok());
    text.and_then(|text| serde_json::from_slice(&text).ok())
        .unwrap_or_default()
}

fn keep(all: BTreeSet<Program>) -> Result<(), Failure> {
    let Some(path) = agreements() else { return Ok(()) };
    let text = serde_json::to_vec_pretty(&all).map_err(Failure::refusal)?;
    let folder = path.parent().unwrap_or(&path);
    let kept = fs::create_dir_all(folder).map_err(Error::file("create", folder));
    // Consent that cannot be stored is asked for again.
    let kept = kept.and_then(|()| write_durably(&path, &text));
    if let Err(error) = kept.and_then(|()| fs::make_private(&path).map_err(Error::file("write", &path))) {
        complain(&format!("warning: what you agreed to is not remembered: {error}"));
    }
    Ok(())
}

/// The folders that the person trusts, from the person's own settings.
fn trusted() -> Result<Vec<PathBuf>, Failure> {
    let path = own_folder("XDG_CONFIG_HOME", ".config").map(|folder| folder.join("regimen.toml"));
    let Some((path, text)) = path.and_then(|path| Some((path.clone(), fs::read_to_string(&path).ok()?)))
    else {
        return Ok(Vec::new());
    };
    let wrong = |problem: &dyn std::fmt::Display| Failure::refusal(format!("{}: {problem}", path.display()));
    let own: OwnSettings = toml::from_str(&text).map_err(|error| wrong(&error))?;
    own.trusted
        .iter()
        .map(|folder| {
            let folder = with_home(folder);
            let found = folder
                .is_absolute()
                .then(|| fs::canonicalize(&folder).unwrap_or(folder.clone()));
            found.ok_or_else(|| {
                wrong(&format!(
                    "`trusted` names `{}`, which is no absolute path",
                    folder.display()
                ))
            })
        })
        .collect()
}

/// A path with `~` replaced by the person's home folder.
#[expect(
    clippy::disallowed_methods,
    reason = "where a person's files lie says nothing of a result"
)]
fn with_home(folder: &str) -> PathBuf {
    let home = std::env::var_os("HOME").map(PathBuf::from);
    match (
        folder.strip_prefix('~').map(|rest| rest.trim_start_matches('/')),
        home,
    ) {
        (Some(rest), Some(home)) => home.join(rest),
        _ => folder.into(),
    }
}
