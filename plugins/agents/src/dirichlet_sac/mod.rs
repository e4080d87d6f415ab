//! Soft actor-critic with a Dirichlet policy: actions are shares on a simplex.
//!
//! Thesis, section 3.4 (equations are its); Haarnoja et al. 2018, "Soft actor-critic algorithms and
//! applications", arXiv:1812.05905, for the automatic temperature; Fujimoto et al. 2018, arXiv:1802.09477,
//! for the lower of two critics.
//!
//! | paper | here | shape |
//! |---|---|---|
//! | s, s' | `observations`, `next_observations` (scaled) | `[batch, observed]` |
//! | a = f(eps, s) | `action`, rows sum to 1 | `[batch, n_shares]` |
//! | alpha | `alpha`, concentrations, `softplus(network) + 1` | `[batch, n_shares]` |
//! | log pi(a, s) | `log_pi` | `[batch, 1]` |
//! | Q_1, Q_2 | `critics` | `[batch, 1]` each |
//! | Q_target | `target_critics` | `[batch, 1]` each |
//! | beta | temperature, kept as `log_temperature` | scalar |
//! | gamma, tau, d | `discount`, `target_smoothing`, number of shares | scalars |
//!
//! Departures from the thesis
//! - The target entropy is stated as a concentration: the printed `-sqrt(d)` is close to or above the largest
//!   entropy of a policy with `alpha >= 1` (`preset: thesis` keeps it).
//! - Defaults that the pilot study found to learn: batch of 256, one update per 16 environment steps, a first
//!   temperature of 0.1. The text gives no first temperature, no temperature rate and no scaling of
//!   observations.
//! - The temperature is exp of a number that descends `-(log pi + target)`, the form of the authors' code of
//!   SAC, which under Adam takes the same steps as equation 18 of that paper up to the scale of the gradient.
//! - Terminal steps do not bootstrap: equation 3.17 is written for a process without end.
//! - Policy: three hidden layers; the second has tanh, the others leaky rectifiers (section 3.4.3 names the
//!   first two).
//!
//! Metrics, means over the updates since the last measurement: `critic_loss` eq. 3.16 summed over both
//! critics, `policy_loss` eq. 3.18, `policy_entropy` `-mean(log pi)`, `temperature` beta,
//! `mean_concentration` mean of alpha, `mean_value` mean of the lower critic at the policy's actions.

mod asset_network;
mod config;
mod networks;
mod policy_graph;

pub use config::{ActionScaling, Config, EvaluationAction, NetworkKind, TargetEntropy};

use crate::shared::{
    allocation,
    checkpoint::{self, finite},
    replay::{Batch, Replay},
    scaling::Scaling,
    schedule::UpdateSchedule,
    seat,
    targets::{bootstrapped, half_squared_error, mean},
};
use asset_network::AssetChannels;
use burn::{module::Module, tensor::Tensor};
use contract::{
    Action, Agent, AgentTraits, Error, Feed, Interface, Metric, Mode, Observation, Recorder, Registry, Rng,
    Transition, Updates,
};
use networks::{Critics, PolicyNetwork, Shape};
use numerics::{
    dirichlet_policy::{log_density, sample},
    network::{device, matrix, softplus, values},
    optimizer::{Adam, ScalarAdam, TrainedNetwork},
    parameters::{restore, soft_update, store},
    policy_file::Head,
    tensor_file::{TensorFile, TensorFileError},
};
use rand::RngCore;
use std::path::Path;

const NAME: &str = "dirichlet_sac";
/// File with networks from which another trial may begin.
const NETWORKS_FILE: &str = "networks.safetensors";

/// Soft actor-critic for one seat that acts on a simplex.
#[derive(Debug, Clone)]
pub struct DirichletSac {
    config: Config,
    scaling: Scaling,
    shares: Vec<String>,
    shape: Shape,
    target_entropy: f64,
    policy: TrainedNetwork<PolicyNetwork>,
    critics: TrainedNetwork<Critics>,
    target_critics: Critics,
    log_temperature: f64,
    temperature_adam: ScalarAdam,
    replay: Replay,
    schedule: UpdateSchedule,
    /// Channels by asset; set where the assets of transitions are permuted.
    assets: Option<AssetChannels>,
}

