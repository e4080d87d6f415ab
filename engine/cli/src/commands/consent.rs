//! Programs that are not ours start when the person agreed to it who runs them.
//!
//! The author of a study names its programs. The consent of a person is kept by the project's folder and the words of
//! the command, in a file of that person, outside of every project and store: neither can say it for them. So is
//! the list of folders whose programs are trusted.

use super::{BAD_SPEC, Failure, complain, planned::Planned};
use clap::Args;
use contract::{
    Error, Interface, Registry, random,
    trial::{Part, Trial},
    trial_end::EndState,
};
use document::reach::Reach;
use execution::{
    store::{Store, write_durably},
    world::fs,
};
use serde::{Deserialize, Serialize};
use std::{
    collections::BTreeSet,
    io::{BufRead, IsTerminal},
    path::{Path, PathBuf},
};
use study::plan::Plan;

/// The name of the folder of a person's own files of this program.
const OWN: &str = "regimen";

/// Consent on the command line.
#[derive(Debug, Clone, Default, Args)]
pub(super) struct Consent {
    /// Start the programs of these studies without a question.
    #[arg(long)]
    yes: bool,
}

/// A program as it is agreed to: the words of its command, with names in braces, in a project.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub(super) struct Program {
    /// The project's folder.
    folder: PathBuf,
    /// The words.
    run: Vec<String>,
}

/// A person's own settings.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct OwnSettings {
    /// Folders whose programs start without a question.
    trusted: Vec<String>,
}

impl Consent {
    /// Asks for what would start and was not agreed to before.
    ///
    /// # Errors
    /// Where the person does not agree, or cannot be asked.
    pub(super) fn ask(&self, registry: &Registry, planned: &[Planned], store: &Store) -> Result<(), Failure> {
        let wanted = missing(registry, planned, store)?;
        self.ask_for(wanted)
    }

    /// As [`ask`](Self::ask), for commands that are started in the current folder.
    pub(super) fn ask_for_commands(&self, commands: Vec<Vec<String>>) -> Result<(), Failure> {
        let folder = project(Path::new(""));
        let program = |run| Program {
            folder: folder.clone(),
            run,
        };
        self.ask_for(commands.into_iter().map(program).collect())
    }

    /// As [`ask`](Self::ask), for programs that are known.
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
            return Err(refused("error: nothing was started".into()));
        }
        keep(known.into_iter().chain(new.into_iter().cloned()).collect())
    }
}

/// The programs of trials that have not ended well.
fn missing(registry: &Registry, planned: &[Planned], store: &Store) -> Result<BTreeSet<Program>, Failure> {
    let mut programs = BTreeSet::new();
    for one in planned {
        for trial in &one.plan.trials {
            let Some(part) = trial.key.agent.agent() else {
                continue;
            };
            let Some(run) = written(registry, part)? else {
                continue;
            };
            let folder = project(&one.path);
            let program = Program { folder, run };
            // A damaged end is no end.
            let is_there = || {
                store
                    .end(&trial.id)
                    .ok()
                    .flatten()
                    .is_some_and(|it| it.state == EndState::Ok)
            };
            if !programs.contains(&program) && !is_there() {
                programs.insert(program);
            }
        }
    }
    Ok(programs)
}

/// The programs of trials that are computed again; `study` tells the project, and the current folder where there
/// is none.
pub(super) fn of_trials<'a>(
    registry: &Registry,
    trials: impl Iterator<Item = &'a Trial>,
    study: Option<&PathBuf>,
) -> Result<BTreeSet<Program>, Failure> {
    let folder = project(study.map_or(Path::new(""), PathBuf::as_path));
    let mut programs = BTreeSet::new();
    for part in trials.filter_map(|trial| trial.key.agent.agent()) {
        let run = written(registry, part)?;
        let folder = folder.clone();
        programs.extend(run.map(|run| Program { folder, run }));
    }
    Ok(programs)
}

/// True where a trial of a plan starts a program.
pub(super) fn has_programs(registry: &Registry, plan: &Plan) -> bool {
    let is_program = |part: &Part| registry.program(part).is_some();
    plan.trials
        .iter()
        .filter_map(|trial| trial.key.agent.agent())
        .any(is_program)
}

