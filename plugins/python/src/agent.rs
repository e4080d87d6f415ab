//! The agent `python`: a user's rule or learner in a Python process of the same server that runs environments.
//!
//! Every call announces its numbers with one byte ([`Process::ask`]): it sends the observations of all rows, and gets
//! actions back. Random numbers come from the trial's streams: one seed at construction and one with every call.

use crate::{
    AgentConfig,
    making::MakeRequest,
    process::{Answer, Process, failed},
    rehearsal, seats, server,
};
use contract::{
    Action, Agent, End, Environment, Error, Interface, Mode, Observation, Recorder, Rng, Transition, Updates,
    artifact::SAVED_FILE,
};
use execution::patience::Watch;
use rand::Rng as _;
use serde::Deserialize;
use std::{
    fs,
    path::Path,
    sync::{Mutex, MutexGuard, PoisonError},
};
use tempfile::TempDir;

const NAME: &str = "python";
/// File of a checkpoint: the count of updates, followed by the bytes that `save` returned.
const FILE: &str = "agent.saved";

/// An agent in Python.
#[derive(Debug)]
pub struct PythonAgent {
    config: AgentConfig,
    request: MakeRequest,
    interface: Interface,
    process: Mutex<Process>,
    /// Holds copies of the data files that the agent reads.
    _files: TempDir,
    face: AgentMethods,
    updates: u64,
    decisions: u64,
    /// An error of a method that cannot return one; the next call reports it.
    trouble: Option<Error>,
}

/// Optional methods of an agent, as reported by Python.
#[derive(Debug, Deserialize)]
struct AgentMethods {
    /// Whether it has `save` and `load`.
    saves: bool,
    /// Whether it has `restart`.
    restarts: bool,
}

/// Builds the agent; registered as `python`.
///
/// # Errors
/// [`Error::Config`] for missing keys and for refusals of Python; [`Error::Unavailable`] where this machine
/// lacks an interpreter or a package.
pub fn build(config: AgentConfig, interface: &Interface, rng: &mut Rng) -> Result<Box<dyn Agent>, Error> {
    let request = config.request(seats::described(&interface.seats), rng.random())?;
    Ok(Box::new(PythonAgent::made(config, request, interface)?))
}

impl PythonAgent {
    fn made(config: AgentConfig, request: MakeRequest, interface: &Interface) -> Result<Self, Error> {
        let (files, asked) = server::with_own_files(&request)?;
        let text = asked.to_string();
        let (process, answer) = Process::start(&config.interpreter, files.path(), "agent", text.as_bytes())?;
        Ok(Self {
            config,
            request,
            interface: interface.clone(),
            process: Mutex::new(process),
            _files: files,
            face: server::face_in(answer)?,
            updates: 0,
            decisions: 0,
            trouble: None,
        })
    }

    /// Makes the same agent again, in a process of its own.
    ///
    /// # Errors
    /// The errors of [`build`].
    pub fn again(&self) -> Result<Self, Error> {
        Self::made(self.config.clone(), self.request.clone(), &self.interface)
    }

    /// Watches the process during a rehearsal.
    pub fn watch(&self) -> Watch {
        self.process().watch("the rehearsal of the agent with")
    }

    /// Whether the agent is trained.
    pub fn learns(&self) -> bool {
        self.config.learns
    }

    /// Whether the agent can continue from a saved state.
    pub fn saves(&self) -> bool {
        self.face.saves
    }

    fn process(&self) -> MutexGuard<'_, Process> {
        // A panic elsewhere ends the trial, and the process with it.
        self.process.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn ask(&self, what: u8, text: &[u8]) -> Result<Vec<u8>, Error> {
        match self.process().ask(Some(what), text)? {
            Answer::Done(bytes) => Ok(bytes),
            Answer::Cannot(problem) | Answer::Failed(problem) => Err(failed(problem)),
        }
    }

    fn ask_numbers(&self, what: u8, numbers: &[f64]) -> Result<Vec<f64>, Error> {
        let bytes = self.ask(what, bytemuck::cast_slice(numbers))?;
        Ok(bytemuck::pod_collect_to_vec(&bytes))
    }

    /// The number of updates and the saved state, in the form of the checkpoint file.
    fn saved(&self) -> Result<Vec<u8>, Error> {
        let state = self.ask(b'p', &[])?;
        Ok([&self.updates.to_le_bytes()[..], &state].concat())
    }

    fn take_up(&mut self, saved: &[u8]) -> Result<(), Error> {
        let misfit = |problem: String| Error::Checkpoint { what: NAME, problem };
        let (updates, state) = saved
            .split_first_chunk()
            .ok_or_else(|| misfit("it is too short".into()))?;
        self.ask(b'r', state).map_err(|error| match error {
            Error::Model { problem, .. } => misfit(problem),
            other => other,
        })?;
        self.updates = u64::from_le_bytes(*updates);
        Ok(())
    }

