//! Environments of one config side by side, each in an episode of its own, and the handling of ended episodes.

use crate::{
    config::ConfiguredEnvironment,
    layout::{Layout, standing},
    refusal::Refusal,
    spaces,
};
use contract::{Action, End, Environment, Error, Phase, Rng, Seat, random};
use serde_json::Value;

/// Start of the episode after an ended one, with Gymnasium's names.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Autoreset {
    /// It begins when `reset` is called.
    Disabled,
    /// It begins in the step after the last one; that step's action is ignored.
    NextStep,
    /// It begins in the last step, which returns both the last observation and that of the new episode's start.
    SameStep,
}

/// Source of an episode's random numbers.
#[derive(Debug, Clone, Copy)]
pub struct Start {
    /// Seed of a new stream; without one the stream continues.
    pub seed: Option<u64>,
    /// Number of an episode in the final measurement of a trial with that seed; without it the stream is that
    /// of a rollout.
    pub episode: Option<u64>,
    /// Number of the environment among those that a trial with that seed learns in.
    pub slot: Option<u64>,
}

/// Environments that are stepped together.
pub struct Episodes {
    places: Vec<SubEnvironment>,
    configured: ConfiguredEnvironment,
    /// Snapshot of the environment before its first episode.
    fresh: Value,
    seats: Vec<Seat>,
    autoreset: Autoreset,
    layout: Layout,
}

struct SubEnvironment {
    environment: Box<dyn Environment>,
    seed: Option<u64>,
    rng: Option<Rng>,
    stage: Stage,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    /// Nothing to step: no episode has begun, or a step failed.
    Idle,
    UnderWay,
    Ended,
}

impl Episodes {
    /// Builds `places` environments that have not begun an episode.
    ///
    /// # Errors
    /// Refusals of the environment's constructor.
    pub fn new(
        configured: ConfiguredEnvironment,
        places: usize,
        autoreset: Autoreset,
    ) -> Result<Self, Refusal> {
        let place = |_| {
            Ok::<_, Refusal>(SubEnvironment {
                environment: configured.build()?,
                seed: None,
                rng: None,
                stage: Stage::Idle,
            })
        };
        let places: Vec<SubEnvironment> = (0..places).map(place).collect::<Result<_, _>>()?;
        let first = places.first().map(|place| &*place.environment);
        let seats = first.map_or_else(Vec::new, |it| it.seats().to_vec());
        let metrics = first.map_or(0, |it| it.metrics().len());
        let fresh = first.map_or(Value::Null, Environment::snapshot);
        let layout = Layout {
            places: places.len(),
            observed: seats.iter().map(|seat| seat.observation.len()).sum(),
            seats: seats.len(),
            metrics,
            keeps_last: autoreset == Autoreset::SameStep,
        };
        Ok(Self {
            places,
            configured,
            fresh,
            seats,
            autoreset,
            layout,
        })
    }

    /// The environment at `place`; `None` beyond the last.
    #[must_use]
    pub fn environment(&self, place: usize) -> Option<&dyn Environment> {
        self.places.get(place).map(|place| &*place.environment)
    }

    /// Key of the random streams of a trial.
    #[must_use]
    pub fn stream_id(&self) -> &str {
        &self.configured.stream_id
    }

    /// Positions of the numbers in the vector that a step returns.
    #[must_use]
    pub fn layout(&self) -> Layout {
        self.layout
    }

    /// Count of numbers in the action of one environment, all seats together.
    #[must_use]
    pub fn n_asked(&self) -> usize {
        self.seats.iter().map(|seat| seat.action.n_asked()).sum()
    }

    /// Begins an episode in every environment and returns the observations of all seats.
    ///
    /// # Errors
    /// [`Refusal::NoSeed`] for a stream that should continue but never began, and errors of the environment.
    pub fn reset(&mut self, starts: &[Start]) -> Result<Vec<f64>, Refusal> {
        let mut numbers = vec![0.0; self.layout.places * self.layout.observed];
        for (number, (place, start)) in self.places.iter_mut().zip(starts).enumerate() {
            if start.seed.is_some() || start.episode.is_some() {
                place.renew(&self.configured, &self.fresh)?;
            }
            place.seek(number, *start, &self.configured.stream_id)?;
            let seats = place.begin(number, start.episode)?;
            write(&mut numbers[self.layout.observations(number)], &seats);
        }
        Ok(numbers)
    }

    /// Steps every environment once, or begins the next episode after an ended one if `autoreset` asks for it; returns
    /// the vector that [`Layout`] describes. After an error no episode is in progress any more.
    ///
    /// # Errors
    /// [`Refusal::NoEpisode`], [`Refusal::Length`], and the environment's errors about an action.
    pub fn step(&mut self, asked: &[f64]) -> Result<Vec<f64>, Refusal> {
        let stepped = self.step_all(asked);
        if stepped.is_err() {
            self.places.iter_mut().for_each(|place| place.stage = Stage::Idle);
        }
        stepped
    }

