//! Tests of the agent as a whole and of its equations.

use super::*;
use crate::shared::{coordination as game, joint::ObservationScope};
use contract::random::stream;
use numerics::network::Activation;

fn tiny() -> Config {
    Config {
        actor_learning_rate: 3e-3,
        critic_learning_rate: 1e-2,
        width: 24,
        batch_size: 32,
        learning_starts: 32,
        updates_per_step: 0.25,
        kernel_particles: 12,
        moved_particles: 6,
        final_temperature: 0.02,
        excess_temperature: 1.0,
        temperature_decline: 5e-3,
        ..Config::default()
    }
}

fn agent(config: Config) -> Masql {
    Masql::new(config, &game::game(), &mut stream(&["masql"])).unwrap()
}

fn trained(config: Config) -> (Masql, Batch) {
    let mut agent = agent(config);
    game::train(&mut agent, 6, &mut stream(&["some"]));
    let batch = agent.replay.sample_distinct(8, &mut stream(&["batch"]));
    (agent, batch)
}

#[test]
fn the_soft_target_by_hand() {
    let (agent, mut batch) = trained(Config {
        value_particles: 3,
        ..tiny()
    });
    batch.continues = batch.continues.ones_like();
    let y = values(agent.soft_target(1, &batch, &mut stream(&["noise"])));
    let particles = values(uniform(24, 2, &mut stream(&["noise"])));
    let (seen, rewards) = (values(batch.next_observations), values(batch.rewards));
    let alpha = agent.temperature();
    for i in 0..8 {
        let q = |k: usize| {
            let at = 3 * i + k;
            let input = matrix(vec![seen[2 * i + 1], particles[2 * at], particles[2 * at + 1]], 3);
            f64::from(values(agent.learners[1].target_critic.forward(input))[0])
        };
        let mean = (0..3).map(|k| (q(k) / alpha).exp()).sum::<f64>() / 3.0;
        let soft_value = alpha * (mean.ln() + 2.0 * 2f64.ln());
        assert!((f64::from(y[i]) - (f64::from(rewards[2 * i + 1]) + 0.95 * soft_value)).abs() < 1e-4);
    }
}

#[test]
fn sums_of_exponentials_do_not_overflow() {
    let got = values(log_mean_exp(matrix(
        vec![1e4, 1e4, -1e4, -1e4, 0.0, 3f32.ln()],
        2,
    )));
    assert!(
        [1e4, -1e4, 2f32.ln()]
            .iter()
            .zip(&got)
            .all(|(a, b)| (a - b).abs() < 1e-6),
        "{got:?}"
    );
}

#[test]
fn scores_agree_with_finite_differences() {
    let (agent, batch) = trained(Config {
        activation: Activation::Tanh,
        sight: ObservationScope::Joint,
        ..tiny()
    });
    let actions = vec![0.3f32, -0.6, 0.9, 0.1];
    let seen = columns(&batch.observations, 0..2).slice([0..2, 0..2]);
    let (scores, _) = agent.scores(0, seen.clone(), &matrix(actions.clone(), 2));
    let scores = values(scores);
    let log_density = |i: usize, step: f64| {
        let mut moved: Vec<f32> = actions.clone();
        moved[i] += step as f32;
        let q = value(
            &agent.learners[0].critic.network().valid(),
            seen.clone(),
            matrix(moved.clone(), 2),
        );
        let face = |a: &f32| (1.0 - f64::from(*a).powi(2) + 1e-6).ln();
        values(q).iter().map(|q| f64::from(*q)).sum::<f64>() / agent.temperature()
            + moved.iter().map(face).sum::<f64>()
    };
    for (i, score) in scores.iter().enumerate() {
        let slope = (log_density(i, 5e-3) - log_density(i, -5e-3)) / 1e-2;
        assert!(
            (f64::from(*score) - slope).abs() < 0.02 * (1.0 + slope.abs()),
            "{score} {slope}"
        );
    }
}

#[test]
fn parameters_follow_the_moved_particles_along_the_direction() {
    let (agent, batch) = trained(Config {
        activation: Activation::Tanh,
        width: 4,
        ..tiny()
    });
    let (seen, sampler) = (
        agent.seen(0, &batch.observations),
        agent.learners[0].sampler.network(),
    );
    let held = agent.drawn(&sampler.valid(), &seen, 6, &mut stream(&["held"]));
    let draw_moved = |sampler: &Mlp| agent.drawn(sampler, &seen, 6, &mut stream(&["moved"]));
    let moved = draw_moved(sampler);
    assert!(!held.is_autodiff() && moved.is_autodiff());
    let (direction, _) = agent.direction(0, &seen, &held, &moved);
    // Held particles and direction are constants: finite differences of the moved ones alone give the
    // gradient.
    let gradient = |sampler: &Mlp| {
        (draw_moved(sampler) * matrix(direction.direction.clone(), 2))
            .mean()
            .neg()
    };
    game::assert_gradient(sampler, gradient);
}

