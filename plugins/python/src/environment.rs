//! The environment `python`: one block in the shared memory of a server.

use crate::{
    PythonConfig, interface,
    making::MakeRequest,
    process::Answer,
    server::{self, Request, Server, SharedServer, prefixed},
};
use base64::{Engine as _, engine::general_purpose::STANDARD};
use contract::{Channel, End, Environment, Error, Metric, Rng, Seat, Space, Step, exact};
use rand::Rng as _;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::{
    collections::BTreeMap,
    sync::{Mutex, PoisonError},
};

/// Environments that passed their rehearsal in this process, with the doubts about each. They are kept because a study
/// is read several times.
static REHEARSED: Mutex<BTreeMap<String, Vec<String>>> = Mutex::new(BTreeMap::new());

/// An environment in Python.
#[derive(Debug)]
pub struct PythonEnvironment {
    config: PythonConfig,
    request: MakeRequest,
    server: SharedServer,
    slot: usize,
    seats: Vec<Seat>,
    state_channels: Vec<Channel>,
    metrics: Vec<Metric>,
    /// Whether no episode has begun yet; another environment may have used the block before.
    is_new: bool,
    /// Whether the request for the next step already lies in shared memory.
    announced: bool,
    /// Last observations of the seats.
    seen: Vec<Vec<f64>>,
    /// Full state at the last observations.
    state: Vec<f64>,
    /// Steps so far in the episode.
    steps: u64,
    numbers: Vec<f64>,
}

/// Builds the environment; registered as `python`.
///
/// # Errors
/// [`Error::Config`] for missing keys and for refusals of Python.
pub fn build(config: PythonConfig) -> Result<Box<dyn Environment>, Error> {
    let request = config.request()?;
    let server = server::shared(&config.interpreter, &request)?;
    let (slot, seats, state_channels, names) = {
        let mut server = server::lock(&server);
        let slot = server.open()?;
        (
            slot,
            server.seats().to_vec(),
            server.state().to_vec(),
            server.metrics().to_vec(),
        )
    };
    // The reductions of each seat's metrics, in their order.
    let taken = config.metrics.values().cycle();
    let metrics = names
        .iter()
        .zip(taken)
        .map(|(name, taken)| taken.named(name))
        .collect();
    Ok(Box::new(PythonEnvironment {
        config,
        request,
        server,
        slot,
        seen: seats
            .iter()
            .map(|seat| vec![f64::NAN; seat.observation.len()])
            .collect(),
        state: vec![f64::NAN; state_channels.len()],
        seats,
        state_channels,
        metrics,
        is_new: true,
        announced: false,
        steps: 0,
        numbers: Vec::new(),
    }))
}

impl PythonEnvironment {
    /// Splits the answer in shared memory: the end of the episode, the rewards and the metrics are returned,
    /// observations and state are kept.
    fn take_answer(&mut self) -> Result<(Option<End>, Vec<f64>, Vec<f64>), Error> {
        server::lock(&self.server).answer(self.slot, &mut self.numbers)?;
        self.is_finite()?;
        let (head, mut rest) = self.numbers.split_at(1 + self.seats.len());
        for (seat, seen) in self.seats.iter().zip(&mut self.seen) {
            let (own, after) = rest.split_at(seat.observation.len());
            seen.copy_from_slice(own);
            rest = after;
        }
        let (state, values) = rest.split_at(self.state.len());
        self.state.copy_from_slice(state);
        // The codes of `server.py`.
        let end = match head[0] {
            1.0 => Some(End::Terminated),
            2.0 => Some(End::Truncated),
            _ => None,
        };
        Ok((end, head[1..].to_vec(), values.to_vec()))
    }

    fn is_finite(&self) -> Result<(), Error> {
        let Some(entry) = self.numbers.iter().position(|value| !value.is_finite()) else {
            return Ok(());
        };
        let name = server::lock(&self.server).name_of(entry);
        let made = self.config.make.in_words();
        Err(Error::NotFinite {
            what: format!("`{name}` of `{made}` (counted in its episode)"),
            step: self.steps,
            value: self.numbers[entry],
        })
    }
}

/// Saved state of an environment; `Err` with the reason if pickling would not continue it identically.
#[derive(Debug, Serialize, Deserialize)]
struct SavedEnvironment {
    state: Result<String, String>,
    steps: u64,
    #[serde(with = "exact")]
    seen: Vec<Vec<f64>>,
    /// Absent in checkpoints of environments without a full state.
    #[serde(with = "exact", default, skip_serializing_if = "Vec::is_empty")]
    full: Vec<f64>,
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

    fn begin_step(&mut self, actions: &[Vec<f64>]) -> Result<(), Error> {
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
            self.begin_step(actions)?;
            self.announced = false;
        }
        self.steps += 1;
        let (end, rewards, values) = self.take_answer()?;
        let names = self.metrics.iter().map(|metric| metric.name.clone());
        Ok(Step::new(self.seen.clone(), rewards, end).record_all(names.zip(values)))
    }

    fn rehearse(&mut self) -> Result<Option<Vec<Error>>, Error> {
        let key = self.request.key()?;
        let known = || REHEARSED.lock().unwrap_or_else(PoisonError::into_inner);
        let doubt = |text: &String| Error::config("make", text.clone());
        if let Some(doubts) = known().get(&key) {
            return Ok(Some(doubts.iter().map(doubt).collect()));
        }
        let mut server = server::lock(&self.server);
        let first = server.rehearse()?;
        let again = server.rehearse()?;
        // Values that an import drew or read from the clock differ only between processes.
        let elsewhere = Server::start(&self.config.interpreter, &self.request)?.rehearse()?;
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
        let doubts = server.doubts()?;
        let found = doubts.iter().map(doubt).collect();
        known().insert(key, doubts);
        Ok(Some(found))
    }

    fn metrics(&self) -> &[Metric] {
        &self.metrics
    }

    fn state_channels(&self) -> Vec<Channel> {
        self.state_channels.clone()
    }

    fn state(&self) -> Vec<f64> {
        self.state.clone()
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
            // Environments in Python observe boxes only.
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
            // The next step reports the error.
            Err(error) => Err(error.to_string()),
        };
        json!(SavedEnvironment {
            state,
            steps: self.steps,
            seen: self.seen.clone(),
            full: self.state.clone(),
        })
    }

    fn restore(&mut self, snapshot: &Value) -> Result<(), Error> {
        let misfit = |problem: String| Error::Checkpoint {
            what: "python",
            problem,
        };
        let saved = SavedEnvironment::deserialize(snapshot).map_err(|source| misfit(source.to_string()))?;
        let state = saved.state.map_err(misfit)?;
        let state = STANDARD
            .decode(state)
            .map_err(|source| misfit(source.to_string()))?;
        match server::lock(&self.server).restore(self.slot, &state)? {
            Answer::Done(_) => {}
            Answer::Cannot(problem) | Answer::Failed(problem) => return Err(misfit(problem)),
        }
        if saved.full.len() != self.state.len() {
            return Err(misfit(format!("its full state has {} entries", saved.full.len())));
        }
        (self.seen, self.state) = (saved.seen, saved.full);
        (self.steps, self.is_new) = (saved.steps, false);
        Ok(())
    }
}

impl Drop for PythonEnvironment {
    fn drop(&mut self) {
        server::lock(&self.server).close(self.slot);
    }
}
