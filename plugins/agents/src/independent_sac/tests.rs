//! Tests of the agent as a whole and of its equations.

use super::*;
use crate::shared::{coordination as game, joint::ObservationScope};
use contract::random::stream;
use numerics::{network::Activation, optimizer::gradients};

fn tiny() -> Config {
    Config {
        actor_learning_rate: 3e-3,
        critic_learning_rate: 3e-3,
        first_temperature: 0.005,
        target_entropy: Some(-2.0),
        width: 24,
        batch_size: 64,
        learning_starts: 32,
        ..Config::default()
    }
}

fn agent(config: Config) -> IndependentSac {
    IndependentSac::new(config, &game::game(), &mut stream(&["isac"])).unwrap()
}

fn trained(config: Config) -> (IndependentSac, SeatBatch) {
    let mut agent = agent(config);
    game::train(&mut agent, 6, &mut stream(&["some"]));
    let batch = agent.seat_batch(1, agent.replay.sample_distinct(8, &mut stream(&["batch"])));
    (agent, batch)
}

#[test]
fn a_seat_reads_its_own_part() {
    let agent = trained(tiny()).0;
    let joint = agent.replay.latest(3);
    let own = agent.seat_batch(1, joint.clone());
    assert_eq!(values(own.actions), values(columns(&joint.actions, 1..2)));
    assert_eq!(values(own.rewards), values(columns(&joint.rewards, 1..2)));
    assert_eq!(values(own.seen), values(columns(&joint.observations, 1..2)));
    let wide = trained(Config {
        sight: ObservationScope::Joint,
        ..tiny()
    })
    .0;
    assert_eq!(wide.seat_batch(1, joint).seen.dims(), [3, 2]);
}

#[test]
fn the_soft_target_by_hand() {
    let (agent, mut batch) = trained(tiny());
    let learner = &agent.learners[1];
    batch.continues = batch.continues.ones_like();
    let y = values(learner.soft_target(&batch, 0.95, &mut stream(&["noise"])));
    let next = sample_exact(
        learner.policy.network().valid().forward(batch.next_seen.clone()),
        &mut stream(&["noise"]),
    );
    let (q1, q2) = learner
        .target_critics
        .forward(joined(&batch.next_seen, next.action));
    let (q1, q2, log_pi, r) = (
        values(q1),
        values(q2),
        values(next.log_density),
        values(batch.rewards),
    );
    let alpha = learner.temperature() as f32;
    assert!((0..8).all(|i| (y[i] - (r[i] + 0.95 * (q1[i].min(q2[i]) - alpha * log_pi[i]))).abs() < 1e-5));
}

#[test]
fn the_policy_gradient_agrees_with_finite_differences() {
    let (agent, batch) = trained(Config {
        width: 5,
        activation: Activation::Tanh,
        ..tiny()
    });
    let learner = &agent.learners[1];
    game::assert_gradient(learner.policy.network(), |policy| {
        learner.policy_loss(policy, &batch, &mut stream(&["xi"])).0
    });
}

#[test]
fn no_gradient_reaches_the_critics_or_another_seat() {
    let (agent, batch) = trained(tiny());
    let learner = &agent.learners[1];
    let (loss, ..) = learner.policy_loss(learner.policy.network(), &batch, &mut stream(&["xi"]));
    let mut reached = loss.backward();
    assert!(
        gradients(learner.policy.network(), &mut reached)
            .iter()
            .all(|g| !g.is_empty())
    );
    assert!(
        gradients(learner.critics.network(), &mut reached)
            .concat()
            .is_empty()
    );
    assert!(
        gradients(agent.learners[0].policy.network(), &mut reached)
            .concat()
            .is_empty()
    );
}

#[test]
fn a_fixed_temperature_stays_and_an_automatic_one_moves() {
    let fixed = trained(Config {
        temperature: Temperature::Fixed,
        target_entropy: None,
        ..tiny()
    })
    .0;
    assert!((fixed.learners[0].temperature() - 0.005).abs() < 1e-12);
    let mut learner = agent(Config {
        temperature_learning_rate: 0.1,
        ..tiny()
    })
    .learners
    .remove(0);
    let before = learner.temperature();
    // An entropy of 1 is above the target of -2, one of -3 is below it.
    learner.update_temperature(-1.0);
    assert!(learner.temperature() < before);
    (0..20).for_each(|_| learner.update_temperature(3.0));
    assert!(learner.temperature() > before);
}

#[test]
fn it_learns_to_coordinate() {
    let mut rng = stream(&["coordination"]);
    // A small buffer: old actions of the other seat are no part of the present environment.
    let mut agent = agent(Config {
        replay_capacity: 256,
        updates_per_step: 0.5,
        ..tiny()
    });
    let before = game::score(&mut agent, &mut rng);
    game::train(&mut agent, 500, &mut rng);
    let after = game::score(&mut agent, &mut rng);
    assert!(before < -0.05 && after > -0.03, "{before} {after}");
}

#[test]
fn spaces_that_do_not_fit_are_refused() {
    let allocation = crate::shared::bandit::interface();
    assert!(matches!(
        IndependentSac::new(tiny(), &allocation, &mut stream(&["x"])),
        Err(Error::Mismatch { .. })
    ));
}

#[test]
fn a_saved_agent_continues() {
    for sight in [ObservationScope::Own, ObservationScope::Joint] {
        let config = Config {
            reward_normalisation: true,
            sight,
            ..tiny()
        };
        game::assert_continues(|rng| build(config.clone(), &game::game(), rng).unwrap());
    }
}

#[test]
fn recorded_metrics_are_declared() {
    game::assert_declared(&mut agent(tiny()), &metrics());
}

#[test]
fn the_exported_policies_take_the_evaluation_actions() {
    game::assert_exports(&mut trained(tiny()).0, 0.3, 1);
    game::assert_exports(
        &mut trained(Config {
            sight: ObservationScope::Joint,
            ..tiny()
        })
        .0,
        0.3,
        2,
    );
}
