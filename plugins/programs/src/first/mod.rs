//! A first study of a program, from its command or from the sweep of another tool.
//!
//! The program is asked for its options and runs once for some seconds, in a folder of its own. Its output and
//! files are read in the same way as in a trial. The study explains each proposal in a comment.

mod command;
mod error;
mod help;
mod hydra;
mod metrics;
mod options;
mod probe;
mod shell_words;
mod sources;
mod sweep;
mod text;
mod wandb;
mod written;
mod yaml;

use crate::process;
use command::{Command, CommandWord};
use contract::draft::{Draft, DraftError, Given};
use error::DraftRefusal;
use help::{Help, HelpOption};
use metrics::{FoundMetric, RefusedMetric};
use probe::{Probe, ProbeRun};
use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    time::Duration,
};
use sweep::Sweep;

/// Programs that do not pass `--help` on to their script.
const SHELLS: [&str; 9] = ["sh", "bash", "dash", "zsh", "awk", "gawk", "mawk", "make", "perl"];
/// Package managers, which find the packages of a project by its file.
const MANAGERS: [&str; 5] = ["uv", "poetry", "pixi", "pdm", "hatch"];

/// The draft of a study of a program.
#[derive(Debug)]
struct ProgramDraft {
    from: String,
    folder: PathBuf,
    /// Environment variables that the command sets.
    variables: BTreeMap<String, String>,
    command: Command,
    sweep: Sweep,
    probe: Probe,
    /// Names and patterns of the program's files.
    sources: Vec<String>,
    lock: Option<&'static str>,
    runs_for: Duration,
    /// Options that keep their defaults.
    others: Vec<HelpOption>,
    ran: ProbeRun,
    /// Metrics of the program, that of the study first.
    seen: Vec<FoundMetric>,
    length: Length,
    notes: Vec<String>,
}

/// Length of the training.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Length {
    /// Steps of a trial.
    steps: u64,
    /// Steps of a trial in the `smoke` profile.
    smoke: u64,
}

/// Begins the draft of a study of a program; nothing runs yet.
///
/// # Errors
/// [`DraftRefusal`] with the reason and a remedy.
pub fn begin(given: &Given<'_>) -> Result<Box<dyn Draft>, DraftError> {
    Ok(Box::new(ProgramDraft::begin(given)?))
}

impl ProgramDraft {
    fn begin(given: &Given<'_>) -> Result<Self, DraftRefusal> {
        let mut sweep = asked(given)?;
        let variables = shell_words::take_variables(&mut sweep.words)?;
        let command = Command::of(&sweep.words, given.folder, &sweep.options(), &Help::default());
        is_here(&command, given.from)?;
        let named = sweep.swept.iter().flat_map(|(_, range)| range.texts());
        let named = named.filter_map(|text| sources::inside(given.folder, text));
        let files: Vec<String> = command.files.iter().cloned().chain(named).collect();
        let mut sources = sources::of(given.folder, &files);
        let first = command.words.first().map_or("", |word| word.started.as_str());
        let project = "pyproject.toml";
        if MANAGERS.contains(&first) && given.folder.join(project).is_file() {
            sources.push(project.into());
        }
        sources.extend(given.sources.iter().cloned());
        sources.dedup();
        let lock = sources::lock(given.folder);
        sources.retain(|name| Some(name.as_str()) != lock);
        let probe =
            Probe::new(given.folder, &sources, lock, &command.interpreter)?.with_variables(&variables);
        Ok(Self {
            from: given.from.to_owned(),
            folder: given.folder.to_owned(),
            variables,
            notes: sweep.notes.clone(),
            command,
            sweep,
            probe,
            sources,
            lock,
            runs_for: given.runs_for,
            others: Vec::new(),
            ran: ProbeRun::default(),
            seen: Vec::new(),
            length: Length::default(),
        })
    }

    fn has_help(&self) -> bool {
        let first = self
            .command
            .words
            .first()
            .map_or("", |word| word.started.as_str());
        !SHELLS.contains(&first)
            && !self
                .sources
                .iter()
                .any(|name| name.ends_with(".sh") && first.ends_with(name))
    }

