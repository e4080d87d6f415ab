//! Seats with equal spaces, whose networks are one.
//!
//! | paper | here | shape |
//! |---|---|---|
//! | tau_a | scaled observation of seat a, and which seat it is (one entry each) | `[batch n, n_observed + n]` |
//! | Q_a(tau_a, u_a) | [`Team::values`] | `[batch n, n_choices]` |
//! | s | end of the rows that the buffer stores, where the state is read | `[batch, n_state]` |

use super::{Config, NAME, ValueMixing};
use crate::shared::{
    choice_seat::ChoiceSeat,
    scaling::Scaling,
    seat::{mismatch, named, observed},
};
use contract::{Error, Interface, Observation, Transition};
use numerics::{equations::network::Network, policy_file::Ports};
use plan::Expression;

/// Seats with equal spaces of observations and choices.
#[derive(Debug, Clone)]
pub(super) struct Team {
    pub(super) n_seats: usize,
    pub(super) n_choices: usize,
    /// Names of the seats, and the encoding of their choices.
    pub(super) seats: Vec<(String, ChoiceSeat)>,
    pub(super) observation: Scaling,
    /// Scaling of the full state where it is read, else of no channels.
    pub(super) state: Scaling,
}

impl Team {
    pub(super) fn new(config: &Config, interface: &Interface) -> Result<Self, Error> {
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
    pub(super) fn ports(&self) -> Ports {
        let mut ports = self.observation.ports(self.seats[0].1.names());
        for (seat, _) in &self.seats {
            ports.inputs.push(format!("is_{seat}"));
            ports.center.push(0.0);
            ports.spread.push(1.0);
        }
        ports
    }

    pub(super) fn n_observed(&self) -> usize {
        self.n_seats * self.observation.n_channels()
    }

    /// Scaled observations of all seats, one after the other, and the full state where it is read.
    pub(super) fn scaled(&self, seen: &Observation) -> Vec<f32> {
        let seats = seen.seats.iter().flat_map(|seat| self.observation.apply(seat));
        seats.chain(self.state.apply(&seen.state)).collect()
    }

    /// A step as the buffer stores it: scaled, with the state as one more seat and choices as indices.
    ///
    /// # Errors
    /// [`Error::Action`] for an action that takes no option.
    #[allow(clippy::cast_precision_loss, reason = "positions of choices")]
    pub(super) fn scaled_step(&self, step: &Transition, reward_scale: f64) -> Result<Transition, Error> {
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
    pub(super) fn values<'e>(&self, network: &Network, rows: Expression<'e>) -> Expression<'e> {
        let (equations, batch, n) = (rows.equations(), rows.n_rows(), self.n_seats);
        let seen = rows
            .columns(0..self.n_observed())
            .reshape([batch * n, self.observation.n_channels()]);
        let which = (0..batch * n * n).map(|at| f64::from(u8::from(at % n == at / n % n)));
        let which = equations.constant([batch * n, n], &which.collect::<Vec<_>>());
        network.apply(equations.join(&[seen, which]))
    }

    /// Values `[batch, n]` of one choice per seat, from those of all choices and the index of each seat's choice
    /// `[batch n, 1]`.
    pub(super) fn of_choices<'e>(&self, values: Expression<'e>, chosen: Expression<'e>) -> Expression<'e> {
        let batch = values.n_rows() / self.n_seats;
        values.gather(chosen).reshape([batch, self.n_seats])
    }

    /// Choice of each seat with the largest value, the first of equals.
    pub(super) fn best(&self, values: &[f32]) -> Vec<usize> {
        let best =
            |row: &[f32]| (1..row.len()).fold(0, |best, at| if row[at] > row[best] { at } else { best });
        values.chunks(self.n_choices).map(best).collect()
    }
}
