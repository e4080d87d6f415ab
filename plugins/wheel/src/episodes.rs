//! Environments of one config side by side, each in an episode of its own, and what becomes of those that ended.

use crate::{
    config::Configured,
    layout::{Layout, standing},
    refusal::Refusal,
    spaces,
};
use contract::{Action, End, Environment, Error, Phase, Rng, Seat, random};
use serde_json::Value;

/// When an episode that ended gives place to the next one, as Gymnasium names it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Autoreset {
    /// When `reset` is called.
    Disabled,
    /// In the step after its last, whose action is passed over.
    NextStep,
    /// In its last step, which keeps what was observed last beside the start of the next one.
    SameStep,
}

/// Where the random numbers of an episode come from.
#[derive(Debug, Clone, Copy)]
pub struct Start {
    /// The seed of a new stream; the stream goes on where there is none.
    pub seed: Option<u64>,
    /// Which episode of the final measurement of a trial with that seed; without it the stream is that of a rollout.
    pub episode: Option<u64>,
    /// Which of the environments that a trial with that seed learns in.
    pub slot: Option<u64>,
}

/// Environments side by side.
pub struct Episodes {
    places: Vec<Place>,
    configured: Configured,
    /// What an environment is that never stepped.
    fresh: Value,
    seats: Vec<Seat>,
    autoreset: Autoreset,
    layout: Layout,
}

struct Place {
    environment: Box<dyn Environment>,
    seed: Option<u64>,
    rng: Option<Rng>,
    stage: Stage,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    /// Nothing to step: it never began, or a step failed.
    Idle,
    UnderWay,
    Ended,
}

impl Episodes {
    /// As many environments as asked, of which none has begun.
    ///
    /// # Errors
    /// What the environment's constructor refuses.
    pub fn new(configured: Configured, places: usize, autoreset: Autoreset) -> Result<Self, Refusal> {
        let place = |_| {
            Ok::<_, Refusal>(Place {
                environment: configured.build()?,
                seed: None,
                rng: None,
                stage: Stage::Idle,
            })
        };
        let places: Vec<Place> = (0..places).map(place).collect::<Result<_, _>>()?;
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

    /// One of the environments; `None` beyond the last.
    #[must_use]
    pub fn environment(&self, place: usize) -> Option<&dyn Environment> {
        self.places.get(place).map(|place| &*place.environment)
    }

    /// The key of the random streams of a trial.
    #[must_use]
    pub fn stream_id(&self) -> &str {
        &self.configured.stream_id
    }

    /// Where numbers stand in what a step comes to.
    #[must_use]
    pub fn layout(&self) -> Layout {
        self.layout
    }

    /// Numbers of an environment's action.
    #[must_use]
    pub fn n_asked(&self) -> usize {
        self.seats.iter().map(|seat| seat.action.n_asked()).sum()
    }

    /// Begins an episode in every environment and returns what their seats observe.
    ///
    /// # Errors
    /// [`Refusal::NoSeed`] for a stream that is to go on and never began, and what the environment says.
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

    /// Steps every environment once, or begins the next episode where the last one ended and that is asked for, and
    /// returns what [`Layout`] says. After an error no episode is under way any more.
    ///
    /// # Errors
    /// [`Refusal::NoEpisode`], [`Refusal::Length`], and what an environment says of an action.
    pub fn step(&mut self, asked: &[f64]) -> Result<Vec<f64>, Refusal> {
        let stepped = self.step_all(asked);
        if stepped.is_err() {
            self.places.iter_mut().for_each(|place| place.stage = Stage::Idle);
        }
        stepped
    }

    fn step_all(&mut self, asked: &[f64]) -> Result<Vec<f64>, Refusal> {
        let actions = self.told(asked)?;
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

    /// The actions of those that will step, of which each is told; `None` for those that begin.
    fn told(&mut self, asked: &[f64]) -> Result<Vec<Option<Action>>, Refusal> {
        let (found, expected) = (asked.len(), self.layout.places * self.n_asked());
        if found != expected {
            return Err(Refusal::Length { found, expected });
        }
        let (seats, columns, autoreset) = (&self.seats, self.n_asked(), self.autoreset);
        let places = self.layout.places;
        let of_one = |(number, place): (usize, &mut Place)| match place.stage {
            Stage::UnderWay => {
                let own = &asked[number * columns..(number + 1) * columns];
                let action = spaces::actions(seats, own).map_err(|error| of_place(error, number, places))?;
                place.environment.announce(&action)?;
                Ok(Some(action))
            }
            Stage::Ended if autoreset == Autoreset::NextStep => Ok(None),
            Stage::Idle | Stage::Ended => Err(Refusal::NoEpisode { place: number }),
        };
        self.places.iter_mut().enumerate().map(of_one).collect()
    }

    /// Begins the next episode wherever one just ended, and keeps what was observed last.
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

impl Place {
    /// Makes the environment as it was before its first episode: some carry something over from one to the next,
    /// as where a solver begins.
    fn renew(&mut self, configured: &Configured, fresh: &Value) -> Result<(), Refusal> {
        if self.environment.restore(fresh).is_err() {
            // What is written in Python may refuse to be restored.
            self.environment = configured.build()?;
        }
        Ok(())
    }

    /// Opens the stream that is asked for.
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

/// Vectors one after the other.
fn write(target: &mut [f64], vectors: &[Vec<f64>]) {
    target
        .iter_mut()
        .zip(vectors.iter().flatten())
        .for_each(|(place, value)| *place = *value);
}

/// An action that is refused, with the environment that refuses it where there are several.
fn of_place(error: Error, number: usize, places: usize) -> Error {
    match error {
        Error::Action { problem } if places > 1 => Error::Action {
            problem: format!("environment {number}: {problem}"),
        },
        other => other,
    }
}
