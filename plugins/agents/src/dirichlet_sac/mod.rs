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
//! | beta | `temperature` | scalar |
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
    acting, allocation,
    batch::{Batch, BatchInputs, plan_of},
    bellman::{Weight, bootstrapped, half_squared_error},
    checkpoint::{self, finite},
    replay::Replay,
    scaling::Scaling,
    schedule::UpdateSchedule,
    seat,
};
use asset_network::AssetChannels;
use contract::{
    Action, Agent, AgentTraits, Error, Feed, Interface, Metric, Mode, Observation, Recorder, Registry, Rng,
    Transition, Updates,
};
use networks::{CriticNetwork, PolicyNetwork, Shape, of_critics, parameters};
use numerics::{
    equations::{
        dirichlet::{Draw, sample},
        network::Network,
    },
    policy_file::{Head, Ports},
    tensor_file::{TensorFile, TensorFileError},
};
use plan::{Descent, Expression, Plans, State};
use rand::RngCore;
use std::path::Path;

const NAME: &str = "dirichlet_sac";
/// Name of the temperature in the state.
const TEMPERATURE: &str = "temperature";
/// File with networks from which another trial may begin.
const NETWORKS_FILE: &str = "networks.safetensors";

/// Soft actor-critic for one seat that acts on a simplex.
#[derive(Debug, Clone)]
pub struct DirichletSac {
    config: Config,
    scaling: Scaling,
    shares: Vec<String>,
    learner: Learner,
    state: State<f32>,
    acting: Plans,
    learning: Plans,
    replay: Replay,
    schedule: UpdateSchedule,
    /// Channels by asset; set where the assets of transitions are permuted.
    assets: Option<AssetChannels>,
}

/// Networks and temperature, and the equations by which they act and learn.
#[derive(Debug, Clone)]
struct Learner {
    policy: PolicyNetwork,
    critics: [CriticNetwork; 2],
    target_critics: [CriticNetwork; 2],
    temperature: Weight,
    target_entropy: f64,
    concentration_cap: Option<f64>,
    action_scaling: ActionScaling,
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
        let (n_observed, n_shares) = (channels.len(), shares.len());
        let shape = Shape::new(&config, channels, n_shares)?;
        let assets = config
            .permute_assets
            .then(|| AssetChannels::find(NAME, "permute_assets: true", channels, n_shares))
            .transpose()?;
        let mut state = State::default();
        let mut agent = Self {
            learner: Learner::new(&config, &shape, n_shares, &mut state, rng),
            scaling: Scaling::new(config.observation_scaling, channels),
            state,
            acting: Plans::default(),
            learning: Plans::default(),
            replay: Replay::new(config.replay_capacity, n_observed, n_shares, 1),
            schedule: UpdateSchedule::new(),
            config,
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
        networks::restore(&self.learner.networks(), &mut self.state, &file)?;
        if let Some(logarithm) = file.header["log_temperature"].as_f64() {
            Weight::new(TEMPERATURE, logarithm.exp(), &mut self.state);
        }
        Ok(())
    }

    /// Writes the networks and the temperature that [`begin_from`](Self::begin_from) reads.
    fn write_networks(&self, dir: &Path) -> Result<(), TensorFileError> {
        let mut file = TensorFile::default();
        networks::store(&self.learner.networks(), &self.state, &mut file);
        file.header["log_temperature"] = self.learner.temperature.value(&self.state).ln().into();
        file.write(&dir.join(NETWORKS_FILE))
    }

    fn update(&mut self, rng: &mut Rng, record: &mut Recorder) -> Result<(), Error> {
        let mut batch = self.replay.draw(self.config.batch_size, rng);
        if let Some(assets) = &self.assets {
            assets.permute(&mut batch, rng);
        }
        self.improve(&batch, rng, record)?;
        self.schedule.count_update();
        Ok(())
    }

