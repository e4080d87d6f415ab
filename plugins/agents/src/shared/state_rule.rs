//! Agents that follow rules of the full state.

use contract::{Action, Agent, Error, Mode, Observation, Rng};

/// A rule without memory and randomness.
pub trait StateRule: Send {
    /// The action of every seat in a full state.
    fn decide(&self, state: &[f64]) -> Action;
}

/// Agent that follows a rule and records nothing.
pub struct RuleAgent<R>(pub R);

impl<R: StateRule> Agent for RuleAgent<R> {
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