    fn words(&self, of: fn(&CommandWord) -> &String, n: usize) -> Vec<String> {
        self.command.words.iter().take(n).map(of).cloned().collect()
    }

    fn asks_for_help(&self) -> Vec<String> {
        let mut words = self.words(|word| &word.started, self.command.head);
        words.push("--help".into());
        words
    }

    fn started(&self) -> Vec<String> {
        self.words(|word| &word.started, usize::MAX)
    }

    fn find_metrics(&mut self) -> Result<(), DraftRefusal> {
        let files: Vec<String> = self.probe.files().map(str::to_owned).collect();
        let (seen, refused) = metrics::seen(&self.probe.place(), &self.ran, &files);
        self.seen = seen;
        let asked = self.sweep.metric.clone();
        let place = asked.and_then(|name| self.seen.iter().position(|it| it.key == name));
        if let Some(place) = place {
            self.seen[..=place].rotate_right(1);
        }
        let Some(first) = self.seen.first().cloned() else {
            return Err(self.without_metric(refused));
        };
        if place.is_none() {
            self.stand_in(&first, &refused);
        }
        let preferred = refused.into_iter().filter(|it| self.is_preferred(it, &first));
        let left_out =
            |it: RefusedMetric| format!("`{}` of `{}` is left out: it {}", it.key, it.from, it.problem);
        let notes: Vec<String> = preferred.map(left_out).collect();
        self.notes.extend(notes);
        Ok(())
    }

    /// Whether a metric that cannot be read would have been that of the study.
    fn is_preferred(&self, refused: &RefusedMetric, first: &FoundMetric) -> bool {
        match &self.sweep.metric {
            Some(name) => *name == refused.key,
            None => refused.rank < first.rank(),
        }
    }

    /// Notes that the sweep's metric was not read. Its goal is that of no other metric.
    fn stand_in(&mut self, first: &FoundMetric, refused: &[RefusedMetric]) {
        let goal = self.sweep.lower_is_better.take();
        let is_better = if first.lower_is_better() {
            "lower"
        } else {
            "higher"
        };
        let stands = format!(
            "`{}`, whose {is_better} values are better, by its name",
            first.key
        );
        let name = self.sweep.metric.as_ref();
        let waits = match name {
            Some(name) if refused.iter().all(|it| it.key != *name) => "; `--seconds` waits longer",
            _ => "",
        };
        self.notes.extend(match (name, goal) {
            (Some(name), _) => Some(format!(
                "the metric `{name}` of the sweep was not read{waits}; in its place stands {stands}"
            )),
            (None, Some(_)) => Some(format!(
                "the direction of the sweep is that of a value without a name; the study goes by {stands}"
            )),
            (None, None) => None,
        });
    }

    fn without_metric(&self, refused: Vec<RefusedMetric>) -> DraftRefusal {
        let program = process::named(&self.started());
        let how = self.how_it_ran();
        if let Some(RefusedMetric {
            key, from, problem, ..
        }) = refused.into_iter().next()
        {
            return DraftRefusal::Unreadable {
                program,
                how,
                key,
                from,
                problem,
            };
        }
        let keys = &self.ran.keys;
        let there = if keys.is_empty() {
            "no line of its output is a JSON object or has words KEY=VALUE, and it left no file with numbers"
                .into()
        } else {
            format!("keys in its output were `{}`", keys.join("`, `"))
        };
        DraftRefusal::NoMetric { program, how, there }
    }

    fn how_it_ran(&self) -> String {
        match self.ran.has_ended {
            true => "ran to its end".into(),
            false => format!("ran for {} s", self.runs_for.as_secs()),
        }
    }

