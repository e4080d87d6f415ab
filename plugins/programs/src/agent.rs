//! The agent `program`: a program that trains and measures itself.

use crate::{
    ProgramConfig,
    metrics::Metrics,
    process::{self, Process},
    words::{Known, OTHERS, Word, filled, parsed},
    workplace::Workplace,
};
use engine::{
    Action, Agent, Error, Interface, Metric, Mode, Observation, OwnTraining, Rng,
    guard::end_leftover,
    own_training::{Advance, Assignment, Curve, Place},
};
use std::{
    fs,
    path::{Path, PathBuf},
    time::Duration,
};

/// A program as an agent.
#[derive(Debug)]
pub struct ProgramAgent {
    config: ProgramConfig,
    run: Vec<Word>,
    resume: Vec<Word>,
    training: Option<Training>,
}

/// A training that was begun.
#[derive(Debug)]
struct Training {
    metrics: Metrics,
    /// `None` where it had ended before.
    process: Option<Process>,
    has_ended: bool,
}

/// Builds the agent; registered as `program`.
///
/// # Errors
/// [`Error::Config`] for what the config lacks, and for words that cannot be read.
pub fn build(config: ProgramConfig, _: &Interface, _: &mut Rng) -> Result<Box<dyn Agent>, Error> {
    config.check()?;
    let run = parsed("run", &config.run)?;
    let resume = parsed("resume", &config.resume)?;
    let taken = |name: &&String| OTHERS.contains(&name.as_str()) || name.contains(['{', '}', '.']);
    if let Some(name) = config.parameters.keys().find(taken) {
        let problem = format!(
            "`{name}` is no name of a parameter: it stands for something else in the words of a program"
        );
        return Err(Error::config("parameters", problem));
    }
    Ok(Box::new(ProgramAgent {
        config,
        run,
        resume,
        training: None,
    }))
}

impl Agent for ProgramAgent {
    fn act(&mut self, _: &[Observation], _: Mode, _: &mut Rng) -> Result<Vec<Action>, Error> {
        Err(Error::Mismatch {
            agent: "program",
            problem: "it trains and measures itself, and is not asked for actions".into(),
        })
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
        self.words(of, &Workplace::at(Path::new("{folder}"), &self.config), true)
    }

    fn written(&self) -> Vec<String> {
        let mut words = self.config.run.clone();
        if let Some(first) = words.first_mut().filter(|_| !self.config.interpreter.is_empty()) {
            first.clone_from(&self.config.interpreter);
        }
        words
    }

    fn goes_on(&self) -> bool {
        !self.resume.is_empty()
    }

    fn doubts(&self) -> Vec<Error> {
        let words = || self.run.iter().chain(&self.resume);
        let is_used = |name: &str| {
            words()
                .flat_map(Word::names)
                .any(|it| it == name || it == "parameters")
        };
        let unused = self.config.parameters.keys().filter(|name| !is_used(name));
        let doubt = |name: &String| {
            let problem =
                format!("no word of the program has `{{{name}}}`, so that its value changes nothing");
            Error::config(format!("parameters.{name}"), problem)
        };
        unused.map(doubt).collect()
    }

    fn begin(&mut self, of: &Assignment, place: &Place) -> Result<(), Error> {
        let place = Workplace::at(&place.folder, &self.config);
        end_leftover(&place.notes(), process::grace(&self.config));
        let has_ended = process::has_ended_well(&place.notes());
        let goes_on = !self.resume.is_empty() && place.has_checkpoint();
        if !has_ended && !goes_on {
            place.empty()?;
        }
        let attempts = attempt(&place, has_ended)?;
        let metrics = Metrics::of(&self.config, &place.folder, &place.notes(), attempts > 1);
        let process = if has_ended {
            None
        } else {
            place.lay(&self.config)?;
            let words = self.words(of, &place, goes_on)?;
            Some(Process::start(
                &self.config,
                started(&self.config, words)?,
                &place,
            )?)
        };
        self.training = Some(Training {
            metrics,
            process,
            has_ended,
        });
        Ok(())
    }

    fn advance(&mut self, wait: Duration) -> Result<Advance, Error> {
        let training = self.training.as_mut().ok_or_else(unbegun)?;
        let Some(process) = training.process.as_mut().filter(|_| !training.has_ended) else {
            return Ok(Advance::Ended);
        };
        match process.ends_within(wait) {
            None => Ok(Advance::Running {
                heard: process.has_heard(),
            }),
            Some(ended) => {
                training.has_ended = true;
                ended.map(|()| Advance::Ended)
            }
        }
    }

    fn curves(&mut self, last: bool) -> Result<&[Curve], Error> {
        let training = self.training.as_mut().ok_or_else(unbegun)?;
        if !last {
            return Ok(training.metrics.now());
        }
        let seen = training.process.as_ref().map(|it| it.listening().seen());
        training.metrics.last(&seen.unwrap_or_default())
    }

    fn stop(&mut self) {
        if let Some(process) = self.training.as_mut().and_then(|it| it.process.as_mut()) {
            process.stop();
        }
    }

    fn output(&self) -> Option<Vec<u8>> {
        let process = self.training.as_ref()?.process.as_ref()?;
        Some(process.listening().said()).filter(|said| !said.is_empty())
    }
}

impl ProgramAgent {
    /// The words of the command, with those that are added where it goes on.
    fn words(&self, of: &Assignment, place: &Workplace, goes_on: bool) -> Result<Vec<String>, Error> {
        let (checkpoint, parameters) = (place.checkpoint(), place.parameters());
        let known = Known {
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

/// The words with the interpreter of this machine. A relative place is seen from where the study was started,
/// and not from the working folder.
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

fn unbegun() -> Error {
    Error::config("run", "the program was not started")
}

/// Counts the attempts of a trial in its working folder: this one and those before it, whose files are there still.
fn attempt(place: &Workplace, has_ended: bool) -> Result<u64, Error> {
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
