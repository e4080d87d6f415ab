//! Rules that decide from the full state alone, as agents.

use contract::{Action, Agent, Error, Mode, Observation, Rng};

/// A rule without memory and chance.
pub trait StateRule: Send {
    /// The action of every seat in a full state.
    fn decide(&self, state: &[f64]) -> Action;
}

/// The agent that does what a rule says. It records nothing.
pub struct Ruled<R>(pub R);

impl<R: StateRule> Agent for Ruled<R> {
    fn act(&mut self, observations: &[Observation], _: Mode, _: &mut Rng) -> Result<Vec<Action>, Error> {
        Ok(observations
            .iter()
            .map(|seen| self.0.decide(&seen.state))
            .collect())
    }

    fn reads_state(&self) -> bool {
        true
    }
}
