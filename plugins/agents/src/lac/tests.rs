//! Tests of the agents as a whole and of their equations.

use super::*;
use crate::shared::{
    coordination::{self, assert_gradient},
    regulator::{self, Plants},
};
use contract::random::stream;
use numerics::{network::Activation, optimizer::gradients};

fn tiny() -> Config {
    Config {
        actor_learning_rate: 3e-3,
        lyapunov_learning_rate: 3e-3,
        multiplier_learning_rate: 3e-3,
        temperature_learning_rate: 3e-3,
        discount: 0.9,
        target_smoothing: 0.05,
        first_multiplier: 0.9,
        first_temperature: 0.05,
        target_entropy: Some(-2.0),
        updates_per_step: 0.25,
        width: 24,
        batch_size: 64,
        learning_starts: 32,
        ..Config::default()
    }
}

fn smooth(smoothness: f64, smoothness_norm: SmoothnessNorm) -> Config {
    Config {
        smoothness,
        smoothness_norm,
        ..tiny()
    }
}

fn agent(config: Config) -> LyapunovActorCritic {
    LyapunovActorCritic::new(LAC, config, &regulator::interface(), &mut stream(&["lac"])).unwrap()
}

/// An agent after some updates, and a batch of its transitions.
fn trained(config: Config) -> (LyapunovActorCritic, MemoryBatch) {
    let (mut agent, mut rng) = (agent(config), stream(&["some"]));
    let mut plants = Plants::new(&mut rng);
    regulator::train(&mut agent, &mut plants, 8, &mut rng);
    let batch = agent.memory.sample(8, &mut rng);
    (agent, batch)
}

/// An agent as in [`trained`], with smooth networks, and observations before so far away that no difference
/// changes its sign.
fn small(config: Config) -> (LyapunovActorCritic, MemoryBatch) {
    let (agent, mut batch) = trained(Config {
        width: 5,
        activation: Activation::Tanh,
        ..config
    });
    batch.before = batch.before.map(|_| batch.observations.clone() + 1.0);
    (agent, batch)
}

fn loss(agent: &LyapunovActorCritic, policy: &Mlp, batch: &MemoryBatch) -> Tensor<1> {
    agent.policy_loss(policy, batch, &mut stream(&["xi"])).loss
}

#[test]
fn the_target_by_hand() {
    let (agent, mut batch) = trained(tiny());
    batch.continues = batch.continues.zeros_like();
    let last = values(agent.target(&batch, &mut stream(&["noise"])));
    assert_eq!(last, values(batch.costs.clone()), "nothing follows");
    batch.continues = batch.continues.ones_like();
    let y = values(agent.target(&batch, &mut stream(&["noise"])));
    let next = agent.limits().draw(
        &agent.target_policy,
        &batch.next_observations,
        &mut stream(&["noise"]),
    );
    let follows = values(value(
        &agent.target_lyapunov,
        &batch.next_observations,
        next.action,
    ));
    let costs = values(batch.costs);
    assert!(costs.iter().all(|cost| *cost >= 0.0) && costs.iter().any(|cost| *cost > 0.1));
    assert!((0..8).all(|i| (y[i] - (costs[i] + 0.9 * follows[i])).abs() < 1e-5));
}

#[test]
fn the_policy_loss_by_hand() {
    let (agent, batch) = trained(Config {
        decrease: 0.5,
        ..smooth(2.0, SmoothnessNorm::Mean)
    });
    let policy = agent.policy.network().valid();
    let found = agent.policy_loss(&policy, &batch, &mut stream(&["xi"]));
    let mut rng = stream(&["xi"]);
    let lyapunov = agent.lyapunov.network().valid();
    let next = agent
        .limits()
        .draw(&policy, &batch.next_observations, &mut rng)
        .action;
    let after = values(value(&lyapunov, &batch.next_observations, next));
    let now = values(value(&lyapunov, &batch.observations, batch.actions.clone()));
    let costs = values(batch.costs.clone());
    let violation = (0..8).map(|i| after[i] - now[i] + 0.5 * costs[i]).sum::<f32>() / 8.0;
    let log_pi = mean(
        agent
            .limits()
            .draw(&policy, &batch.observations, &mut rng)
            .log_density,
    );
    let scored = |seen: &Tensor<2>| values(mean_action(policy.forward(seen.clone())));
    let (here, before) = (
        scored(&batch.observations),
        scored(batch.before.as_ref().unwrap()),
    );
    let change = here.iter().zip(&before).map(|(a, b)| (a - b).abs()).sum::<f32>() / 8.0;
    assert!((found.violation - f64::from(violation)).abs() < 1e-5);
    assert!((found.log_pi - f64::from(log_pi)).abs() < 1e-5);
    assert!(change > 1e-3 && (found.action_change.unwrap() - f64::from(change)).abs() < 1e-5);
    let expected = agent.weight() * f64::from(violation)
        + agent.temperature.value() * f64::from(log_pi)
        + 2.0 * f64::from(change);
    assert!((f64::from(values(found.loss)[0]) - expected).abs() < 1e-4);
}

