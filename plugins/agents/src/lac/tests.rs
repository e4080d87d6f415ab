//! Tests of the agents as a whole and of their equations.

use super::memory::MemoryInputs;
use super::networks::value;
use super::*;
use crate::shared::{
    batch::Batch,
    batch::BatchInputs,
    coordination,
    gradient_checks::{assert_gradient, outputs},
    regulator::{self, Plants},
};
use contract::random::stream;
use numerics::{
    activation::Activation,
    equations::{network::Network, squashed::mean_action},
};
use plan::{Equations, Processor};

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
fn trained(config: Config) -> (LyapunovActorCritic, Batch) {
    let (mut agent, mut rng) = (agent(config), stream(&["some"]));
    let mut plants = Plants::new(&mut rng);
    regulator::train(&mut agent, &mut plants, 8, &mut rng);
    let batch = agent.memory.sample(8, &mut rng);
    (agent, batch)
}

/// An agent as in [`trained`], with smooth networks, and observations before so far away that no difference
/// changes its sign.
fn small(config: Config) -> (LyapunovActorCritic, Batch) {
    let (agent, mut batch) = trained(Config {
        width: 5,
        activation: Activation::Tanh,
        ..config
    });
    // An action of one entry, and two channels.
    let width = agent.memory.widths().acted;
    for (row, seen) in batch.actions.chunks_mut(width).zip(batch.observations.chunks(2)) {
        row[1..]
            .iter_mut()
            .zip(seen)
            .for_each(|(before, x)| *before = x + 1.0);
    }
    (agent, batch)
}

/// Writes a routine `loss` for a batch of 8.
fn write<'e>(agent: &LyapunovActorCritic, equations: &'e Equations) -> MemoryInputs<'e> {
    let batch = BatchInputs::new(equations, 8, agent.memory.widths());
    equations.routine("loss");
    MemoryInputs::of(batch, 1)
}

#[test]
fn the_target_by_hand() {
    let (agent, mut batch) = trained(tiny());
    let learner = &agent.learner;
    let mut found = |continues: f32| {
        batch.continues.fill(continues);
        // Draws of a routine are numbered, so that the target's draw is that of `next`.
        let [target] = outputs(["target"], &agent.state, &batch, |equations| {
            equations.output("target", learner.target(write(&agent, equations), 0.9));
        });
        let [follows] = outputs(["follows"], &agent.state, &batch, |equations| {
            let seen = write(&agent, equations).next_observations;
            let next = learner.limits.draw(&learner.target_policy, seen).action;
            equations.output("follows", value(&learner.target_lyapunov, seen, next));
        });
        (target, follows)
    };
    let ((last, _), (y, follows)) = (found(0.0), found(1.0));
    let costs: Vec<f32> = batch.rewards.iter().map(|reward| -reward).collect();
    assert_eq!(last, costs, "nothing follows");
    assert!(costs.iter().all(|cost| *cost >= 0.0) && costs.iter().any(|cost| *cost > 0.1));
    assert!((0..8).all(|i| (y[i] - (costs[i] + 0.9 * follows[i])).abs() < 1e-5));
}

#[test]
fn the_policy_loss_by_hand() {
    let (agent, batch) = trained(Config {
        decrease: 0.5,
        ..smooth(2.0, SmoothnessNorm::Mean)
    });
    let (learner, state) = (&agent.learner, &agent.state);
    let names = ["loss", "violation", "log_pi", "action_change"];
    let found = outputs(names, state, &batch, |equations| {
        let found = learner.policy_loss(write(&agent, equations), &agent.config);
        equations.output("loss", found.loss);
        equations.output("violation", found.violation);
        equations.output("log_pi", found.log_pi);
        equations.output("action_change", found.action_change.unwrap());
    });
    let names = ["after", "now", "log_density", "here", "there"];
    let [after, now, log_density, here, there] = outputs(names, state, &batch, |equations| {
        let batch = write(&agent, equations);
        let (seen, next_seen) = (batch.observations, batch.next_observations);
        let next = learner.limits.draw(&learner.policy, next_seen).action;
        equations.output("after", value(&learner.lyapunov, next_seen, next));
        equations.output("now", value(&learner.lyapunov, seen, batch.actions));
        let drawn = learner.limits.draw(&learner.policy, seen);
        equations.output("log_density", drawn.log_density);
        equations.output("here", mean_action(learner.policy.apply(seen)));
        equations.output("there", mean_action(learner.policy.apply(batch.before.unwrap())));
    });
    let mean = |of: &dyn Fn(usize) -> f32| (0..8).map(|i| f64::from(of(i))).sum::<f64>() / 8.0;
    let violation = mean(&|i| after[i] - now[i] - 0.5 * batch.rewards[i]);
    let log_pi = mean(&|i| log_density[i]);
    let change = mean(&|i| (here[i] - there[i]).abs());
    let [loss, found_violation, found_log_pi, found_change] = found.map(|found| f64::from(found[0]));
    assert!((found_violation - violation).abs() < 1e-5);
    assert!((found_log_pi - log_pi).abs() < 1e-5);
    assert!(change > 1e-3 && (found_change - change).abs() < 1e-5);
    let weight = learner.multiplier.value(state).min(1.0);
    let expected = weight * violation + learner.temperature.value(state) * log_pi + 2.0 * change;
    assert!((loss - expected).abs() < 1e-4);
}

