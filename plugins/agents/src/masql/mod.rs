//! Multi-agent soft Q-learning: every seat learns a soft value of the joint action, draws joint actions in
//! proportion to its exponential, and executes its own part of a draw.
//!
//! Wei, Wicke, Freelan and Luke 2018, "Multiagent soft Q-learning", arXiv:1804.09817; the single-agent
//! algorithm with its equations is Haarnoja et al. 2017, "Reinforcement learning with deep energy-based
//! policies", arXiv:1702.08165; constants of `preset: rommeo_paper` from the code of Tian et al. 2019, "A
//! regularized opponent model with maximum entropy objective", arXiv:1905.08087, for its baseline.
//!
//! | paper | here | shape |
//! |---|---|---|
//! | s | the columns of `observations` that `sight` gives to the seat | `[batch, seen]` |
//! | a = (a_1, ..., a_N) | joint `actions` | `[batch, n_acted]` |
//! | Q_soft(s, a) | `critic` | `[batch, 1]` |
//! | Q_soft with target parameters | `target_critic` | `[batch, 1]` |
//! | V_soft(s) | `soft_value` | `[batch, 1]` |
//! | f(xi; s) | `tanh(sampler(s, xi))` | `[batch K, n_acted]` |
//! | xi | latent noise, standard normal | `[batch K, n_acted]` |
//! | Delta f | direction of [`numerics::equations::stein`] | `[batch moved, n_acted]` |
//! | alpha | `temperature`, a schedule of the step | `[1, 1]` |
//! | gamma, tau | `discount`, `target_smoothing` | scalars |
//!
//! Equations
//! - `V_soft(s) = alpha (ln mean_k exp(Q(s, u_k) / alpha) + n_acted ln 2)` with `u_k` uniform on the cube:
//!   eq. 10, whose proposal density is `2^-n_acted`. The density that the particles follow is `exp(Q(s, a) /
//!   alpha)`, eq. 6.
//! - Critic: half the squared error to `r + gamma (1 - d) V_soft(s')`, eq. 11.
//! - Sampler: particles follow `Delta f`, eq. 13, and the parameters follow the particles, eq. 14. The target
//!   density is that of the authors' code, `Q / alpha + sum ln(1 - a^2 + 1e-6)`: its second term keeps
//!   particles away from the faces of the cube.
//!
//! Departures
//! - The code of Tian et al. multiplies only the sum of exponentials by alpha and adds `n_acted ln 2 - ln K`
//!   unscaled; here the value is that of the equation. The two differ by a constant while alpha is constant.
//! - Uniform particles are drawn for every row of a batch, not once for the batch.
//! - The action in evaluation is the best of several draws by default: the sampler has no mean.
//!   `evaluation_action: draw` takes one draw.
//! - Weights start after He et al. No batch normalisation of inputs, which the thesis's code has in every
//!   network. The thesis does not compare with this algorithm; `preset: thesis` takes the sizes and rates of
//!   its own.
//!
//! Metrics, means over updates and seats since the last measurement: `critic_loss`, `particle_value` mean of
//! Q at the held particles, `kernel_bandwidth` mean of h, `temperature` alpha.

mod config;
mod seat;
#[cfg(test)]
mod tests;

pub use config::{Config, EvaluationAction};

use seat::Seat;

use crate::shared::{
    batch::{Batch, BatchInputs, plan_of},
    bellman::{bootstrapped, half_squared_error},
    checkpoint::{self, finite},
    joint::JointLayout,
    replay::Replay,
    schedule::UpdateSchedule,
};
use contract::{
    Action, Agent, AgentTraits, Error, Feed, Interface, Metric, Mode, Observation, Recorder, Registry, Rng,
    Transition, Updates,
};
use numerics::{
    equations::{
        network::Network,
        state_file::{restore_network, store_network},
    },
    policy_file::{Head, Policy, Ports},
    tensor_file::TensorFile,
};
use plan::{Descent, Expression, Plans, State};
use rand::RngCore;
use std::path::Path;

const NAME: &str = "masql";
/// File of a seat's exported critic; the next constant is the prefix of its tensors' names.
const CRITIC_FILE: &str = "critic.safetensors";
const CRITIC: &str = "critic";
/// Metrics of the update of a seat.
const MEASURES: [&str; 3] = ["critic_loss", "particle_value", "kernel_bandwidth"];

/// Multi-agent soft Q-learning for all seats.
#[derive(Debug, Clone)]
pub struct Masql {
    config: Config,
    learner: Learner,
    state: State<f32>,
    acting: Plans,
    learning: Plans,
    replay: Replay,
    schedule: UpdateSchedule,
}

/// Networks of all seats, and the equations by which they act and learn.
#[derive(Debug, Clone)]
struct Learner {
    layout: JointLayout,
    seats: Vec<Seat>,
}

