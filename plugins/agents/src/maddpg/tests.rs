//! Tests of the agent as a whole and of its equations.

use super::exploration::Noise;
use super::*;
use crate::shared::{
    coordination as game,
    gradient_checks::{assert_gradient, outputs},
    joint::ObservationScope,
};
use contract::random::stream;
use numerics::activation::Activation;

fn tiny() -> Config {
    Config {
        width: 16,
        batch_size: 32,
        learning_starts: 32,
        updates_per_step: 0.25,
        exploration_steps: 2_000,
        ..Config::default()
    }
}

fn agent(config: Config) -> Maddpg {
    Maddpg::new(config, &game::game(), &mut stream(&["maddpg"])).unwrap()
}

fn trained(config: Config) -> (Maddpg, Batch) {
    let mut agent = agent(config);
    game::train(&mut agent, 6, &mut stream(&["some"]));
    let batch = agent.replay.draw_distinct(8, &mut stream(&["batch"]));
    (agent, batch)
}

/// Writes a routine `loss` for a batch of 8.
fn write<'e>(agent: &Maddpg, equations: &'e Equations) -> BatchInputs<'e> {
    let batch = BatchInputs::new(equations, 8, agent.replay.widths());
    equations.routine("loss");
    batch
}

#[test]
fn the_target_uses_all_target_networks() {
    let (agent, mut batch) = trained(tiny());
    batch.continues.fill(1.0);
    let learner = &agent.learner;
    let [y, q] = outputs(["target", "next_value"], &agent.state, &batch, |equations| {
        let inputs = write(&agent, equations);
        equations.output("target", learner.target(1, inputs, 0.95));
        let next = inputs.next_observations;
        let act = |seat: usize| {
            let seen = next.columns(seat..seat + 1);
            learner.seats[seat].target_policy.apply(seen).tanh()
        };
        let next = equations.join(&[next, act(0), act(1)]);
        equations.output("next_value", learner.seats[1].target_critic.apply(next));
    });
    let r = &batch.rewards;
    assert!((0..8).all(|i| (y[i] - (r[2 * i + 1] + 0.95 * q[i])).abs() < 1e-6));
    let [last] = outputs(
        ["target"],
        &agent.state,
        &Batch {
            continues: vec![0.0; 8],
            ..batch.clone()
        },
        |equations| {
            equations.output("target", learner.target(1, write(&agent, equations), 0.95));
        },
    );
    assert!((0..8).all(|i| last[i] == r[2 * i + 1]), "nothing follows");
}

fn smooth() -> Config {
    Config {
        width: 5,
        activation: Activation::Tanh,
        logit_penalty: 0.1,
        ..tiny()
    }
}

#[test]
fn the_policy_gradient_passes_the_critic_of_the_joint_action() {
    for policy_sight in [ObservationScope::Own, ObservationScope::Joint] {
        let (agent, batch) = trained(Config {
            policy_sight,
            ..smooth()
        });
        let learner = &agent.learner;
        assert_gradient(&[&learner.seats[1].policy], &agent.state, &batch, |equations| {
            let (loss, penalty) = learner.policy_loss(1, write(&agent, equations));
            equations.output("loss", loss + penalty * agent.config.logit_penalty);
        });
    }
}

#[test]
fn the_critics_gradient_agrees_with_finite_differences() {
    let (agent, batch) = trained(smooth());
    assert_gradient(
        &[&agent.learner.seats[1].critic],
        &agent.state,
        &batch,
        |equations| {
            let loss = agent.learner.critic_loss(1, write(&agent, equations), 0.95);
            equations.output("loss", loss);
        },
    );
}

