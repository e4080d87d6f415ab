//! The environment `python`: one block of a server.

use crate::{
    PythonConfig, interface,
    process::Answer,
    server::{self, Request, Server, Shared, prefixed},
};
use base64::{Engine as _, engine::general_purpose::STANDARD};
use engine::{Channel, End, Environment, Error, Rng, Seat, Space, Step, checkpoint::exact};
use rand::Rng as _;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::{
    collections::BTreeSet,
    sync::{Mutex, PoisonError},
};

/// What was rehearsed well in this process: a study is read more than once.
static REHEARSED: Mutex<BTreeSet<String>> = Mutex::new(BTreeSet::new());

/// An environment in Python.
#[derive(Debug)]
pub struct PythonEnvironment {
    config: PythonConfig,
    told: Value,
    server: Shared,
    slot: usize,
    seats: Vec<Seat>,
    /// False until its first episode: another one had its block before.
    is_new: bool,
    /// True where its next step lies in shared memory.
    announced: bool,
    /// What the seats saw last.
    seen: Vec<Vec<f64>>,
    /// Steps of the episode.
    steps: u64,
    numbers: Vec<f64>,
}

/// Builds the environment; registered as `python`.
///
/// # Errors
/// [`Error::Config`] for what the config lacks and for what Python refuses.
pub fn build(config: PythonConfig) -> Result<Box<dyn Environment>, Error> {
    let told = config.told()?;
    let server = server::shared(&config.interpreter, &told)?;
    let (slot, seats) = {
        let mut server = server::lock(&server);
        (server.open()?, server.seats().to_vec())
    };
    Ok(Box::new(PythonEnvironment {
        config,
        told,
        server,
        slot,
        seen: seats
            .iter()
            .map(|seat| vec![f64::NAN; seat.observation.len()])
            .collect(),
        seats,
        is_new: true,
        announced: false,
        steps: 0,
        numbers: Vec::new(),
    }))
}

impl PythonEnvironment {
    /// Takes the answer that lies in shared memory apart: how the episode stands and the rewards; observations are
    /// kept.
    fn take_answer(&mut self) -> Result<(Option<End>, Vec<f64>), Error> {
        server::lock(&self.server).answer(self.slot, &mut self.numbers)?;
        let (head, mut rest) = self.numbers.split_at(1 + self.seats.len());
        for (seat, seen) in self.seats.iter().zip(&mut self.seen) {
            let (own, after) = rest.split_at(seat.observation.len());
            seen.copy_from_slice(own);
            rest = after;
        }
        self.is_finite()?;
        // As in `server.py`.
        let end = match self.numbers[0] {
            1.0 => Some(End::Terminated),
            2.0 => Some(End::Truncated),
            _ => None,
        };
        Ok((end, head[1..].to_vec()))
    }

    fn is_finite(&self) -> Result<(), Error> {
        let rewards = &self.numbers[1..=self.seats.len()];
        for (at, seat) in self.seats.iter().enumerate() {
            let named = |entry: Option<usize>| match entry {
                None => prefixed(seat, "reward"),
                Some(entry) => prefixed(seat, &seat.observation.names()[entry]),
            };
            let wrong = |value: &f64| !value.is_finite();
            let entry = self.seen[at].iter().position(wrong);
            let found = entry.map(|entry| (Some(entry), self.seen[at][entry]));
            let found = found.or_else(|| Some((None, rewards[at])).filter(|(_, value)| wrong(value)));
            if let Some((entry, value)) = found {
                let what = format!(
                    "`{}` of `{}` (counted in its episode)",
                    named(entry),
                    self.config.make.in_words()
                );
                let step = self.steps;
                return Err(Error::NotFinite { what, step, value });
            }
        }
        Ok(())
    }
}

/// What is kept of an environment: nothing from which to go on where it cannot be pickled to the same continuation.
#[derive(Debug, Serialize, Deserialize)]
struct Saved {
    state: Result<String, String>,
    steps: u64,
    #[serde(with = "exact")]
    seen: Vec<Vec<f64>>,
}

impl Environment for PythonEnvironment {
    fn seats(&self) -> &[Seat] {
        &self.seats
    }