#[test]
fn the_lyapunov_gradient_agrees_with_finite_differences() {
    let (agent, batch) = small(tiny());
    let target = agent.target(&batch, &mut stream(&["xi"]));
    assert_gradient(agent.lyapunov.network(), |lyapunov| {
        let found = value(lyapunov, &batch.observations, batch.actions.clone());
        half_squared_error(found, target.clone())
    });
}

#[test]
fn policy_gradients_agree_with_finite_differences() {
    for (smoothness, norm) in [
        (0.0, SmoothnessNorm::Mean),
        (3.0, SmoothnessNorm::Mean),
        (3.0, SmoothnessNorm::Frobenius),
    ] {
        let (agent, batch) = small(smooth(smoothness, norm));
        assert_eq!(batch.before.is_some(), smoothness > 0.0);
        assert_gradient(agent.policy.network(), |policy| loss(&agent, policy, &batch));
    }
}

/// The gradient of each norm alone, through the actions at both states.
#[test]
fn smoothness_gradients_agree_with_finite_differences() {
    for norm in [SmoothnessNorm::Mean, SmoothnessNorm::Frobenius] {
        let (agent, batch) = small(smooth(1.0, norm));
        assert_gradient(agent.policy.network(), |policy| {
            let scored = |seen: &Tensor<2>| mean_action(policy.forward(seen.clone()));
            norm.of(scored(&batch.observations) - scored(batch.before.as_ref().unwrap()))
        });
    }
}

#[test]
fn no_gradient_reaches_the_critic_from_the_policy() {
    let (agent, batch) = trained(smooth(1.0, SmoothnessNorm::Mean));
    let mut reached = loss(&agent, agent.policy.network(), &batch).backward();
    assert!(
        gradients(agent.policy.network(), &mut reached)
            .iter()
            .all(|g| !g.is_empty())
    );
    assert!(
        gradients(agent.lyapunov.network(), &mut reached)
            .concat()
            .is_empty()
    );
}

/// The multiplier rises where the value falls too little, and counts as at most 1.
#[test]
fn the_multiplier_rises_with_the_violation_and_is_clipped() {
    let after = |decrease| {
        let fast = Config {
            decrease,
            first_multiplier: 0.5,
            multiplier_learning_rate: 0.05,
            ..tiny()
        };
        trained(fast).0
    };
    let violated = after(1e3);
    assert!(violated.multiplier.value() > 0.55, "{:?}", violated.multiplier);
    let mut held = violated.clone();
    (0..100).for_each(|_| held.multiplier.rise_with(1e3));
    assert!(held.multiplier.value() > 1.0);
    assert_eq!(held.weight(), 1.0);
    let mut kept = violated;
    (0..100).for_each(|_| kept.multiplier.rise_with(-1e3));
    assert!(kept.weight() < 0.1);
}

#[test]
fn the_temperature_steers_to_the_target_entropy() {
    let after = |target| {
        trained(Config {
            target_entropy: Some(target),
            ..tiny()
        })
        .0
        .temperature
        .value()
    };
    // An entropy of at most ln 2 is far below 5, and far above -50.
    assert!(after(5.0) > 0.0501 && after(-50.0) < 0.0499);
    let default = agent(Config {
        target_entropy: None,
        ..tiny()
    });
    assert_eq!(default.target_entropy, -1.0);
}

#[test]
fn without_learning_rates_left_nothing_moves() {
    let (mut agent, mut rng) = (
        agent(Config {
            decline_steps: Some(32),
            ..tiny()
        }),
        stream(&["some"]),
    );
    let before = regulator::scored(&mut agent, &[0.4]);
    regulator::train(&mut agent, &mut Plants::new(&mut rng), 8, &mut rng);
    assert_eq!(regulator::scored(&mut agent, &[0.4]), before);
    assert!(agent.updates().unwrap().made > 0);
    assert_eq!(agent.multiplier.value(), Multiplier::new(0.9, 1.0).value());
}

#[test]
fn noise_is_added_while_exploring_alone() {
    let (mut clean, mut noisy) = (
        agent(tiny()),
        agent(Config {
            exploration_observation_sd: 0.5,
            ..tiny()
        }),
    );
    let explore = |agent: &mut LyapunovActorCritic| {
        let seen = [regulator::observe(0.3)];
        agent.act(&seen, Mode::Train, &mut stream(&["act"])).unwrap()
    };
    assert_ne!(explore(&mut noisy), explore(&mut clean));
    assert_eq!(
        regulator::scored(&mut noisy, &[0.3]),
        regulator::scored(&mut clean, &[0.3])
    );
}

