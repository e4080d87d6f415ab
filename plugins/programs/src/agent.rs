//! The agent `program`: a program that trains and measures itself.

use crate::{
    ProgramConfig,
    link::Link,
    metrics::Metrics,
    output::{self, OutputReader},
    policy::Policy,
    process::{self, Process},
    words::{Word, WordValues, filled, parsed},
    working_folder::WorkingFolder,
};
use contract::{
    Action, Agent, Error, Interface, Metric, Mode, Observation, OwnTraining, Rng, Seat,
    own_training::{Advance, Assignment, Curve, Measured, TrainingAllocation},
};
use execution::guard::end_leftover;
use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    time::Duration,
};

/// Time between two polls for a measurement that the program requests.
const LOOK: Duration = Duration::from_millis(2);
/// Time that a program has to end after it broke a measurement off. One that asks for another measurement goes on.
const LEAVES_WITHIN: Duration = Duration::from_secs(5);

/// A program as an agent.
#[derive(Debug)]
pub struct ProgramAgent {
    config: ProgramConfig,
    run: Vec<Word>,
    resume: Vec<Word>,
    /// The seat for which the program is asked for actions.
    seat: Option<Seat>,
    training: Option<Training>,
    /// The policy that the program left, here or in another trial.
    policy: Option<Policy>,
    /// Number of decisions so far.
    decisions: u64,
}

/// State of a training's program.
#[derive(Debug)]
enum Work {
    /// The program runs.
    Running(Process),
    /// The program had ended before; its captured output is kept.
    Done(OutputReader),
}

impl Work {
    fn process(&mut self) -> Option<&mut Process> {
        match self {
            Self::Running(process) => Some(process),
            Self::Done(_) => None,
        }
    }

    fn output_reader(&self) -> &OutputReader {
        match self {
            Self::Running(process) => process.output_reader(),
            Self::Done(output_reader) => output_reader,
        }
    }
}

/// A training that has begun.
#[derive(Debug)]
struct Training {
    folder: PathBuf,
    metrics: Metrics,
    work: Work,
    /// Socket on which the program requests measurements.
    link: Option<Link>,
    has_ended: bool,
}

/// Builds the agent; registered as `program`.
///
/// # Errors
/// [`Error::Config`] for missing keys, and for words of the command that cannot be parsed.
pub fn build(config: ProgramConfig, interface: &Interface, _: &mut Rng) -> Result<Box<dyn Agent>, Error> {
    config.check()?;
    let run = parsed("run", &config.run)?;
    let resume = parsed("resume", &config.resume)?;
    Ok(Box::new(ProgramAgent {
        config,
        run,
        resume,
        seat: interface.seats.first().cloned(),
        training: None,
        policy: None,
        decisions: 0,
    }))
}

impl Agent for ProgramAgent {
    fn act(&mut self, observations: &[Observation], _: Mode, _: &mut Rng) -> Result<Vec<Action>, Error> {
        let rows: Vec<&[f64]> = observations.iter().map(|it| it.seats[0].as_slice()).collect();
        self.decisions += rows.len() as u64;
        if let Some(policy) = &self.policy {
            let act = |row: &&[f64]| Ok(vec![policy.act(row, self.decisions)?]);
            return rows.iter().map(act).collect();
        }
        let space = &self.seat.as_ref().ok_or_else(not_asked)?.action;
        let training = self.training.as_mut().ok_or_else(not_asked)?;
        let asked = training.act(&rows, space.n_asked())?;
        let action = |entries: &Vec<f64>| match entries.iter().find(|entry| !entry.is_finite()) {
            Some(value) => Err(not_finite("the action of the program", self.decisions, *value)),
            None => Ok(vec![space.asked(entries)?]),
        };
        asked.iter().map(action).collect()
    }

    fn export(&self, folder: &Path) -> Result<bool, Error> {
        let (Some(Measured::Policy), Some(seat)) = (self.config.measured, &self.seat) else {
            return Ok(false);
        };
        match &self.policy {
            Some(policy) => Policy::leave(policy.bytes(), folder)?,
            None => Policy::leave(&Policy::stub(seat), folder)?,
        }
        Ok(true)
    }

    fn import(&mut self, folder: &Path) -> Result<bool, Error> {
        let (Some(Measured::Policy), Some(seat)) = (self.config.measured, &self.seat) else {
            return Ok(false);
        };
        self.policy = Some(Policy::taken_up(folder, seat)?);
        Ok(true)
    }

    fn own_training(&mut self) -> Option<&mut dyn OwnTraining> {
        Some(self)
    }