    /// Decides the steps, by those of the metrics and by the option of the command.
    fn measure_length(&mut self) {
        let seen = self.seen.first().map_or(0, FoundMetric::last_step).max(1);
        let ended = self.ran.has_ended;
        if let Some((option, steps)) = self.command.steps.clone() {
            let fits = if ended {
                seen * 2 >= steps && seen <= steps * 2
            } else {
                seen <= steps
            };
            if fits && steps > 0 {
                let smoke = if ended { steps } else { seen };
                self.length = Length { steps, smoke };
                return;
            }
            self.notes.push(format!(
                "`{option}` stays at {steps}: it counts something else than the steps of the metrics, which went to {seen}"
            ));
            self.command.keep_steps();
        }
        let steps = if ended { seen } else { seen.saturating_mul(10) };
        let why = match ended {
            true => "the last step of a metric",
            false => "a guess, since the program was stopped",
        };
        self.notes.push(format!(
            "`steps: {steps}` is {why}: it says where curves end, and no word of the program has it"
        ));
        self.length = Length { steps, smoke: steps };
    }

    fn look_at_words(&mut self) {
        if self.command.seed.is_none() {
            let note =
                "no option for a seed was found: put `{seed}` into `run`, or all seeds compute the same";
            self.notes.push(note.into());
        }
        if !self.command.kept.is_empty() {
            let kept = self.command.kept.join("`, `");
            self.notes.push(format!(
                "`{kept}` stay as they are: a name in braces and `parameters` make one a parameter"
            ));
        }
        if self.lock.is_none() {
            self.notes.push(
                "no lock file was found: `lock: none` is right for a program without packages alone".into(),
            );
        }
    }
}

impl Draft for ProgramDraft {
    fn starts(&self) -> Vec<Vec<String>> {
        let help = self.has_help().then(|| self.asks_for_help());
        let mut all: Vec<Vec<String>> = help.into_iter().chain([self.started()]).collect();
        for words in &mut all {
            if let Some(first) = words.first_mut().filter(|_| !self.command.interpreter.is_empty()) {
                first.clone_from(&self.command.interpreter);
            }
        }
        all
    }

    fn look(&mut self) -> Result<(), DraftError> {
        if self.has_help() {
            let help = Help::read(&self.probe.help(self.asks_for_help(), self.runs_for)?);
            self.command = Command::of(&self.sweep.words, &self.folder, &self.sweep.options(), &help);
            self.others = self.command.complete(&help);
        }
        self.ran = self.probe.run(self.started(), self.runs_for)?;
        self.find_metrics()?;
        self.measure_length();
        self.look_at_words();
        Ok(())
    }

    fn text(&self, name: &str) -> String {
        text::Text(self).study(name)
    }

    fn told(&self) -> Vec<String> {
        self.notes.clone()
    }
}

/// The sweep in the request; a command is a sweep without values.
fn asked(given: &Given<'_>) -> Result<Sweep, DraftRefusal> {
    let from = given.from.trim();
    let is_file =
        [".yaml", ".yml"].iter().any(|end| from.ends_with(end)) && !from.contains(char::is_whitespace);
    if !is_file {
        return Ok(Sweep {
            what: "a command",
            words: shell_words::words(from)?,
            ..Sweep::default()
        });
    }
    if !given.folder.join(from).is_file() {
        let what = "a sweep".into();
        let file = from.to_owned();
        return Err(DraftRefusal::NotHere { file, what });
    }
    Sweep::read(given.folder, Path::new(from))
}

/// Refuses a command whose script does not exist.
fn is_here(command: &Command, from: &str) -> Result<(), DraftRefusal> {
    let is_script = |word: &&CommandWord| {
        let end = Path::new(&word.started).extension().and_then(|end| end.to_str());
        ["py", "sh", "awk", "jl", "R", "js", "rb", "pl"]
            .iter()
            .any(|it| Some(*it) == end)
    };
    match command
        .words
        .iter()
        .find(is_script)
        .filter(|_| command.files.is_empty())
    {
        Some(word) => Err(DraftRefusal::NotHere {
            file: word.started.clone(),
            what: format!("which `{from}` names"),
        }),
        None => Ok(()),
    }
}

#[cfg(test)]
#[path = "draft_tests.rs"]
mod tests;
