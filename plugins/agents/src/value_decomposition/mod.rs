//! Value decomposition: seats with one choice each learn one value of the team, and choose independently.
//!
//! - QMIX: T. Rashid, M. Samvelyan, C. Schroeder de Witt, G. Farquhar, J. Foerster and S. Whiteson, "QMIX: monotonic
//!   value function factorisation for deep multi-agent reinforcement learning", ICML 2018, arXiv:1803.11485.
//! - VDN: P. Sunehag and others, "Value-decomposition networks for cooperative multi-agent learning", AAMAS 2018,
//!   arXiv:1706.05296.
//! - Independent Q-learning: M. Tan, "Multi-agent reinforcement learning: independent vs. cooperative agents", ICML
//!   1993; with deep networks V. Mnih and others, Nature 518 (2015) 529.
//!
//! | paper | here | shape |
//! | tau_a | `observation` of seat a, and the index of the seat (one entry per seat) | `[batch n, n_observed + n]` |
//! | tau_a | `observation` of seat a, and which seat it is (one entry each) | `[batch n, n_observed + n]` |
//! | Q_a(tau_a, u_a) | `seat` network, one for all seats | `[batch n, n_choices]` |
//! | s | `state`, for QMIX alone | `[batch, n_state]` |
//! | Q_tot | `mixed` | `[batch, 1]`; `[batch, n]` without mixing |
//! | r | mean reward of the seats (all earn alike in a team); each its own without mixing | as Q_tot |
//! | theta^- | `target` | |
//! | epsilon | [`Config::exploration_at`] | scalar |
//!
//! `y = r + gamma (1 - d) Q_tot(s', tau', argmax_u Q(tau', u; theta); theta^-)` (eq. 6, with the choices of the
//! learned network and the values of its target: H. van Hasselt, A. Guez and D. Silver, "Deep reinforcement learning
//! with double Q-learning", AAAI 2016, as in the authors' code). Since Q_tot increases with every Q_a, the
//! best choice of each seat is the best choice of the team (eq. 5).
//!
//! - Conservative Q-learning: A. Kumar, A. Zhou, G. Tucker and S. Levine, "Conservative Q-learning for offline
//!   reinforcement learning", NeurIPS 2020, arXiv:2006.04779.
//!
//! With `conservatism` alpha above 0, the loss has the further term `alpha (ln sum_u exp Q_a(tau_a, u) -
//! Q_a(tau_a, u_a))`, the mean over batch and seats (their eq. 4 for choices, of each seat's value). Where
//! there is only a dataset, a choice that was never made is then not valued above those that were.
//!
//! Departures from the papers
//! - Networks see one observation and remember nothing: they are for observations with complete information,
//!   such as beliefs. The papers have a recurrent layer. So the buffer holds steps, not episodes.
//! - Adam instead of RMSprop; targets follow by a moving average instead of occasional copies; half of the
//!   squared error.
//! - The full state is scaled by the typical values of its channels, and so are observations.
//!
//! The policy of every seat is one file in its folder, all with the same network: the last inputs are 1 for
//! the acting seat and 0 for the others.
//!
//! Metrics, means over updates since the last measurement: `value_loss` half the squared error, `value` the mean of
//! Q_tot in the batch, `exploration` the probability of a random choice.

mod config;
mod mixer;
#[cfg(test)]
mod tests;

pub use config::{Config, ValueMixing};
pub use mixer::MonotonicMixer;

use crate::shared::{
    checkpoint::{self, finite},
    choice_seat::ChoiceSeat,
    joint::columns,
    replay::{Batch, Replay},
    scaling::Scaling,
    schedule::UpdateSchedule,
    seat::{mismatch, named, observed},
    targets::{bootstrapped, half_squared_error, mean},
};
use burn::{module::Module, tensor::Tensor};
use contract::{
    Action, Agent, AgentTraits, Error, Feed, Interface, Metric, Mode, Observation, Recorder, Registry, Rng,
    Transition, Updates,
};
use numerics::{
    network::{Mlp, matrix, values},
    optimizer::{Adam, TrainedNetwork},
    parameters::{restore, soft_update, store},
    policy_file::{self, Head, Policy, Ports},
    tensor_file::TensorFile,
};
use rand::Rng as _;
use std::path::Path;