    fn records(&self) -> Vec<Metric> {
        self.config
            .metrics
            .keys()
            .map(|name| self.config.metric(name))
            .collect()
    }
}

impl OwnTraining for ProgramAgent {
    fn command(&self, of: &Assignment) -> Result<Vec<String>, Error> {
        self.words(of, &WorkingFolder::at(Path::new("{folder}"), &self.config), true)
    }

    fn written(&self) -> Vec<String> {
        let mut words = self.config.run.clone();
        if let Some(first) = words.first_mut().filter(|_| !self.config.interpreter.is_empty()) {
            first.clone_from(&self.config.interpreter);
        }
        words
    }

    fn variables(&self) -> BTreeMap<String, String> {
        self.config.variables.clone()
    }

    fn goes_on(&self) -> bool {
        !self.resume.is_empty()
    }

    fn doubts(&self, seeds: usize) -> Vec<Error> {
        let words = || self.run.iter().chain(&self.resume);
        let has = |name: &str| words().flat_map(Word::names).any(|it| it == name);
        let is_used = |name: &str| has(name) || has("parameters");
        let unused = self.config.parameters.keys().filter(|name| !is_used(name));
        let doubt = |name: &String| {
            let problem =
                format!("no word of the program has `{{{name}}}`, so that its value changes nothing");
            Error::config(format!("parameters.{name}"), problem)
        };
        // The engine measures a program that calls it on other episodes for each seed.
        let is_called = self.config.measured == Some(Measured::Calls);
        let alike = (seeds > 1 && !has("seed") && !is_called).then(|| {
            let problem = "no word of it has `{seed}`: every seed gives the same values, unless the program draws from \
                           `trial.environment()`";
            Error::config("run", problem)
        });
        let unfilled = self.config.unfilled_variables();
        unused.map(doubt).chain(alike).chain(unfilled).collect()
    }

    fn begin(&mut self, of: &Assignment, within: &TrainingAllocation) -> Result<(), Error> {
        let place = WorkingFolder::at(&within.folder, &self.config);
        end_leftover(&place.notes());
        // Measurements by calls are in no file.
        let is_asked = self.config.measured == Some(Measured::Calls);
        let has_ended = process::has_ended_well(&place.notes()) && !is_asked;
        let can_go_on = place.has_checkpoint() && !output::is_numbered(&place.notes());
        let goes_on = !self.resume.is_empty() && can_go_on;
        if !has_ended && !goes_on {
            place.empty()?;
        }
        let mut output_reader = process::output_reader(&self.config, &place)?;
        let attempts = attempt(&place, has_ended)?;
        let mut metrics = Metrics::of(&self.config, &place.folder, &place.notes(), attempts > 1);
        let link = is_asked.then(|| Link::open(within.patience)).transpose()?;
        let work = if has_ended {
            output_reader.end();
            Work::Done(output_reader)
        } else {
            if goes_on {
                output_reader.mark_continuation(&place.notes())?;
                metrics.mark_continuation()?;
            }
            place.lay(&self.config)?;
            place.tell(of, link.as_ref().map(Link::path).as_deref())?;
            let words = self.words(of, &place, goes_on)?;
            let words = started(&self.config, words)?;
            Work::Running(Process::start(
                &self.config,
                words,
                (&place, &within.share),
                output_reader,
            )?)
        };
        self.training = Some(Training {
            folder: place.folder,
            metrics,
            work,
            link,
            has_ended,
        });
        Ok(())
    }

    fn measured(&self) -> Option<Measured> {
        self.config.measured
    }

    fn take_up(&mut self) -> Result<(), Error> {
        let pattern = self.config.leaves.policy.as_deref().unwrap_or_default();
        let training = self.training.as_ref().ok_or_else(unbegun)?;
        let seat = self.seat.as_ref().ok_or_else(not_asked)?;
        self.policy = Some(Policy::left(&training.folder, pattern, seat)?);
        Ok(())
    }

    fn answer(&mut self, means: Option<&BTreeMap<String, f64>>) -> Result<(), Error> {
        match self.training.as_mut().and_then(|it| it.link.as_mut()) {
            Some(link) => link.answer(means),
            None => Err(not_asked()),
        }
    }

    fn advance(&mut self, wait: Duration) -> Result<Advance, Error> {
        self.training.as_mut().ok_or_else(unbegun)?.advance(wait)
    }