/// Registers the agent.
pub(crate) fn register(registry: &mut Registry, version: u32) {
    let about = "multi-agent soft Q-learning: joint actions drawn by a Stein sampler";
    let traits = AgentTraits::learner([Feed::Decisions], metrics());
    registry.agent(NAME, version, about, traits, build);
}

/// Builds the agent for seats that observe boxes and act in boxes with limits -1 and 1.
///
/// # Errors
/// [`Error::Mismatch`] for any other seat, [`Error::Config`] for settings that contradict each other.
fn build(config: Config, interface: &Interface, rng: &mut Rng) -> Result<Box<dyn Agent>, Error> {
    Ok(Box::new(Masql::new(config, interface, rng)?))
}

/// Metrics that [`Masql::learn`] records.
fn metrics() -> Vec<Metric> {
    vec![
        Metric::new(
            "critic_loss",
            "",
            "half the squared error of a critic, mean over seats",
        )
        .lower_is_better(),
        Metric::new(
            "particle_value",
            "",
            "mean value of the joint actions that the samplers draw",
        ),
        Metric::new(
            "kernel_bandwidth",
            "",
            "mean bandwidth of the kernel between joint actions",
        ),
        Metric::new("temperature", "", "weight alpha of the entropy").lower_is_better(),
    ]
}

impl Masql {
    fn new(config: Config, interface: &Interface, rng: &mut Rng) -> Result<Self, Error> {
        config.check()?;
        let layout = JointLayout::new(NAME, interface)?;
        let mut state = State::default();
        let seats = (0..layout.n_seats()).map(|seat| Seat::new(&config, &layout, seat, &mut state, rng));
        Ok(Self {
            replay: Replay::of_seats(config.replay_capacity, &layout),
            learner: Learner {
                seats: seats.collect(),
                layout,
            },
            state,
            acting: Plans::default(),
            learning: Plans::default(),
            schedule: UpdateSchedule::new(),
            config,
        })
    }

    #[allow(clippy::cast_possible_truncation, reason = "networks compute in f32")]
    fn update(&mut self, rng: &mut Rng, record: &mut Recorder) -> Result<(), Error> {
        let temperature = self.temperature();
        let (learner, config, widths) = (&self.learner, &self.config, self.replay.widths());
        let n_rows = config.batch_size.min(self.replay.len());
        let plan = plan_of(&mut self.learning, n_rows, widths, |batch| {
            learner.update(batch, config);
        });
        plan.write("temperature", &[temperature as f32]);
        for seat in 0..widths.seats {
            drawn(&self.replay, n_rows, config, rng).write(plan);
            plan.run_seeded(&of_seat(seat, "update"), &mut self.state, rng.next_u64());
            for metric in MEASURES {
                let number = plan.number(&of_seat(seat, metric));
                record.mean(metric, finite(metric, self.schedule.n_steps(), number)?);
            }
        }
        self.schedule.count_update();
        if self.schedule.n_updates().is_multiple_of(config.target_period) {
            plan.run("follow", &mut self.state);
        }
        record.mean("temperature", temperature);
        Ok(())
    }

    fn temperature(&self) -> f64 {
        self.config.temperature_at(self.schedule.n_steps())
    }

    /// Inputs and outputs of a seat's sampler as its file describes them: observations, then noise for every
    /// entry of the joint action.
    fn ports(&self, seat: usize) -> Ports {
        let layout = &self.learner.layout;
        let acted = 0..layout.n_acted();
        let mut ports = layout.ports(self.learner.seats[seat].seen.clone(), acted.clone());
        for entry in acted {
            ports.inputs.push(format!("noise_{entry}"));
            ports.center.push(0.0);
            ports.spread.push(1.0);
        }
        ports
    }
}

/// A batch for one seat, with the rewards that its config asks for.
fn drawn(replay: &Replay, n_rows: usize, config: &Config, rng: &mut Rng) -> Batch {
    let mut batch = replay.draw_distinct(n_rows, rng);
    if config.reward_normalisation {
        replay.standardise_rewards(&mut batch);
    }
    batch
}

/// Name of what belongs to a seat.
fn of_seat(seat: usize, what: &str) -> String {
    format!("seat_{seat}.{what}")
}

impl Learner {
    /// Joint actions of the own parts of draws: of one draw each, and of the best of `n_draws`.
    fn act(&self, observations: Expression<'_>, n_draws: usize) {
        let equations = observations.equations();
        equations.routine("draw");
        let joint = self.own_actions(|seat| seat.drawn(seat.seen(observations), 1));
        equations.output("drawn", joint);
        equations.routine("choose");
        let joint = self.own_actions(|seat| seat.best_drawn(seat.seen(observations), n_draws));
        equations.output("chosen", joint);
    }