    /// Converts the numbers from Python to the actions of all rows.
    fn actions(&self, numbers: &[f64]) -> Result<Vec<Action>, Error> {
        let seats = &self.interface.seats;
        let rows = numbers.chunks(seats::n_asked(seats).max(1));
        rows.map(|row| {
            seats::action(seats, row)?.map_err(|(what, value)| Error::NotFinite {
                what: format!(
                    "{what} of `{}` (counted in its decisions)",
                    self.config.make.in_words()
                ),
                step: self.decisions,
                value,
            })
        })
        .collect()
    }
}

impl Agent for PythonAgent {
    fn act(&mut self, observations: &[Observation], mode: Mode, rng: &mut Rng) -> Result<Vec<Action>, Error> {
        if let Some(trouble) = self.trouble.take() {
            return Err(trouble);
        }
        let explore = if mode == Mode::Train { 1.0 } else { 0.0 };
        let mut numbers = vec![explore, f64::from(rng.random::<u32>())];
        observations.iter().for_each(|row| see(row, &mut numbers));
        let answer = self.ask_numbers(b'a', &numbers)?;
        self.decisions += observations.len() as u64;
        self.actions(&answer)
    }

    fn learn(
        &mut self,
        transitions: &[Transition],
        rng: &mut Rng,
        record: &mut Recorder,
    ) -> Result<(), Error> {
        if !self.config.learns {
            return Ok(());
        }
        let mut numbers = vec![f64::from(rng.random::<u32>())];
        for transition in transitions {
            see(&transition.observation, &mut numbers);
            seats::asked(&self.interface.seats, &transition.action, &mut numbers)?;
            numbers.extend(&transition.rewards);
            see(&transition.next_observation, &mut numbers);
            // The codes of `agents.py`.
            numbers.push(match transition.end {
                None => 0.0,
                Some(End::Terminated) => 1.0,
                Some(End::Truncated) => 2.0,
            });
        }
        let answer = self.ask_numbers(b'l', &numbers)?;
        let (made, recorded) = answer
            .split_first()
            .ok_or_else(|| failed("`learn` was not answered".into()))?;
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "Python sends a count"
        )]
        let made = (*made >= 0.0).then_some(*made as u64);
        self.updates = made.unwrap_or(self.updates + 1);
        for (name, value) in self.config.metrics.iter().zip(recorded.chunks(2)) {
            if let [1.0, value] = value {
                record.mean(name, *value);
            }
        }
        Ok(())
    }

    fn updates(&self) -> Option<Updates> {
        self.config.learns.then_some(Updates {
            made: self.updates,
            first_after: 1,
        })
    }

    fn rehearse(
        &mut self,
        make_environment: &dyn Fn() -> Result<Box<dyn Environment>, Error>,
    ) -> Result<bool, Error> {
        rehearsal::rehearse(self, make_environment)?;
        Ok(true)
    }

    fn remembers(&self) -> bool {
        self.face.restarts
    }

    fn restart(&mut self) {
        if self.face.restarts {
            self.trouble = self.ask(b'x', &[]).err();
        }
    }

    fn save(&self, dir: &Path) -> Result<(), Error> {
        if !self.face.saves {
            return Ok(());
        }
        let path = dir.join(FILE);
        fs::write(&path, self.saved()?).map_err(Error::file("write", &path))
    }

    fn load(&mut self, dir: &Path) -> Result<(), Error> {
        if !self.face.saves {
            let made = self.config.make.in_words();
            return Err(Error::Checkpoint {
                what: NAME,
                problem: format!("`{made}` has no `save` and `load` by which it could go on"),
            });
        }
        let path = dir.join(FILE);
        let saved = fs::read(&path).map_err(|source| Error::Checkpoint {
            what: NAME,
            problem: format!("`{FILE}` cannot be read: {source}"),
        })?;
        self.take_up(&saved)
    }

    fn export(&self, dir: &Path) -> Result<bool, Error> {
        if !self.config.learns || !self.face.saves {
            return Ok(false);
        }
        let path = dir.join(SAVED_FILE);
        fs::write(&path, self.saved()?).map_err(Error::file("write", &path))?;
        Ok(true)
    }

    fn import(&mut self, dir: &Path) -> Result<bool, Error> {
        if !self.config.learns || !self.face.saves {
            return Ok(false);
        }
        let path = dir.join(SAVED_FILE);
        let saved = fs::read(&path).map_err(Error::file("read", &path))?;
        self.take_up(&saved)?;
        Ok(true)
    }
}

fn see(observation: &Observation, numbers: &mut Vec<f64>) {
    observation.seats.iter().for_each(|seat| numbers.extend(seat));
}
