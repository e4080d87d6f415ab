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
//! |---|---|---|
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
mod team;
#[cfg(test)]
mod tests;

pub use config::{Config, ValueMixing};
pub use mixer::MonotonicMixer;

use team::Team;

use crate::shared::{
    batch::{BatchInputs, plan_of},
    bellman::{bootstrapped, half_squared_error},
    checkpoint::{self, finite},
    replay::Replay,
    schedule::UpdateSchedule,
};
use contract::{
    Action, Agent, AgentTraits, Error, Feed, Interface, Metric, Mode, Observation, Recorder, Registry, Rng,
    Transition, Updates,
};
use numerics::{
    equations::network::Network,
    policy_file::{Head, Policy},
};
use plan::{Descent, Equations, Expression, Plans, State};
use rand::Rng as _;
use std::path::Path;

const NAME: &str = "value_decomposition";

/// Value decomposition for all seats.
#[derive(Debug, Clone)]
pub struct ValueDecomposition {
    config: Config,
    learner: Learner,
    state: State<f32>,
    acting: Plans,
    learning: Plans,
    replay: Replay,
    schedule: UpdateSchedule,
}

/// Seats and networks, and the equations by which they choose and learn.
#[derive(Debug, Clone)]
struct Learner {
    team: Team,
    mixing: ValueMixing,
    networks: Networks,
    target: Networks,
}

/// Networks that are trained jointly.
#[derive(Debug, Clone)]
struct Networks {
    seat: Network,
    /// Mixing network; `None` without mixing and for a sum.
    mixer: Option<MonotonicMixer>,
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

impl Networks {
    fn all(&self) -> Vec<&Network> {
        let mixer = self.mixer.iter().flat_map(MonotonicMixer::networks);
        std::iter::once(&self.seat).chain(mixer).collect()
    }

    fn parameters<'e>(&self, equations: &'e Equations) -> Vec<Expression<'e>> {
        let of_each = self
            .all()
            .into_iter()
            .map(|network| network.parameters(equations));
        of_each.flatten().collect()
    }

    /// Copies for the targets.
    fn target(&self, state: &mut State<f32>) -> Self {
        let mut copy = |network: &Network| network.copied(format!("target_{}", network.name()), state);
        Self {
            seat: copy(&self.seat),
            mixer: self.mixer.as_ref().map(|mixer| mixer.map(&mut copy)),
        }
    }
}

impl Learner {
    /// Values of all choices of all seats.
    fn choose(&self, observations: Expression<'_>) {
        let equations = observations.equations();
        equations.routine("choose");
        equations.output("values", self.team.values(&self.networks.seat, observations));
    }

    /// One update of the networks, and one move of the targets.
    fn update(&self, batch: BatchInputs<'_>, config: &Config) {
        let equations = batch.observations.equations();
        equations.routine("update");
        let (value, excess) = self.value(batch);
        equations.output("value", value.mean());
        let error = half_squared_error(value, self.target(batch, config.discount));
        equations.output("value_loss", error);
        let parameters = self.networks.parameters(equations);
        let descent = Descent::adam("learning_rate", config.learning_rate, config.gradient_clip);
        equations.descend(loss(error, excess, config), &parameters, &descent);
        let targets = self.target.parameters(equations);
        equations.follow(&targets, &parameters, config.target_smoothing);
    }

    /// Q_tot of the stored choices, and the excess of all choices' values over theirs.
    fn value<'e>(&self, batch: BatchInputs<'e>) -> (Expression<'e>, Expression<'e>) {
        let done = self.of_each_seat(batch.actions);
        let of_all = self.team.values(&self.networks.seat, batch.observations);
        let of_done = self.team.of_choices(of_all, done);
        (
            self.mixed(&self.networks, of_done, batch.observations),
            excess(of_all, done),
        )
    }

    /// Target of Q_tot, eq. 6.
    fn target<'e>(&self, batch: BatchInputs<'e>, discount: f64) -> Expression<'e> {
        let next = batch.next_observations;
        let best = self.team.values(&self.networks.seat, next).place_of_largest();
        let of_all = self.team.values(&self.target.seat, next);
        let value = self.mixed(&self.target, self.team.of_choices(of_all, best), next);
        let rewards = match self.mixing {
            ValueMixing::None => batch.rewards,
            ValueMixing::Sum | ValueMixing::Monotonic => batch.rewards.mean_columns(),
        };
        bootstrapped(rewards, batch.continues, value, discount)
    }

    /// Mixed value from the seats' values `[batch, n]` and rows that end with the state.
    fn mixed<'e>(
        &self,
        networks: &Networks,
        of_seats: Expression<'e>,
        rows: Expression<'e>,
    ) -> Expression<'e> {
        match (self.mixing, &networks.mixer) {
            (ValueMixing::Sum, _) => of_seats.sum_columns(),
            (ValueMixing::Monotonic, Some(mixer)) => {
                mixer.apply(of_seats, rows.columns(self.team.n_observed()..rows.n_columns()))
            }
            _ => of_seats,
        }
    }

    /// Numbers of the seats `[batch, n]` one below the other, `[batch n, 1]`.
    fn of_each_seat<'e>(&self, numbers: Expression<'e>) -> Expression<'e> {
        numbers.reshape([numbers.n_rows() * self.team.n_seats, 1])
    }
}

/// `ln sum_u exp Q_a(tau_a, u) - Q_a(tau_a, u_a)`, mean over batch and seats, from values of all choices
/// `[batch n, n_choices]` and the stored choices `[batch n, 1]`.
fn excess<'e>(of_all: Expression<'e>, done: Expression<'e>) -> Expression<'e> {
    -of_all.log_softmax().gather(done).mean()
}

