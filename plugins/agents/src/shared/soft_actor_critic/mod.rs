//! Soft actor-critic: actions in a box from a squashed Gaussian policy that is paid for its entropy.
//!
//! Haarnoja et al. 2018, "Soft actor-critic algorithms and applications", arXiv:1812.05905 (equations are
//! its).
//!
//! | paper | here | shape |
//! |---|---|---|
//! | s, s' | `observations`, `next_observations` (scaled) | `[batch, observed]` |
//! | a = f(eps; s) | `tanh(mean + sd noise)` | `[batch, n]` |
//! | log pi | `log_density` on the cube | `[batch, 1]` |
//! | Q_1, Q_2 | `critics` | `[batch, 1]` each |
//! | Q target | `target_critics` | `[batch, 1]` each |
//! | alpha | `temperature` | scalar |
//! | H | `target_entropy`, minus the number of entries of an action | scalar |
//! | gamma, tau | `discount`, `target_smoothing` | scalars |
//!
//! In evaluation the policy acts by `tanh(mean)`.
//!
//! Departures from the paper
//! - The temperature is exp of a number that descends `-(log pi + target)`, the form of the authors' code.
//! - No uniform first actions: the untrained policy acts until learning starts.
//! - Observations are scaled by the typical values of their channels; `observation_scaling: none` leaves them
//!   as they are.
//! - Weights are initialised after He et al. 2015, and the policy's last layer a tenth as large, so that
//!   first means are close to zero and first deviations close to 1.
//!
//! Metrics, means over the updates since the last measurement: `critic_loss` half the squared error summed
//! over both critics, `policy_loss` eq. 9, `policy_entropy` `-mean(log pi)`, `temperature` alpha,
//! `mean_value` mean of the lower critic at the policy's actions.

mod config;
#[cfg(test)]
mod tests;

pub use config::{Config, Temperature};

use crate::shared::{
    batch::{Batch, BatchInputs, BatchWidths},
    bellman::{Weight, bootstrapped, half_squared_error},
    box_seat::BoxSeat,
    checkpoint::{self, finite},
    replay::Replay,
    schedule::UpdateSchedule,
};
use contract::{
    Action, Agent, Error, Interface, Metric, Mode, Observation, Recorder, Rng, Transition, Updates,
};
use numerics::{
    equations::{
        network::{Network, lower, parameters},
        squashed::{Correction, mean_action, sample},
    },
    policy_file::{Head, Policy},
};
use plan::{Descent, Expression, Plans, Processor, State};
use rand::RngCore;
use std::path::Path;

const NAME: &str = "soft_actor_critic";
/// Gain of the policy's last layer.
const POLICY_OUTPUT_GAIN: f64 = 0.1;

/// Soft actor-critic for one seat.
#[derive(Debug, Clone)]
pub struct SoftActorCritic {
    config: Config,
    seat: BoxSeat,
    learner: Learner,
    state: State<f32>,
    acting: Plans,
    learning: Plans,
    replay: Replay,
    schedule: UpdateSchedule,
}

/// Networks, and the equations by which they act and learn.
#[derive(Debug, Clone)]
struct Learner {
    policy: Network,
    critics: [Network; 2],
    target_critics: [Network; 2],
    temperature: Weight,
    target_entropy: f64,
}

/// Metrics that [`SoftActorCritic::learn`] records.
pub(crate) fn metrics() -> Vec<Metric> {
    vec![
        Metric::new("critic_loss", "", "half the squared error of both critics").lower_is_better(),
        Metric::new(
            "policy_loss",
            "",
            "temperature times log pi less the lower critic",
        )
        .lower_is_better(),
        Metric::new(
            "policy_entropy",
            "nat",
            "minus the mean log density of sampled actions",
        ),
        Metric::new("temperature", "", "weight of the entropy").lower_is_better(),
        Metric::new(
            "mean_value",
            "",
            "mean of the lower critic at the policy's actions",
        ),
    ]
}

impl SoftActorCritic {
    /// Builds the agent for one seat that observes a box and acts in a box with limits -1 and 1.
    ///
    /// # Errors
    /// [`Error::Mismatch`] for any other seat, [`Error::Config`] for settings that contradict each other.
    pub(crate) fn new(config: Config, interface: &Interface, rng: &mut Rng) -> Result<Self, Error> {
        let seat = BoxSeat::new(NAME, config.observation_scaling, interface)?;
        config.check()?;
        Ok(Self::assemble(config, seat, |network, output_gain, state| {
            network.initialise(output_gain, state, rng);
        }))
    }

