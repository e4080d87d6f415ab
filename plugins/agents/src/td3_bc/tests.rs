//! Tests of the agent as a whole and of its equations.

use super::*;
use crate::shared::{
    bandit,
    batch::Batch,
    dataset_actor::tests::{cube, decisions, fit},
    gradient_checks::{assert_gradient, computed, outputs},
};
use contract::random::stream;
use plan::Equations;
use rand::Rng as _;

fn tiny() -> Config {
    Config {
        width: 16,
        actor_learning_rate: 1e-3,
        critic_learning_rate: 3e-3,
        ..Config::default()
    }
}

fn agent(config: Config, interface: &Interface) -> Td3Bc {
    Td3Bc::new(config, interface, &mut stream(&["td3_bc"])).unwrap()
}

/// Shares drawn uniformly from the simplex.
fn random_shares(_: f64, rng: &mut Rng) -> Vec<f64> {
    let draws: Vec<f64> = (0..3).map(|_| -rng.random::<f64>().max(1e-300).ln()).collect();
    draws
        .iter()
        .map(|draw| draw / draws.iter().sum::<f64>())
        .collect()
}

fn reward(x: f64, action: &[f64]) -> f64 {
    -bandit::best(x)
        .iter()
        .zip(action)
        .map(|(best, share)| (best - share).abs())
        .sum::<f64>()
}

fn batch_of(agent: &Td3Bc, n: usize) -> Batch {
    agent
        .actor
        .batch(&decisions(n, &mut stream(&["batch"]), random_shares, reward))
}

/// Writes a routine `loss` for a batch of 4.
fn write<'e>(agent: &Td3Bc, equations: &'e Equations) -> BatchInputs<'e> {
    let batch = BatchInputs::new(equations, 4, agent.actor.widths());
    equations.routine("loss");
    batch
}

#[test]
fn the_target_takes_the_lower_target_critic_of_a_smoothed_action() {
    let mut agent = agent(tiny(), &bandit::interface());
    bandit::train(&mut agent, 6, &mut stream(&["target"]));
    let mut batch = batch_of(&agent, 4);
    batch.continues = vec![1.0, 1.0, 0.0, 1.0];
    let (learner, state) = (&agent.learner, &agent.actor.state);
    // Draws of a routine are numbered, so that the target's noise is that of `next`.
    let [y] = outputs(["target"], state, &batch, |equations| {
        let target = learner.target(write(&agent, equations), &agent.config);
        equations.output("target", target);
    });
    let names = ["first", "second", "smoothed", "plain"];
    let [q1, q2, next, plain] = outputs(names, state, &batch, |equations| {
        let seen = write(&agent, equations).next_observations;
        let next = learner.smoothed(seen, &agent.config);
        let judged = learner.judged(seen, next);
        equations.output("first", learner.target_critics[0].apply(judged));
        equations.output("second", learner.target_critics[1].apply(judged));
        equations.output("smoothed", next);
        let plain = learner.actions.act(learner.target_policy.apply(seen));
        equations.output("plain", plain);
    });
    let r = &batch.rewards;
    for i in 0..4 {
        let expected = if i == 2 {
            r[i]
        } else {
            r[i] + 0.99 * q1[i].min(q2[i])
        };
        assert!((y[i] - expected).abs() < 1e-6, "{i}: {} {expected}", y[i]);
    }
    let sums: Vec<f32> = next.chunks(3).map(|shares| shares.iter().sum()).collect();
    assert!(sums.iter().all(|sum| (sum - 1.0).abs() < 1e-6), "{sums:?}");
    assert_ne!(next, plain);
}

#[test]
fn noise_is_clipped_and_actions_stay_in_the_box() {
    let drawn = computed(|equations| clipped_noise(equations.constant([4_000, 2], &[0.0; 8_000]), 0.2, 0.3));
    assert!(drawn.iter().all(|x| x.abs() <= 0.3) && drawn.iter().filter(|x| x.abs() == 0.3).count() > 400);
    let wild = Config {
        target_noise: 10.0,
        target_noise_limit: 5.0,
        ..tiny()
    };
    let agent = agent(wild, &cube());
    let mut batch = batch_of(&agent, 4);
    batch.actions = vec![0.0; 4];
    let [smoothed] = outputs(["smoothed"], &agent.actor.state, &batch, |equations| {
        let seen = write(&agent, equations).next_observations;
        equations.output("smoothed", agent.learner.smoothed(seen, &agent.config));
    });
    assert!(
        smoothed.iter().all(|x| x.abs() <= 1.0) && smoothed.iter().any(|x| x.abs() == 1.0),
        "{smoothed:?}"
    );
}

#[test]
fn the_weight_by_hand_does_not_depend_on_the_scale_of_the_rewards() {
    let of = |scale: f64| {
        let q = [1.0 * scale, -3.0 * scale];
        computed(|equations| lambda(equations.constant([2, 1], &q), 2.5))[0]
    };
    // 2.5 / ((1 + 3) / 2).
    assert!((of(1.0) - 1.25).abs() < 1e-6);
    // The weight times the mean of the values, -1 and -100.
    assert!((of(1.0) - 100.0 * of(100.0)).abs() < 1e-6);
}

