//! Tests of the agent as a whole and of its equations.

use super::*;
use crate::shared::{
    coordination::assert_gradient,
    regulator::{self, Plants},
};
use contract::random::stream;
use numerics::{network::Activation, optimizer::gradients};

fn tiny() -> Config {
    Config {
        actor_learning_rate: 3e-3,
        critic_learning_rate: 3e-3,
        temperature_learning_rate: 3e-3,
        first_temperature: 0.05,
        target_entropy: Some(-2.0),
        discount: 0.9,
        target_smoothing: 0.05,
        updates_per_step: 0.25,
        width: 24,
        batch_size: 64,
        learning_starts: 32,
        ..Config::default()
    }
}

fn agent(config: Config) -> SoftActorCritic {
    SoftActorCritic::new(config, &regulator::interface(), &mut stream(&["sac"])).unwrap()
}

/// An agent after some updates, and a batch of its transitions.
fn trained(config: Config) -> (SoftActorCritic, Batch) {
    let (mut agent, mut rng) = (agent(config), stream(&["some"]));
    let mut plants = Plants::new(&mut rng);
    regulator::train(&mut agent, &mut plants, 8, &mut rng);
    let batch = agent.replay.sample_distinct(8, &mut rng);
    (agent, batch)
}

/// Config of a small and smooth network, whose finite differences are close to its slopes.
fn smooth() -> Config {
    Config {
        width: 5,
        activation: Activation::Tanh,
        ..tiny()
    }
}

#[test]
fn the_soft_target_by_hand() {
    let (agent, mut batch) = trained(tiny());
    batch.continues = batch.continues.zeros_like();
    let last = values(agent.soft_target(&batch, &mut stream(&["noise"])));
    assert_eq!(last, values(batch.rewards.clone()), "nothing follows");
    batch.continues = batch.continues.ones_like();
    let y = values(agent.soft_target(&batch, &mut stream(&["noise"])));
    let next = sample_exact(
        agent
            .policy
            .network()
            .valid()
            .forward(batch.next_observations.clone()),
        &mut stream(&["noise"]),
    );
    let (q1, q2) = agent
        .target_critics
        .forward(joined(&batch.next_observations, next.action));
    let (q1, q2, log_pi, r) = (
        values(q1),
        values(q2),
        values(next.log_density),
        values(batch.rewards),
    );
    let alpha = agent.temperature.value() as f32;
    assert!((0..8).all(|i| (y[i] - (r[i] + 0.9 * (q1[i].min(q2[i]) - alpha * log_pi[i]))).abs() < 1e-5));
}

#[test]
fn the_policy_gradient_agrees_with_finite_differences() {
    let (agent, batch) = trained(smooth());
    assert_gradient(agent.policy.network(), |policy| {
        agent.policy_loss(policy, &batch, &mut stream(&["xi"])).0
    });
}

#[test]
fn the_critics_gradient_agrees_with_finite_differences() {
    let (agent, batch) = trained(smooth());
    let target = agent.soft_target(&batch, &mut stream(&["xi"]));
    assert_gradient(&agent.critics.network().second, |second| {
        let twins = TwinMlp {
            first: agent.critics.network().first.clone(),
            second: second.clone(),
        };
        critic_loss(&twins, &batch, &target)
    });
}

#[test]
fn no_gradient_reaches_the_critics() {
    let (agent, batch) = trained(tiny());
    let (loss, ..) = agent.policy_loss(agent.policy.network(), &batch, &mut stream(&["xi"]));
    let mut reached = loss.backward();
    assert!(
        gradients(agent.policy.network(), &mut reached)
            .iter()
            .all(|g| !g.is_empty())
    );
    assert!(
        gradients(agent.critics.network(), &mut reached)
            .concat()
            .is_empty()
    );
}

#[test]
fn a_fixed_temperature_stays_and_an_automatic_one_moves() {
    let fixed = Config {
        temperature: Temperature::Fixed,
        target_entropy: None,
        ..tiny()
    };
    assert!((trained(fixed).0.temperature.value() - 0.05).abs() < 1e-12);
    // An entropy of at most ln 2 is far below 5, and far above -50.
    let after = |target| {
        trained(Config {
            target_entropy: Some(target),
            ..tiny()
        })
        .0
        .temperature
        .value()
    };
    assert!(after(5.0) > 0.0501 && after(-50.0) < 0.0499);
}

#[test]
fn the_target_entropy_is_minus_the_number_of_entries() {
    assert_eq!(
        agent(Config {
            target_entropy: None,
            ..tiny()
        })
        .target_entropy,
        -1.0
    );
}

#[test]
fn it_learns_to_regulate() {
    regulator::assert_learns(&mut agent(tiny()), 300);
}

#[test]
fn contradictions_and_seats_that_do_not_fit_are_refused() {
    let build = |config: Config, interface: &Interface| {
        SoftActorCritic::new(config, interface, &mut stream(&["x"]))
            .unwrap_err()
            .to_string()
    };
    let text = build(
        Config {
            replay_capacity: 9,
            ..tiny()
        },
        &regulator::interface(),
    );
    assert!(text.contains("`batch_size`"), "{text}");
    let text = build(
        Config {
            temperature: Temperature::Fixed,
            ..tiny()
        },
        &regulator::interface(),
    );
    assert!(text.contains("`target_entropy`: a fixed temperature"), "{text}");
    let text = build(tiny(), &crate::shared::bandit::interface());
    assert!(
        text.contains("soft_actor_critic") && text.contains("takes a simplex"),
        "{text}"
    );
}

#[test]
fn a_saved_agent_continues() {
    regulator::assert_continues(|rng| {
        Box::new(SoftActorCritic::new(tiny(), &regulator::interface(), rng).unwrap())
    });
}

#[test]
fn recorded_metrics_are_declared() {
    regulator::assert_records(&mut agent(tiny()), &regulator::names(&metrics()));
}

#[test]
fn the_exported_policy_takes_the_evaluation_actions() {
    regulator::assert_exports(|rng| {
        Box::new(SoftActorCritic::new(tiny(), &regulator::interface(), rng).unwrap())
    });
}
