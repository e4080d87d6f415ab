//! Lyapunov actor-critic (`lac`), and its constrained form (`clac`) with smooth actions.
//!
//! M. Han, L. Zhang, J. Wang and W. Pan 2020, "Actor-critic reinforcement learning for control with
//! stability guarantee", arXiv:2004.14288, and the authors' code; thesis, section 2.3.3, for `clac`
//! (equations are its). "Released code" is that of the thesis' group for the calibration of models.
//!
//! | thesis | here | shape |
//! |---|---|---|
//! | c | cost, minus the reward; 0 at least | `[batch, 1]` |
//! | s, s' | `observations`, `next_observations` (scaled) | `[batch, observed]` |
//! | a = f(eps, s) | `tanh(mean + sd noise)`, ln sd within `log_sd_low` and `log_sd_high` | `[batch, n]` |
//! | pi*(s) | `tanh(mean)`, also the action in evaluation | `[batch, n]` |
//! | s_near | `before`, the observation one step before s | `[batch, observed]` |
//! | L(s, a) | sum of the squares of the last hidden layer of `lyapunov` | `[batch, 1]` |
//! | L target | `target_lyapunov` at a sample of `target_policy` | `[batch, 1]` |
//! | lambda | `multiplier`, at most 1 where it counts | scalar |
//! | beta, H_t | `temperature`, `target_entropy` | scalars |
//! | alpha, alpha_3 | `smoothness`, `decrease` | scalars |
//! | gamma, tau | `discount`, `target_smoothing` | scalars |
//!
//! An update, after which both targets follow by tau:
//! - L descends half the squared error to `c + gamma (1 - d) L_target(s', a')` (eq. 2.5 and 2.6) without an
//!   entropy bonus;
//! - the policy descends `lambda D + beta mean(log pi(a | s)) + alpha |pi*(s) - pi*(s_near)|` (eq. 2.7 and
//!   2.10) with the violation `D = mean(L(s', f(eps, s')) - L(s, a) + alpha_3 c)`, in which a gradient passes
//!   through the action at s' alone;
//! - `log lambda` ascends `log lambda D` (eq. 2.9), `log beta` ascends `log beta (log pi + H_t)` (eq. 2.8).
//!
//! Departures
//! - Eq. 2.6 prints a maximum over actions; a sample is taken, as all public code does.
//! - Eq. 2.8 and 2.9 print beta and lambda themselves as factors; public code has their logarithms.
//! - The parts of an update follow each other. Public code evaluates them at once, and moves the targets
//!   first.
//! - Leaky rectifiers have the slope 0.01 below zero (Maas et al. 2013, whom the thesis names), in the
//!   released code 0.2. Mean and ln sd are one last layer of the policy, there they are two.
//! - Learning rates decline from update to update, in the released code from episode to episode; it keeps
//!   transitions of whole episodes, and for CLAC none of the first two steps of one, here not the first.
//!
//! Metrics, means over the updates since the last measurement: `lyapunov_loss`, `policy_loss`,
//! `policy_entropy` `-mean(log pi)`, `temperature` beta, `multiplier` lambda as it counts, `violation` D,
//! `mean_lyapunov` mean of L(s, a), and where `smoothness` is above 0 `action_change`, the norm that it
//! weighs.

mod config;
mod exploration;
mod learner;
mod memory;
mod networks;
#[cfg(test)]
mod tests;

pub use config::{ClacConfig, Config, SmoothnessNorm};

use crate::shared::{
    acting,
    batch::plan_of,
    box_seat::BoxSeat,
    checkpoint::{self, finite},
    schedule::UpdateSchedule,
    seat::mismatch,
};
use contract::{
    Action, Agent, AgentTraits, Error, Feed, Interface, Metric, Mode, Observation, Recorder, Registry, Rng,
    Transition, Updates,
};
use exploration::Disturbance;
use learner::Learner;
use memory::{Memory, MemoryOptions, PreviousObservations};
use numerics::{
    equations::state_file,
    policy_file::{Head, Policy},
    tensor_file::TensorFile,
};
use plan::{Plans, State};
use rand::RngCore;
use serde::{Deserialize, Serialize};
use std::path::Path;

const LAC: &str = "lac";
const CLAC: &str = "clac";

/// Agent of both algorithms.
#[derive(Debug, Clone)]
pub struct LyapunovActorCritic {
    name: &'static str,
    config: Config,
    seat: BoxSeat,
    disturbance: Disturbance,
    learner: Learner,
    state: State<f32>,
    acting: Plans,
    learning: Plans,
    memory: Memory,
    schedule: UpdateSchedule,
}