/// Means over a batch at the policy's actions.
struct PolicyMeans {
    log_pi: f64,
    concentration: f64,
    value: f64,
}

/// Registers the agent.
pub(crate) fn register(registry: &mut Registry, version: u32) {
    let about = "soft actor-critic with a Dirichlet policy";
    // Off-policy: the replay buffer takes decisions of any policy.
    let traits = AgentTraits::learner([Feed::Decisions, Feed::Dataset], metrics());
    registry.agent(NAME, version, about, traits, build);
    registry.policy_form("equivariant", policy_graph::portable);
}

/// Builds the agent for one seat that observes a box and acts on a simplex.
///
/// # Errors
/// [`Error::Mismatch`] for any other seat.
fn build(config: Config, interface: &Interface, rng: &mut Rng) -> Result<Box<dyn Agent>, Error> {
    Ok(Box::new(DirichletSac::new(config, interface, rng)?))
}

/// Metrics that [`DirichletSac::learn`] records.
fn metrics() -> Vec<Metric> {
    vec![
        Metric::new(
            "critic_loss",
            "",
            "half the squared error of both critics, eq. 3.16",
        )
        .lower_is_better(),
        Metric::new("policy_loss", "", "beta log pi less the lower critic, eq. 3.18").lower_is_better(),
        Metric::new(
            "policy_entropy",
            "nat",
            "minus the mean log density of sampled actions",
        ),
        Metric::new("temperature", "", "weight beta of the entropy").lower_is_better(),
        Metric::new("mean_concentration", "", "mean concentration alpha of a share"),
        Metric::new(
            "mean_value",
            "",
            "mean of the lower critic at the policy's actions",
        ),
    ]
}

impl DirichletSac {
    fn new(config: Config, interface: &Interface, rng: &mut Rng) -> Result<Self, Error> {
        let seat = seat::only_seat(NAME, interface)?;
        let shares = seat::simplex(NAME, seat)?.to_vec();
        let channels = seat::observed(NAME, seat)?;
        let scaling = Scaling::new(config.observation_scaling, channels);
        let (n_observed, n_shares) = (scaling.n_channels(), shares.len());
        let shape = Shape::new(&config, channels, n_shares)?;
        let assets = config
            .permute_assets
            .then(|| AssetChannels::find(NAME, "permute_assets: true", channels, n_shares))
            .transpose()?;
        let tracked = device().autodiff();
        let policy = shape.policy(rng, &tracked);
        let critics = shape.critics(rng, &tracked);
        let adam = |rate| Adam::new(rate, config.gradient_clip);
        let mut agent = Self {
            target_entropy: config.target_nats(n_shares),
            shape,
            target_critics: critics.valid(),
            policy: TrainedNetwork::new(policy, adam(config.actor_learning_rate)),
            critics: TrainedNetwork::new(critics, adam(config.critic_learning_rate)),
            log_temperature: config.first_temperature.ln(),
            temperature_adam: ScalarAdam::new(config.temperature_learning_rate),
            replay: Replay::new(config.replay_capacity, n_observed, n_shares, 1),
            schedule: UpdateSchedule::new(),
            config,
            scaling,
            shares,
            assets,
        };
        if let Some(start) = agent.config.start.clone() {
            agent
                .begin_from(start.folder()?)
                .map_err(|error| Error::config("start", error.to_string()))?;
        }
        Ok(agent)
    }

    /// Loads networks and temperature of another trial; optimisers and replay stay new.
    fn begin_from(&mut self, dir: &Path) -> Result<(), TensorFileError> {
        let file = TensorFile::read(&dir.join(NETWORKS_FILE))?;
        self.policy
            .set_network(restore(self.policy.network().clone(), "policy", &file)?);
        self.critics
            .set_network(restore(self.critics.network().clone(), "critics", &file)?);
        self.target_critics = restore(self.target_critics.clone(), "target_critics", &file)?;
        self.log_temperature = file.header["log_temperature"]
            .as_f64()
            .unwrap_or(self.log_temperature);
        Ok(())
    }

