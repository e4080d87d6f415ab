//! Tests of the agent as a whole and of its equations.

use super::exploration::Noise;
use super::*;
use crate::shared::{coordination as game, joint::ObservationScope};
use contract::random::stream;
use numerics::{network::Activation, optimizer::gradients};

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
    let batch = agent.replay.sample_distinct(8, &mut stream(&["batch"]));
    (agent, batch)
}

#[test]
fn the_target_uses_all_target_networks() {
    let (agent, mut batch) = trained(tiny());
    batch.continues = batch.continues.ones_like();
    let act = |seat: usize| {
        let seen = columns(&batch.next_observations, seat..seat + 1);
        agent.learners[seat].target_policy.forward(seen).tanh()
    };
    let next = vec![batch.next_observations.clone(), act(0), act(1)];
    let q = values(agent.learners[1].target_critic.forward(Tensor::cat(next, 1)));
    let (y, r) = (values(agent.target(1, &batch)), values(batch.rewards));
    assert!((0..8).all(|i| (y[i] - (r[2 * i + 1] + 0.95 * q[i])).abs() < 1e-6));
}

#[test]
fn the_policy_gradient_passes_the_critic_of_the_joint_action() {
    for policy_sight in [ObservationScope::Own, ObservationScope::Joint] {
        let config = Config {
            width: 5,
            activation: Activation::Tanh,
            logit_penalty: 0.1,
            policy_sight,
            ..tiny()
        };
        let (agent, batch) = trained(config);
        game::assert_gradient(agent.learners[1].policy.network(), |policy| {
            let (loss, penalty) = agent.policy_loss(1, policy, &batch);
            loss + penalty
        });
    }
}

#[test]
fn no_gradient_reaches_the_critic_or_the_other_policy() {
    let (agent, batch) = trained(tiny());
    let (loss, _) = agent.policy_loss(0, agent.learners[0].policy.network(), &batch);
    let mut reached = loss.backward();
    assert!(
        gradients(agent.learners[0].policy.network(), &mut reached)
            .iter()
            .all(|g| !g.is_empty())
    );
    assert!(
        gradients(agent.learners[0].critic.network(), &mut reached)
            .concat()
            .is_empty()
    );
    assert!(
        gradients(agent.learners[1].policy.network(), &mut reached)
            .concat()
            .is_empty()
    );
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

#[test]
fn it_learns_to_coordinate() {
    let mut rng = stream(&["coordination"]);
    let mut agent = agent(tiny());
    let before = game::score(&mut agent, &mut rng);
    game::train(&mut agent, 400, &mut rng);
    let after = game::score(&mut agent, &mut rng);
    assert!(before < -0.05 && after > -0.02, "{before} {after}");
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
