//! Tests of the losses and of the agent as a whole.

use super::*;
use crate::shared::{coordination, opponent_modelling::trials};
use plan::{Equations, Processor, State};

fn tiny() -> Config {
    Config {
        opponent_samples: 2,
        settings: trials::tiny(),
        ..Config::default()
    }
}

fn plain() -> Config {
    Config {
        settings: trials::plain(),
        ..tiny()
    }
}

#[test]
fn the_target_by_its_parts() {
    for bootstrap in [Bootstrap::PerState, Bootstrap::BatchMean] {
        let mut learner = trials::learner(Config {
            critic_entropy_weight: 0.3,
            bootstrap,
            ..plain()
        });
        let batch = trials::batch(&mut learner, 8);
        let mut got = trials::computed(&learner, 0, &batch, |update| learner.algorithm.next_value(update));
        let mut want = trials::computed(&learner, 0, &batch, |update| {
            let (player, s) = (update.player(), update.batch.next_observations);
            let draw = |head| sample(head, Correction::Softened);
            let own = draw(player.policy.head(s));
            let head = player.opponents[0].head(s.equations().join(&[s, own.action]));
            let q = || {
                let answer = draw(head).action;
                let actions = s.equations().join(&[own.action, answer]);
                player.critic.target_value(s, actions)
            };
            (q() + q()) * 0.5 - own.log_density * 0.3
        });
        if bootstrap == Bootstrap::BatchMean {
            want = vec![want.iter().sum::<f32>() / 8.0; 8];
            // One number for all rows.
            got = vec![got[0]; 8];
        }
        assert!(
            got.iter().zip(&want).all(|(got, want)| (got - want).abs() < 1e-5),
            "{got:?} {want:?}"
        );
    }
}

#[test]
fn draws_are_joined_by_hand() {
    let join = |joined_draws, weight| {
        let equations = Equations::new();
        let draws = [[1.0, 0.0], [3.0, 0.0]].map(|column| equations.constant([2, 1], &column));
        equations.routine("join");
        let config = Config {
            joined_draws,
            ..plain()
        };
        equations.output("joined", config.joined(&draws, weight));
        let mut processor = Processor::<f32>::new(equations.into_graph());
        processor.run("join", &mut State::default());
        processor.entries("joined").to_vec()
    };
    assert_eq!(join(JoinedDraws::Mean, 2.0), [2.0, 0.0]);
    assert_eq!(join(JoinedDraws::LogMeanExp, 0.0), [2.0, 0.0]);
    let soft = join(JoinedDraws::LogMeanExp, 2.0);
    let want = 2.0 * (f32::midpoint(0.5f32.exp(), 1.5f32.exp())).ln();
    assert!(
        (soft[0] - want).abs() < 1e-5 && soft[1].abs() < 1e-6,
        "{soft:?} {want}"
    );
}

/// With one critic and one set of draws, the recursion through the opponents' answers is part of the
/// gradient.
#[test]
fn gradients_agree_with_finite_differences_through_the_answers() {
    for (input_normalisation, joined_draws) in [(false, JoinedDraws::Mean), (true, JoinedDraws::LogMeanExp)] {
        let settings = Settings {
            input_normalisation,
            ..trials::plain()
        };
        let config = Config {
            joined_draws,
            settings,
            ..plain()
        };
        trials::assert_gradient(
            config.clone(),
            |player| &player.policy,
            |update| config.policy_loss(update).0,
        );
        trials::assert_gradient(
            config.clone(),
            |player| &player.opponents[0],
            |update| config.opponent_loss(update, 0, 1),
        );
    }
}

#[test]
fn losses_reach_one_network_alone() {
    let mut learner = trials::learner(plain());
    let batch = trials::batch(&mut learner, 8);
    let config = &learner.algorithm;
    trials::assert_moves_only(&learner, 0, &batch, "seat_0.opponent_0", |update| {
        update.improve_opponents(|at, other| config.opponent_loss(update, at, other));
    });
    trials::assert_moves_only(&learner, 1, &batch, "seat_1.policy", |update| {
        let (loss, log_density) = config.policy_loss(update);
        update.improve_policy(loss, log_density);
    });
}

#[test]
fn a_pessimist_turns_the_gradient_of_the_value() {
    let mut learner = trials::learner(Config {
        settings: Settings {
            opponent_entropy_weight: 0.0,
            ..trials::plain()
        },
        ..plain()
    });
    let batch = trials::batch(&mut learner, 8);
    let gradient = |opponent_objective| {
        let config = Config {
            opponent_objective,
            ..learner.algorithm.clone()
        };
        let model = &learner.game.players[0].opponents[0];
        trials::gradient(&learner, model, &batch, |update| {
            config.opponent_loss(update, 0, 1)
        })
    };
    let (up, down) = (
        gradient(OpponentObjective::Maximise),
        gradient(OpponentObjective::Minimise),
    );
    assert!(trials::norm(&up) > 1e-3 && up.iter().zip(&down).all(|(up, down)| *up == -down));
}

#[test]
fn it_learns_to_coordinate() {
    let settings = Settings {
        policy_entropy_weight: 0.1,
        opponent_entropy_weight: 0.1,
        ..trials::tiny()
    };
    trials::assert_learns(Config { settings, ..tiny() });
}

#[test]
fn a_saved_agent_continues() {
    coordination::assert_continues(|rng| build(tiny(), &coordination::game(), rng).unwrap());
}

#[test]
fn an_exported_agent_acts_and_predicts_the_same() {
    trials::assert_exports(tiny());
}

#[test]
fn a_seat_that_sees_its_own_observation_heeds_no_other() {
    trials::assert_sight(|settings| Config { settings, ..tiny() });
}

#[test]
fn recorded_metrics_are_declared() {
    trials::assert_declared(tiny(), metrics());
}

#[test]
fn members_of_a_population_learn_as_trials_alone() {
    trials::assert_members_learn_as_alone(&tiny());
}
