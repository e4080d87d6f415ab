//! Tests of the agent as a whole and of its equations.

use super::*;
use crate::shared::{
    batch::BatchInputs,
    gradient_checks::{assert_gradient, outputs},
    regulator::{self, Plants},
    soft_learner::joined,
};
use contract::random::stream;
use numerics::activation::Activation;
use plan::Equations;

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
    let batch = agent.replay.draw_distinct(8, &mut rng);
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

/// Writes a routine `loss` for a batch of 8.
fn write<'e>(agent: &SoftActorCritic, equations: &'e Equations) -> BatchInputs<'e> {
    let batch = BatchInputs::new(equations, 8, agent.replay.widths());
    equations.routine("loss");
    batch
}

#[test]
fn the_soft_target_by_hand() {
    let (agent, mut batch) = trained(tiny());
    let learner = &agent.learner;
    let mut found = |continues: f32| {
        batch.continues.fill(continues);
        // Draws of a routine are numbered, so that the target's draw is that of `next`.
        let target = outputs(["target"], &agent.state, &batch, |equations| {
            equations.output("target", learner.soft_target(write(&agent, equations)));
        });
        let parts = outputs(["first", "second", "log_pi"], &agent.state, &batch, |equations| {
            let inputs = write(&agent, equations);
            let next = learner.draw(inputs.next_observations);
            let seen = joined(inputs.next_observations, next.action);
            equations.output("first", learner.target_critics[0].apply(seen));
            equations.output("second", learner.target_critics[1].apply(seen));
            equations.output("log_pi", next.log_density);
        });
        (target, parts, batch.rewards.clone())
    };
    let ([last], _, rewards) = found(0.0);
    assert_eq!(last, rewards, "nothing follows");
    let ([y], [q1, q2, log_pi], r) = found(1.0);
    let alpha = learner.temperature.value(&agent.state) as f32;
    assert!((0..8).all(|i| (y[i] - (r[i] + 0.9 * (q1[i].min(q2[i]) - alpha * log_pi[i]))).abs() < 1e-5));
}

#[test]
fn the_policy_gradient_agrees_with_finite_differences() {
    let (agent, batch) = trained(smooth());
    assert_gradient(&[&agent.learner.policy], &agent.state, &batch, |equations| {
        let loss = agent.learner.policy_loss(write(&agent, equations)).0;
        equations.output("loss", loss);
    });
}

#[test]
fn the_critics_gradient_agrees_with_finite_differences() {
    let (agent, batch) = trained(smooth());
    let [first, second] = &agent.learner.critics;
    assert_gradient(&[first, second], &agent.state, &batch, |equations| {
        let inputs = write(&agent, equations);
        let target = agent.learner.soft_target(inputs);
        equations.output("loss", agent.learner.critic_loss(inputs, target));
    });
}

#[test]
fn a_fixed_temperature_stays_and_an_automatic_one_moves() {
    let fixed = Config {
        temperature: Temperature::Fixed,
        target_entropy: None,
        ..tiny()
    };
    let of = |config| {
        let agent = trained(config).0;
        agent.learner.temperature.value(&agent.state)
    };
    assert!((of(fixed) - 0.05).abs() < 1e-8);
    // An entropy of at most ln 2 is far below 5, and far above -50.
    let after = |target| {
        of(Config {
            target_entropy: Some(target),
            ..tiny()
        })
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
        .learner
        .target_entropy(),
        -1.0
    );
}

#[test]
fn it_learns_to_regulate() {
    regulator::assert_learns(&mut agent(tiny()), 300);
}

#[test]
fn members_of_a_population_learn_as_trials_alone() {
    crate::shared::population::assert_members_learn_as_alone(
        |rng| SoftActorCritic::new(tiny(), &regulator::interface(), rng).unwrap(),
        |agent| std::slice::from_mut(&mut agent.learning),
        |agent, rng| drop(regulator::train(agent, &mut Plants::new(rng), 13, rng)),
    );
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
