//! Policies that are conditioned on predicted actions of the others (TDOM-AC and ROMMEO).

use super::{ActingPrediction, Game, SeatBatch, beside};
use burn::tensor::Tensor;
use contract::{Mode, Rng};
use numerics::squashed::{mean_action, sample};

/// Actions `[rows, n_i]` of a seat: draws where it explores, means in evaluation.
pub(crate) fn decide(
    game: &Game,
    seat: usize,
    observations: &Tensor<2>,
    prediction: ActingPrediction,
    mode: Mode,
    rng: &mut Rng,
) -> Tensor<2> {
    let (player, observations) = (&game.players[seat], &game.seen(seat, observations));
    let heads = player
        .opponents
        .iter()
        .map(|model| model.acting_head(observations.clone()));
    let predicted = heads.map(|head| match (mode, prediction) {
        (Mode::Train, ActingPrediction::Sample) => sample(head, rng).action,
        _ => mean_action(head),
    });
    let predicted: Vec<_> = predicted.collect();
    let head = player.policy.acting_head(beside(observations, predicted));
    match mode {
        Mode::Train => sample(head, rng).action,
        Mode::Evaluate => mean_action(head),
    }
}

/// Mean actions of the others `[rows, n_acted - n_i]` that a seat predicts.
pub(crate) fn predict(game: &Game, seat: usize, observations: &Tensor<2>) -> Tensor<2> {
    let (models, seen) = (game.players[seat].opponents.iter(), game.seen(seat, observations));
    Tensor::cat(
        models
            .map(|model| mean_action(model.acting_head(seen.clone())))
            .collect(),
        1,
    )
}

/// Eq. 4.16 as a loss `[1]`, `mean(alpha log pi - Q)` at constant predictions, and `log pi` `[batch, 1]`.
pub(crate) fn policy_loss(
    game: &mut Game,
    seat: usize,
    batch: &SeatBatch,
    weight: f64,
    rng: &mut Rng,
) -> (Tensor<1>, Tensor<2>) {
    let seen = game.seen(seat, &batch.observations);
    let player = &mut game.players[seat];
    let predicted: Vec<_> = player
        .draw_others(&seen, rng)
        .into_iter()
        .map(|draw| draw.action)
        .collect();
    let drawn = sample(player.policy.tracked_head(beside(&seen, predicted.clone())), rng);
    let actions = game.joint(seat, drawn.action, predicted);
    let value = game.players[seat].critic.value(&batch.observations, actions);
    (
        (drawn.log_density.clone() * weight - value).mean(),
        drawn.log_density,
    )
}