#[test]
fn the_direction_is_that_of_each_row_by_hand() {
    let (agent, batch) = trained(Config {
        kernel_particles: 3,
        moved_particles: 1,
        ..tiny()
    });
    let (seen, sampler) = (
        agent.seen(0, &batch.observations),
        agent.learners[0].sampler.network(),
    );
    let (held, moved) = (
        agent.drawn(&sampler.valid(), &seen, 2, &mut stream(&["held"])),
        agent.drawn(sampler, &seen, 1, &mut stream(&["moved"])),
    );
    let (scores, _) = agent.scores(0, repeat_rows(&seen, 2), &held);
    let (x, s, y) = (values(held.clone()), values(scores), values(moved.clone()));
    let direction = agent.direction(0, &seen, &held, &moved).0.direction;
    for row in 0..8 {
        let at = |all: &[f32], i: usize, e: usize| f64::from(all[4 * row + 2 * i + e]);
        let to = |e: usize| f64::from(y[2 * row + e]);
        let square = |i: usize| (at(&x, i, 0) - to(0)).powi(2) + (at(&x, i, 1) - to(1)).powi(2);
        let h = (square(0).min(square(1)) / 2f64.ln()).max(1e-3);
        for e in 0..2 {
            let term = |i: usize| (-square(i) / h).exp() * (at(&s, i, e) - 2.0 * (at(&x, i, e) - to(e)) / h);
            let phi = (term(0) + term(1)) / 2.0;
            assert!((f64::from(direction[2 * row + e]) - phi).abs() < 1e-4 * (1.0 + phi.abs()));
        }
    }
}

#[test]
fn the_evaluation_action_is_the_best_of_the_draws() {
    let (agent, batch) = trained(tiny());
    let seen = agent.seen(0, &batch.observations);
    let sampler = agent.learners[0].sampler.network().valid();
    let best = agent.best_drawn(0, &sampler, &seen, &mut stream(&["best"]));
    let all = agent.drawn(&sampler, &seen, 16, &mut stream(&["best"]));
    let critic = agent.learners[0].critic.network().valid();
    let (best, all) = (
        values(value(&critic, seen.clone(), best)),
        values(value(&critic, repeat_rows(&seen, 16), all)),
    );
    for (best, all) in best.iter().zip(all.chunks(16)) {
        assert!((best - all.iter().copied().fold(f32::NEG_INFINITY, f32::max)).abs() < 1e-6);
    }
}

#[test]
fn it_learns_to_coordinate() {
    let mut rng = stream(&["coordination"]);
    let mut agent = agent(tiny());
    let before = game::score(&mut agent, &mut rng);
    game::train(&mut agent, 300, &mut rng);
    let after = game::score(&mut agent, &mut rng);
    assert!(before < -0.2 && after > -0.05, "{before} {after}");
}

#[test]
fn spaces_that_do_not_fit_are_refused() {
    let allocation = crate::shared::bandit::interface();
    assert!(matches!(
        Masql::new(tiny(), &allocation, &mut stream(&["x"])),
        Err(Error::Mismatch { .. })
    ));
}

#[test]
fn a_saved_agent_continues() {
    for evaluation_action in [EvaluationAction::BestOfDraws, EvaluationAction::Draw] {
        let config = Config {
            reward_normalisation: true,
            target_period: 3,
            evaluation_action,
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
fn the_exported_sampler_draws_as_the_agent() {
    let (agent, _) = trained(tiny());
    let dir = tempfile::tempdir().unwrap();
    assert!(agent.export(dir.path()).unwrap());
    let sampler = agent.learners[1].sampler.network().valid();
    let drawn = values(agent.drawn(&sampler, &matrix(vec![0.3], 1), 1, &mut stream(&["xi"])));
    let latent = values(normal(1, 2, &mut stream(&["xi"])));
    let exported = Policy::read(&dir.path().join("seat_1")).unwrap();
    let again = exported.act(&[0.3, f64::from(latent[0]), f64::from(latent[1])]);
    assert!(
        drawn
            .iter()
            .zip(&again)
            .all(|(a, b)| (f64::from(*a) - b).abs() < 1e-6)
    );
}
