//! The update of one seat in equations: what its losses read, and the steps that they lead to.

use super::{Game, Player, Settings, others};
use crate::shared::batch::{BatchInputs, BatchWidths};
use crate::shared::bellman::bootstrapped;
use numerics::equations::squashed::{Correction, Draw, sample};
use plan::{Equations, Expression};

/// A seat that learns from a batch.
#[derive(Debug, Clone, Copy)]
pub struct SeatUpdate<'g, 'e> {
    /// All seats with their networks.
    pub game: &'g Game,
    /// Settings that all algorithms share.
    pub settings: &'g Settings,
    /// The seat that learns.
    pub seat: usize,
    /// Transitions of all seats.
    pub batch: BatchInputs<'e>,
    /// Whether the policy has made a step before, which the update of the critic may repeat.
    pub repeats: bool,
}

impl Game {
    /// Adds the batches of all seats; `seat_0.observations` and so on are those of the first.
    #[must_use]
    pub fn updates<'g, 'e>(
        &'g self,
        settings: &'g Settings,
        equations: &'e Equations,
        n_rows: usize,
        repeats: bool,
    ) -> Vec<SeatUpdate<'g, 'e>> {
        let widths = BatchWidths {
            observed: self.layout.n_observed(),
            acted: self.layout.n_acted(),
            seats: self.layout.n_seats(),
        };
        let update = |seat| SeatUpdate {
            game: self,
            settings,
            seat,
            batch: BatchInputs::named(&of_seat(seat, ""), equations, n_rows, widths),
            repeats,
        };
        (0..self.layout.n_seats()).map(update).collect()
    }
}

impl<'g, 'e> SeatUpdate<'g, 'e> {
    /// Networks of the seat.
    #[must_use]
    pub fn player(self) -> &'g Player {
        &self.game.players[self.seat]
    }

    /// Places of the opponent models with the seats that they model, in order.
    pub fn opponents(self) -> impl Iterator<Item = (usize, usize)> {
        others(self.game.players.len(), self.seat).enumerate()
    }

    /// Columns of joint observations that policy, opponent models and prior of the seat see.
    #[must_use]
    pub fn seen(self, observations: Expression<'e>) -> Expression<'e> {
        self.game.seen(self.seat, observations)
    }

    /// Joint action `[batch, n_acted]` from the seat's own action and those of the others, in order.
    #[must_use]
    pub fn joint(self, own: Expression<'e>, mut others: Vec<Expression<'e>>) -> Expression<'e> {
        others.insert(self.seat, own);
        own.equations().join(&others)
    }

    /// Stored actions with those of a seat replaced.
    #[must_use]
    pub fn exchanged(self, seat: usize, action: Expression<'e>) -> Expression<'e> {
        self.game.layout.exchanged(self.batch.actions, seat, action)
    }

    /// One draw per row and opponent.
    #[must_use]
    pub fn draw_others(self, input: Expression<'e>) -> Vec<Draw<'e>> {
        let models = self.player().opponents.iter();
        models
            .map(|model| sample(model.head(input), Correction::Softened))
            .collect()
    }

    /// Takes one step of the seat's critic towards `r + gamma (1 - d) next_value`, where `next_value` is
    /// `[batch, 1]` (eq. 4.12, without its half).
    pub fn improve_critic(self, next_value: Expression<'e>) {
        let Self { settings, batch, .. } = self;
        let rewards = batch.rewards.columns(self.seat..self.seat + 1);
        let target = bootstrapped(rewards, batch.continues, next_value, settings.discount);
        let Player { critic, policy, .. } = self.player();
        let value = critic.value(batch.observations, batch.actions);
        let loss = (value - target).square().mean();
        self.output("critic_loss", loss);
        critic.descend(loss, settings);
        if self.repeats {
            policy.step_again(loss.equations(), settings);
        }
    }

    /// Takes one step of each opponent model, one after the other; `loss` is that of the model at a place, of a seat.
    pub fn improve_opponents(self, mut loss: impl FnMut(usize, usize) -> Expression<'e>) {
        let models = &self.player().opponents;
        let step = |(at, other)| {
            let loss = loss(at, other);
            models[at].descend(loss, self.settings);
            loss
        };
        if let Some(total) = self.opponents().map(step).reduce(|total, loss| total + loss) {
            self.output("opponent_loss", total);
        }
    }

    /// Takes one step of the seat's policy; `log_density` `[batch, 1]` is that of its draws.
    pub fn improve_policy(self, loss: Expression<'e>, log_density: Expression<'e>) {
        self.output("policy_loss", loss);
        self.output("policy_entropy", -log_density.mean());
        self.player().policy.descend(loss, self.settings);
    }

    /// Names a metric of the seat's update.
    pub fn output(self, metric: &str, value: Expression<'e>) {
        value.equations().output(&of_seat(self.seat, metric), value);
    }
}

/// Name of what belongs to a seat.
pub(crate) fn of_seat(seat: usize, what: &str) -> String {
    format!("seat_{seat}.{what}")
}
