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
//! | Delta f | direction of [`numerics::stein`] | `[batch moved, n_acted]` |
//! | alpha | temperature, a schedule of the step | scalar |
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
#[cfg(test)]
mod tests;

pub use config::{Config, EvaluationAction};

use crate::shared::{
    checkpoint::{self, finite},
    joint::{JointLayout, columns, repeat_rows},
    replay::{Batch, Replay},
    schedule::UpdateSchedule,
    targets::{bootstrapped, half_squared_error, mean},
};
use burn::{module::Module, tensor::Tensor};
use contract::{
    Action, Agent, AgentTraits, Error, Feed, Interface, Metric, Mode, Observation, Recorder, Registry, Rng,
    Transition, Updates,
};
use numerics::{
    gaussian::{standard_normal, standard_uniform},
    network::{Mlp, matrix, values},
    optimizer::{Adam, TrainedNetwork},
    parameters::{restore, soft_update, store},
    policy_file::{Head, Policy, Ports},
    stein::{Particles, SteinDirection, stein_direction},
    tensor_file::TensorFile,
};
use std::path::Path;

const NAME: &str = "masql";
/// File of a seat's exported critic; the next constant is the prefix of its tensors' names.
const CRITIC_FILE: &str = "critic.safetensors";
const CRITIC: &str = "critic";
/// Keeps the logarithm of the correction for tanh finite on the faces of the cube.
const FACE: f64 = 1e-6;

/// Multi-agent soft Q-learning for all seats.
#[derive(Debug, Clone)]
pub struct Masql {
    config: Config,
    layout: JointLayout,
    learners: Vec<Learner>,
    replay: Replay,
    schedule: UpdateSchedule,
}