#[test]
fn the_gradient_of_the_policy_agrees_with_finite_differences() {
    for interface in [bandit::interface(), cube()] {
        let agent = agent(tiny(), &interface);
        let n = agent.actor.n_acted();
        let actions = (0..4 * n).map(|i| 0.1 + 0.05 * i as f32).collect();
        let batch = Batch {
            actions,
            ..batch_of(&self::agent(tiny(), &bandit::interface()), 4)
        };
        let learner = &agent.learner;
        assert_gradient(&[&learner.policy], &agent.actor.state, &batch, |equations| {
            let batch = write(&agent, equations);
            let (acted, q) = learner.acted_and_valued(batch);
            let lambda = equations.constant([1, 1], &[1.7]);
            equations.output("loss", learner.policy_loss(batch, acted, q, lambda));
        });
    }
}

#[test]
fn the_policy_and_the_targets_wait_for_the_critics() {
    let mut agent = agent(
        Config {
            policy_delay: 3,
            ..tiny()
        },
        &bandit::interface(),
    );
    let data = decisions(8, &mut stream(&["delay"]), random_shares, reward);
    let learn = |agent: &mut Td3Bc| {
        let entries = |agent: &Td3Bc, network: &Network| {
            let names = network.parameter_names().into_iter();
            names
                .map(|name| agent.actor.state.entries(&name).to_vec())
                .collect::<Vec<_>>()
        };
        let both = |agent: &Td3Bc| {
            let Learner {
                policy,
                target_critics,
                ..
            } = &agent.learner;
            [entries(agent, policy), entries(agent, &target_critics[0])]
        };
        let before = both(agent);
        agent
            .learn(&data, &mut stream(&["x"]), &mut Recorder::default())
            .unwrap();
        let after = both(agent);
        [before[0] != after[0], before[1] != after[1]]
    };
    let moved: Vec<_> = (0..6).map(|_| learn(&mut agent)).collect();
    assert_eq!(
        moved,
        [
            [false; 2], [false; 2], [true; 2], [false; 2], [false; 2], [true; 2]
        ]
    );
}

#[test]
fn it_does_better_than_the_dataset_and_cloning_does_not() {
    let mut rng = stream(&["better"]);
    let data = decisions(2_000, &mut rng, random_shares, reward);
    let mut error = |config: Config| {
        let mut agent = agent(config, &bandit::interface());
        fit(&mut agent, &data, 1_200, &mut rng);
        bandit::error(&mut agent, &mut rng)
    };
    let (improved, cloned) = (error(tiny()), error(Config { alpha: 0.0, ..tiny() }));
    // Cloning yields the mean of the actions, equal shares; |1/3 - best| adds up to 0.39 on average.
    assert!(cloned > 0.3 && improved < 0.6 * cloned, "{improved} {cloned}");
}

#[test]
fn it_learns_in_a_box() {
    let mut rng = stream(&["box"]);
    let anywhere = |_: f64, rng: &mut Rng| vec![rng.random_range(-1.0..1.0)];
    let data = decisions(2_000, &mut rng, anywhere, |x, action| {
        -(action[0] - 0.8 * x).abs()
    });
    let mut error = |alpha: f64| {
        let mut agent = agent(Config { alpha, ..tiny() }, &cube());
        fit(&mut agent, &data, 1_200, &mut rng);
        let seen: Vec<_> = [-0.9, 0.9]
            .iter()
            .map(|x| Observation {
                seats: vec![vec![*x]],
                state: vec![],
            })
            .collect();
        let actions = agent.act(&seen, Mode::Evaluate, &mut rng).unwrap();
        ((actions[0][0][0] + 0.72).abs() + (actions[1][0][0] - 0.72).abs()) / 2.0
    };
    let (improved, cloned) = (error(2.5), error(0.0));
    assert!(cloned > 0.5 && improved < 0.6 * cloned, "{improved} {cloned}");
}

#[test]
fn a_saved_agent_continues() {
    bandit::assert_continues(|rng| build(tiny(), &bandit::interface(), rng).unwrap());
}

#[test]
fn the_scaling_by_a_dataset_goes_with_the_agent_and_with_the_policy() {
    crate::shared::dataset_actor::tests::assert_scaling_is_kept(|rng| {
        build(tiny(), &bandit::interface(), rng).unwrap()
    });
}

#[test]
fn recorded_metrics_are_declared_and_the_exported_policy_acts() {
    bandit::assert_declared(&mut agent(tiny(), &bandit::interface()), &metrics());
    bandit::assert_exports(&mut agent(tiny(), &bandit::interface()));
    bandit::assert_imports(|interface, rng| build(tiny(), interface, rng).unwrap());
}

#[test]
fn members_of_a_population_learn_as_trials_alone() {
    crate::shared::population::assert_members_learn_as_alone(
        |rng| Td3Bc::new(tiny(), &bandit::interface(), rng).unwrap(),
        |agent| std::slice::from_mut(&mut agent.learning),
        |agent, rng| drop(bandit::train(agent, 5, rng)),
    );
}
