//! The external programs that trials would start.

use crate::{Failure, Planned, Session};
use contract::{
    Error, Interface, OwnTraining, Registry, part::Part, random, trial::Trial, trial_end::EndState,
};
use document::reach::Reach;
use execution::store::Store;
use serde::{Deserialize, Serialize};
use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};
use study::plan::Plan;

/// A program as consent is given to it: the words of its command, with names in braces, its variables, among them those
/// by which the first word finds a program, and its project.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Program {
    /// The project's folder.
    pub folder: PathBuf,
    /// The words.
    pub run: Vec<String>,
    /// The environment variables that the study sets.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub variables: BTreeMap<String, String>,
}

impl Program {
    /// The words as a person would type them.
    #[must_use]
    pub fn in_words(&self) -> String {
        let set = self
            .variables
            .iter()
            .map(|(name, value)| format!("{name}={value}"));
        in_words(&set.chain(self.run.iter().cloned()).collect::<Vec<_>>())
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
        let program = |part: &Part| program(self.registry, part, Path::new("")).ok().flatten();
        parts.filter_map(program).map(|it| it.in_words()).collect()
    }
}

/// Commands as programs of the project of the current folder.
pub fn of_commands(commands: impl IntoIterator<Item = Vec<String>>) -> BTreeSet<Program> {
    let folder = project(Path::new(""));
    let program = |run| Program {
        folder: folder.clone(),
        run,
        variables: BTreeMap::new(),
    };
    commands.into_iter().map(program).collect()
}

/// The programs of trials that have not ended `ok`.
fn missing(registry: &Registry, planned: &[Planned], store: &Store) -> Result<BTreeSet<Program>, Failure> {
    let mut programs = BTreeSet::new();
    for one in planned {
        let folder = project(&one.path);
        for trial in &one.plan.trials {
            let Some(part) = trial.key.agent.agent() else {
                continue;
            };
            let Some(program) = program(registry, part, &folder)? else {
                continue;
            };
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
        programs.extend(program(registry, part, &folder)?);
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

/// Whether an agent is a program that begins anew after an interruption.
pub(crate) fn begins_anew(registry: &Registry, part: &Part) -> bool {
    let goes_on = ask(registry, part, |training| training.goes_on());
    matches!(goes_on, Ok(Some(false)))
}

/// The program behind an agent, in the project at `folder`; `None` if the agent is not a program.
fn program(registry: &Registry, part: &Part, folder: &Path) -> Result<Option<Program>, Error> {
    ask(registry, part, |training| Program {
        folder: folder.to_owned(),
        run: training.written(),
        variables: training.variables(),
    })
}

/// Asks the program behind an agent, which is not started; `None` if the agent is not a program.
fn ask<T>(
    registry: &Registry,
    part: &Part,
    question: impl FnOnce(&mut dyn OwnTraining) -> T,
) -> Result<Option<T>, Error> {
    let Some(entry) = registry.program(part) else {
        return Ok(None);
    };
    let nothing = Interface {
        seats: Vec::new(),
        state: Vec::new(),
    };
    let mut agent = (entry.build)(&part.config, &nothing, &mut random::stream(&["consent"]))?;
    Ok(agent.own_training().map(question))
}

/// The command of the program behind an agent, for messages.
pub(crate) fn in_short(registry: &Registry, part: &Part) -> String {
    let words = ask(registry, part, |training| training.written()).ok().flatten();
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

    #[test]
    fn variables_are_part_of_a_program_and_stand_before_its_words() {
        let plain = r#"{ "folder": "/lab", "run": ["python", "a.py"] }"#;
        let plain: Program = serde_json::from_str(plain).unwrap();
        let variables =
            [("A", "b c"), ("PATH", "/lab/bin")].map(|(name, value)| (name.to_owned(), value.to_owned()));
        let other = Program {
            variables: variables.into(),
            ..plain.clone()
        };
        assert_eq!(plain.in_words(), "python a.py");
        assert_eq!(other.in_words(), r#""A=b c" PATH=/lab/bin python a.py"#);
        assert!(plain != other);
    }
}