    /// Builds the agent for a seat. `initialise` adds a network with the gain of its last layer to a state: the policy,
    /// then both critics.
    pub(crate) fn assemble(
        config: Config,
        seat: BoxSeat,
        mut initialise: impl FnMut(&Network, f64, &mut State<f32>),
    ) -> Self {
        let (n_seen, n_done) = (seat.n_observed(), seat.n_acted());
        let mut state = State::default();
        let mut network = |name: &str, inputs, outputs, gain| {
            let network = config.hidden().network(name, inputs, outputs);
            initialise(&network, gain, &mut state);
            network
        };
        let policy = network("policy", n_seen, 2 * n_done, POLICY_OUTPUT_GAIN);
        let critics = ["critics.first", "critics.second"].map(|name| network(name, n_seen + n_done, 1, 1.0));
        let target = |critic: &Network, state: &mut State<f32>| {
            critic.copied(format!("target_{}", critic.name()), state)
        };
        let learner = Learner {
            target_critics: critics.each_ref().map(|critic| target(critic, &mut state)),
            policy,
            critics,
            temperature: Weight::new("temperature", config.first_temperature, &mut state),
            target_entropy: config.target_entropy.unwrap_or(-(n_done as f64)),
        };
        Self {
            replay: Replay::new(config.replay_capacity, n_seen, n_done, 1),
            learner,
            state,
            acting: Plans::default(),
            learning: Plans::default(),
            schedule: UpdateSchedule::new(),
            config,
            seat,
        }
    }

    /// Stores a transition in the replay buffer without an update.
    pub(crate) fn remember(&mut self, transition: &Transition) {
        self.replay.push_scaled(transition, &self.seat.scaling);
    }

    /// Number of stored transitions.
    pub(crate) fn n_remembered(&self) -> usize {
        self.replay.len()
    }

    /// Number of updates so far.
    pub(crate) fn n_updates(&self) -> u64 {
        self.schedule.n_updates()
    }

    /// Updates once with a batch drawn from the replay buffer.
    pub(crate) fn update(&mut self, rng: &mut Rng, record: &mut Recorder) -> Result<(), Error> {
        let n_rows = self.config.batch_size.min(self.replay.len());
        let batch = self.replay.draw_distinct(n_rows, rng);
        self.improve(&batch, rng, record)
    }

    /// Updates once with the whole replay buffer as the batch.
    pub(crate) fn update_with_everything(
        &mut self,
        rng: &mut Rng,
        record: &mut Recorder,
    ) -> Result<(), Error> {
        let batch = self.replay.latest(self.replay.len());
        self.improve(&batch, rng, record)
    }

    fn improve(&mut self, batch: &Batch, rng: &mut Rng, record: &mut Recorder) -> Result<(), Error> {
        let plan = self.learner.plan(
            &mut self.learning,
            batch.n_rows,
            self.replay.widths(),
            &self.config,
        );
        batch.write(plan);
        plan.run_seeded("update", &mut self.state, rng.next_u64());
        for metric in ["critic_loss", "policy_loss"] {
            record.mean(
                metric,
                finite(metric, self.schedule.n_steps(), plan.number(metric))?,
            );
        }
        for metric in ["policy_entropy", "mean_value", "temperature"] {
            record.mean(metric, plan.number(metric));
        }
        self.schedule.count_update();
        Ok(())
    }
}