/// Networks of one seat.
#[derive(Debug, Clone)]
struct Learner {
    sampler: TrainedNetwork<Mlp>,
    critic: TrainedNetwork<Mlp>,
    target_critic: Mlp,
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
        let learners = (0..layout.n_seats())
            .map(|seat| Learner::new(&config, &layout, seat, rng))
            .collect();
        Ok(Self {
            learners,
            replay: Replay::of_seats(config.replay_capacity, &layout),
            schedule: UpdateSchedule::new(),
            config,
            layout,
        })
    }

    fn update(&mut self, rng: &mut Rng, record: &mut Recorder) -> Result<(), Error> {
        for seat in 0..self.layout.n_seats() {
            let batch = self
                .replay
                .sample_distinct(self.config.batch_size.min(self.replay.len()), rng);
            self.update_critic(seat, &batch, rng, record)?;
            self.update_sampler(seat, &batch, rng, record)?;
        }
        self.schedule.count_update();
        if self
            .schedule
            .n_updates()
            .is_multiple_of(self.config.target_period)
        {
            let tau = self.config.target_smoothing;
            self.learners.iter_mut().for_each(|learner| learner.follow(tau));
        }
        record.mean("temperature", self.temperature());
        Ok(())
    }

    /// Eq. 11: the critic descends the squared error to its target.
    fn update_critic(
        &mut self,
        seat: usize,
        batch: &Batch,
        rng: &mut Rng,
        record: &mut Recorder,
    ) -> Result<(), Error> {
        let target = self.soft_target(seat, batch, rng);
        let seen = self.seen(seat, &batch.observations);
        let critic = &mut self.learners[seat].critic;
        let loss = half_squared_error(value(critic.network(), seen, batch.actions.clone()), target);
        record.mean(
            "critic_loss",
            finite("critic_loss", self.schedule.n_steps(), values(loss.clone())[0])?,
        );
        critic.descend(&loss);
        Ok(())
    }

    /// Reward plus the discounted soft value of the next observation.
    fn soft_target(&self, seat: usize, batch: &Batch, rng: &mut Rng) -> Tensor<2> {
        let next_value = self.soft_value(seat, &batch.next_observations, rng);
        let rewards = self
            .replay
            .rewards_of(batch, seat, self.config.reward_normalisation);
        bootstrapped(rewards, batch.continues.clone(), next_value, self.config.discount)
    }

    /// Eq. 10 with uniform particles.
    #[allow(
        clippy::cast_precision_loss,
        reason = "numbers of entries and particles are far below 2^52"
    )]
    fn soft_value(&self, seat: usize, observations: &Tensor<2>, rng: &mut Rng) -> Tensor<2> {
        let (n_particles, n_acted) = (self.config.value_particles, self.layout.n_acted());
        let seen = repeat_rows(&self.seen(seat, observations), n_particles);
        let particles = uniform(seen.dims()[0], n_acted, rng);
        let q = value(&self.learners[seat].target_critic, seen, particles);
        let scaled = q.reshape([observations.dims()[0], n_particles]) / self.temperature();
        let log_volume = n_acted as f64 * std::f64::consts::LN_2;
        (log_mean_exp(scaled) + log_volume) * self.temperature()
    }

    /// Eq. 14: the sampler's parameters follow its particles in the direction of eq. 13.
    fn update_sampler(
        &mut self,
        seat: usize,
        batch: &Batch,
        rng: &mut Rng,
        record: &mut Recorder,
    ) -> Result<(), Error> {
        let seen = self.seen(seat, &batch.observations);
        let sampler = self.learners[seat].sampler.network();
        // The untracked network draws the held particles: no gradient reaches them.
        let held = self.drawn(&sampler.valid(), &seen, self.config.n_held(), rng);
        let moved = self.drawn(sampler, &seen, self.config.moved_particles, rng);
        let (direction, value) = self.direction(seat, &seen, &held, &moved);
        record.mean(
            "particle_value",
            finite("particle_value", self.schedule.n_steps(), value)?,
        );
        record.mean("kernel_bandwidth", direction.mean_bandwidth);
        let direction = matrix(direction.direction, self.layout.n_acted());
        self.learners[seat]
            .sampler
            .descend(&(moved * direction).mean().neg());
        Ok(())
    }

    /// Direction of eq. 13 for the moved particles, and the mean value at the held ones.
    fn direction(
        &self,
        seat: usize,
        seen: &Tensor<2>,
        held: &Tensor<2>,
        moved: &Tensor<2>,
    ) -> (SteinDirection, f32) {
        let (n_held, n_moved, dimension) = (
            self.config.n_held(),
            self.config.moved_particles,
            self.layout.n_acted(),
        );
        let (scores, value) = self.scores(seat, repeat_rows(seen, n_held), held);
        let particles = Particles {
            n_held,
            n_moved,
            dimension,
        };
        (
            stein_direction(
                &values(held.clone()),
                &values(scores),
                &values(moved.clone()),
                particles,
            ),
            value,
        )
    }

    /// Gradient of `Q / alpha + sum ln(1 - a^2 + 1e-6)` in the joint actions `a`, and the mean of Q.
    fn scores(&self, seat: usize, seen: Tensor<2>, actions: &Tensor<2>) -> (Tensor<2>, f32) {
        let actions = Tensor::<2>::from_inner(actions.clone()).require_grad();
        let q = value(
            &self.learners[seat].critic.network().valid(),
            seen,
            actions.clone(),
        );
        let correction = (actions.clone().square().neg() + (1.0 + FACE)).log();
        let log_density = q.clone().sum() / self.temperature() + correction.sum();
        // The sum depends on every action, so that each one has a gradient.
        let gradient = actions
            .grad(&log_density.backward())
            .expect("a gradient in every action");
        (gradient, mean(q))
    }

    /// Draws `n` joint actions per row of a seat's observations, `[batch n, n_acted]`.
    fn drawn(&self, sampler: &Mlp, seen: &Tensor<2>, n: usize, rng: &mut Rng) -> Tensor<2> {
        let seen = repeat_rows(seen, n);
        let latent = normal(seen.dims()[0], self.layout.n_acted(), rng);
        sampler.forward(Tensor::cat(vec![seen, latent], 1)).tanh()
    }

    /// Draw with the largest value in each row, `[batch, n_acted]`.
    fn best_drawn(&self, seat: usize, sampler: &Mlp, seen: &Tensor<2>, rng: &mut Rng) -> Tensor<2> {
        let (n, n_acted) = (self.config.value_particles, self.layout.n_acted());
        let drawn = self.drawn(sampler, seen, n, rng);
        let q = values(value(
            &self.learners[seat].critic.network().valid(),
            repeat_rows(seen, n),
            drawn.clone(),
        ));
        let drawn = values(drawn);
        let best = |(row, q): (usize, &[f32])| {
            let at = row * n + greatest(q);
            drawn[at * n_acted..(at + 1) * n_acted].to_vec()
        };
        matrix(q.chunks(n).enumerate().flat_map(best).collect(), n_acted)
    }

    /// Part of a joint draw that the seat executes, `[batch, n_i]`.
    fn own_action(&self, seat: usize, observations: &Tensor<2>, mode: Mode, rng: &mut Rng) -> Tensor<2> {
        let (seen, sampler) = (
            self.seen(seat, observations),
            self.learners[seat].sampler.network().valid(),
        );
        let joint = match (mode, self.config.evaluation_action) {
            (Mode::Evaluate, EvaluationAction::BestOfDraws) => self.best_drawn(seat, &sampler, &seen, rng),
            _ => self.drawn(&sampler, &seen, 1, rng),
        };
        columns(&joint, self.layout.acted(seat))
    }

    fn seen(&self, seat: usize, observations: &Tensor<2>) -> Tensor<2> {
        columns(observations, self.config.sight.columns(&self.layout, seat))
    }

    fn temperature(&self) -> f64 {
        self.config.temperature_at(self.schedule.n_steps())
    }
}