    fn curves(&mut self, last: bool) -> Result<&[Curve], Error> {
        let training = self.training.as_mut().ok_or_else(unbegun)?;
        if !last {
            return Ok(training.metrics.now());
        }
        let seen = training.work.output_reader().seen_keys();
        training.metrics.last(&seen)
    }

    fn stop(&mut self) {
        if let Some(process) = self.training.as_mut().and_then(|it| it.work.process()) {
            process.stop();
        }
    }

    fn output(&self) -> Option<Vec<u8>> {
        let output_reader = self.training.as_ref()?.work.output_reader();
        Some(output_reader.captured()).filter(|said| !said.is_empty())
    }
}

impl Training {
    fn advance(&mut self, wait: Duration) -> Result<Advance, Error> {
        let Some(process) = self.work.process().filter(|_| !self.has_ended) else {
            return Ok(Advance::Ended);
        };
        let mut left = wait;
        loop {
            if let Some(asked) = self.link.as_mut().map(Link::asked).transpose()?.flatten() {
                return Ok(Advance::Asks(asked));
            }
            let now = if self.link.is_some() { left.min(LOOK) } else { left };
            if let Some(ended) = process.ends_within(now) {
                self.has_ended = true;
                return ended.map(|()| Advance::Ended);
            }
            left = left.saturating_sub(now);
            if left.is_zero() {
                let heard = process.has_heard();
                return Ok(Advance::Running { heard });
            }
        }
    }

    /// The program's actions for these rows. Where the program ended instead, its end is the error.
    fn act(&mut self, rows: &[&[f64]], columns: usize) -> Result<Vec<Vec<f64>>, Error> {
        let link = self.link.as_mut().ok_or_else(not_asked)?;
        let error = match link.act(rows, columns) {
            Err(error @ Error::Model { .. }) => error,
            answered => return answered,
        };
        let mut left = LEAVES_WITHIN;
        while !left.is_zero() && !link.is_asked_again() {
            if let Some(ended) = self.work.process().and_then(|it| it.ends_within(LOOK)) {
                self.has_ended = true;
                return Err(ended.err().unwrap_or(error));
            }
            left = left.saturating_sub(LOOK);
        }
        Err(error)
    }
}

impl ProgramAgent {
    /// The words of the command, with those that are added for a restart from a checkpoint.
    fn words(&self, of: &Assignment, place: &WorkingFolder, goes_on: bool) -> Result<Vec<String>, Error> {
        let (checkpoint, parameters) = (place.checkpoint(), place.parameters());
        let known = WordValues {
            assignment: of,
            parameters: &self.config.parameters,
            inputs: &place.inputs,
            folder: &place.folder,
            checkpoint: &checkpoint,
            parameters_file: &parameters,
        };
        let mut words = filled("run", &self.run, &known)?;
        if goes_on {
            words.extend(filled("resume", &self.resume, &known)?);
        }
        Ok(words)
    }
}

/// Puts this machine's interpreter before the words. A relative path is resolved from the folder where the
/// study was started, and not from the working folder.
pub fn started(config: &ProgramConfig, mut words: Vec<String>) -> Result<Vec<String>, Error> {
    let own = &config.interpreter;
    if own.is_empty() {
        return Ok(words);
    }
    let path = if own.contains('/') {
        std::path::absolute(own).map_err(Error::file("find", Path::new(own)))?
    } else {
        PathBuf::from(own)
    };
    if let Some(first) = words.first_mut() {
        *first = path.display().to_string();
    }
    Ok(words)
}

/// The error of an action that ends a trial as `nan`.
pub fn not_finite(what: &str, decisions: u64, value: f64) -> Error {
    Error::NotFinite {
        what: format!("{what} (counted in its decisions)"),
        step: decisions,
        value,
    }
}

fn not_asked() -> Error {
    Error::Mismatch {
        agent: "program",
        problem: "it trains and measures itself, and is not asked for actions".into(),
    }
}

fn unbegun() -> Error {
    Error::config("run", "the program was not started")
}

/// Counts the attempts of a trial in its working folder, this one included.
fn attempt(place: &WorkingFolder, has_ended: bool) -> Result<u64, Error> {
    let path = place.notes().join("attempts");
    let before = fs::read_to_string(&path)
        .ok()
        .and_then(|text| text.trim().parse().ok());
    let before: u64 = before.unwrap_or(0);
    if has_ended {
        return Ok(before);
    }
    fs::create_dir_all(place.notes()).map_err(Error::file("create", &path))?;
    fs::write(&path, (before + 1).to_string()).map_err(Error::file("write", &path))?;
    Ok(before + 1)
}