#[test]
fn lac_learns_to_regulate() {
    regulator::assert_learns(&mut agent(tiny()), 400);
}

#[test]
fn clac_learns_to_regulate() {
    regulator::assert_learns(&mut agent(smooth(0.02, SmoothnessNorm::Mean)), 400);
}

/// Compares the slopes of the deterministic action between neighbouring positions.
#[test]
fn a_heavy_weight_keeps_neighbouring_actions_together() {
    let steepness = |smoothness| {
        let (mut agent, mut rng) = (
            agent(smooth(smoothness, SmoothnessNorm::Frobenius)),
            stream(&["steep"]),
        );
        regulator::train(&mut agent, &mut Plants::new(&mut rng), 300, &mut rng);
        let scored = regulator::scored(&mut agent, &[-0.4, -0.2, 0.0, 0.2, 0.4]);
        scored
            .windows(2)
            .map(|pair| (pair[1] - pair[0]).abs())
            .sum::<f64>()
    };
    let (free, held) = (steepness(1e-6), steepness(1.0));
    assert!(held < 0.3 * free && free > 0.3, "{held} {free}");
}

#[test]
fn a_gain_is_no_cost() {
    let (mut agent, mut rng) = (agent(tiny()), stream(&["gain"]));
    let mut plants = Plants::new(&mut rng);
    regulator::train(&mut agent, &mut plants, 2, &mut rng);
    plants.bonus = 3.0;
    let transitions = plants.step(&mut agent, &mut rng);
    let refusal = agent
        .learn(&transitions, &mut rng, &mut Recorder::default())
        .unwrap_err();
    assert!(matches!(refusal, Error::Mismatch { agent: "lac", .. }));
    let text = refusal.to_string();
    assert!(
        text.contains("needs costs of at least 0") && text.contains("after step 16 the reward is 2."),
        "{text}"
    );
}

#[test]
fn contradictions_and_seats_that_do_not_fit_are_refused() {
    let refusal = |config: Config, interface: &Interface| {
        build(CLAC, config, interface, &mut stream(&["x"]))
            .err()
            .unwrap()
            .to_string()
    };
    let text = refusal(
        Config {
            log_sd_low: 1.0,
            log_sd_high: 0.0,
            ..tiny()
        },
        &regulator::interface(),
    );
    assert!(text.contains("`log_sd_low`"), "{text}");
    let text = refusal(
        Config {
            exploration_noise_channels: vec!["target_".into()],
            ..tiny()
        },
        &regulator::interface(),
    );
    assert!(
        text.contains("`exploration_noise_channels`: no observed channel begins with `target_`")
            && text.contains("x, nothing"),
        "{text}"
    );
    let text = refusal(tiny(), &crate::shared::bandit::interface());
    assert!(
        text.contains("`clac`") && text.contains("takes a simplex"),
        "{text}"
    );
    let text = refusal(tiny(), &coordination::game());
    assert!(
        text.contains("it plays one seat, the environment has 2"),
        "{text}"
    );
}

/// Episodes of one step have no observation before any transition: the agent learns nothing and does not
/// fail.
#[test]
fn episodes_of_one_step_give_no_neighbours() {
    let (mut agent, mut rng) = (agent(smooth(0.5, SmoothnessNorm::Mean)), stream(&["one"]));
    let mut plants = Plants::new(&mut rng);
    for _ in 0..8 {
        let mut transitions = plants.step(&mut agent, &mut rng);
        transitions
            .iter_mut()
            .for_each(|it| it.end = Some(contract::End::Truncated));
        agent
            .learn(&transitions, &mut rng, &mut Recorder::default())
            .unwrap();
    }
    assert_eq!(agent.updates().unwrap().made, 0);
}

#[test]
fn saved_agents_continue() {
    for smoothness in [0.0, 0.5] {
        let config = Config {
            exploration_observation_sd: 0.1,
            decline_steps: Some(200),
            ..smooth(smoothness, SmoothnessNorm::Frobenius)
        };
        regulator::assert_continues(|rng| build(CLAC, config.clone(), &regulator::interface(), rng).unwrap());
    }
}

#[test]
fn recorded_metrics_are_declared() {
    let declared = metrics();
    let all = regulator::names(&declared);
    regulator::assert_records(&mut agent(smooth(0.5, SmoothnessNorm::Mean)), &all);
    regulator::assert_records(&mut agent(tiny()), &all[..all.len() - 1]);
}

#[test]
fn the_exported_policy_takes_the_evaluation_actions() {
    regulator::assert_exports(|rng| build(LAC, tiny(), &regulator::interface(), rng).unwrap());
}
