//! Frame of the agents that propose designs from the values of earlier designs, without networks. A
//! [`Method`] chooses the next design.

use super::checkpoint;
use super::designs::{EvaluatedDesign, PartialDesign, best, choices, random_design};
use contract::{
    Action, Agent, Choice, Error, Interface, Mode, Observation, Recorder, Rng, Transition, Updates, choice,
};
use numerics::tensor_file::TensorFile;
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use std::path::Path;

/// Rule that chooses the next design.
pub trait Method: Send + 'static {
    /// Name under which the agent is registered.
    const NAME: &'static str;
    /// State of the search besides the [history](SearchHistory).
    type State: Default + Clone + Send + Serialize + DeserializeOwned;

    /// Options of the next step of the unfinished design, one per choice.
    fn propose(&self, history: &SearchHistory, state: &mut Self::State, rng: &mut Rng) -> Vec<usize>;

    /// Records metrics after a step; `whole` where the step completed a design, which is then the last of the
    /// evaluated ones.
    fn record_step(&self, history: &SearchHistory, state: &Self::State, whole: bool, record: &mut Recorder);

    /// Number of designs or steps that were proposed from the history, and of transitions before the first of
    /// them.
    fn updates(&self, state: &Self::State) -> Updates;
}

/// Choices and designs of a search so far.
#[derive(Debug, Clone)]
pub struct SearchHistory {
    /// Choices of every step.
    pub choices: Vec<Choice>,
    /// Design whose episode is not over.
    pub under_way: PartialDesign,
    /// Complete designs in the order of their evaluation.
    pub tried: Vec<EvaluatedDesign>,
}

/// Agent around a [`Method`]. In evaluation it makes the best design so far, and takes random steps beyond
/// its end.
#[derive(Debug, Clone)]
pub struct Proposer<M: Method> {
    method: M,
    history: SearchHistory,
    state: M::State,
    /// Number of steps made so far of the design in evaluation.
    scored: usize,
}

/// Content of the agent's checkpoint.
#[derive(Serialize, Deserialize)]
struct Checkpoint<S> {
    under_way: PartialDesign,
    tried: Vec<EvaluatedDesign>,
    state: S,
}

impl<M: Method> Proposer<M> {
    /// Builds the agent for one seat that chooses among options.
    ///
    /// # Errors
    /// [`Error::Mismatch`] for any other seat.
    pub fn new(method: M, interface: &Interface) -> Result<Self, Error> {
        let history = SearchHistory {
            choices: choices(M::NAME, interface)?,
            under_way: PartialDesign::default(),
            tried: Vec::new(),
        };
        Ok(Self {
            method,
            history,
            state: M::State::default(),
            scored: 0,
        })
    }

    fn best_so_far(&mut self, rng: &mut Rng) -> Vec<usize> {
        let taken = best(&self.history.tried).and_then(|best| best.options.get(self.scored));
        self.scored += 1;
        taken
            .cloned()
            .unwrap_or_else(|| random_design(&self.history.choices, rng))
    }
}

impl<M: Method> Agent for Proposer<M> {
    fn act(&mut self, observations: &[Observation], mode: Mode, rng: &mut Rng) -> Result<Vec<Action>, Error> {
        let mut row = |_| {
            let taken = match mode {
                Mode::Train => self.method.propose(&self.history, &mut self.state, rng),
                Mode::Evaluate => self.best_so_far(rng),
            };
            vec![choice::vector(&self.history.choices, &taken)]
        };
        Ok(observations.iter().map(&mut row).collect())
    }

    fn learn(&mut self, transitions: &[Transition], _: &mut Rng, record: &mut Recorder) -> Result<(), Error> {
        for transition in transitions {
            let whole = self.history.under_way.take(&self.history.choices, transition)?;
            let ended = whole.is_some();
            self.history.tried.extend(whole);
            self.method.record_step(&self.history, &self.state, ended, record);
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
        let stored = Checkpoint {
            under_way: self.history.under_way.clone(),
            tried: self.history.tried.clone(),
            state: self.state.clone(),
        };
        checkpoint::write(M::NAME, dir, TensorFile::default(), &stored)
    }

    fn load(&mut self, dir: &Path) -> Result<(), Error> {
        let (_, stored): (_, Checkpoint<M::State>) = checkpoint::read(M::NAME, dir)?;
        (self.history.under_way, self.history.tried) = (stored.under_way, stored.tried);
        self.state = stored.state;
        Ok(())
    }
}
