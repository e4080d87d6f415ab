//! A deterministic policy learned from a dataset, for actions in a box or on a simplex. Inputs can be scaled
//! by the moments of the dataset.
//!
//! | symbol | here | shape |
//! |---|---|---|
//! | s | observations, `(x - center) / spread` channel by channel | `[batch, observed]` |
//! | z | outputs of the network | `[batch, n]` |
//! | pi(s) | `tanh(z)` in a box with limits -1 and 1, `softmax(z)` on a simplex | `[batch, n]` |
//! | c(a) | a centred action: `a` in a box, `n a - 1` on a simplex, which is 0 for equal shares | `[batch, n]` |
//!
//! With `scale_by: dataset`, `center` is the mean of a channel over the observations before the dataset's
//! decisions. `spread` is their standard deviation plus a thousandth of the typical deviation that the
//! environment states. Fujimoto and Gu 2021 add 0.001 to states without units; the thousandth does not depend
//! on the unit either.

#[cfg(test)]
pub(crate) mod tests;

use crate::shared::batch::{Batch, BatchWidths};
use crate::shared::joint::acted;
use crate::shared::scaling::{ObservationScaling, Scaling};
use crate::shared::seat_network::HiddenLayers;
use crate::shared::{allocation, checkpoint, seat};
use contract::{Action, End, Error, Interface, Observation, Rng, Seat, Space, Transition, Updates};
use numerics::{
    activation::Activation,
    equations::{network::Network, state_file},
    policy_file::{FILE_NAME, Head, Policy, Ports},
    tensor_file::{TensorFile, TensorFileError},
};
use plan::{Expression, Plans, State};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::path::Path;

/// Share of a channel's typical deviation that is added to the dataset's, so that a constant channel is not
/// divided by zero.
const LEAST_SPREAD: f64 = 1e-3;
const SCALING: &str = "scaling";

/// Source of the moments by which observations are scaled.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ScalingSource {
    /// Mean and standard deviation of each channel in the dataset.
    #[default]
    Dataset,
    /// The typical value and deviation that the environment states for each channel.
    Typical,
    /// No scaling: as observed, in SI units.
    Nothing,
}

/// Set of admissible actions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ActionSet {
    /// A box with limits -1 and 1.
    Cube,
    /// Shares that sum to 1.
    Simplex,
}

impl ActionSet {
    /// Actions `[rows, n]` from the outputs of a network.
    #[must_use]
    pub fn act(self, outputs: Expression<'_>) -> Expression<'_> {
        match self {
            Self::Cube => outputs.tanh(),
            Self::Simplex => outputs.softmax(),
        }
    }

    /// Actions around 0, so that distances between them have the same order for any number of shares.
    #[must_use]
    #[allow(clippy::cast_precision_loss, reason = "a number of shares is far below 2^52")]
    pub fn centred(self, actions: Expression<'_>) -> Expression<'_> {
        match self {
            Self::Cube => actions,
            Self::Simplex => actions * actions.n_columns() as f64 - 1.0,
        }
    }

    fn head(self) -> Head {
        match self {
            Self::Cube => Head::Tanh,
            Self::Simplex => Head::SoftmaxMean,
        }
    }
}

/// Layers and scaling of a policy.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ActorSettings {
    /// Number of units of each hidden layer.
    pub width: usize,
    /// Number of hidden layers.
    pub layers: usize,
    /// Source of the moments by which observations are scaled.
    pub scale_by: ScalingSource,
}

impl ActorSettings {
    /// Network of rectifiers with `inputs` and `outputs`, started as PyTorch starts its linear layers.
    pub fn network(
        &self,
        name: &str,
        [inputs, outputs]: [usize; 2],
        state: &mut State<f32>,
        rng: &mut Rng,
    ) -> Network {
        let hidden = HiddenLayers {
            width: self.width,
            layers: self.layers,
            activation: Activation::Relu,
        };
        let network = hidden.network(name, inputs, outputs);
        network.initialise_uniform(state, rng);
        network
    }
}

/// A policy for one seat with its scaling, and the state of what learns.
#[derive(Debug, Clone)]
pub struct DatasetActor {
    agent: &'static str,
    /// Set of admissible actions of the seat.
    pub actions: ActionSet,
    names: Vec<String>,
    scale_by: ScalingSource,
    scaling: Scaling,
    /// Typical deviations that the environment states, one per observed channel.
    typical: Vec<f64>,
    /// Network from scaled observations to outputs `z`.
    pub policy: Network,
    /// Parameters of the policy, and of what an agent adds.
    pub state: State<f32>,
    /// Number of updates so far.
    pub n_updates: u64,
    acting: Plans,
}

impl DatasetActor {
    /// Builds an untrained policy for the only seat of an environment.
    ///
    /// # Errors
    /// [`Error::Mismatch`] for several seats, for an observation that is no box, and for an action that is
    /// neither on a simplex nor in a box with limits -1 and 1.
    pub fn new(
        agent: &'static str,
        form: &ActorSettings,
        interface: &Interface,
        rng: &mut Rng,
    ) -> Result<Self, Error> {
        let seat = seat::only_seat(agent, interface)?;
        let (actions, names) = action_set(agent, seat)?;
        let channels = seat::observed(agent, seat)?;
        let kind = if form.scale_by == ScalingSource::Nothing {
            ObservationScaling::None
        } else {
            ObservationScaling::Typical
        };
        let mut state = State::default();
        Ok(Self {
            agent,
            actions,
            scale_by: form.scale_by,
            scaling: Scaling::new(kind, channels),
            typical: channels.iter().map(|channel| channel.spread).collect(),
            policy: form.network("policy", [channels.len(), names.len()], &mut state, rng),
            state,
            n_updates: 0,
            acting: Plans::default(),
            names,
        })
    }

