//! What an agent is: `act`, `learn`, `save`, `load`.

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
    /// What was seen.
    pub observation: Observation,
    /// What was done.
    pub action: Action,
    /// What each seat earned.
    pub rewards: Vec<f64>,
    /// What was seen next (before any reset).
    pub next_observation: Observation,
    /// Whether the episode ended with this step.
    pub end: Option<End>,
}

/// What an agent that learns says of its updates.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Updates {
    /// How many `learn` made so far, also before a checkpoint that `load` took up.
    pub made: u64,
    /// Transitions that `learn` must have been given before the first one can be made; `u64::MAX` where none
    /// ever is.
    pub first_after: u64,
}

/// A policy for all seats of an environment, and how it improves.
///
/// A protocol steps several environments together, so `act` and `learn` take one row per environment.
pub trait Agent: Send {
    /// One action per row; rows are independent of each other. An agent that
    /// [`remembers`](Self::remembers) is shown one row at a time, those of an episode in order.
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

    /// Told once, before the first `learn`, of all transitions from which batches will be drawn, by a
    /// protocol that has them all: what only a whole dataset says, such as how its observations are spread,
    /// can be taken up here. Not told again after `load`.
    ///
    /// # Errors
    /// Where the transitions cannot be learned from.
    fn survey(&mut self, _transitions: &[Transition]) -> Result<(), Error> {
        Ok(())
    }

    /// The training of an agent that trains itself; `None` for others, which a protocol trains.
    fn own_training(&mut self) -> Option<&mut dyn OwnTraining> {
        None
    }

    /// Metrics that an agent records which trains itself.
    fn records(&self) -> Vec<Metric> {
        Vec::new()
    }

    /// Tried out by `check` in environments of its trial, before any trial runs: an agent whose code is not this
    /// program's own refuses here what would make trials that fail or that nobody can repeat. False where there is
    /// nothing to try, as for all code of this program's own.
    ///
    /// # Errors
    /// A problem with which it must not run, at the key that names it.
    fn rehearse(
        &mut self,
        _make_environment: &dyn Fn() -> Result<Box<dyn Environment>, Error>,
    ) -> Result<bool, Error> {
        Ok(false)
    }

    /// The updates of an agent that learns; `None` for others.
    fn updates(&self) -> Option<Updates> {
        None
    }

    /// What [`Agent::assess`] measures; agents without have none.
    fn decision_metrics(&self) -> Vec<Metric> {
        Vec::new()
    }

    /// Measures decisions that were scored: one row per observation, with `n_seats` values per entry of
    /// [`Agent::decision_metrics`], metric after metric. A measurement records the mean over the decisions of
    /// an episode.
    ///
    /// # Errors
    /// Where a value cannot be computed.
    fn assess(&mut self, _observations: &[Observation], _actions: &[Action]) -> Result<Vec<Vec<f64>>, Error> {
        Ok(Vec::new())
    }

    /// True where an action depends on what was seen before in the episode, as of a filter: its episodes are
    /// played one after the other, and it is told where one begins.
    fn remembers(&self) -> bool {
        false
    }

    /// Forgets what was seen of the episode: another one begins.
    fn restart(&mut self) {}

    /// Asked by the protocol `search` after every step that ends no episode: true where the rest of the design
    /// is not worth its evaluations, so that another one begins.
    fn gives_up(&mut self) -> bool {
        false
    }

    /// True where `act` or `learn` reads [`Observation::state`].
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