const NAME: &str = "value_decomposition";

/// Value decomposition for all seats.
#[derive(Debug, Clone)]
pub struct ValueDecomposition {
    config: Config,
    team: Team,
    networks: TrainedNetwork<Networks>,
    target: Networks,
    replay: Replay,
    schedule: UpdateSchedule,
}

/// Networks that are trained jointly.
#[derive(Module, Debug, Default)]
struct Networks {
    seat: Mlp,
    /// Mixing network; `None` without mixing and for a sum.
    mixer: Option<MonotonicMixer>,
}

/// Seats with equal spaces of observations and choices.
#[derive(Debug, Clone)]
struct Team {
    n_seats: usize,
    n_choices: usize,
    /// Names of the seats, and the encoding of their choices.
    seats: Vec<(String, ChoiceSeat)>,
    observation: Scaling,
    /// Scaling of the full state where it is read, else of no channels.
    state: Scaling,
}

/// Registers the agent.
pub(crate) fn register(registry: &mut Registry, version: u32) {
    let about = "QMIX, value-decomposition networks and independent Q-learning, for seats with choices";
    let traits = AgentTraits::learner([Feed::Decisions, Feed::Dataset], metrics());
    registry.agent(NAME, version, about, traits, build);
}

/// Builds the agent for seats that observe boxes of one size and take one of equally many choices.
///
/// # Errors
/// [`Error::Mismatch`] for any other seats and, with monotonic mixing, for an environment without a full
/// state; [`Error::Config`] for settings that contradict each other.
fn build(config: Config, interface: &Interface, rng: &mut Rng) -> Result<Box<dyn Agent>, Error> {
    Ok(Box::new(ValueDecomposition::new(config, interface, rng)?))
}

/// Metrics that [`ValueDecomposition::learn`] records.
fn metrics() -> Vec<Metric> {
    vec![
        Metric::new("value_loss", "", "half the squared error of the value").lower_is_better(),
        Metric::new(
            "value",
            "",
            "mean value of the batch, in the unit of the scaled rewards",
        ),
        Metric::new("exploration", "", "probability that a seat chooses at random").lower_is_better(),
    ]
}

impl Team {
    fn new(config: &Config, interface: &Interface) -> Result<Self, Error> {
        let Some(first) = interface.seats.first() else {
            return Err(mismatch(NAME, "the environment has no seats"));
        };
        let (seen, n_choices) = (
            observed(NAME, first)?,
            ChoiceSeat::new(NAME, first)?.names().len(),
        );
        let mut seats = Vec::new();
        for seat in &interface.seats {
            let options = ChoiceSeat::new(NAME, seat)?;
            if observed(NAME, seat)?.len() != seen.len() || options.names().len() != n_choices {
                let (seat, first) = (named(seat), named(first));
                let problem = format!("one network is for all seats, and {seat} is not as {first}");
                return Err(mismatch(NAME, problem));
            }
            seats.push((seat.name.clone(), options));
        }
        let state = if config.mixing == ValueMixing::Monotonic {
            &interface.state[..]
        } else {
            &[]
        };
        if config.mixing == ValueMixing::Monotonic && state.is_empty() {
            return Err(mismatch(
                NAME,
                "`mixing: monotonic` reads the full state, and there is none",
            ));
        }
        Ok(Self {
            n_seats: seats.len(),
            n_choices,
            seats,
            observation: Scaling::new(config.observation_scaling, seen),
            state: Scaling::new(config.observation_scaling, state),
        })
    }

