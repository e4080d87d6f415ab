//! A network that is fitted to the full state of an environment: the surrogate of an engine (thesis, section
//! 2.4: three hidden layers of 100 rectifiers, Adam), and the supervised baseline that the thesis calls
//! `End-to-End`.
//!
//! The input is the observation. The target is the full state, entry by entry the answer for which an action
//! stands: the typical value and deviation of a state channel are those of the action's channel in its units.
//!
//! | symbol | here | shape |
//! |---|---|---|
//! | x | chosen channels of the observation, less their typical values, in parts of their typical deviations | `[batch, inputs]` |
//! | f(x) | the network's outputs | `[batch, n]` |
//! | y | states, scaled in the same way | `[batch, n]` |
//! | a | `center + spread f(x)` with those of the action's channels, inside their limits | `[batch, n]` |
//!
//! The loss is the mean of `(f(x) - y)^2` over batch and entries. Without inputs the network is one constant:
//! the best answer without observations, a floor for other agents.
//!
//! Departures: the step size is halved at a steady pace where `halved_every` is set, and examples are reused
//! where `updates_per_batch` is above 1; the thesis mentions neither.
//!
//! Metric, mean over the updates since the last measurement: `fit_loss`, the loss above.

#[cfg(test)]
mod tests;

use crate::shared::{
    checkpoint::{self, finite},
    ring::Ring,
    scaling::{ObservationScaling, Scaling},
    seat,
    seat_network::HiddenLayers,
};
use contract::{
    Action, Agent, AgentTraits, Channel, Error, Feed, Interface, Metric, Mode, Observation, Recorder,
    Registry, Rng, Space, Transition, Updates,
};
use numerics::{
    activation::Activation,
    equations::{network::Network, state_file},
    policy_file::{Head, Policy},
    tensor_file::TensorFile,
};
use plan::{Descent, Expression, Plans, Processor, State};
use rand::Rng as _;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;

const NAME: &str = "network_regression";
/// Name of the learning rate in the state.
const RATE: &str = "learning_rate";

/// Hyper-parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Step size of Adam.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub learning_rate: f64,
    /// Updates after which the step size has halved, little by little; null for a constant one.
    #[schemars(range(min = 1))]
    pub halved_every: Option<u64>,
    /// Units of each hidden layer.
    #[schemars(range(min = 1, max = 4096), extend("x-source" = "thesis, section 2.4"))]
    pub width: usize,
    /// Number of hidden layers.
    #[schemars(range(min = 1, max = 8), extend("x-source" = "thesis, section 2.4"))]
    pub layers: usize,
    /// Updates for each batch of examples: the first on the batch, the others on as many stored examples,
    /// drawn with replacement.
    #[schemars(range(min = 1, max = 1000))]
    pub updates_per_batch: u64,
    /// Number of the latest examples that are stored for it; 0 where each is used once.
    #[schemars(range(min = 0, max = 1_000_000))]
    pub memory: usize,
    /// Beginnings of the names of the channels that the network sees; null for all channels, an empty list
    /// for none.
    pub inputs: Option<Vec<String>>,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            learning_rate: 1e-3,
            halved_every: None,
            width: 100,
            layers: 3,
            updates_per_batch: 1,
            memory: 0,
            inputs: None,
        }
    }
}

impl contract::Config for Config {}

/// Regression from observations to the full state.
#[derive(Debug, Clone)]
pub struct NetworkRegression {
    config: Config,
    /// Positions of the inputs in the observation.
    places: Vec<usize>,
    /// Scaling of the inputs.
    inputs: Scaling,
    targets: Scaling,
    actions: Vec<Channel>,
    network: Network,
    state: State<f32>,
    acting: Plans,
    learning: Plans,
    n_updates: u64,
    /// Stored examples, inputs before targets.
    memory: Ring,
}

/// Registers the agent.
pub(crate) fn register(registry: &mut Registry, version: u32) {
    let about = "regression of what an environment knows, by a network: surrogates, supervised baselines";
    let traits = AgentTraits::learner([Feed::Examples], metrics());
    registry.agent(NAME, version, about, traits, build);
}

/// Builds the agent for one seat in boxes, in an environment whose state is the answer.
///
/// # Errors
/// [`Error::Mismatch`] for any other environment and for unknown inputs.
fn build(config: Config, interface: &Interface, rng: &mut Rng) -> Result<Box<dyn Agent>, Error> {
    Ok(Box::new(NetworkRegression::new(config, interface, rng)?))
}

/// Metrics that [`NetworkRegression::learn`] records.
fn metrics() -> Vec<Metric> {
    vec![Metric::new("fit_loss", "", "what the regression minimises").lower_is_better()]
}

