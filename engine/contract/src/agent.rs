//! The interface of agents: `act`, `learn`, `save`, `load`.

use crate::{Action, End, Environment, Error, Metric, Observation, OwnTraining, Recorder, Rng};
use std::path::Path;

/// Whether actions are for learning (exploration) or for measuring (the best of the policy).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// Actions that gather experience.
    Train,
    /// Actions that are scored.
    Evaluate,
}

/// One step of one environment, for all seats.
#[derive(Debug, Clone, PartialEq)]
pub struct Transition {
    /// Observations of all seats before the step.
    pub observation: Observation,
    /// Actions of all seats in this step.
    pub action: Action,
    /// Rewards of this step, one for each seat.
    pub rewards: Vec<f64>,
    /// Observations of all seats after the step, before any reset.
    pub next_observation: Observation,
    /// Whether the episode ended with this step.
    pub end: Option<End>,
}

/// Counts of the updates of an agent that learns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Updates {
    /// Number of updates that `learn` made, including those before a checkpoint that `load` restored.
    pub made: u64,
    /// Number of transitions that `learn` must have been given before the first update; `u64::MAX` for an agent that
    /// never updates.
    pub first_after: u64,
}

/// A policy for all seats of an environment, and its training.
///
/// A protocol steps several environments together, so `act` and `learn` take one row per environment.
pub trait Agent: Send {
    /// One action per row; rows are independent of each other. An agent that [`remembers`](Self::remembers) gets one
    /// row at a time, the rows of an episode in order.
    ///
    /// # Errors
    /// The policy produced numbers that are no action ([`Error::NotFinite`]).
    fn act(&mut self, observations: &[Observation], mode: Mode, rng: &mut Rng) -> Result<Vec<Action>, Error>;

    /// Takes in one transition per environment and updates when due. Agents that do not learn ignore it.
    ///
    /// # Errors
    /// A loss or a parameter is no longer finite ([`Error::NotFinite`]).
    fn learn(
        &mut self,
        _transitions: &[Transition],
        _rng: &mut Rng,
        _record: &mut Recorder,
    ) -> Result<(), Error> {
        Ok(())
    }

    /// Receives all transitions from which batches will be drawn. A protocol that has them all calls it once, before
    /// the first `learn`. The agent can compute properties of the whole dataset here, such as the spread of its
    /// observations. It is not called again after `load`.
    ///
    /// # Errors
    /// The agent cannot learn from the transitions.
    fn observe_dataset(&mut self, _transitions: &[Transition]) -> Result<(), Error> {
        Ok(())
    }

    /// The training of an agent that trains itself; `None` for agents that a protocol trains.
    fn own_training(&mut self) -> Option<&mut dyn OwnTraining> {
        None
    }

    /// Metrics that an agent which trains itself records.
    fn records(&self) -> Vec<Metric> {
        Vec::new()
    }

    /// Tries out an agent whose code is not part of this program. `check` calls it in environments of its trial before
    /// any trial runs; the agent refuses a config whose trials would fail or could not be repeated. Returns false if
    /// there is nothing to try, as for all code of this program.
    ///
    /// # Errors
    /// A problem that prevents the agent from running, at the key that causes it.
    fn rehearse(
        &mut self,
        _make_environment: &dyn Fn() -> Result<Box<dyn Environment>, Error>,
    ) -> Result<bool, Error> {
        Ok(false)
    }

    /// The operations of one update as text, with their number and the bytes that they move; `None` for agents that do
    /// not learn by a plan. `n_rows` is the size of a batch if the protocol decides it.
    fn plan(&mut self, _n_rows: usize) -> Option<String> {
        None
    }

    /// The updates of an agent that learns; `None` for others.
    fn updates(&self) -> Option<Updates> {
        None
    }

    /// Metrics of decisions that [`Agent::assess`] measures; empty for agents without them.
    fn decision_metrics(&self) -> Vec<Metric> {
        Vec::new()
    }

    /// Measures scored decisions: one row per observation, with `n_seats` values per entry of
    /// [`Agent::decision_metrics`], metric after metric. A measurement records the mean over the decisions of an
    /// episode.
    ///
    /// # Errors
    /// A value cannot be computed.
    fn assess(&mut self, _observations: &[Observation], _actions: &[Action]) -> Result<Vec<Vec<f64>>, Error> {
        Ok(Vec::new())
    }

    /// Whether an action depends on earlier observations of the episode, as that of a filter does. Episodes of such an
    /// agent are played one after the other, and [`restart`](Self::restart) is called at the beginning of each.
    fn remembers(&self) -> bool {
        false
    }

    /// Forgets the observations of the episode, because another one begins.
    fn restart(&mut self) {}

    /// Whether the agent ends the episode before the environment does, for instance for a design that is not worth the
    /// rest of its evaluations. The protocol `search` asks after every step that ends no episode.
    fn truncates(&mut self) -> bool {
        false
    }

    /// Whether `act` or `learn` reads [`Observation::state`].
    fn reads_state(&self) -> bool {
        false
    }

    /// Writes everything that `load` needs to continue bit by bit: networks, optimisers, replay, counters.
    ///
    /// # Errors
    /// A file cannot be written.
    fn save(&self, _dir: &Path) -> Result<(), Error> {
        Ok(())
    }

    /// Continues from the files that `save` wrote.
    ///
    /// # Errors
    /// [`Error::Checkpoint`] if the files do not fit this agent.
    fn load(&mut self, _dir: &Path) -> Result<(), Error> {
        Ok(())
    }

    /// Writes the policy alone as `policy.safetensors`, in folders by seat if each seat has its own policy, for use by
    /// other programs. Returns false if there is none to write.
    ///
    /// # Errors
    /// The file cannot be written.
    fn export(&self, _dir: &Path) -> Result<bool, Error> {
        Ok(false)
    }

    /// Loads the policy that `export` of an agent with the same config wrote for the same seats: scored actions then
    /// equal those of that agent bit by bit. Returns false if no policy can be loaded.
    ///
    /// # Errors
    /// [`Error::File`] or [`Error::Checkpoint`] if the files are missing or do not fit this agent.
    fn import(&mut self, _dir: &Path) -> Result<bool, Error> {
        Ok(false)
    }
}