    /// Inputs and outputs of the network as a policy file describes them: an observation and the index of the
    /// seat, and one value per choice.
    fn ports(&self) -> Ports {
        let mut ports = self.observation.ports(self.seats[0].1.names());
        for (seat, _) in &self.seats {
            ports.inputs.push(format!("is_{seat}"));
            ports.center.push(0.0);
            ports.spread.push(1.0);
        }
        ports
    }

    fn n_observed(&self) -> usize {
        self.n_seats * self.observation.n_channels()
    }

    /// Scaled observations of all seats, one after the other, and the full state where it is read.
    fn scaled(&self, seen: &Observation) -> Vec<f32> {
        let seats = seen.seats.iter().flat_map(|seat| self.observation.apply(seat));
        seats.chain(self.state.apply(&seen.state)).collect()
    }

    /// A step as the buffer stores it: scaled, with the state as one more seat and choices as indices.
    ///
    /// # Errors
    /// [`Error::Action`] for an action that takes no option.
    #[allow(clippy::cast_precision_loss, reason = "positions of choices")]
    fn scaled_step(&self, step: &Transition, reward_scale: f64) -> Result<Transition, Error> {
        let scaled = |seen: &Observation| Observation {
            seats: vec![self.scaled(seen).into_iter().map(f64::from).collect()],
            state: Vec::new(),
        };
        let taken = self.seats.iter().zip(&step.action);
        let taken = taken.map(|((_, seat), action)| Ok(vec![seat.taken(action)? as f64]));
        Ok(Transition {
            observation: scaled(&step.observation),
            action: taken.collect::<Result<_, Error>>()?,
            rewards: step.rewards.iter().map(|reward| reward * reward_scale).collect(),
            next_observation: scaled(&step.next_observation),
            end: step.end,
        })
    }

    /// Values Q_a of all choices of all seats, `[batch n, n_choices]`, from rows that begin with the
    /// observations.
    fn values(&self, network: &Mlp, rows: &Tensor<2>) -> Tensor<2> {
        let (batch, n) = (rows.dims()[0], self.n_seats);
        let seen = columns(rows, 0..self.n_observed()).reshape([batch * n, self.observation.n_channels()]);
        let which = (0..batch * n * n)
            .map(|at| f32::from(u8::from(at % n == at / n % n)))
            .collect();
        network.forward(Tensor::cat(vec![seen, matrix(which, n)], 1))
    }

    /// Values `[batch, n]` of one choice per seat.
    fn of_choices(&self, values: Tensor<2>, chosen: &[usize]) -> Tensor<2> {
        let is_chosen =
            |choice: usize| (0..self.n_choices).map(move |other| f32::from(u8::from(other == choice)));
        let mask = chosen.iter().flat_map(|choice| is_chosen(*choice)).collect();
        let of_seats = (values * matrix(mask, self.n_choices)).sum_dim(1);
        of_seats.reshape([chosen.len() / self.n_seats, self.n_seats])
    }

    /// Choice of each seat with the largest value, the first of equals.
    fn best(&self, values: &[f32]) -> Vec<usize> {
        let best =
            |row: &[f32]| (1..row.len()).fold(0, |best, at| if row[at] > row[best] { at } else { best });
        values.chunks(self.n_choices).map(best).collect()
    }
}

impl ValueDecomposition {
    fn new(config: Config, interface: &Interface, rng: &mut Rng) -> Result<Self, Error> {
        config.check()?;
        let team = Team::new(&config, interface)?;
        let (n, n_state) = (team.n_seats, team.state.n_channels());
        let inputs = team.observation.n_channels() + n;
        let seat = config.hidden().network(inputs, team.n_choices, 1.0, rng);
        let mixer = (config.mixing == ValueMixing::Monotonic)
            .then(|| MonotonicMixer::new(n_state, n, config.mixing_width, rng));
        let networks = Networks { seat, mixer };
        Ok(Self {
            target: networks.valid(),
            networks: TrainedNetwork::new(networks, Adam::new(config.learning_rate, config.gradient_clip)),
            replay: Replay::new(config.replay_capacity, team.n_observed() + n_state, n, n),
            schedule: UpdateSchedule::new(),
            team,
            config,
        })
    }