impl NetworkRegression {
    fn new(config: Config, interface: &Interface, rng: &mut Rng) -> Result<Self, Error> {
        let seat = seat::only_seat(NAME, interface)?;
        let Space::Box(actions) = &seat.action else {
            let problem = format!(
                "its answers are numbers in a box, the environment takes {}",
                seat::kind(&seat.action)
            );
            return Err(seat::mismatch(NAME, problem));
        };
        seat::state_of_length(NAME, interface, actions.len())?;
        let observed = seat::observed(NAME, seat)?;
        let places = places(config.inputs.as_deref(), observed)?;
        let chosen: Vec<Channel> = places.iter().map(|place| observed[*place].clone()).collect();
        let hidden = HiddenLayers {
            width: config.width,
            layers: config.layers,
            activation: Activation::Relu,
        };
        // A network without inputs gets one that is always 0.
        let network = hidden.network("network", chosen.len().max(1), actions.len());
        let mut state = State::default();
        network.initialise(1.0, &mut state, rng);
        if config.updates_per_batch > 1 && config.memory == 0 {
            return Err(Error::config(
                "memory",
                "updates of remembered examples need some: 10000, say",
            ));
        }
        let memory = Ring::new(config.memory, chosen.len().max(1) + actions.len());
        Ok(Self {
            inputs: Scaling::new(ObservationScaling::Typical, &chosen),
            targets: Scaling::new(ObservationScaling::Typical, &interface.state),
            actions: actions.clone(),
            network,
            state,
            acting: Plans::default(),
            learning: Plans::default(),
            places,
            config,
            n_updates: 0,
            memory,
        })
    }

    /// Rows of scaled inputs.
    fn seen<'a>(&self, observations: impl Iterator<Item = &'a Observation>) -> Vec<f32> {
        let row = |observation: &Observation| {
            if self.places.is_empty() {
                return vec![0.0];
            }
            let seen = &observation.seats[0];
            let chosen: Vec<f64> = self.places.iter().map(|place| seen[*place]).collect();
            self.inputs.apply(&chosen).collect()
        };
        observations.flat_map(row).collect()
    }

    fn n_inputs(&self) -> usize {
        self.places.len().max(1)
    }

    #[allow(clippy::cast_precision_loss, reason = "a number of updates is far below 2^52")]
    fn learning_rate(&self) -> f64 {
        let halvings = self
            .config
            .halved_every
            .map_or(0.0, |every| self.n_updates as f64 / every as f64);
        self.config.learning_rate * (-halvings).exp2()
    }

    /// Examples `[rows, inputs + n]`, inputs before targets.
    fn rows(&self, transitions: &[Transition]) -> Vec<f32> {
        let row = |it: &Transition| {
            let mut row = self.seen(std::iter::once(&it.observation));
            row.extend(self.targets.apply(&it.observation.state));
            row
        };
        transitions.iter().flat_map(row).collect()
    }

    fn remember(&mut self, rows: &[f32]) {
        if self.config.memory > 0 {
            for row in rows.chunks(self.memory.width()) {
                self.memory.push(row);
            }
        }
    }

    /// Draws `n` stored examples with replacement.
    fn drawn(&self, n: usize, rng: &mut Rng) -> Vec<f32> {
        let n_remembered = self.memory.len() as u64;
        let mut drawn = Vec::with_capacity(n * self.memory.width());
        for _ in 0..n {
            // The draw is below the number of rows.
            drawn.extend(self.memory.row(rng.random_range(0..n_remembered) as usize));
        }
        drawn
    }

    /// Updates once on examples, row by row.
    fn update(&mut self, rows: &[f32], record: &mut Recorder) -> Result<(), Error> {
        self.state.set_number(RATE, self.learning_rate());
        let (plan, state) = self.written(rows.len() / self.memory.width());
        plan.write("examples", rows);
        plan.run("update", state);
        let loss = plan.number("fit_loss");
        let loss = finite("fit_loss", self.n_updates, loss)?;
        record.mean("fit_loss", loss);
        self.n_updates += 1;
        Ok(())
    }

    /// The plan for so many examples, and the state that it trains.
    fn written(&mut self, n_rows: usize) -> (&mut Processor<f32>, &mut State<f32>) {
        let (network, widths) = (&self.network, [self.n_inputs(), self.actions.len()]);
        let (n_columns, first_rate) = (self.memory.width(), self.config.learning_rate);
        let plan = self.learning.of_rows(n_rows, |equations| {
            let examples = equations.input("examples", [n_rows, n_columns]);
            update(network, widths, examples, first_rate);
        });
        (plan, &mut self.state)
    }

    fn names(&self) -> Vec<String> {
        self.actions.iter().map(|channel| channel.name.clone()).collect()
    }
}