/// State of a checkpoint besides its tensors.
#[derive(Serialize, Deserialize)]
struct Counters {
    before: PreviousObservations,
    schedule: UpdateSchedule,
}

/// Registers Lyapunov actor-critic.
pub(crate) fn register(registry: &mut Registry, version: u32) {
    let about =
        "actor-critic that lets a Lyapunov function of the cost fall; learns from costs of 0 at least";
    registry.agent(LAC, version, about, traits(), |config, interface, rng| {
        build(LAC, config, interface, rng)
    });
}

/// Registers the constrained form.
pub(crate) fn register_constrained(registry: &mut Registry, version: u32) {
    let about = "Lyapunov actor-critic that is kept from moving its action between neighbouring states";
    registry.agent(
        CLAC,
        version,
        about,
        traits(),
        |ClacConfig(config), interface, rng| build(CLAC, config, interface, rng),
    );
}

/// Traits of both algorithms. They take no datasets, whose transitions lack the observation before.
fn traits() -> AgentTraits {
    AgentTraits::learner([Feed::Decisions], metrics())
}

/// Builds the agent for one seat that observes a box and acts in a box with limits -1 and 1.
///
/// # Errors
/// [`Error::Mismatch`] for any other seat; [`Error::Config`] for settings that contradict each other or name
/// unknown channels.
fn build(
    name: &'static str,
    config: Config,
    interface: &Interface,
    rng: &mut Rng,
) -> Result<Box<dyn Agent>, Error> {
    Ok(Box::new(LyapunovActorCritic::new(name, config, interface, rng)?))
}

/// Metrics that [`LyapunovActorCritic::learn`] records.
fn metrics() -> Vec<Metric> {
    let of = Metric::new;
    vec![
        of(
            "lyapunov_loss",
            "",
            "half the squared error of the Lyapunov critic",
        )
        .lower_is_better(),
        of("policy_loss", "", "violation, log pi and action change, weighed").lower_is_better(),
        of(
            "policy_entropy",
            "nat",
            "minus the mean log density of sampled actions",
        ),
        of("temperature", "", "weight of the entropy").lower_is_better(),
        of("multiplier", "", "weight of the violation, at most 1").lower_is_better(),
        of("violation", "", "by how much the Lyapunov value falls too little").lower_is_better(),
        of("mean_lyapunov", "", "mean Lyapunov value of what was done").lower_is_better(),
        of(
            "action_change",
            "",
            "norm of the scored action's moves to neighbouring states; where `smoothness` is above 0",
        )
        .lower_is_better(),
    ]
}

impl LyapunovActorCritic {
    fn new(name: &'static str, config: Config, interface: &Interface, rng: &mut Rng) -> Result<Self, Error> {
        let seat = BoxSeat::new(name, config.observation_scaling, interface)?;
        config.check()?;
        let (n_seen, n_done) = (seat.n_observed(), seat.n_acted());
        let mut state = State::default();
        let options = MemoryOptions {
            before: config.smoothness > 0.0,
            bootstrap_at_time_limit: config.bootstrap_at_time_limit,
        };
        Ok(Self {
            name,
            disturbance: Disturbance::new(&config, &seat)?,
            learner: Learner::new(&config, [n_seen, n_done], &mut state, rng),
            state,
            acting: Plans::default(),
            learning: Plans::default(),
            memory: Memory::new(config.replay_capacity, n_seen, n_done, options),
            schedule: UpdateSchedule::new(),
            config,
            seat,
        })
    }

    fn update(&mut self, rng: &mut Rng, record: &mut Recorder) -> Result<(), Error> {
        self.decline();
        let (learner, config, widths) = (&self.learner, &self.config, self.memory.widths());
        let batch = self.memory.sample(config.batch_size, rng);
        let plan = plan_of(&mut self.learning, batch.n_rows, widths, |batch| {
            learner.update(batch, config);
        });
        batch.write(plan);
        plan.run_seeded("update", &mut self.state, rng.next_u64());
        for metric in ["lyapunov_loss", "policy_loss"] {
            let loss = finite(metric, self.schedule.n_steps(), plan.number(metric))?;
            record.mean(metric, loss);
        }
        let others = [
            "mean_lyapunov",
            "policy_entropy",
            "violation",
            "multiplier",
            "temperature",
        ];
        let change = (config.smoothness > 0.0).then_some("action_change");
        for metric in others.into_iter().chain(change) {
            record.mean(metric, plan.number(metric));
        }
        self.schedule.count_update();
        Ok(())
    }