    fn reset(&mut self, rng: &mut Rng) -> Result<Vec<Vec<f64>>, Error> {
        let what = if self.is_new {
            Request::Renew
        } else {
            Request::Reset
        };
        (self.is_new, self.announced, self.steps) = (false, false, 0);
        server::lock(&self.server).request(self.slot, what, rng.random(), &[])?;
        self.take_answer()?;
        Ok(self.seen.clone())
    }

    fn announce(&mut self, actions: &[Vec<f64>]) -> Result<(), Error> {
        if actions.len() != self.seats.len() {
            let problem = format!("{} seats in place of {}", actions.len(), self.seats.len());
            return Err(Error::Action { problem });
        }
        let mut numbers = Vec::new();
        for (seat, action) in self.seats.iter().zip(actions) {
            interface::asked(seat, action, &mut numbers)?;
        }
        server::lock(&self.server).request(self.slot, Request::Step, 0, &numbers)?;
        self.announced = true;
        Ok(())
    }

    fn step(&mut self, actions: &[Vec<f64>], _rng: &mut Rng) -> Result<Step, Error> {
        if !std::mem::take(&mut self.announced) {
            self.announce(actions)?;
            self.announced = false;
        }
        self.steps += 1;
        let (end, rewards) = self.take_answer()?;
        Ok(Step {
            observations: self.seen.clone(),
            rewards,
            info: Vec::new(),
            end,
        })
    }

    fn rehearse(&mut self) -> Result<(), Error> {
        let key = self.told.to_string();
        let known = || REHEARSED.lock().unwrap_or_else(PoisonError::into_inner);
        if known().contains(&key) {
            return Ok(());
        }
        let mut server = server::lock(&self.server);
        let first = server.rehearse()?;
        let again = server.rehearse()?;
        // What an import drew or read from the clock differs only between processes.
        let elsewhere = Server::start(&self.config.interpreter, &self.told)?.rehearse()?;
        for (other, place) in [(again, "in one process"), (elsewhere, "in another process")] {
            if let Some(difference) = server.difference(&first, &other) {
                let problem = format!(
                    "`reset(seed)` and ten steps do not give the same the second time, {place}: {difference}. All that \
                     it draws must come from the seed that `reset` is given, as `self.np_random` of a gymnasium.Env \
                     does"
                );
                return Err(Error::config("make", problem));
            }
        }
        known().insert(key);
        Ok(())
    }

    fn trace_channels(&self) -> Vec<Channel> {
        let of_seat = |seat: &Seat| match &seat.observation {
            Space::Box(channels) => {
                let named = channels.iter().map(|it| Channel {
                    name: prefixed(seat, &it.name),
                    ..it.clone()
                });
                named.collect::<Vec<_>>()
            }
            // Python gives out boxes alone.
            _ => Vec::new(),
        };
        self.seats.iter().flat_map(of_seat).collect()
    }

    fn trace(&self) -> Vec<f64> {
        self.seen.concat()
    }

    fn snapshot(&self) -> Value {
        let answer = server::lock(&self.server).snapshot(self.slot);
        let state = match answer {
            Ok(Answer::Done(state)) => Ok(STANDARD.encode(state)),
            Ok(Answer::Cannot(problem) | Answer::Failed(problem)) => Err(problem),
            // It shows at the next step.
            Err(error) => Err(error.to_string()),
        };
        json!(Saved {
            state,
            steps: self.steps,
            seen: self.seen.clone(),
        })
    }

    fn restore(&mut self, snapshot: &Value) -> Result<(), Error> {
        let misfit = |problem: String| Error::Checkpoint {
            what: "python",
            problem,
        };
        let saved = Saved::deserialize(snapshot).map_err(|source| misfit(source.to_string()))?;
        let state = saved.state.map_err(misfit)?;
        let state = STANDARD
            .decode(state)
            .map_err(|source| misfit(source.to_string()))?;
        match server::lock(&self.server).restore(self.slot, &state)? {
            Answer::Done(_) => {}
            Answer::Cannot(problem) | Answer::Failed(problem) => return Err(misfit(problem)),
        }
        (self.seen, self.steps, self.is_new) = (saved.seen, saved.steps, false);
        Ok(())
    }
}

impl Drop for PythonEnvironment {
    fn drop(&mut self) {
        server::lock(&self.server).close(self.slot);
    }
}