    /// Writes the networks and the temperature that [`begin_from`](Self::begin_from) reads.
    fn write_networks(&self, dir: &Path) -> Result<(), TensorFileError> {
        let mut file = TensorFile::default();
        store(self.policy.network(), "policy", &mut file);
        store(self.critics.network(), "critics", &mut file);
        store(&self.target_critics, "target_critics", &mut file);
        file.header["log_temperature"] = self.log_temperature.into();
        file.write(&dir.join(NETWORKS_FILE))
    }

    fn update(&mut self, rng: &mut Rng, record: &mut Recorder) -> Result<(), Error> {
        let batch = self.replay.sample_with_replacement(self.config.batch_size, rng);
        let batch = match &self.assets {
            Some(assets) => assets.permuted(batch, rng),
            None => batch,
        };
        self.update_critics(&batch, rng, record)?;
        let log_pi = self.update_policy(&batch, rng, record)?;
        self.update_temperature(log_pi);
        let target = std::mem::take(&mut self.target_critics);
        self.target_critics = soft_update(target, self.critics.network(), self.config.target_smoothing);
        self.schedule.count_update();
        Ok(())
    }

    /// Eq. 3.16: both critics descend half the squared error.
    fn update_critics(&mut self, batch: &Batch, rng: &mut Rng, record: &mut Recorder) -> Result<(), Error> {
        let target = self.soft_target(batch, rng)?;
        let (q1, q2) = self.q_values(self.critics.network(), &batch.observations, batch.actions.clone());
        let loss = half_squared_error(q1, target.clone()) + half_squared_error(q2, target);
        record.mean(
            "critic_loss",
            finite("critic_loss", self.schedule.n_steps(), values(loss.clone())[0])?,
        );
        self.critics.descend(&loss);
        Ok(())
    }

    /// Eq. 3.17: reward plus the discounted soft value of the next observation, without gradients.
    fn soft_target(&self, batch: &Batch, rng: &mut Rng) -> Result<Tensor<2>, Error> {
        let alpha = self.concentrations(&self.policy.network().valid(), &batch.next_observations);
        finite("concentration", self.schedule.n_steps(), mean(alpha.clone()))?;
        let next = sample(alpha.clone(), rng);
        let log_pi = log_density(alpha, next.log_action);
        let (q1, q2) = self.q_values(&self.target_critics, &batch.next_observations, next.action);
        let shift = if self.config.shifted_entropy_bonus {
            self.target_entropy
        } else {
            0.0
        };
        let soft_value = q1.min_pair(q2) - (log_pi + shift) * self.temperature();
        Ok(bootstrapped(
            batch.rewards.clone(),
            batch.continues.clone(),
            soft_value,
            self.config.discount,
        ))
    }

    /// One step against eq. 3.18; returns the mean of `log pi`.
    fn update_policy(&mut self, batch: &Batch, rng: &mut Rng, record: &mut Recorder) -> Result<f64, Error> {
        let (loss, parts) = self.policy_loss(&batch.observations, rng)?;
        record.mean(
            "policy_loss",
            finite("policy_loss", self.schedule.n_steps(), values(loss.clone())[0])?,
        );
        self.policy.descend(&loss);
        record.mean("policy_entropy", -parts.log_pi);
        record.mean("mean_concentration", parts.concentration);
        record.mean("mean_value", parts.value);
        record.mean("temperature", self.temperature());
        Ok(parts.log_pi)
    }

    /// Eq. 3.18: `beta log pi - Q` at reparameterised samples, and the means of its parts.
    fn policy_loss(
        &self,
        observations: &Tensor<2>,
        rng: &mut Rng,
    ) -> Result<(Tensor<1>, PolicyMeans), Error> {
        let alpha = self.concentrations(self.policy.network(), observations);
        // The sampler does not accept a concentration that is not finite.
        let concentration = finite("concentration", self.schedule.n_steps(), mean(alpha.clone()))?;
        let drawn = sample(alpha.clone(), rng);
        let log_pi = log_density(alpha, drawn.log_action);
        // Untracked critics: the gradient passes through them to the action alone.
        let (q1, q2) = self.q_values(&self.critics.network().valid(), observations, drawn.action);
        let q = q1.min_pair(q2);
        let loss = (log_pi.clone() * self.temperature() - q.clone()).mean();
        let (log_pi, value) = (f64::from(mean(log_pi)), f64::from(mean(q)));
        Ok((
            loss,
            PolicyMeans {
                log_pi,
                concentration,
                value,
            },
        ))
    }

