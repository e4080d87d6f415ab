//! The networks of one seat, and the equations of its soft values and of its draws.
//!
//! | paper | here | shape |
//! |---|---|---|
//! | Q_soft(s, a) | `critic` | `[batch, 1]` |
//! | V_soft(s) | [`Seat::soft_value`] | `[batch, 1]` |
//! | f(xi; s) | [`Seat::drawn`] | `[batch K, n_acted]` |
//! | Delta f | [`Movement::direction`] | `[batch moved, n_acted]` |
//! | alpha | `temperature` | `[1, 1]` |

use super::{Config, of_seat};
use crate::shared::{batch::BatchInputs, joint::JointLayout};
use contract::Rng;
use numerics::equations::{network::Network, stein::stein_direction};
use plan::{Expression, State};
use std::ops::Range;

/// Keeps the logarithm of the correction for tanh finite on the faces of the cube.
const FACE: f64 = 1e-6;

/// Networks of one seat.
#[derive(Debug, Clone)]
pub(super) struct Seat {
    /// Columns of the joint observation that sampler and critic see.
    pub(super) seen: Range<usize>,
    pub(super) sampler: Network,
    pub(super) critic: Network,
    pub(super) target_critic: Network,
}

/// Particles of a sampler that move, and their direction.
#[derive(Debug, Clone, Copy)]
pub(super) struct Movement<'e> {
    /// Moved particles, `[batch moved, n_acted]`.
    pub(super) moved: Expression<'e>,
    /// Direction of eq. 13, `[batch moved, n_acted]`.
    pub(super) direction: Expression<'e>,
    /// Bandwidth h of each row, `[batch, 1]`.
    pub(super) bandwidth: Expression<'e>,
    /// Mean of Q at the held particles, `[1, 1]`.
    pub(super) held_value: Expression<'e>,
}

impl<'e> Movement<'e> {
    /// Eq. 14: a loss against whose gradient the parameters follow the moved particles. The direction is a constant of
    /// the gradient, as the held particles are.
    pub(super) fn loss(&self) -> Expression<'e> {
        -(self.moved * self.direction.stop_gradient()).mean()
    }
}

impl Seat {
    pub(super) fn new(
        config: &Config,
        layout: &JointLayout,
        seat: usize,
        state: &mut State<f32>,
        rng: &mut Rng,
    ) -> Self {
        let (seen, n_acted) = (config.sight.columns(layout, seat), layout.n_acted());
        let mut network = |what: &str, outputs| {
            let inputs = seen.len() + n_acted;
            let network = config.hidden().network(of_seat(seat, what), inputs, outputs);
            network.initialise(1.0, state, rng);
            network
        };
        let (sampler, critic) = (network("sampler", n_acted), network("critic", 1));
        Self {
            seen,
            sampler,
            target_critic: critic.copied(of_seat(seat, "target_critic"), state),
            critic,
        }
    }

    pub(super) fn seen<'e>(&self, observations: Expression<'e>) -> Expression<'e> {
        observations.columns(self.seen.clone())
    }

    pub(super) fn n_acted(&self) -> usize {
        self.sampler.sizes().last().copied().unwrap_or_default()
    }

    /// Q of the joint actions of a batch.
    pub(super) fn critic_value<'e>(&self, batch: BatchInputs<'e>) -> Expression<'e> {
        value(&self.critic, self.seen(batch.observations), batch.actions)
    }

    /// Eq. 10 with uniform particles.
    #[allow(clippy::cast_precision_loss, reason = "a number of entries is far below 2^52")]
    pub(super) fn soft_value<'e>(
        &self,
        observations: Expression<'e>,
        temperature: Expression<'e>,
        n_particles: usize,
    ) -> Expression<'e> {
        let (rows, n_acted) = (observations.n_rows(), self.n_acted());
        let seen = self.seen(observations).repeat_rows(n_particles);
        let particles = seen.equations().uniform([rows * n_particles, n_acted]) * 2.0 - 1.0;
        let q = value(&self.target_critic, seen, particles).reshape([rows, n_particles]);
        let log_volume = n_acted as f64 * std::f64::consts::LN_2;
        (log_mean_exp(q / temperature) + log_volume) * temperature
    }

    /// Eq. 13 for draws of the sampler.
    pub(super) fn movement<'e>(
        &self,
        observations: Expression<'e>,
        temperature: Expression<'e>,
        config: &Config,
    ) -> Movement<'e> {
        let (seen, n_held) = (self.seen(observations), config.n_held());
        let held = self.drawn(seen, n_held);
        let moved = self.drawn(seen, config.moved_particles);
        let (scores, held_value) = self.scores(seen.repeat_rows(n_held), held, temperature);
        let stein = stein_direction(held, scores, moved, observations.n_rows());
        Movement {
            moved,
            direction: stein.direction,
            bandwidth: stein.bandwidth,
            held_value,
        }
    }

    /// Gradient of `Q / alpha + sum ln(1 - a^2 + 1e-6)` in the joint actions `a`, and the mean of Q.
    pub(super) fn scores<'e>(
        &self,
        seen: Expression<'e>,
        actions: Expression<'e>,
        temperature: Expression<'e>,
    ) -> (Expression<'e>, Expression<'e>) {
        let (log_density, q) = self.log_density(seen, actions, temperature);
        let gradients = seen.equations().gradients(log_density.sum(), &[actions]);
        (gradients[0], q.mean())
    }

    /// `Q / alpha + sum ln(1 - a^2 + 1e-6)`, and Q, `[rows, 1]` each.
    pub(super) fn log_density<'e>(
        &self,
        seen: Expression<'e>,
        actions: Expression<'e>,
        temperature: Expression<'e>,
    ) -> (Expression<'e>, Expression<'e>) {
        let q = value(&self.critic, seen, actions);
        let correction = ((1.0 + FACE) - actions.square()).ln().sum_columns();
        (q / temperature + correction, q)
    }

    /// Draws `n` joint actions per row of the seat's observations, `[batch n, n_acted]`.
    pub(super) fn drawn<'e>(&self, seen: Expression<'e>, n: usize) -> Expression<'e> {
        let seen = seen.repeat_rows(n);
        let latent = seen.equations().normal([seen.n_rows(), self.n_acted()]);
        value(&self.sampler, seen, latent).tanh()
    }

    /// Draw with the largest value of `n` in each row, `[batch, n_acted]`.
    pub(super) fn best_drawn<'e>(&self, seen: Expression<'e>, n: usize) -> Expression<'e> {
        let (equations, shape) = (seen.equations(), [seen.n_rows(), n]);
        let drawn = self.drawn(seen, n);
        let q = value(&self.critic, seen.repeat_rows(n), drawn).reshape(shape);
        let best = q.place_of_largest();
        let entry = |at| drawn.columns(at..at + 1).reshape(shape).gather(best);
        let entries: Vec<_> = (0..self.n_acted()).map(entry).collect();
        equations.join(&entries)
    }
}

/// Outputs of a network for observations and actions, or noise.
pub(super) fn value<'e>(network: &Network, seen: Expression<'e>, actions: Expression<'e>) -> Expression<'e> {
    network.apply(seen.equations().join(&[seen, actions]))
}

/// `ln mean_k exp(x_k)` over the columns, `[rows, 1]`, without overflow.
pub(super) fn log_mean_exp(x: Expression<'_>) -> Expression<'_> {
    let largest = x.largest_of_columns();
    (x - largest).exp().mean_columns().ln() + largest
}