impl Learner {
    fn new(config: &Config, layout: &JointLayout, seat: usize, rng: &mut Rng) -> Self {
        let (n_seen, n_acted) = (config.sight.columns(layout, seat).len(), layout.n_acted());
        let sampler = config.hidden().network(n_seen + n_acted, n_acted, 1.0, rng);
        let critic = config.hidden().network(n_seen + n_acted, 1, 1.0, rng);
        Self {
            target_critic: critic.valid(),
            sampler: TrainedNetwork::new(
                sampler,
                Adam::new(config.actor_learning_rate, config.gradient_clip),
            ),
            critic: TrainedNetwork::new(
                critic,
                Adam::new(config.critic_learning_rate, config.gradient_clip),
            ),
        }
    }

    fn follow(&mut self, tau: f64) {
        self.target_critic = soft_update(
            std::mem::take(&mut self.target_critic),
            self.critic.network(),
            tau,
        );
    }
}

fn value(critic: &Mlp, seen: Tensor<2>, actions: Tensor<2>) -> Tensor<2> {
    critic.forward(Tensor::cat(vec![seen, actions], 1))
}

/// `ln mean_k exp(x_k)` over the columns, `[rows, 1]`, without overflow.
fn log_mean_exp(x: Tensor<2>) -> Tensor<2> {
    let greatest = x.clone().max_dim(1);
    (x - greatest.clone()).exp().mean_dim(1).log() + greatest
}

#[allow(clippy::cast_possible_truncation, reason = "networks compute in f32")]
fn normal(rows: usize, columns: usize, rng: &mut Rng) -> Tensor<2> {
    matrix(
        (0..rows * columns).map(|_| standard_normal(rng) as f32).collect(),
        columns,
    )
}

/// Uniform draws from the cube between -1 and 1.
#[allow(clippy::cast_possible_truncation, reason = "networks compute in f32")]
fn uniform(rows: usize, columns: usize, rng: &mut Rng) -> Tensor<2> {
    matrix(
        (0..rows * columns)
            .map(|_| (2.0 * standard_uniform(rng) - 1.0) as f32)
            .collect(),
        columns,
    )
}

fn greatest(x: &[f32]) -> usize {
    (0..x.len()).fold(0, |best, at| if x[at] > x[best] { at } else { best })
}

