//! Policies that are conditioned on predicted actions of the others (TDOM-AC and ROMMEO).

use super::{ActingPrediction, Game, SeatUpdate, beside};
use contract::Mode;
use numerics::equations::squashed::{Correction, mean_action, sample};
use plan::Expression;

/// Actions `[rows, n_i]` of a seat: draws where it explores, means in evaluation.
pub(crate) fn decide<'e>(
    game: &Game,
    seat: usize,
    observations: Expression<'e>,
    prediction: ActingPrediction,
    mode: Mode,
) -> Expression<'e> {
    let (player, seen) = (&game.players[seat], game.seen(seat, observations));
    let heads = player.opponents.iter().map(|model| model.acting_head(seen));
    let predicted = heads.map(|head| match (mode, prediction) {
        (Mode::Train, ActingPrediction::Sample) => sample(head, Correction::Softened).action,
        _ => mean_action(head),
    });
    let predicted: Vec<_> = predicted.collect();
    acted(player.policy.acting_head(beside(seen, &predicted)), mode)
}

/// Actions of a policy's head: draws where it explores, means in evaluation.
pub(crate) fn acted(head: Expression<'_>, mode: Mode) -> Expression<'_> {
    match mode {
        Mode::Train => sample(head, Correction::Softened).action,
        Mode::Evaluate => mean_action(head),
    }
}

/// Mean actions of the others `[rows, n_acted - n_i]` that a seat predicts from what its opponent models see.
pub(crate) fn predict<'e>(game: &Game, seat: usize, input: Expression<'e>) -> Expression<'e> {
    let models = game.players[seat].opponents.iter();
    let means: Vec<_> = models
        .map(|model| mean_action(model.acting_head(input)))
        .collect();
    input.equations().join(&means)
}

/// Eq. 4.16 as a loss `[1, 1]`, `mean(alpha log pi - Q)` at constant predictions, and `log pi` `[batch, 1]`.
pub(crate) fn policy_loss<'e>(update: SeatUpdate<'_, 'e>, weight: f64) -> (Expression<'e>, Expression<'e>) {
    let (player, observations) = (update.player(), update.batch.observations);
    let seen = update.seen(observations);
    let predicted: Vec<_> = update.draw_others(seen).iter().map(|draw| draw.action).collect();
    let drawn = sample(player.policy.head(beside(seen, &predicted)), Correction::Softened);
    let value = player
        .critic
        .value(observations, update.joint(drawn.action, predicted));
    ((drawn.log_density * weight - value).mean(), drawn.log_density)
}
