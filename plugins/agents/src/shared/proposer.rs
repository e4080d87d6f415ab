//! An agent that proposes designs by what those that it tried were worth, without networks: the frame around a
//! [`Method`].

use super::checkpoint;
use super::designs::{Tried, UnderWay, best, choices, random_design};
use contract::{
    Action, Agent, Choice, Error, Interface, Mode, Observation, Recorder, Rng, Transition, Updates, choice,
};
use numerics::tensor_file::TensorFile;
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use std::path::Path;

/// How the next design is come by.
pub trait Method: Send + 'static {
    /// The agent's name.
    const NAME: &'static str;
    /// What changes while it searches, besides what is known.
    type State: Default + Clone + Send + Serialize + DeserializeOwned;

    /// The options of the next step of the design under way, one per choice.
    fn propose(&self, known: &Known, state: &mut Self::State, rng: &mut Rng) -> Vec<usize>;

    /// Records what the last step showed; `whole` where it ended a design, which then stands last among those that
    /// were tried.
    fn note(&self, known: &Known, state: &Self::State, whole: bool, record: &mut Recorder);

    /// Designs or steps that were proposed by what is known, and transitions before the first of them.
    fn updates(&self, state: &Self::State) -> Updates;
}

/// What a search knows.
#[derive(Debug, Clone)]
pub struct Known {
    /// What there is to choose.
    pub choices: Vec<Choice>,
    /// The design under way.
    pub under_way: UnderWay,
    /// Whole designs, in the order in which they were tried.
    pub tried: Vec<Tried>,
}

/// The agent. Where it is scored it makes the best design that it has seen, and random steps beyond its end.
#[derive(Debug, Clone)]
pub struct Proposer<M: Method> {
    method: M,
    known: Known,
    state: M::State,
    /// Steps of the design that is made where it is scored.
    scored: usize,
}

/// What is stored of it.
#[derive(Serialize, Deserialize)]
struct Stored<S> {
    under_way: UnderWay,
    tried: Vec<Tried>,
    state: S,
}

impl<M: Method> Proposer<M> {
    /// The agent for one seat that chooses among options.
    ///
    /// # Errors
    /// [`Error::Mismatch`] for any other seat.
    pub fn new(method: M, interface: &Interface) -> Result<Self, Error> {
        let known = Known {
            choices: choices(M::NAME, interface)?,
            under_way: UnderWay::default(),
            tried: Vec::new(),
        };
        Ok(Self {
            method,
            known,
            state: M::State::default(),
            scored: 0,
        })
    }

    fn best_so_far(&mut self, rng: &mut Rng) -> Vec<usize> {
        let taken = best(&self.known.tried).and_then(|best| best.options.get(self.scored));
        self.scored += 1;
        taken
            .cloned()
            .unwrap_or_else(|| random_design(&self.known.choices, rng))
    }
}

impl<M: Method> Agent for Proposer<M> {
    fn act(&mut self, observations: &[Observation], mode: Mode, rng: &mut Rng) -> Result<Vec<Action>, Error> {
        let mut row = |_| {
            let taken = match mode {
                Mode::Train => self.method.propose(&self.known, &mut self.state, rng),
                Mode::Evaluate => self.best_so_far(rng),
            };
            vec![choice::vector(&self.known.choices, &taken)]
        };
        Ok(observations.iter().map(&mut row).collect())
    }

    fn learn(&mut self, transitions: &[Transition], _: &mut Rng, record: &mut Recorder) -> Result<(), Error> {
        for transition in transitions {
            let whole = self.known.under_way.take(&self.known.choices, transition)?;
            let ended = whole.is_some();
            self.known.tried.extend(whole);
            self.method.note(&self.known, &self.state, ended, record);
        }
        Ok(())
    }

    fn updates(&self) -> Option<Updates> {
        Some(self.method.updates(&self.state))
    }

    fn remembers(&self) -> bool {
        true
    }

    fn restart(&mut self) {
        self.scored = 0;
    }

    fn save(&self, dir: &Path) -> Result<(), Error> {
        let stored = Stored {
            under_way: self.known.under_way.clone(),
            tried: self.known.tried.clone(),
            state: self.state.clone(),
        };
        checkpoint::write(M::NAME, dir, TensorFile::default(), &stored)
    }

    fn load(&mut self, dir: &Path) -> Result<(), Error> {
        let (_, stored): (_, Stored<M::State>) = checkpoint::read(M::NAME, dir)?;
        (self.known.under_way, self.known.tried) = (stored.under_way, stored.tried);
        self.state = stored.state;
        Ok(())
    }
}