impl Masql {
    /// Inputs and outputs of a seat's sampler as its file describes them: observations, then noise for every
    /// entry of the joint action.
    fn ports(&self, seat: usize) -> Ports {
        let acted = 0..self.layout.n_acted();
        let mut ports = self
            .layout
            .ports(self.config.sight.columns(&self.layout, seat), acted.clone());
        for entry in acted {
            ports.inputs.push(format!("noise_{entry}"));
            ports.center.push(0.0);
            ports.spread.push(1.0);
        }
        ports
    }
}

impl Agent for Masql {
    fn act(&mut self, observations: &[Observation], mode: Mode, rng: &mut Rng) -> Result<Vec<Action>, Error> {
        let joint = self.layout.observations(observations);
        let own = (0..self.layout.n_seats())
            .map(|seat| self.own_action(seat, &joint, mode, rng))
            .collect();
        self.layout
            .actions(&values(Tensor::cat(own, 1)), self.schedule.n_steps())
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

    fn updates(&self) -> Option<Updates> {
        Some(
            self.schedule
                .updates(self.config.learning_starts, self.config.updates_per_step),
        )
    }

    fn save(&self, dir: &Path) -> Result<(), Error> {
        let mut file = TensorFile::default();
        for (seat, learner) in self.learners.iter().enumerate() {
            learner.sampler.store(&format!("sampler_{seat}"), &mut file);
            learner.critic.store(&format!("critic_{seat}"), &mut file);
            store(
                &learner.target_critic,
                &format!("target_critic_{seat}"),
                &mut file,
            );
        }
        self.replay.store(&mut file);
        checkpoint::write(NAME, dir, file, &self.schedule)
    }

    fn load(&mut self, dir: &Path) -> Result<(), Error> {
        let (file, schedule) = checkpoint::read(NAME, dir)?;
        let misfit = checkpoint::error_of(NAME);
        for (seat, learner) in self.learners.iter_mut().enumerate() {
            learner
                .sampler
                .restore(&format!("sampler_{seat}"), &file)
                .map_err(&misfit)?;
            learner
                .critic
                .restore(&format!("critic_{seat}"), &file)
                .map_err(&misfit)?;
            let target = restore(
                learner.target_critic.clone(),
                &format!("target_critic_{seat}"),
                &file,
            );
            learner.target_critic = target.map_err(&misfit)?;
        }
        self.replay.restore(&file).map_err(&misfit)?;
        self.schedule = schedule;
        Ok(())
    }

    /// Writes one file per seat, in a folder with the seat's name. Inputs are the observation and then
    /// standard normal noise, one number per entry of the joint action. Outputs are the joint action, of
    /// which the seat executes its own entries. The critic has a file beside it: the best of several draws is
    /// the one with the largest value.
    fn export(&self, dir: &Path) -> Result<bool, Error> {
        for (seat, learner) in self.learners.iter().enumerate() {
            let policy = Policy::new(learner.sampler.network(), self.ports(seat), Head::Tanh);
            let folder = self.layout.folder(dir, seat)?;
            policy.write(&folder).map_err(checkpoint::error_of(NAME))?;
            let mut critic = TensorFile::default();
            store(&learner.critic.network().valid(), CRITIC, &mut critic);
            critic
                .write(&folder.join(CRITIC_FILE))
                .map_err(checkpoint::error_of(NAME))?;
        }
        Ok(true)
    }

    fn import(&mut self, dir: &Path) -> Result<bool, Error> {
        let misfit = checkpoint::error_of(NAME);
        for seat in 0..self.learners.len() {
            let (ports, folder) = (self.ports(seat), self.layout.place(dir, seat));
            let learner = &mut self.learners[seat];
            checkpoint::import_policy(NAME, &mut learner.sampler, &folder, &ports, Head::Tanh)?;
            let critic = TensorFile::read(&folder.join(CRITIC_FILE)).map_err(&misfit)?;
            learner.critic.restore_network(CRITIC, &critic).map_err(&misfit)?;
        }
        Ok(true)
    }
}