impl Learner {
    fn plan<'p>(
        &self,
        plans: &'p mut Plans,
        n_rows: usize,
        widths: BatchWidths,
        config: &Config,
    ) -> &'p mut Processor<f32> {
        plans.of_rows(n_rows, |equations| {
            self.update(BatchInputs::new(equations, n_rows, widths), config);
        })
    }

    /// Actions of the policy, drawn and most likely ones.
    fn act(&self, observations: Expression<'_>) {
        let equations = observations.equations();
        equations.routine("draw");
        let head = self.policy.apply(observations);
        equations.output("drawn", sample(head, Correction::Exact).action);
        equations.routine("choose");
        let head = self.policy.apply(observations);
        equations.output("chosen", mean_action(head));
    }

    /// One update of critics, policy, temperature and target critics.
    fn update(&self, batch: BatchInputs<'_>, config: &Config) {
        let equations = batch.observations.equations();
        equations.routine("update");
        let adam = |rate, first_rate| Descent::adam(rate, first_rate, config.gradient_clip);
        let target = self.soft_target(batch, config.discount);
        let loss = self.critic_loss(batch, target);
        let critics = parameters(&self.critics, equations);
        equations.output("critic_loss", loss);
        equations.descend(
            loss,
            &critics,
            &adam("critic_learning_rate", config.critic_learning_rate),
        );

        let (loss, log_density) = self.policy_loss(batch);
        equations.output("policy_loss", loss);
        let policy = self.policy.parameters(equations);
        equations.descend(
            loss,
            &policy,
            &adam("actor_learning_rate", config.actor_learning_rate),
        );
        equations.output("policy_entropy", -log_density);
        equations.output("temperature", self.temperature.expression(equations));
        if config.temperature == Temperature::Automatic {
            // Eq. 18: it rises where the entropy is below its target.
            self.temperature.rise_with(
                log_density + self.target_entropy,
                config.temperature_learning_rate,
            );
        }
        let targets = parameters(&self.target_critics, equations);
        equations.follow(&targets, &critics, config.target_smoothing);
    }

    /// Eq. 2 and 3: reward plus the discounted soft value of the next observation.
    fn soft_target<'e>(&self, batch: BatchInputs<'e>, discount: f64) -> Expression<'e> {
        let next = sample(self.policy.apply(batch.next_observations), Correction::Exact);
        let value = lower(&self.target_critics, joined(batch.next_observations, next.action));
        let soft_value = value - next.log_density * self.temperature.expression(value.equations());
        bootstrapped(batch.rewards, batch.continues, soft_value, discount)
    }

    /// Eq. 5: half the squared soft Bellman error of both critics.
    fn critic_loss<'e>(&self, batch: BatchInputs<'e>, target: Expression<'e>) -> Expression<'e> {
        let seen = joined(batch.observations, batch.actions);
        let [first, second] = self
            .critics
            .each_ref()
            .map(|critic| half_squared_error(critic.apply(seen), target));
        first + second
    }

    /// Eq. 9, and the mean of `log pi`.
    fn policy_loss<'e>(&self, batch: BatchInputs<'e>) -> (Expression<'e>, Expression<'e>) {
        let drawn = sample(self.policy.apply(batch.observations), Correction::Exact);
        let value = lower(&self.critics, joined(batch.observations, drawn.action));
        let equations = value.equations();
        equations.output("mean_value", value.mean());
        let loss = (drawn.log_density * self.temperature.expression(equations) - value).mean();
        (loss, drawn.log_density.mean())
    }
}

fn joined<'e>(observations: Expression<'e>, actions: Expression<'e>) -> Expression<'e> {
    observations.equations().join(&[observations, actions])
}

impl Agent for SoftActorCritic {
    fn act(&mut self, observations: &[Observation], mode: Mode, rng: &mut Rng) -> Result<Vec<Action>, Error> {
        let (learner, seat) = (&self.learner, &self.seat);
        let plan = self.acting.of_rows(observations.len(), |equations| {
            learner.act(equations.input("observations", [observations.len(), seat.n_observed()]));
        });
        plan.write("observations", &seat.scaled(observations));
        let action = match mode {
            Mode::Train => {
                plan.run_seeded("draw", &mut self.state, rng.next_u64());
                "drawn"
            }
            Mode::Evaluate => {
                plan.run("choose", &mut self.state);
                "chosen"
            }
        };
        seat.actions(plan.entries(action), self.schedule.n_steps())
    }

    fn learn(
        &mut self,
        transitions: &[Transition],
        rng: &mut Rng,
        record: &mut Recorder,
    ) -> Result<(), Error> {
        for transition in transitions {
            self.remember(transition);
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

    fn plan(&mut self) -> Option<String> {
        let (rows, widths) = (self.config.batch_size, self.replay.widths());
        let plan = self.learner.plan(&mut self.learning, rows, widths, &self.config);
        Some(plan.graph().to_string())
    }

    checkpoint::keeps!(NAME);

    fn export(&self, dir: &Path) -> Result<bool, Error> {
        let policy = Policy::new(&self.learner.policy, &self.state, self.seat.ports(), Head::Tanh);
        policy.write(dir).map_err(checkpoint::error_of(NAME))?;
        Ok(true)
    }

    fn import(&mut self, dir: &Path) -> Result<bool, Error> {
        let ports = self.seat.ports();
        checkpoint::import_policy(
            NAME,
            &self.learner.policy,
            &mut self.state,
            dir,
            &ports,
            Head::Tanh,
        )?;
        Ok(true)
    }
}