    fn update(&mut self, rng: &mut Rng, record: &mut Recorder) -> Result<(), Error> {
        let size = self.config.batch_size.min(self.replay.len());
        let batch = self.replay.sample_distinct(size, rng);
        let (value, excess) = self.value(self.networks.network(), &batch);
        record.mean("value", f64::from(mean(value.clone())));
        let loss = half_squared_error(value, self.target(&batch));
        record.mean(
            "value_loss",
            finite("value_loss", self.schedule.n_steps(), values(loss.clone())[0])?,
        );
        record.mean("exploration", self.config.exploration_at(self.schedule.n_steps()));
        let loss = match excess {
            None => loss,
            Some(excess) => loss + excess.mul_scalar(self.config.conservatism),
        };
        self.networks.descend(&loss);
        let target = std::mem::take(&mut self.target);
        self.target = soft_update(target, self.networks.network(), self.config.target_smoothing);
        self.schedule.count_update();
        Ok(())
    }

    /// Q_tot of the stored choices and, with conservatism, the excess of all choices' values over theirs.
    fn value(&self, networks: &Networks, batch: &Batch) -> (Tensor<2>, Option<Tensor<1>>) {
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "positions of choices"
        )]
        let done: Vec<usize> = values(batch.actions.clone())
            .into_iter()
            .map(|choice| choice as usize)
            .collect();
        let of_all = self.team.values(&networks.seat, &batch.observations);
        let of_done = self.team.of_choices(of_all.clone(), &done);
        let excess = (self.config.conservatism > 0.0).then(|| excess(of_all, of_done.clone()));
        (self.mixed(networks, of_done, &batch.observations), excess)
    }

    /// Target of Q_tot, eq. 6.
    fn target(&self, batch: &Batch) -> Tensor<2> {
        let next = &batch.next_observations;
        let likes = self.team.values(&self.networks.network().seat.valid(), next);
        let best = self.team.best(&values(likes));
        let of_all = self.team.values(&self.target.seat, next);
        let value = self.mixed(&self.target, self.team.of_choices(of_all, &best), next);
        let rewards = match self.config.mixing {
            ValueMixing::None => batch.rewards.clone(),
            ValueMixing::Sum | ValueMixing::Monotonic => batch.rewards.clone().mean_dim(1),
        };
        bootstrapped(rewards, batch.continues.clone(), value, self.config.discount)
    }

    /// Mixed value from the seats' values `[batch, n]` and rows that end with the state.
    fn mixed(&self, networks: &Networks, of_seats: Tensor<2>, rows: &Tensor<2>) -> Tensor<2> {
        match (self.config.mixing, &networks.mixer) {
            (ValueMixing::Sum, _) => of_seats.sum_dim(1),
            (ValueMixing::Monotonic, Some(mixer)) => {
                let width = rows.dims()[1];
                mixer.forward(of_seats, &columns(rows, self.team.n_observed()..width))
            }
            _ => of_seats,
        }
    }

    /// `choice`, or with the probability of exploration a random one.
    fn explored(&self, choice: usize, rng: &mut Rng) -> usize {
        if rng.random::<f64>() >= self.config.exploration_at(self.schedule.n_steps()) {
            return choice;
        }
        // `u32`: the width of `usize` depends on the machine and would change the stream.
        #[allow(clippy::cast_possible_truncation, reason = "nobody names 2^32 choices")]
        let drawn = rng.random_range(0..self.team.n_choices as u32);
        drawn as usize
    }
}