/// Action in the units of its channels from scaled outputs.
fn action(outputs: &[f32], channels: &[Channel], step: u64) -> Result<Action, Error> {
    let entry = |(output, channel): (&f32, &Channel)| {
        let number = finite("action", step, *output)?;
        Ok((channel.center + channel.spread * number).clamp(channel.low, channel.high))
    };
    let entries = outputs.iter().zip(channels).map(entry);
    Ok(vec![entries.collect::<Result<_, Error>>()?])
}

/// One update on examples `[rows, inputs + n]`, inputs before targets.
fn update(network: &Network, [inputs, n]: [usize; 2], examples: Expression<'_>, first_rate: f64) {
    let equations = examples.equations();
    equations.routine("update");
    let off = network.apply(examples.columns(0..inputs)) - examples.columns(inputs..inputs + n);
    let loss = off.square().mean();
    equations.output("fit_loss", loss);
    let parameters = network.parameters(equations);
    equations.descend(loss, &parameters, &Descent::adam(RATE, first_rate, None));
}

/// Positions of the channels whose names begin with one of `wanted`; all positions for `None`.
fn places(wanted: Option<&[String]>, observed: &[Channel]) -> Result<Vec<usize>, Error> {
    let Some(wanted) = wanted else {
        return Ok((0..observed.len()).collect());
    };
    let begins = |channel: &Channel, word: &String| channel.name.starts_with(word.as_str());
    for word in wanted {
        if !observed.iter().any(|channel| begins(channel, word)) {
            let known: Vec<&str> = observed.iter().map(|channel| channel.name.as_str()).collect();
            let problem = format!("no channel begins with `{word}`; there are: {}", known.join(", "));
            return Err(seat::mismatch(NAME, problem));
        }
    }
    let is_wanted = |channel: &Channel| wanted.iter().any(|word| begins(channel, word));
    Ok((0..observed.len())
        .filter(|place| is_wanted(&observed[*place]))
        .collect())
}

impl Agent for NetworkRegression {
    fn act(&mut self, observations: &[Observation], _: Mode, _: &mut Rng) -> Result<Vec<Action>, Error> {
        let (network, shape) = (&self.network, [observations.len(), self.n_inputs()]);
        let seen = self.seen(observations.iter());
        let plan = self.acting.of_rows(observations.len(), |equations| {
            let seen = equations.input("seen", shape);
            equations.routine("answer");
            equations.output("answers", network.apply(seen));
        });
        plan.write("seen", &seen);
        plan.run("answer", &mut self.state);
        let rows = plan.entries("answers").chunks(self.actions.len());
        rows.map(|row| action(row, &self.actions, self.n_updates))
            .collect()
    }

    fn learn(
        &mut self,
        transitions: &[Transition],
        rng: &mut Rng,
        record: &mut Recorder,
    ) -> Result<(), Error> {
        let rows = self.rows(transitions);
        self.remember(&rows);
        self.update(&rows, record)?;
        for _ in 1..self.config.updates_per_batch {
            let rows = self.drawn(transitions.len(), rng);
            self.update(&rows, record)?;
        }
        Ok(())
    }

    fn plan(&mut self, n_rows: usize) -> Option<String> {
        Some(self.written(n_rows).0.graph().to_string())
    }

    fn reads_state(&self) -> bool {
        true
    }

    fn updates(&self) -> Option<Updates> {
        Some(Updates {
            made: self.n_updates,
            first_after: 1,
        })
    }

    fn save(&self, dir: &Path) -> Result<(), Error> {
        let mut file = TensorFile::default();
        state_file::store(&self.state, &mut file);
        self.memory.store("memory", &mut file);
        checkpoint::write(NAME, dir, file, &self.n_updates)
    }

    fn load(&mut self, dir: &Path) -> Result<(), Error> {
        let (file, n_updates) = checkpoint::read(NAME, dir)?;
        let misfit = checkpoint::error_of(NAME);
        state_file::restore(&mut self.state, &file).map_err(&misfit)?;
        self.memory.restore("memory", &file).map_err(&misfit)?;
        self.n_updates = n_updates;
        Ok(())
    }

    fn export(&self, dir: &Path) -> Result<bool, Error> {
        let ports = self.inputs.ports(&self.names());
        let (center, spread) = self.actions.iter().map(|it| (it.center, it.spread)).unzip();
        let policy = Policy::new(&self.network, &self.state, ports, Head::Identity);
        let policy = policy.in_units(center, spread);
        policy.write(dir).map_err(checkpoint::error_of(NAME))?;
        Ok(true)
    }

    fn import(&mut self, dir: &Path) -> Result<bool, Error> {
        let ports = self.inputs.ports(&self.names());
        checkpoint::import_policy(NAME, &self.network, &mut self.state, dir, &ports, Head::Identity)?;
        Ok(true)
    }
}