#[test]
fn the_lyapunov_gradient_agrees_with_finite_differences() {
    let (agent, batch) = small(tiny());
    let learner = &agent.learner;
    assert_gradient(&[&learner.lyapunov], &agent.state, &batch, |equations| {
        let loss = learner.lyapunov_loss(write(&agent, equations), 0.9).0;
        equations.output("loss", loss);
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
        let learner = &agent.learner;
        assert_gradient(&[&learner.policy], &agent.state, &batch, |equations| {
            let batch = write(&agent, equations);
            assert_eq!(batch.before.is_some(), smoothness > 0.0);
            equations.output("loss", learner.policy_loss(batch, &agent.config).loss);
        });
    }
}

/// The gradient of each norm alone, through the actions at both states.
#[test]
fn smoothness_gradients_agree_with_finite_differences() {
    for norm in [SmoothnessNorm::Mean, SmoothnessNorm::Frobenius] {
        let (agent, batch) = small(smooth(1.0, norm));
        let policy = &agent.learner.policy;
        assert_gradient(&[policy], &agent.state, &batch, |equations| {
            let batch = write(&agent, equations);
            let [here, there] =
                [batch.observations, batch.before.unwrap()].map(|seen| mean_action(policy.apply(seen)));
            equations.output("loss", norm.of(here - there));
        });
    }
}

#[test]
fn no_gradient_reaches_the_critic_from_the_policy() {
    let (agent, batch) = trained(smooth(1.0, SmoothnessNorm::Mean));
    let (learner, equations) = (&agent.learner, Equations::new());
    learner.update_policy(write(&agent, &equations), &agent.config);
    let (mut plan, mut state) = (Processor::new(equations.into_graph()), agent.state.clone());
    batch.write(&mut plan);
    plan.run_seeded("loss", &mut state, 3);
    let moved = |network: &Network| {
        let names = network.parameter_names().into_iter();
        names
            .map(|name| state.entries(&name) != agent.state.entries(&name))
            .collect::<Vec<_>>()
    };
    assert!(moved(&learner.policy).into_iter().all(|it| it));
    assert!(!moved(&learner.lyapunov).into_iter().any(|it| it));
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
    let (learner, state) = (&violated.learner, &violated.state);
    assert!(learner.multiplier.value(state) > 0.55);
    // The multiplier and its weight after further steps.
    let further = |excess| {
        let (equations, mut state) = (Equations::new(), state.clone());
        equations.routine("rise");
        let excess = equations.constant([1, 1], &[excess]);
        learner.multiplier.rise_with(excess, 0.05);
        equations.routine("weigh");
        equations.output("weight", learner.weight(&equations));
        let mut plan = Processor::<f32>::new(equations.into_graph());
        (0..100).for_each(|_| plan.run("rise", &mut state));
        plan.run("weigh", &mut state);
        (learner.multiplier.value(&state), plan.number("weight"))
    };
    let (held, weight) = further(1e3);
    assert!(held > 1.0);
    assert_eq!(weight, 1.0);
    assert!(further(-1e3).1 < 0.1);
}

#[test]
fn the_temperature_steers_to_the_target_entropy() {
    let after = |target| {
        let (agent, _) = trained(Config {
            target_entropy: Some(target),
            ..tiny()
        });
        agent.learner.temperature.value(&agent.state)
    };
    // An entropy of at most ln 2 is far below 5, and far above -50.
    assert!(after(5.0) > 0.0501 && after(-50.0) < 0.0499);
    let default = agent(Config {
        target_entropy: None,
        ..tiny()
    });
    assert_eq!(default.learner.target_entropy, -1.0);
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
    let multiplier = agent.learner.multiplier.value(&agent.state);
    assert_eq!(multiplier, f64::from(0.9f64.ln() as f32).exp());
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

#[test]
fn members_of_a_population_learn_as_trials_alone() {
    crate::shared::population::assert_members_learn_as_alone(
        |rng| {
            LyapunovActorCritic::new(
                CLAC,
                smooth(0.5, SmoothnessNorm::Frobenius),
                &regulator::interface(),
                rng,
            )
            .unwrap()
        },
        |agent| std::slice::from_mut(&mut agent.learning),
        |agent, rng| drop(regulator::train(agent, &mut Plants::new(rng), 13, rng)),
    );
}