/// `ln sum_u exp Q_a(tau_a, u) - Q_a(tau_a, u_a)`, mean over batch and seats, from values of all choices
/// `[batch n, n_choices]` and of the stored ones `[batch, n]`.
fn excess(of_all: Tensor<2>, of_done: Tensor<2>) -> Tensor<1> {
    // The largest value is subtracted so that no exponential overflows; the result is unchanged.
    let largest = of_all.clone().max_dim(1).detach();
    let together = (of_all - largest.clone()).exp().sum_dim(1).log() + largest;
    together.mean() - of_done.mean()
}

impl Agent for ValueDecomposition {
    fn act(&mut self, observations: &[Observation], mode: Mode, rng: &mut Rng) -> Result<Vec<Action>, Error> {
        let seats = observations.iter().flat_map(|seen| seen.seats.iter());
        let rows: Vec<f32> = seats.flat_map(|seat| self.team.observation.apply(seat)).collect();
        let rows = matrix(rows, self.team.n_observed());
        let values = values(self.team.values(&self.networks.network().seat.valid(), &rows));
        if let Some(value) = values.iter().find(|value| !value.is_finite()) {
            return Err(Error::NotFinite {
                what: "the value of a choice".into(),
                step: self.schedule.n_steps(),
                value: f64::from(*value),
            });
        }
        let mut chosen = self.team.best(&values);
        if mode == Mode::Train {
            chosen
                .iter_mut()
                .for_each(|choice| *choice = self.explored(*choice, rng));
        }
        let seats = &self.team.seats;
        let action = |row: &[usize]| {
            let each = row.iter().zip(seats);
            each.map(|(option, (_, seat))| seat.action(*option)).collect()
        };
        Ok(chosen.chunks(self.team.n_seats).map(action).collect())
    }

    fn learn(
        &mut self,
        transitions: &[Transition],
        rng: &mut Rng,
        record: &mut Recorder,
    ) -> Result<(), Error> {
        for transition in transitions {
            self.replay
                .push(&self.team.scaled_step(transition, self.config.reward_scale)?);
        }
        let (starts, per_step) = (self.config.learning_starts, self.config.updates_per_step);
        for _ in 0..self.schedule.advance(transitions.len(), starts, per_step) {
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

    fn reads_state(&self) -> bool {
        self.config.mixing == ValueMixing::Monotonic
    }

    fn export(&self, dir: &Path) -> Result<bool, Error> {
        for (seat, _) in &self.team.seats {
            let folder = dir.join(seat);
            std::fs::create_dir_all(&folder).map_err(Error::file("create", &folder))?;
            Policy::new(&self.networks.network().seat, self.team.ports(), Head::Argmax)
                .write(&folder)
                .map_err(checkpoint::error_of(NAME))?;
        }
        Ok(true)
    }

    fn import(&mut self, dir: &Path) -> Result<bool, Error> {
        let misfit = checkpoint::error_of(NAME);
        for (seat, _) in &self.team.seats {
            let file = checkpoint::read_policy(NAME, &dir.join(seat), &self.team.ports(), Head::Argmax)?;
            let mut networks = self.networks.network().clone();
            networks.seat = restore(networks.seat, policy_file::PREFIX, &file).map_err(&misfit)?;
            self.networks.set_network(networks);
        }
        Ok(true)
    }

    fn save(&self, dir: &Path) -> Result<(), Error> {
        let mut file = TensorFile::default();
        self.networks.store("networks", &mut file);
        store(&self.target, "target", &mut file);
        self.replay.store(&mut file);
        checkpoint::write(NAME, dir, file, &self.schedule)
    }

    fn load(&mut self, dir: &Path) -> Result<(), Error> {
        let (file, schedule) = checkpoint::read(NAME, dir)?;
        let misfit = checkpoint::error_of(NAME);
        self.networks.restore("networks", &file).map_err(&misfit)?;
        self.target = restore(self.target.clone(), "target", &file).map_err(&misfit)?;
        self.replay.restore(&file).map_err(&misfit)?;
        self.schedule = schedule;
        Ok(())
    }
}