    fn improve(&mut self, batch: &Batch, rng: &mut Rng, record: &mut Recorder) -> Result<(), Error> {
        let (learner, config, widths) = (&self.learner, &self.config, self.replay.widths());
        let plan = plan_of(&mut self.learning, batch.n_rows, widths, |batch| {
            learner.update(batch, config);
        });
        batch.write(plan);
        plan.run_seeded("update", &mut self.state, rng.next_u64());
        let step = self.schedule.n_steps();
        finite("concentration", step, plan.number("next_concentration"))?;
        for metric in ["critic_loss", "mean_concentration", "policy_loss"] {
            record.mean(metric, finite(metric, step, plan.number(metric))?);
        }
        for metric in ["policy_entropy", "mean_value", "temperature"] {
            record.mean(metric, plan.number(metric));
        }
        Ok(())
    }

    fn head(&self) -> Head {
        match self.config.evaluation_action {
            EvaluationAction::Mean => Head::DirichletMean,
            EvaluationAction::Mode => Head::DirichletMode,
        }
    }

    fn ports(&self) -> Ports {
        self.scaling.ports(&self.shares)
    }
}

impl Learner {
    /// Adds the parameters to a state: those of the policy, then of both critics.
    fn new(config: &Config, shape: &Shape, n_shares: usize, state: &mut State<f32>, rng: &mut Rng) -> Self {
        let (policy, critics) = (shape.policy(), shape.critics("critics"));
        networks::initialise(&policy.networks(), state, rng);
        networks::initialise(&of_critics(&critics), state, rng);
        let target_critics = shape.critics("target_critics");
        for (critic, target) in of_critics(&critics).iter().zip(of_critics(&target_critics)) {
            state.copy(critic.name(), target.name());
        }
        Self {
            policy,
            critics,
            target_critics,
            temperature: Weight::new(TEMPERATURE, config.first_temperature, state),
            target_entropy: config.target_nats(n_shares),
            concentration_cap: config.concentration_cap,
            action_scaling: config.critic_action_scaling,
        }
    }

    /// All networks, each with its own name.
    fn networks(&self) -> Vec<&Network> {
        let critics = [of_critics(&self.critics), of_critics(&self.target_critics)];
        [self.policy.networks(), critics.concat()].concat()
    }

    /// Weights of the shares up to their sum: draws, and in evaluation the mean or the mode.
    fn act(&self, observations: Expression<'_>, evaluation: EvaluationAction) {
        let equations = observations.equations();
        equations.routine("draw");
        equations.output("drawn", sample(self.concentrations(observations)).action);
        equations.routine("choose");
        let alpha = self.concentrations(observations);
        let weights = match evaluation {
            EvaluationAction::Mean => alpha,
            EvaluationAction::Mode => alpha - 1.0,
        };
        equations.output("chosen", weights);
    }

    /// The routine `update` of critics, policy, temperature and target critics.
    fn update(&self, batch: BatchInputs<'_>, config: &Config) {
        let equations = batch.observations.equations();
        equations.routine("update");
        let adam = |rate, first_rate| Descent::adam(rate, first_rate, config.gradient_clip);
        let target = self.soft_target(batch, config);
        let loss = self.critic_loss(batch, target);
        equations.output("critic_loss", loss);
        let critics = parameters(&of_critics(&self.critics), equations);
        let descent = adam("critic_learning_rate", config.critic_learning_rate);
        equations.descend(loss, &critics, &descent);

        let alpha = self.concentrations(batch.observations);
        equations.output("mean_concentration", alpha.mean());
        let (loss, log_density) = self.policy_loss(batch.observations, alpha, sample(alpha));
        equations.output("policy_loss", loss);
        let policy = parameters(&self.policy.networks(), equations);
        let descent = adam("actor_learning_rate", config.actor_learning_rate);
        equations.descend(loss, &policy, &descent);
        equations.output("policy_entropy", -log_density);
        equations.output("temperature", self.temperature.expression(equations));
        self.steer_temperature(log_density, config.temperature_learning_rate);
        let targets = parameters(&of_critics(&self.target_critics), equations);
        equations.follow(&targets, &critics, config.target_smoothing);
    }

