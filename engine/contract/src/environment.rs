//! The interface of environments: seats with spaces, `reset`, `step`.

use crate::{
    Error, Rng,
    choice::{self, Choice},
    drawing::{Graph, Image},
    exact,
};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;

/// One entry of an observation, action or state vector.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Channel {
    /// Column name, for example `voltage_1`.
    pub name: String,
    /// SI unit; empty if there is none.
    pub unit: String,
    /// Smallest value that can occur (may be `-inf`).
    #[serde(with = "exact")]
    pub low: f64,
    /// Largest value that can occur (may be `inf`).
    #[serde(with = "exact")]
    pub high: f64,
    /// A typical value; agents that scale their inputs subtract it.
    pub center: f64,
    /// A typical deviation from `center`, above zero; agents that scale their inputs divide by it.
    pub spread: f64,
    /// For an entry of an action: the environment's own limits that correspond to `low` and `high`, if these differ.
    /// Code of the environment's author uses its own limits.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub own_limits: Option<(f64, f64)>,
}

impl Channel {
    /// A channel without limits, centred at 0 with a spread of 1.
    #[must_use]
    pub fn new(name: impl Into<String>, unit: &str) -> Self {
        Self {
            name: name.into(),
            unit: unit.into(),
            low: f64::NEG_INFINITY,
            high: f64::INFINITY,
            center: 0.0,
            spread: 1.0,
            own_limits: None,
        }
    }

    /// The same channel with a typical value and deviation.
    #[must_use]
    pub fn typical(self, center: f64, spread: f64) -> Self {
        Self {
            center,
            spread,
            ..self
        }
    }

    /// The same channel within limits.
    #[must_use]
    pub fn within(self, low: f64, high: f64) -> Self {
        Self { low, high, ..self }
    }

    /// The same channel, with the environment's own limits that correspond to its limits.
    #[must_use]
    pub fn standing_for(self, low: f64, high: f64) -> Self {
        Self {
            own_limits: Some((low, high)),
            ..self
        }
    }
}

/// The set that contains an observation or action vector.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Space {
    /// A box, one channel per entry.
    Box(Vec<Channel>),
    /// Non-negative entries that sum to 1, one name per entry.
    Simplex(Vec<String>),
    /// One of several named choices; the vector has one entry, the index.
    Discrete(Vec<String>),
    /// Several choices at once, each among named options: one value in [-1, 1] per option, and the option with the
    /// largest value of each choice is selected. See [`choice`].
    Choices(Vec<Choice>),
}

impl Space {
    /// Number of entries of a vector in this space.
    #[must_use]
    pub fn len(&self) -> usize {
        match self {
            Space::Box(channels) => channels.len(),
            Space::Simplex(names) => names.len(),
            Space::Discrete(_) => 1,
            Space::Choices(choices) => choice::n_options(choices),
        }
    }

    /// Whether the space has no entries.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Number of entries of an action in the form of other programs, which has the position of the option for each
    /// choice.
    #[must_use]
    pub fn n_asked(&self) -> usize {
        match self {
            Space::Choices(choices) => choices.len(),
            space => space.len(),
        }
    }

    /// The action of this space for entries in the form of other programs.
    ///
    /// # Errors
    /// [`Error::Action`] for another number of entries, and for a number that is no position of an option. The
    /// environment refuses other values outside the space.
    pub fn asked(&self, entries: &[f64]) -> Result<Vec<f64>, Error> {
        if entries.len() != self.n_asked() {
            let problem = format!(
                "it has {} entries, and {} are asked for",
                entries.len(),
                self.n_asked()
            );
            return Err(Error::Action { problem });
        }
        match self {
            Space::Choices(choices) => {
                let taken = choices.iter().zip(entries).map(|(choice, at)| choice.at(*at));
                Ok(choice::vector(choices, &taken.collect::<Result<Vec<_>, _>>()?))
            }
            _ => Ok(entries.to_vec()),
        }
    }

    /// Column names of a vector in this space.
    #[must_use]
    pub fn names(&self) -> Vec<String> {
        match self {
            Space::Box(channels) => channels.iter().map(|channel| channel.name.clone()).collect(),
            Space::Simplex(names) => names.clone(),
            Space::Discrete(_) => vec!["choice".into()],
            Space::Choices(choices) => choice::names(choices),
        }
    }
}