/// Half the squared error and, with conservatism, the weighted excess.
fn loss<'e>(error: Expression<'e>, excess: Expression<'e>, config: &Config) -> Expression<'e> {
    if config.conservatism > 0.0 {
        error + excess * config.conservatism
    } else {
        error
    }
}

impl ValueDecomposition {
    fn new(config: Config, interface: &Interface, rng: &mut Rng) -> Result<Self, Error> {
        config.check()?;
        let team = Team::new(&config, interface)?;
        let (n, n_state) = (team.n_seats, team.state.n_channels());
        let mut state = State::default();
        let inputs = team.observation.n_channels() + n;
        let seat = config.hidden().network("seat", inputs, team.n_choices);
        seat.initialise(1.0, &mut state, rng);
        let mixer = (config.mixing == ValueMixing::Monotonic)
            .then(|| MonotonicMixer::new([n_state, n, config.mixing_width], &mut state, rng));
        let networks = Networks { seat, mixer };
        Ok(Self {
            replay: Replay::new(config.replay_capacity, team.n_observed() + n_state, n, n),
            learner: Learner {
                team,
                mixing: config.mixing,
                target: networks.target(&mut state),
                networks,
            },
            state,
            acting: Plans::default(),
            learning: Plans::default(),
            schedule: UpdateSchedule::new(),
            config,
        })
    }

    fn update(&mut self, rng: &mut Rng, record: &mut Recorder) -> Result<(), Error> {
        let (learner, config, widths) = (&self.learner, &self.config, self.replay.widths());
        let n_rows = config.batch_size.min(self.replay.len());
        let plan = plan_of(&mut self.learning, n_rows, widths, |batch| {
            learner.update(batch, config);
        });
        self.replay.draw_distinct(n_rows, rng).write(plan);
        plan.run("update", &mut self.state);
        let step = self.schedule.n_steps();
        record.mean("value", plan.number("value"));
        record.mean(
            "value_loss",
            finite("value_loss", step, plan.number("value_loss"))?,
        );
        record.mean("exploration", config.exploration_at(step));
        self.schedule.count_update();
        Ok(())
    }

    /// Values of all choices of all seats, from rows of the seats' scaled observations.
    fn values(&mut self, rows: &[f32]) -> &[f32] {
        let (learner, n_observed) = (&self.learner, self.learner.team.n_observed());
        let n_rows = rows.len() / n_observed;
        let plan = self.acting.of_rows(n_rows, |equations| {
            learner.choose(equations.input("observations", [n_rows, n_observed]));
        });
        plan.write("observations", rows);
        plan.run("choose", &mut self.state);
        plan.entries("values")
    }

    /// `choice`, or with the probability of exploration a random one.
    fn explored(&self, choice: usize, rng: &mut Rng) -> usize {
        if rng.random::<f64>() >= self.config.exploration_at(self.schedule.n_steps()) {
            return choice;
        }
        // `u32`: the width of `usize` depends on the machine and would change the stream.
        #[allow(clippy::cast_possible_truncation, reason = "nobody names 2^32 choices")]
        let drawn = rng.random_range(0..self.learner.team.n_choices as u32);
        drawn as usize
    }
}

impl Agent for ValueDecomposition {
    fn act(&mut self, observations: &[Observation], mode: Mode, rng: &mut Rng) -> Result<Vec<Action>, Error> {
        let scaling = &self.learner.team.observation;
        let seats = observations.iter().flat_map(|seen| seen.seats.iter());
        let rows: Vec<f32> = seats.flat_map(|seat| scaling.apply(seat)).collect();
        let values = self.values(&rows).to_vec();
        let team = &self.learner.team;
        if let Some(value) = values.iter().find(|value| !value.is_finite()) {
            return Err(Error::NotFinite {
                what: "the value of a choice".into(),
                step: self.schedule.n_steps(),
                value: f64::from(*value),
            });
        }
        let mut chosen = team.best(&values);
        if mode == Mode::Train {
            chosen
                .iter_mut()
                .for_each(|choice| *choice = self.explored(*choice, rng));
        }
        let seats = &team.seats;
        let action = |row: &[usize]| {
            let each = row.iter().zip(seats);
            each.map(|(option, (_, seat))| seat.action(*option)).collect()
        };
        Ok(chosen.chunks(team.n_seats).map(action).collect())
    }

    fn learn(
        &mut self,
        transitions: &[Transition],
        rng: &mut Rng,
        record: &mut Recorder,
    ) -> Result<(), Error> {
        for transition in transitions {
            let step = self
                .learner
                .team
                .scaled_step(transition, self.config.reward_scale)?;
            self.replay.push(&step);
        }
        let (starts, per_step) = (self.config.learning_starts, self.config.updates_per_step);
        for _ in 0..self.schedule.advance(transitions.len(), starts, per_step) {
            self.update(rng, record)?;
        }
        Ok(())
    }

    fn reads_state(&self) -> bool {
        self.config.mixing == ValueMixing::Monotonic
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
        let team = &self.learner.team;
        for (seat, _) in &team.seats {
            let folder = dir.join(seat);
            std::fs::create_dir_all(&folder).map_err(Error::file("create", &folder))?;
            Policy::new(
                &self.learner.networks.seat,
                &self.state,
                team.ports(),
                Head::Argmax,
            )
            .write(&folder)
            .map_err(checkpoint::error_of(NAME))?;
        }
        Ok(true)
    }

    fn import(&mut self, dir: &Path) -> Result<bool, Error> {
        let (network, ports) = (&self.learner.networks.seat, self.learner.team.ports());
        for (seat, _) in &self.learner.team.seats {
            let folder = dir.join(seat);
            checkpoint::import_policy(NAME, network, &mut self.state, &folder, &ports, Head::Argmax)?;
        }
        Ok(true)
    }
}