    /// Number of entries of an observation.
    #[must_use]
    pub fn n_observed(&self) -> usize {
        self.scaling.n_channels()
    }

    /// Number of entries of an action.
    #[must_use]
    pub fn n_acted(&self) -> usize {
        self.names.len()
    }

    /// Takes the moments of a dataset's observations, where observations are scaled by the dataset.
    pub fn observe_dataset(&mut self, transitions: &[Transition]) {
        if self.scale_by == ScalingSource::Dataset && !transitions.is_empty() {
            let (center, sd) = moments(transitions, self.n_observed());
            let spread = sd
                .iter()
                .zip(&self.typical)
                .map(|(sd, typical)| sd + LEAST_SPREAD * typical)
                .collect();
            self.scaling = self.scaling.clone().with(center, spread);
        }
    }

    /// Numbers of entries of a batch.
    #[must_use]
    pub fn widths(&self) -> BatchWidths {
        BatchWidths {
            observed: self.n_observed(),
            acted: self.n_acted(),
            seats: 1,
        }
    }

    /// Transitions with scaled observations.
    #[must_use]
    #[allow(clippy::cast_possible_truncation, reason = "networks compute in f32")]
    pub fn batch(&self, transitions: &[Transition]) -> Batch {
        let all = || transitions.iter();
        let continues = |it: &Transition| f32::from(u8::from(it.end != Some(End::Terminated)));
        Batch {
            n_rows: transitions.len(),
            observations: self.scaled(all().map(|it| &it.observation)),
            actions: all()
                .flat_map(|it| &it.action[0])
                .map(|entry| *entry as f32)
                .collect(),
            rewards: all().map(|it| it.rewards[0] as f32).collect(),
            next_observations: self.scaled(all().map(|it| &it.next_observation)),
            continues: all().map(continues).collect(),
        }
    }

    fn scaled<'a>(&self, observations: impl Iterator<Item = &'a Observation>) -> Vec<f32> {
        let seen = observations.map(|observation| &observation.seats[0]);
        seen.flat_map(|seen| self.scaling.apply(seen)).collect()
    }

    /// Actions of the policy, one per observation.
    ///
    /// # Errors
    /// [`Error::NotFinite`] where an output of the network is not finite.
    pub fn act(&mut self, observations: &[Observation]) -> Result<Vec<Action>, Error> {
        let (set, policy, shape) = (
            self.actions,
            &self.policy,
            [observations.len(), self.n_observed()],
        );
        let scaled = self.scaled(observations.iter());
        let plan = self.acting.of_rows(observations.len(), |equations| {
            let observations = equations.input("observations", shape);
            equations.routine("choose");
            equations.output("chosen", set.act(policy.apply(observations)));
        });
        plan.write("observations", &scaled);
        plan.run("choose", &mut self.state);
        let (actions, n, step) = (plan.entries("chosen"), self.names.len(), self.n_updates);
        match self.actions {
            ActionSet::Simplex => allocation::actions(actions, n, step),
            ActionSet::Cube => actions
                .chunks(n)
                .map(|row| Ok(vec![numbers(row, step)?]))
                .collect(),
        }
    }

    /// The updates; the first one comes with the first batch.
    #[must_use]
    pub fn updates(&self) -> Updates {
        Updates {
            made: self.n_updates,
            first_after: 1,
        }
    }