/// The words of the program that an agent is; `None` where it is none.
fn written(registry: &Registry, part: &Part) -> Result<Option<Vec<String>>, Error> {
    let Some(entry) = registry.program(part) else {
        return Ok(None);
    };
    let nothing = Interface {
        seats: Vec::new(),
        state: Vec::new(),
    };
    let mut agent = (entry.build)(&part.config, &nothing, &mut random::stream(&["consent"]))?;
    Ok(agent.own_training().map(|training| training.written()))
}

/// The programs that the trials of these agents would start, for `check`.
pub(super) fn shown<'a>(registry: &Registry, parts: impl Iterator<Item = &'a Part>) -> BTreeSet<String> {
    let words = |part: &Part| written(registry, part).ok().flatten();
    parts.filter_map(words).map(|words| in_words(&words)).collect()
}

/// The program that an agent is, for messages.
pub(super) fn in_short(registry: &Registry, part: &Part) -> String {
    let words = written(registry, part).ok().flatten();
    words.map_or_else(
        || part.plugin.clone(),
        |words| in_words(&words[..words.len().min(2)]),
    )
}

/// The folder of the project that a study is part of.
fn project(study: &Path) -> PathBuf {
    Reach::of(study.parent().unwrap_or(Path::new(".")))
        .project()
        .to_owned()
}

/// Words as a person would type them.
fn in_words(run: &[String]) -> String {
    let quoted = |word: &String| match word
        .chars()
        .all(|it| it.is_alphanumeric() || "{}._-/=:,+@%".contains(it))
    {
        true if !word.is_empty() => word.clone(),
        _ => format!("{word:?}"),
    };
    run.iter().map(quoted).collect::<Vec<_>>().join(" ")
}

/// Asks on a terminal.
fn answers_yes(new: &[&Program]) -> Result<bool, Failure> {
    let lines = new
        .iter()
        .map(|it| format!("  {} (in {})\n", in_words(&it.run), it.folder.display()));
    let list: String = lines.collect();
    let (ask, hear) = (std::io::stderr(), std::io::stdin());
    if !ask.is_terminal() || !hear.is_terminal() {
        let text = format!(
            "error: these programs would be started, and you have not run them here before:\n{list}help: `--yes` starts \
             them, once and from then on"
        );
        return Err(refused(text));
    }
    complain(&format!(
        "these programs would be started, and you have not run them here before:\n{list}Start them? [y/N]"
    ));
    let mut line = String::new();
    // No answer is none.
    let _ = hear.lock().read_line(&mut line);
    Ok(matches!(line.trim(), "y" | "Y" | "yes"))
}

fn refused(text: String) -> Failure {
    Failure { code: BAD_SPEC, text }
}

/// A folder of a person's own files: the one that the variable names, or one below the home.
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

/// Earlier consent; a file that cannot be read says nothing.
fn agreed() -> BTreeSet<Program> {
    let text = agreements().and_then(|path| fs::read(path).ok());
    text.and_then(|text| serde_json::from_slice(&text).ok())
        .unwrap_or_default()
}

fn keep(all: BTreeSet<Program>) -> Result<(), Failure> {
    let Some(path) = agreements() else { return Ok(()) };
    let text = serde_json::to_vec_pretty(&all).map_err(|error| refused(format!("error: {error}")))?;
    let folder = path.parent().unwrap_or(&path);
    let kept = fs::create_dir_all(folder).map_err(Error::file("create", folder));
    // Who cannot be remembered is asked again.
    let kept = kept.and_then(|()| write_durably(&path, &text));
    if let Err(error) = kept.and_then(|()| fs::make_private(&path).map_err(Error::file("write", &path))) {
        complain(&format!("warning: what you agreed to is not remembered: {error}"));
    }
    Ok(())
}

/// The folders that a person trusts, from that person's own settings.
fn trusted() -> Result<Vec<PathBuf>, Failure> {
    let path = own_folder("XDG_CONFIG_HOME", ".config").map(|folder| folder.join("regimen.toml"));
    let Some((path, text)) = path.and_then(|path| Some((path.clone(), fs::read_to_string(&path).ok()?)))
    else {
        return Ok(Vec::new());
    };
    let wrong = |problem: &dyn std::fmt::Display| refused(format!("error: {}: {problem}", path.display()));
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

/// A path in which `~` stands for the home of the person.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_shown_so_that_each_is_told_from_the_next() {
        let run = ["python", "train.py", "--lr", "{lr}", "a b", "", "$(reboot)"];
        let run = run.map(str::to_owned);
        assert_eq!(
            in_words(&run),
            r#"python train.py --lr {lr} "a b" "" "$(reboot)""#
        );
    }
}