/// A step of the policy alone: the critic's learning rate is 0.
#[test]
fn no_gradient_reaches_the_critic_or_the_other_policy() {
    let (mut agent, batch) = trained(tiny());
    agent.state.set_number("critic_learning_rate", 0.0);
    let before = agent.state.clone();
    let plan = agent.learning.of_rows(8, |equations| {
        let inputs = BatchInputs::new(equations, 8, agent.replay.widths());
        agent.learner.update(inputs, &agent.config);
    });
    batch.write(plan);
    plan.run("seat_0.update", &mut agent.state);
    let is_moment = |name: &str| name.ends_with(".first") || name.ends_with(".second");
    let parameters = before.tensors().filter(|(name, ..)| !is_moment(name));
    for (name, _, entries) in parameters {
        let has_moved = agent.state.entries(name) != entries;
        assert_eq!(has_moved, name.starts_with("seat_0.policy."), "{name}");
    }
}

#[test]
fn noise_declines_and_is_absent_in_evaluation() {
    let config = Config {
        exploration_steps: 100,
        ..Config::default()
    };
    let at = |step| config.exploration_sd_at(step);
    assert!((at(0) - 0.5).abs() < 1e-12 && (at(50) - 0.3).abs() < 1e-12 && (at(500) - 0.1).abs() < 1e-12);
    assert_eq!(
        Config {
            exploration_steps: 0,
            ..config
        }
        .exploration_sd_at(0),
        0.1
    );
    let mut agent = agent(tiny());
    let observation = [Observation {
        seats: vec![vec![0.3]; 2],
        state: Vec::new(),
    }];
    let mut act = |mode| agent.act(&observation, mode, &mut stream(&["noise"])).unwrap();
    let (explored, scored) = (act(Mode::Train), act(Mode::Evaluate));
    assert_ne!(explored, scored);
    assert_eq!(scored, act(Mode::Evaluate));
}

/// Single starts end between -0.027 and -0.009, so that one says little.
#[test]
fn it_learns_to_coordinate_from_twelve_starts_in_the_mean() {
    let scores = |start: u32| {
        let name = start.to_string();
        let mut rng = stream(&["coordination", &name]);
        let mut agent = Maddpg::new(tiny(), &game::game(), &mut stream(&["maddpg", &name])).unwrap();
        let before = game::score(&mut agent, &mut rng);
        game::train(&mut agent, 400, &mut rng);
        [before, game::score(&mut agent, &mut rng)]
    };
    let all: Vec<[f64; 2]> = (0..12).map(scores).collect();
    let mean = |at: usize| all.iter().map(|scores| scores[at]).sum::<f64>() / 12.0;
    assert!(all.iter().all(|[before, _]| *before < -0.05), "{all:?}");
    assert!(mean(1) > -0.02, "{all:?}");
}

#[test]
fn contradictions_are_named() {
    let problem = |config: Config| {
        Maddpg::new(config, &game::game(), &mut stream(&["x"]))
            .unwrap_err()
            .to_string()
    };
    assert!(
        problem(Config {
            replay_capacity: 9,
            ..tiny()
        })
        .contains("`batch_size`")
    );
    assert!(
        problem(Config {
            final_exploration_sd: 0.9,
            ..tiny()
        })
        .contains("0.9 is above `exploration_sd`, 0.5")
    );
    let preset = <Config as contract::Config>::presets();
    assert!(preset.iter().all(|p| {
        serde_json::from_value::<Config>(p.values.clone())
            .unwrap()
            .check()
            .is_ok()
    }));
    let allocation = crate::shared::bandit::interface();
    assert!(matches!(
        Maddpg::new(tiny(), &allocation, &mut stream(&["x"])),
        Err(Error::Mismatch { .. })
    ));
}

#[test]
fn a_saved_agent_continues() {
    for exploration_noise in [Noise::Gaussian, Noise::OrnsteinUhlenbeck] {
        let config = Config {
            reward_normalisation: true,
            exploration_noise,
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
            policy_sight: ObservationScope::Joint,
            ..tiny()
        })
        .0,
        0.3,
        2,
    );
}

#[test]
fn members_of_a_population_learn_as_trials_alone() {
    crate::shared::population::assert_members_learn_as_alone(
        |rng| Maddpg::new(tiny(), &game::game(), rng).unwrap(),
        |agent| std::slice::from_mut(&mut agent.learning),
        |agent, rng| drop(game::train(agent, 5, rng)),
    );
}