    /// The temperature rises where the entropy `-mean_log_pi` is below its target.
    fn update_temperature(&mut self, mean_log_pi: f64) {
        let gradient = -(mean_log_pi + self.target_entropy);
        self.log_temperature = self.temperature_adam.step(self.log_temperature, gradient);
    }

    fn temperature(&self) -> f64 {
        self.log_temperature.exp()
    }

    /// `alpha = softplus(f(s)) + 1` (section 3.4.3), so that the density has one mode inside the simplex.
    fn concentrations(&self, policy: &PolicyNetwork, observations: &Tensor<2>) -> Tensor<2> {
        let alpha = softplus(self.shape.shares(policy, observations)) + 1.0;
        match self.config.concentration_cap {
            Some(cap) => alpha.clamp_max(cap),
            None => alpha,
        }
    }

    #[allow(clippy::cast_precision_loss, reason = "a number of shares is far below 2^52")]
    fn q_values(
        &self,
        critics: &Critics,
        observations: &Tensor<2>,
        action: Tensor<2>,
    ) -> (Tensor<2>, Tensor<2>) {
        let action = match self.config.critic_action_scaling {
            ActionScaling::Centred => action * (self.shares.len() as f64) - 1.0,
            ActionScaling::None => action,
        };
        self.shape.values(critics, observations, action)
    }

    fn head(&self) -> Head {
        match self.config.evaluation_action {
            EvaluationAction::Mean => Head::DirichletMean,
            EvaluationAction::Mode => Head::DirichletMode,
        }
    }

    /// Rows of positive weights: a sample in training; in evaluation the mean or the mode, up to their sum.
    fn weights(
        &self,
        observations: &Tensor<2>,
        mode: Mode,
        rng: &mut impl RngCore,
    ) -> Result<Vec<f32>, Error> {
        let alpha = self.concentrations(&self.policy.network().valid(), observations);
        finite("concentration", self.schedule.n_steps(), mean(alpha.clone()))?;
        Ok(values(match (mode, self.config.evaluation_action) {
            (Mode::Train, _) => sample(alpha, rng).action,
            (Mode::Evaluate, EvaluationAction::Mean) => alpha,
            (Mode::Evaluate, EvaluationAction::Mode) => alpha - 1.0,
        }))
    }
}

impl Agent for DirichletSac {
    fn act(&mut self, observations: &[Observation], mode: Mode, rng: &mut Rng) -> Result<Vec<Action>, Error> {
        let scaled = observations
            .iter()
            .flat_map(|observation| self.scaling.apply(&observation.seats[0]))
            .collect();
        let weights = self.weights(&matrix(scaled, self.scaling.n_channels()), mode, rng)?;
        allocation::actions(&weights, self.shares.len(), self.schedule.n_steps())
    }

    fn learn(
        &mut self,
        transitions: &[Transition],
        rng: &mut Rng,
        record: &mut Recorder,
    ) -> Result<(), Error> {
        for transition in transitions {
            self.replay.push_scaled(transition, &self.scaling);
        }
        let Config {
            learning_starts,
            updates_per_step,
            ..
        } = self.config;
        for _ in 0..self
            .schedule
            .advance(transitions.len(), learning_starts, updates_per_step)
        {
            self.update(rng, record)?;
        }
        Ok(())
    }

    checkpoint::keeps!(NAME; trained: policy, critics; targets: target_critics; counters: log_temperature, temperature_adam);

    fn export(&self, dir: &Path) -> Result<bool, Error> {
        let ports = self.scaling.ports(&self.shares);
        self.shape
            .write(self.policy.network(), ports, self.head(), dir)
            .map_err(checkpoint::error_of(NAME))?;
        self.write_networks(dir).map_err(checkpoint::error_of(NAME))?;
        Ok(true)
    }

    fn import(&mut self, dir: &Path) -> Result<bool, Error> {
        let file = self
            .shape
            .policy_file(dir, &self.scaling.ports(&self.shares), self.head())?;
        self.policy.set_network(
            Shape::read(self.policy.network().clone(), &file).map_err(checkpoint::error_of(NAME))?,
        );
        Ok(true)
    }
}

#[cfg(test)]
mod tests;