    /// Writes a checkpoint of state, scaling and number of updates.
    ///
    /// # Errors
    /// [`Error::File`] where the operating system refuses.
    pub fn save(&self, dir: &Path) -> Result<(), Error> {
        let mut file = TensorFile::default();
        state_file::store(&self.state, &mut file);
        let Ports { center, spread, .. } = self.ports();
        file.header[SCALING] = json!([center, spread]);
        checkpoint::write(self.agent, dir, file, &self.n_updates)
    }

    /// Restores what [`save`](Self::save) wrote.
    ///
    /// # Errors
    /// [`Error::File`] or [`Error::Checkpoint`] where the file is missing or does not fit.
    pub fn load(&mut self, dir: &Path) -> Result<(), Error> {
        let (file, n_updates) = checkpoint::read(self.agent, dir)?;
        let misfit = checkpoint::error_of(self.agent);
        state_file::restore(&mut self.state, &file).map_err(&misfit)?;
        self.rescale(&file.header[SCALING][0], &file.header[SCALING][1])
            .map_err(&misfit)?;
        self.n_updates = n_updates;
        Ok(())
    }

    /// Writes the policy file to `dir`.
    ///
    /// # Errors
    /// [`Error::File`] where the operating system refuses.
    pub fn export(&self, dir: &Path) -> Result<bool, Error> {
        let policy = Policy::new(&self.policy, &self.state, self.ports(), self.actions.head());
        policy.write(dir).map_err(checkpoint::error_of(self.agent))?;
        Ok(true)
    }

    /// Loads an exported policy together with the scaling that it was trained with.
    ///
    /// # Errors
    /// [`Error::File`] or [`Error::Checkpoint`] where the file is missing or of another form.
    pub fn import(&mut self, dir: &Path) -> Result<bool, Error> {
        if self.scale_by == ScalingSource::Dataset {
            let misfit = checkpoint::error_of(self.agent);
            let file = TensorFile::read(&dir.join(FILE_NAME)).map_err(&misfit)?;
            self.rescale(&file.header["center"], &file.header["spread"])
                .map_err(&misfit)?;
        }
        let (ports, head) = (self.ports(), self.actions.head());
        checkpoint::import_policy(self.agent, &self.policy, &mut self.state, dir, &ports, head)?;
        Ok(true)
    }

    fn ports(&self) -> Ports {
        self.scaling.ports(&self.names)
    }

    fn rescale(
        &mut self,
        center: &serde_json::Value,
        spread: &serde_json::Value,
    ) -> Result<(), TensorFileError> {
        let read = |list: &serde_json::Value| {
            Vec::<f64>::deserialize(list)
                .ok()
                .filter(|it| it.len() == self.n_observed())
        };
        match (read(center), read(spread)) {
            (Some(center), Some(spread)) => self.scaling = self.scaling.clone().with(center, spread),
            _ => {
                return Err(TensorFileError::Missing {
                    name: format!("{SCALING} of {} channels", self.n_observed()),
                });
            }
        }
        Ok(())
    }
}

fn action_set(agent: &'static str, seat: &Seat) -> Result<(ActionSet, Vec<String>), Error> {
    match &seat.action {
        Space::Simplex(_) => Ok((ActionSet::Simplex, seat::simplex(agent, seat)?.to_vec())),
        _ => Ok((ActionSet::Cube, acted(agent, seat)?)),
    }
}

/// Mean and standard deviation of each channel over the observations before the decisions.
#[allow(
    clippy::cast_precision_loss,
    reason = "a number of transitions is far below 2^52"
)]
fn moments(transitions: &[Transition], n_observed: usize) -> (Vec<f64>, Vec<f64>) {
    let n = transitions.len() as f64;
    let mean_of = |of: &dyn Fn(usize, f64) -> f64| -> Vec<f64> {
        let mut sums = vec![0.0; n_observed];
        for transition in transitions {
            let seen = transition.observation.seats[0].iter().enumerate();
            sums.iter_mut()
                .zip(seen)
                .for_each(|(sum, (channel, value))| *sum += of(channel, *value));
        }
        sums.into_iter().map(|sum| sum / n).collect()
    };
    let mean = mean_of(&|_, value| value);
    let variance = mean_of(&|channel, value| (value - mean[channel]).powi(2));
    (mean, variance.into_iter().map(f64::sqrt).collect())
}

fn numbers(row: &[f32], step: u64) -> Result<Vec<f64>, Error> {
    let check = |value: &f32| match f64::from(*value) {
        value if value.is_finite() => Ok(value.clamp(-1.0, 1.0)),
        value => Err(Error::NotFinite {
            what: "an action".into(),
            step,
            value,
        }),
    };
    row.iter().map(check).collect()
}
