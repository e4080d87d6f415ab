//! The external programs that trials would start.

use crate::{Failure, Planned, Session};
use contract::{Error, Interface, Registry, part::Part, random, trial::Trial, trial_end::EndState};
use document::reach::Reach;
use execution::store::Store;
use serde::{Deserialize, Serialize};
use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
};
use study::plan::Plan;

/// A program as consent is given to it: the words of its command, with names in braces, and its project.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Program {
    /// The project's folder.
    pub folder: PathBuf,
    /// The words.
    pub run: Vec<String>,
}

impl Program {
    /// The words as a person would type them.
    #[must_use]
    pub fn in_words(&self) -> String {
        in_words(&self.run)
    }
}

impl Session<'_> {
    /// The programs of trials that have not ended `ok`.
    ///
    /// # Errors
    /// A program that cannot be built, and a store that cannot be opened.
    pub fn missing_programs(&self, planned: &[Planned]) -> Result<BTreeSet<Program>, Failure> {
        missing(self.registry, planned, self.store()?)
    }

    /// The programs that the trials of these agents would start, in words.
    pub fn programs_of<'p>(&self, parts: impl Iterator<Item = &'p Part>) -> BTreeSet<String> {
        let words = |part: &Part| written(self.registry, part).ok().flatten();
        parts.filter_map(words).map(|words| in_words(&words)).collect()
    }
}

/// Commands as programs of the project of the current folder.
pub fn of_commands(commands: impl IntoIterator<Item = Vec<String>>) -> BTreeSet<Program> {
    let folder = project(Path::new(""));
    let program = |run| Program {
        folder: folder.clone(),
        run,
    };
    commands.into_iter().map(program).collect()
}

/// The programs of trials that have not ended `ok`.
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
            // A trial with a damaged end counts as missing.
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

/// The programs of trials that are computed again. `study` identifies the project; without it, the current folder does.
pub(crate) fn of_trials<'a>(
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
pub(crate) fn has_programs(registry: &Registry, plan: &Plan) -> bool {
    let is_program = |part: &Part| registry.program(part).is_some();
    plan.trials
        .iter()
        .filter_map(|trial| trial.key.agent.agent())
        .any(is_program)
}

/// The command of the program behind an agent; `None` if the agent is not a program.
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

/// The command of the program behind an agent, for messages.
pub(crate) fn in_short(registry: &Registry, part: &Part) -> String {
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