    /// Sets the learning rates of the present step.
    fn decline(&mut self) {
        let Config {
            actor_learning_rate,
            lyapunov_learning_rate,
            multiplier_learning_rate,
            temperature_learning_rate,
            ..
        } = self.config;
        let left = self.config.rate_left(self.schedule.n_steps());
        for (name, rate) in [
            ("actor_learning_rate", actor_learning_rate),
            ("lyapunov_learning_rate", lyapunov_learning_rate),
            ("multiplier_learning_rate", multiplier_learning_rate),
            ("temperature_learning_rate", temperature_learning_rate),
        ] {
            self.state.set_number(name, left * rate);
        }
    }

    /// Refuses negative costs: their discounted sum is no Lyapunov function.
    fn check_costs(&self, transitions: &[Transition]) -> Result<(), Error> {
        let Some(gain) = transitions.iter().find(|it| it.rewards[0] > 0.0) else {
            return Ok(());
        };
        let (step, reward) = (self.schedule.n_steps(), gain.rewards[0]);
        let problem = format!(
            "a Lyapunov critic needs costs of at least 0, which are minus the rewards; after step {step} the \
             reward is {reward}: use an environment whose rewards are 0 at most"
        );
        Err(mismatch(self.name, problem))
    }
}

impl Agent for LyapunovActorCritic {
    fn act(&mut self, observations: &[Observation], mode: Mode, rng: &mut Rng) -> Result<Vec<Action>, Error> {
        let mut seen = self.seat.scaled(observations);
        if mode == Mode::Train {
            self.disturbance.add_to(&mut seen, rng);
        }
        let (learner, shape) = (&self.learner, [observations.len(), self.seat.n_observed()]);
        let plan = self.acting.of_rows(observations.len(), |equations| {
            learner.act(equations.input("observations", shape));
        });
        plan.write("observations", &seen);
        let action = acting::actions(plan, mode, &mut self.state, rng);
        self.seat.actions(action, self.schedule.n_steps())
    }

    fn learn(
        &mut self,
        transitions: &[Transition],
        rng: &mut Rng,
        record: &mut Recorder,
    ) -> Result<(), Error> {
        self.check_costs(transitions)?;
        self.memory.push(transitions, &self.seat.scaling);
        let Config {
            learning_starts,
            updates_per_step,
            ..
        } = self.config;
        let due = self
            .schedule
            .advance(transitions.len(), learning_starts, updates_per_step);
        if self.memory.is_empty() {
            // The buffer is empty after episodes of one step.
            return Ok(());
        }
        (0..due).try_for_each(|_| self.update(rng, record))
    }

    fn plan(&mut self, _: usize) -> Option<String> {
        let (learner, config, widths) = (&self.learner, &self.config, self.memory.widths());
        let plan = plan_of(&mut self.learning, config.batch_size, widths, |batch| {
            learner.update(batch, config);
        });
        Some(plan.graph().to_string())
    }

    fn updates(&self) -> Option<Updates> {
        Some(
            self.schedule
                .updates(self.config.learning_starts, self.config.updates_per_step),
        )
    }

    fn save(&self, dir: &Path) -> Result<(), Error> {
        let mut file = TensorFile::default();
        state_file::store(&self.state, &mut file);
        self.memory.store(&mut file);
        let counters = Counters {
            before: self.memory.before().clone(),
            schedule: self.schedule,
        };
        checkpoint::write(self.name, dir, file, &counters)
    }

    fn load(&mut self, dir: &Path) -> Result<(), Error> {
        let (file, counters): (_, Counters) = checkpoint::read(self.name, dir)?;
        let misfit = checkpoint::error_of(self.name);
        state_file::restore(&mut self.state, &file).map_err(&misfit)?;
        self.memory.restore(&file, counters.before).map_err(&misfit)?;
        self.schedule = counters.schedule;
        Ok(())
    }

    fn export(&self, dir: &Path) -> Result<bool, Error> {
        let (policy, ports) = (&self.learner.policy, self.seat.ports());
        let policy = Policy::new(policy, &self.state, ports, Head::Tanh);
        policy.write(dir).map_err(checkpoint::error_of(self.name))?;
        Ok(true)
    }

    fn import(&mut self, dir: &Path) -> Result<bool, Error> {
        let (policy, ports) = (&self.learner.policy, self.seat.ports());
        checkpoint::import_policy(self.name, policy, &mut self.state, dir, &ports, Head::Tanh)?;
        Ok(true)
    }
}
