//! The interface of agents: `act`, `learn`, `save`, `load`.

use crate::{Action, End, Environment, Error, Metric, Observation, OwnTraining, Recorder, Rng};
use std::path::Path;

/// Whether actions are for learning (explore) or for measuring (the policy's best).
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
    /// Number of updates that `learn` made, also before a checkpoint that `load` took up.
    pub made: u64,
    /// Number of transitions that `learn` must have been given before the first update; `u64::MAX` for an agent that
    /// never updates.
    pub first_after: u64,
}

/// A policy for all seats of an environment, and how it improves.
///
/// A protocol steps several environments together, so `act` and `learn` take one row per environment.
pub trait Agent: Send {
    /// One action per row; rows are independent of each other. An agent that [`remembers`](Self::remembers) gets one
    /// row at a time, those of an episode in order.
    ///
    /// # Errors
    /// Where the policy produced numbers that are no action ([`Error::NotFinite`]).
    fn act(&mut self, observations: &[Observation], mode: Mode, rng: &mut Rng) -> Result<Vec<Action>, Error>;

    /// Takes in one transition per environment and improves when due. Agents that do not learn ignore it.
    ///
    /// # Errors
    /// Where a loss or a parameter is no longer finite ([`Error::NotFinite`]).
    fn learn(
        &mut self,
        _transitions: &[Transition],
        _rng: &mut Rng,
        _record: &mut Recorder,
    ) -> Result<(), Error> {
        Ok(())
    }

    /// Called once, before the first `learn`, with all transitions from which batches will be drawn, by a protocol that
    /// has them all. The agent can take up properties of the whole dataset here, such as the spread of its
    /// observations. It is not called again after `load`.
    ///
    /// # Errors
    /// Where the transitions cannot be learned from.
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

    /// Tries out an agent whose code is not this program's own. `check` calls it in environments of its trial before
    /// any trial runs; the agent refuses a config whose trials would fail or could not be repeated. False where there
    /// is nothing to try, as for all code of this program's own.
    ///
    /// # Errors
    /// A problem with which it must not run, at the key that names it.
    fn rehearse(
        &mut self,
        _make_environment: &dyn Fn() -> Result<Box<dyn Environment>, Error>,
    ) -> Result<bool, Error> {
        Ok(false)
    }

    /// The operations of one update as text, with their number and the bytes that they move; `None` for agents that do
    /// not learn by a plan. `n_rows` is the size of a batch where the protocol decides it.
    fn plan(&mut self, _n_rows: usize) -> Option<String> {
        None
    }

    /// The updates of an agent that learns; `None` for others.
    fn updates(&self) -> Option<Updates> {
        None
    }

    /// Metrics of decisions that [`Agent::assess`] measures; agents without have none.
    fn decision_metrics(&self) -> Vec<Metric> {
        Vec::new()
    }

    /// Measures scored decisions: one row per observation, with `n_seats` values per entry of
    /// [`Agent::decision_metrics`], metric after metric. A measurement records the mean over the decisions of an
    /// episode.
    ///
    /// # Errors
    /// Where a value cannot be computed.
    fn assess(&mut self, _observations: &[Observation], _actions: &[Action]) -> Result<Vec<Vec<f64>>, Error> {
        Ok(Vec::new())
    }

    /// Whether an action depends on earlier observations of the episode, as of a filter. Episodes of such an agent are
    /// played one after the other, and [`restart`](Self::restart) is called where one begins.
    fn remembers(&self) -> bool {
        false
    }

    /// Forgets the observations of the episode: another one begins.
    fn restart(&mut self) {}

    /// Whether the agent ends the episode before the environment does, as a design that is not worth the rest of its
    /// evaluations. The protocol `search` asks after every step that ends no episode.
    fn truncates(&mut self) -> bool {
        false
    }

    /// Whether `act` or `learn` reads [`Observation::state`].
    fn reads_state(&self) -> bool {
        false
    }

    /// Writes everything that `load` needs to continue to the same bits: networks, optimisers, replay,
    /// counters.
    ///
    /// # Errors
    /// Where a file cannot be written.
    fn save(&self, _dir: &Path) -> Result<(), Error> {
        Ok(())
    }

    /// Continues from what `save` wrote.
    ///
    /// # Errors
    /// [`Error::Checkpoint`] where the files do not fit this agent.
    fn load(&mut self, _dir: &Path) -> Result<(), Error> {
        Ok(())
    }

    /// Writes the policy alone as `policy.safetensors`, in folders by seat where there is one policy per
    /// seat, to be used by other programs; false where there is none to write.
    ///
    /// # Errors
    /// Where the file cannot be written.
    fn export(&self, _dir: &Path) -> Result<bool, Error> {
        Ok(false)
    }

    /// Takes up the policy that `export` of an agent with the same config wrote for the same seats: scored
    /// actions are then that agent's to the bit. False where no policy can be taken up.
    ///
    /// # Errors
    /// [`Error::File`] or [`Error::Checkpoint`] where the files are missing or do not fit this agent.
    fn import(&mut self, _dir: &Path) -> Result<bool, Error> {
        Ok(false)
    }
}