/// Spaces of one actor. A single-agent environment has one seat.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Seat {
    /// Name, for example `agent_0`; empty for the only seat of a single-agent environment.
    pub name: String,
    /// Space of the observations.
    pub observation: Space,
    /// Space of the actions.
    pub action: Space,
}

/// The description of an environment for which an agent is built.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Interface {
    /// The seats, in order.
    pub seats: Vec<Seat>,
    /// Channels of the full state, which informed controllers and centralised critics read.
    pub state: Vec<Channel>,
}

/// Reason why an episode ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum End {
    /// The environment reached a terminal state: no value follows.
    Terminated,
    /// The episode was cut off: the value of the last state still counts.
    Truncated,
}

/// Observations of all seats at one time.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Observation {
    /// One vector per seat.
    pub seats: Vec<Vec<f64>>,
    /// The full state; empty if the agent does not read it.
    pub state: Vec<f64>,
}

/// One vector per seat.
pub type Action = Vec<Vec<f64>>;

/// Result of one step of an environment.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Step {
    /// Observation of each seat after the step.
    pub observations: Vec<Vec<f64>>,
    /// Reward of each seat.
    pub rewards: Vec<f64>,
    /// Set on the last step of an episode.
    pub end: Option<End>,
    /// The value of each of [`Environment::metrics`], under its name.
    pub metrics: Vec<(Cow<'static, str>, f64)>,
}

impl Step {
    /// A step without metrics.
    #[must_use]
    pub fn new(observations: Vec<Vec<f64>>, rewards: Vec<f64>, end: Option<End>) -> Self {
        Self {
            observations,
            rewards,
            end,
            metrics: Vec::new(),
        }
    }

    /// Records the value of a metric.
    #[must_use]
    pub fn record(mut self, metric: impl Into<Cow<'static, str>>, value: f64) -> Self {
        self.metrics.push((metric.into(), value));
        self
    }

    /// Records the values of several metrics.
    #[must_use]
    pub fn record_all<Name: Into<Cow<'static, str>>>(
        self,
        values: impl IntoIterator<Item = (Name, f64)>,
    ) -> Self {
        let record = |step: Self, (metric, value)| step.record(metric, value);
        values.into_iter().fold(self, record)
    }

    /// The recorded value of a metric; `None` if the step did not record it.
    #[must_use]
    pub fn metric(&self, name: &str) -> Option<f64> {
        let named = self.metrics.iter().find(|(metric, _)| metric == name);
        named.map(|(_, value)| *value)
    }
}

/// Better direction of a metric.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Better {
    /// More is better.
    Higher,
    /// Less is better.
    Lower,
}

/// Reduction of the values of a metric over the steps of an episode to one value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum PerEpisode {
    /// The sum over the steps.
    Sum,
    /// The mean over the steps.
    Mean,
    /// The value at the last step.
    Last,
    /// The largest value of a step.
    Max,
    /// The smallest value of a step.
    Min,
}

/// A number that a trial records under a name.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Metric {
    /// Name, as studies write it.
    pub name: String,
    /// SI unit; empty if there is none.
    pub unit: String,
    /// Meaning of the metric, in one line.
    pub about: String,
    /// Whether larger or smaller values are better.
    pub better: Better,
    /// Reduction of the values of steps to one value of an episode.
    pub per_episode: PerEpisode,
}

impl Metric {
    /// A metric whose larger values are better, summed over an episode.
    #[must_use]
    pub fn new(name: &str, unit: &str, about: &str) -> Self {
        Self {
            name: name.into(),
            unit: unit.into(),
            about: about.into(),
            better: Better::Higher,
            per_episode: PerEpisode::Sum,
        }
    }

    /// The reason why a name cannot be used in a claim; `None` if it can. Names consist of letters, digits and `_`.
    #[must_use]
    pub fn name_problem(name: &str) -> Option<&'static str> {
        let is_name = !name.is_empty() && name.chars().all(|it| it.is_alphanumeric() || it == '_');
        (!is_name).then_some("is no name that a claim could say: letters, digits and `_` make one")
    }

    /// The same metric, with lower values being better.
    #[must_use]
    pub fn lower_is_better(self) -> Self {
        Self {
            better: Better::Lower,
            ..self
        }
    }

    /// The same metric with another reduction to one value of an episode.
    #[must_use]
    pub fn per_episode(self, per_episode: PerEpisode) -> Self {
        Self { per_episode, ..self }
    }
}