    /// Eq. 3.17: reward plus the discounted soft value of the next observation.
    fn soft_target<'e>(&self, batch: BatchInputs<'e>, config: &Config) -> Expression<'e> {
        let alpha = self.concentrations(batch.next_observations);
        let equations = alpha.equations();
        equations.output("next_concentration", alpha.mean());
        let next = sample(alpha);
        let log_density = alpha.dirichlet_density(next.log_action);
        let excess = if config.shifted_entropy_bonus {
            log_density + self.target_entropy
        } else {
            log_density
        };
        let [first, second] = self.values(&self.target_critics, batch.next_observations, next.action);
        let soft_value = first.min(second) - excess * self.temperature.expression(equations);
        bootstrapped(batch.rewards, batch.continues, soft_value, config.discount)
    }

    /// Eq. 3.16: half the squared error of both critics.
    fn critic_loss<'e>(&self, batch: BatchInputs<'e>, target: Expression<'e>) -> Expression<'e> {
        let values = self.values(&self.critics, batch.observations, batch.actions);
        let [first, second] = values.map(|value| half_squared_error(value, target));
        first + second
    }

    /// Eq. 3.18: `beta log pi - Q` at a reparameterised draw from `Dirichlet(alpha)`, and the mean of `log pi`.
    fn policy_loss<'e>(
        &self,
        observations: Expression<'e>,
        alpha: Expression<'e>,
        drawn: Draw<'e>,
    ) -> (Expression<'e>, Expression<'e>) {
        let equations = alpha.equations();
        let log_density = alpha.dirichlet_density(drawn.log_action);
        let [first, second] = self.values(&self.critics, observations, drawn.action);
        let value = first.min(second);
        equations.output("mean_value", value.mean());
        let loss = (log_density * self.temperature.expression(equations) - value).mean();
        (loss, log_density.mean())
    }

    /// The temperature rises where the entropy is below its target.
    fn steer_temperature(&self, mean_log_density: Expression<'_>, rate: f64) {
        self.temperature
            .rise_with(mean_log_density + self.target_entropy, rate);
    }

    /// `alpha = softplus(f(s)) + 1` (section 3.4.3), so that the density has one mode inside the simplex.
    fn concentrations<'e>(&self, observations: Expression<'e>) -> Expression<'e> {
        let alpha = self.policy.apply(observations).softplus() + 1.0;
        match self.concentration_cap {
            Some(cap) => alpha.clamp(0.0, cap),
            None => alpha,
        }
    }

    /// Values of both critics.
    #[allow(clippy::cast_precision_loss, reason = "a number of shares is far below 2^52")]
    fn values<'e>(
        &self,
        critics: &[CriticNetwork; 2],
        observations: Expression<'e>,
        actions: Expression<'e>,
    ) -> [Expression<'e>; 2] {
        let actions = match self.action_scaling {
            ActionScaling::Centred => actions * actions.n_columns() as f64 - 1.0,
            ActionScaling::None => actions,
        };
        critics
            .each_ref()
            .map(|critic| critic.value(observations, actions))
    }
}

impl Agent for DirichletSac {
    fn act(&mut self, observations: &[Observation], mode: Mode, rng: &mut Rng) -> Result<Vec<Action>, Error> {
        let (learner, shape) = (&self.learner, [observations.len(), self.scaling.n_channels()]);
        let evaluation = self.config.evaluation_action;
        let plan = self.acting.of_rows(observations.len(), |equations| {
            learner.act(equations.input("observations", shape), evaluation);
        });
        plan.write("observations", &self.scaling.rows(observations));
        let weights = acting::actions(plan, mode, &mut self.state, rng);
        allocation::actions(weights, self.shares.len(), self.schedule.n_steps())
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

    fn plan(&mut self, _: usize) -> Option<String> {
        let (learner, config, widths) = (&self.learner, &self.config, self.replay.widths());
        let plan = plan_of(&mut self.learning, config.batch_size, widths, |batch| {
            learner.update(batch, config);
        });
        Some(plan.graph().to_string())
    }

    checkpoint::keeps!(NAME);

    fn export(&self, dir: &Path) -> Result<bool, Error> {
        let policy = &self.learner.policy;
        policy
            .write(&self.state, self.ports(), self.head(), dir)
            .and_then(|()| self.write_networks(dir))
            .map_err(checkpoint::error_of(NAME))?;
        Ok(true)
    }

    fn import(&mut self, dir: &Path) -> Result<bool, Error> {
        let (ports, head) = (self.ports(), self.head());
        self.learner.policy.import(&mut self.state, &ports, head, dir)?;
        Ok(true)
    }
}

#[cfg(test)]
mod tests;