    /// Joint actions from each seat's own part of a joint draw.
    fn own_actions<'e>(&self, draw: impl Fn(&Seat) -> Expression<'e>) -> Expression<'e> {
        let own = |(at, seat)| draw(seat).columns(self.layout.acted(at));
        let parts: Vec<_> = self.seats.iter().enumerate().map(own).collect();
        parts[0].equations().join(&parts)
    }

    /// One update of each seat's critic and sampler, and one move of all targets.
    fn update(&self, batch: BatchInputs<'_>, config: &Config) {
        let equations = batch.observations.equations();
        let temperature = equations.input("temperature", [1, 1]);
        let descend = |loss, network: &Network, rate, first_rate| {
            let descent = Descent::adam(rate, first_rate, config.gradient_clip);
            equations.descend(loss, &network.parameters(equations), &descent);
        };
        for (at, seat) in self.seats.iter().enumerate() {
            equations.routine(&of_seat(at, "update"));
            let target = self.soft_target(at, batch, temperature, config);
            let loss = half_squared_error(seat.critic_value(batch), target);
            equations.output(&of_seat(at, "critic_loss"), loss);
            descend(
                loss,
                &seat.critic,
                "critic_learning_rate",
                config.critic_learning_rate,
            );
            let movement = seat.movement(batch.observations, temperature, config);
            equations.output(&of_seat(at, "particle_value"), movement.held_value);
            equations.output(&of_seat(at, "kernel_bandwidth"), movement.bandwidth.mean());
            let loss = movement.loss();
            descend(
                loss,
                &seat.sampler,
                "actor_learning_rate",
                config.actor_learning_rate,
            );
        }
        equations.routine("follow");
        for seat in &self.seats {
            let (target, source) = (&seat.target_critic, &seat.critic);
            let (target, source) = (target.parameters(equations), source.parameters(equations));
            equations.follow(&target, &source, config.target_smoothing);
        }
    }

    /// Eq. 11: reward plus the discounted soft value of the next observation.
    fn soft_target<'e>(
        &self,
        seat: usize,
        batch: BatchInputs<'e>,
        temperature: Expression<'e>,
        config: &Config,
    ) -> Expression<'e> {
        let n_particles = config.value_particles;
        let next_value = self.seats[seat].soft_value(batch.next_observations, temperature, n_particles);
        let rewards = batch.rewards.columns(seat..seat + 1);
        bootstrapped(rewards, batch.continues, next_value, config.discount)
    }
}

impl Agent for Masql {
    fn act(&mut self, observations: &[Observation], mode: Mode, rng: &mut Rng) -> Result<Vec<Action>, Error> {
        let (learner, layout, n_rows) = (&self.learner, &self.learner.layout, observations.len());
        let plan = self.acting.of_rows(n_rows, |equations| {
            let observations = equations.input("observations", [n_rows, layout.n_observed()]);
            learner.act(observations, self.config.value_particles);
        });
        let (routine, actions) = match (mode, self.config.evaluation_action) {
            (Mode::Evaluate, EvaluationAction::BestOfDraws) => ("choose", "chosen"),
            _ => ("draw", "drawn"),
        };
        plan.write("observations", &layout.observation_rows(observations));
        plan.run_seeded(routine, &mut self.state, rng.next_u64());
        layout.actions(plan.entries(actions), self.schedule.n_steps())
    }

    fn learn(
        &mut self,
        transitions: &[Transition],
        rng: &mut Rng,
        record: &mut Recorder,
    ) -> Result<(), Error> {
        transitions
            .iter()
            .for_each(|transition| self.replay.push(transition));
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

    /// Writes one file per seat, in a folder with the seat's name. Inputs are the observation and then
    /// standard normal noise, one number per entry of the joint action. Outputs are the joint action, of
    /// which the seat executes its own entries. The critic has a file beside it: the best of several draws is
    /// the one with the largest value.
    fn export(&self, dir: &Path) -> Result<bool, Error> {
        let misfit = checkpoint::error_of(NAME);
        for (at, seat) in self.learner.seats.iter().enumerate() {
            let policy = Policy::new(&seat.sampler, &self.state, self.ports(at), Head::Tanh);
            let folder = self.learner.layout.folder(dir, at)?;
            policy.write(&folder).map_err(&misfit)?;
            let mut critic = TensorFile::default();
            store_network(&seat.critic, CRITIC, &self.state, &mut critic);
            critic.write(&folder.join(CRITIC_FILE)).map_err(&misfit)?;
        }
        Ok(true)
    }

    fn import(&mut self, dir: &Path) -> Result<bool, Error> {
        let misfit = checkpoint::error_of(NAME);
        for (at, seat) in self.learner.seats.iter().enumerate() {
            let (ports, folder) = (self.ports(at), self.learner.layout.place(dir, at));
            checkpoint::import_policy(NAME, &seat.sampler, &mut self.state, &folder, &ports, Head::Tanh)?;
            let critic = TensorFile::read(&folder.join(CRITIC_FILE)).map_err(&misfit)?;
            restore_network(&seat.critic, CRITIC, &mut self.state, &critic).map_err(&misfit)?;
        }
        Ok(true)
    }
}