/// Values that belong to an environment rather than to an episode, such as a reward over a grid of two actions.
#[derive(Debug, Clone, PartialEq)]
pub struct StaticTrace {
    /// Names of the columns, as they are traced.
    pub names: Vec<String>,
    /// Points, each with a value for every column.
    pub points: Vec<Vec<f64>>,
}

/// A simulated system with one or more seats.
///
/// All randomness comes from the `rng` arguments; an environment reads no clock and no file after it was
/// built.
pub trait Environment: Send {
    /// The seats, in order; fixed for the life of the environment.
    fn seats(&self) -> &[Seat];

    /// The metrics that every step records by name, see [`Step::record`].
    fn metrics(&self) -> &[Metric] {
        &[]
    }

    /// Starts an episode and returns the observation of each seat.
    ///
    /// # Errors
    /// The start that the config asks for does not exist.
    fn reset(&mut self, rng: &mut Rng) -> Result<Vec<Vec<f64>>, Error>;

    /// Starts the episode with this number of a measurement. An environment with a list of episodes, such as test
    /// cases, starts the one at this place; for others every episode is like [`reset`](Self::reset).
    ///
    /// # Errors
    /// The errors of `reset`.
    fn reset_to(&mut self, _episode: u64, rng: &mut Rng) -> Result<Vec<Vec<f64>>, Error> {
        self.reset(rng)
    }

    /// Begins the next [`step`](Self::step), which follows with the same actions, like `step_async` of Gymnasium's
    /// vector environments. It is called for all environments that are stepped together before the first of them is
    /// stepped, so that those in other processes compute in parallel. Other environments do nothing.
    ///
    /// # Errors
    /// The errors of `step`.
    fn begin_step(&mut self, _actions: &[Vec<f64>]) -> Result<(), Error> {
        Ok(())
    }

    /// Applies one action per seat.
    ///
    /// # Errors
    /// An action lies outside its space, or the model's equations fail.
    fn step(&mut self, actions: &[Vec<f64>], rng: &mut Rng) -> Result<Step, Error>;

    /// Channels of [`Environment::state`].
    fn state_channels(&self) -> Vec<Channel> {
        Vec::new()
    }

    /// The full state, which ordinary policies do not see. Informed controllers, regressions (as the target) and
    /// centralised critics read it.
    fn state(&self) -> Vec<f64> {
        Vec::new()
    }

    /// Channels of [`Environment::trace`]: values that a rollout writes besides actions and rewards.
    fn trace_channels(&self) -> Vec<Channel>;

    /// Traced values at the present time, one per trace channel; `NaN` becomes an empty cell.
    fn trace(&self) -> Vec<f64>;

    /// Values that are the same for all episodes; protocols that trace episodes trace them too. `None` if an
    /// environment has none.
    fn static_trace(&self) -> Option<StaticTrace> {
        None
    }

    /// Graph of the design of the episode that just ended, if the environment has designs. Protocols that search store
    /// it for figures.
    fn graph(&self) -> Option<Graph> {
        None
    }

    /// Samples that the design of the episode that just ended generates, square and of one size; empty if there is
    /// nothing to show. Protocols that search store them for figures.
    ///
    /// # Errors
    /// The images cannot be generated.
    fn images(&mut self) -> Result<Vec<Image>, Error> {
        Ok(Vec::new())
    }

    /// The state that changes during an episode, with which a stopped trial continues bit by bit.
    fn snapshot(&self) -> serde_json::Value;

    /// Continues from a snapshot of an environment with the same config.
    ///
    /// # Errors
    /// [`Error::Checkpoint`] if the snapshot does not fit.
    fn restore(&mut self, snapshot: &serde_json::Value) -> Result<(), Error>;

    /// Tries out an environment whose code is not part of this program. `check` calls it before any trial runs. The
    /// environment refuses a config whose trials could not be repeated, and returns its doubts, each an
    /// [`Error::Config`] with its key. `None` if there is nothing to try, as for all code of this program.
    ///
    /// # Errors
    /// A problem that prevents the environment from running.
    fn rehearse(&mut self) -> Result<Option<Vec<Error>>, Error> {
        Ok(None)
    }

    /// The interface for which agents are built.
    fn interface(&self) -> Interface {
        Interface {
            seats: self.seats().to_vec(),
            state: self.state_channels(),
        }
    }
}