    fn step_all(&mut self, asked: &[f64]) -> Result<Vec<f64>, Refusal> {
        let actions = self.announce_actions(asked)?;
        let mut numbers = vec![0.0; self.layout.total()];
        for (number, (place, action)) in self.places.iter_mut().zip(actions).enumerate() {
            match action {
                None => {
                    let seats = place.begin(number, None)?;
                    write(&mut numbers[self.layout.observations(number)], &seats);
                    numbers[self.layout.standing(number)] = standing::BEGAN;
                }
                Some(action) => place.step(number, &action, &self.layout, &mut numbers)?,
            }
        }
        if self.autoreset == Autoreset::SameStep {
            self.begin_anew(&mut numbers)?;
        }
        Ok(numbers)
    }

    /// Announces the actions of those environments that will step; `None` stands for those that begin an
    /// episode.
    fn announce_actions(&mut self, asked: &[f64]) -> Result<Vec<Option<Action>>, Refusal> {
        let (found, expected) = (asked.len(), self.layout.places * self.n_asked());
        if found != expected {
            return Err(Refusal::Length { found, expected });
        }
        let (seats, columns, autoreset) = (&self.seats, self.n_asked(), self.autoreset);
        let places = self.layout.places;
        let of_one = |(number, place): (usize, &mut SubEnvironment)| match place.stage {
            Stage::UnderWay => {
                let own = &asked[number * columns..(number + 1) * columns];
                let action = spaces::actions(seats, own).map_err(|error| of_place(error, number, places))?;
                place.environment.begin_step(&action)?;
                Ok(Some(action))
            }
            Stage::Ended if autoreset == Autoreset::NextStep => Ok(None),
            Stage::Idle | Stage::Ended => Err(Refusal::NoEpisode { place: number }),
        };
        self.places.iter_mut().enumerate().map(of_one).collect()
    }

    /// Begins the next episode of every environment whose episode just ended, and keeps its last observations.
    fn begin_anew(&mut self, numbers: &mut [f64]) -> Result<(), Refusal> {
        for (number, place) in self.places.iter_mut().enumerate() {
            if place.stage == Stage::Ended {
                let observed = self.layout.observations(number);
                numbers.copy_within(observed.clone(), self.layout.last_observations(number).start);
                write(&mut numbers[observed], &place.begin(number, None)?);
            }
        }
        Ok(())
    }
}

impl SubEnvironment {
    /// Restores the environment to the state before its first episode, because some environments carry information from
    /// one episode to the next, such as the starting point of a solver.
    fn renew(&mut self, configured: &ConfiguredEnvironment, fresh: &Value) -> Result<(), Refusal> {
        if self.environment.restore(fresh).is_err() {
            // Environments written in Python may refuse to be restored.
            self.environment = configured.build()?;
        }
        Ok(())
    }

    /// Opens the requested random stream.
    fn seek(&mut self, number: usize, start: Start, stream_id: &str) -> Result<(), Refusal> {
        self.seed = start.seed.or(self.seed);
        let seed = self.seed.ok_or(Refusal::NoSeed { place: number })?;
        let of_trial = |phase: Phase, episode| {
            random::Streams::new("", stream_id, seed).environment(phase.name(), episode)
        };
        match (start.episode, start.slot, start.seed) {
            (Some(episode), _, _) => self.rng = Some(of_trial(Phase::Final, episode)),
            (None, Some(slot), _) => self.rng = Some(of_trial(Phase::Train, slot)),
            (None, None, Some(_)) => self.rng = Some(random::rollout(seed)),
            (None, None, None) => {}
        }
        Ok(())
    }

    fn begin(&mut self, number: usize, episode: Option<u64>) -> Result<Vec<Vec<f64>>, Refusal> {
        let rng = self.rng.as_mut().ok_or(Refusal::NoSeed { place: number })?;
        self.stage = Stage::Idle;
        let seats = match episode {
            Some(episode) => self.environment.reset_to(episode, rng)?,
            None => self.environment.reset(rng)?,
        };
        self.stage = Stage::UnderWay;
        Ok(seats)
    }

    fn step(
        &mut self,
        number: usize,
        action: &Action,
        layout: &Layout,
        numbers: &mut [f64],
    ) -> Result<(), Refusal> {
        let rng = self.rng.as_mut().ok_or(Refusal::NoSeed { place: number })?;
        let step = self
            .environment
            .step(action, rng)
            .map_err(|error| of_place(error, number, layout.places))?;
        write(&mut numbers[layout.observations(number)], &step.observations);
        numbers[layout.rewards(number)].copy_from_slice(&step.rewards);
        let metrics = self.environment.metrics().iter();
        for (number, metric) in numbers[layout.metrics(number)].iter_mut().zip(metrics) {
            *number = step.metric(&metric.name).unwrap_or(f64::NAN);
        }
        numbers[layout.standing(number)] = match step.end {
            None => standing::GOES_ON,
            Some(End::Terminated) => standing::TERMINATED,
            Some(End::Truncated) => standing::TRUNCATED,
        };
        if step.end.is_some() {
            self.stage = Stage::Ended;
        }
        Ok(())
    }
}

/// Writes the vectors one after the other.
fn write(target: &mut [f64], vectors: &[Vec<f64>]) {
    target
        .iter_mut()
        .zip(vectors.iter().flatten())
        .for_each(|(place, value)| *place = *value);
}

/// The error of a refused action, with the number of its environment if there are several.
fn of_place(error: Error, number: usize, places: usize) -> Error {
    match error {
        Error::Action { problem } if places > 1 => Error::Action {
            problem: format!("environment {number}: {problem}"),
        },
        other => other,
    }
}
