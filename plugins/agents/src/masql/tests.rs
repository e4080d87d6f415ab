//! Tests of the agent as a whole and of its equations.

use super::seat::{log_mean_exp, value};
use super::*;
use crate::shared::{
    coordination as game,
    gradient_checks::{assert_gradient, outputs},
    joint::ObservationScope,
};
use contract::random::stream;
use numerics::activation::Activation;
use plan::{Equations, Processor};

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
    let batch = agent.replay.draw_distinct(8, &mut stream(&["batch"]));
    (agent, batch)
}

/// Writes a routine `loss` for a batch of 8, with the temperature of the agent.
fn write<'e>(agent: &Masql, equations: &'e Equations) -> (BatchInputs<'e>, Expression<'e>) {
    let batch = BatchInputs::new(equations, 8, agent.replay.widths());
    equations.routine("loss");
    (batch, equations.constant([1, 1], &[agent.temperature()]))
}

#[test]
fn the_soft_target_by_hand() {
    let (agent, mut batch) = trained(Config {
        value_particles: 3,
        ..tiny()
    });
    batch.continues.fill(1.0);
    // Draws of a routine are numbered, so that the target's draw is that of `q`.
    let [y] = outputs(["y"], &agent.state, &batch, |equations| {
        let (inputs, temperature) = write(&agent, equations);
        equations.output(
            "y",
            agent.learner.soft_target(1, inputs, temperature, &agent.config),
        );
    });
    let [q] = outputs(["q"], &agent.state, &batch, |equations| {
        let seen = write(&agent, equations).0.next_observations.columns(1..2);
        let particles = equations.uniform([24, 2]) * 2.0 - 1.0;
        let critic = &agent.learner.seats[1].target_critic;
        equations.output("q", value(critic, seen.repeat_rows(3), particles));
    });
    let alpha = agent.temperature();
    for i in 0..8 {
        let q = |k: usize| f64::from(q[3 * i + k]);
        let mean = (0..3).map(|k| (q(k) / alpha).exp()).sum::<f64>() / 3.0;
        let soft_value = alpha * (mean.ln() + 2.0 * 2f64.ln());
        let reward = f64::from(batch.rewards[2 * i + 1]);
        assert!((f64::from(y[i]) - (reward + 0.95 * soft_value)).abs() < 1e-4);
    }
}

#[test]
fn sums_of_exponentials_do_not_overflow() {
    let equations = Equations::new();
    let x = equations.constant([3, 2], &[1e4, 1e4, -1e4, -1e4, 0.0, 3f64.ln()]);
    equations.routine("loss");
    equations.output("y", log_mean_exp(x));
    let mut processor = Processor::<f32>::new(equations.into_graph());
    processor.run("loss", &mut State::default());
    let got = processor.entries("y");
    assert!(
        [1e4, -1e4, 2f32.ln()]
            .iter()
            .zip(got)
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
    let equations = Equations::new();
    let seen: Vec<f64> = batch.observations[..4].iter().map(|x| f64::from(*x)).collect();
    let seen = equations.constant([2, 2], &seen);
    let actions = equations.input("actions", [2, 2]);
    equations.routine("loss");
    let temperature = equations.constant([1, 1], &[agent.temperature()]);
    let seat = &agent.learner.seats[0];
    // A gradient may be the value of another name.
    equations.output("scores", seat.scores(seen, actions, temperature).0 * 1.0);
    equations.output("q", value(&seat.critic, seen, actions));
    let mut processor = Processor::<f64>::new(equations.into_graph());
    let mut state = agent.state.widened();
    let mut at = |actions: &[f64]| {
        processor.write("actions", actions);
        processor.run("loss", &mut state);
        let face = |a: &f64| (1.0 - a.powi(2) + 1e-6).ln();
        let q = processor.entries("q").iter().sum::<f64>();
        let log_density = q / agent.temperature() + actions.iter().map(face).sum::<f64>();
        (log_density, processor.entries("scores").to_vec())
    };
    let actions = [0.3, -0.6, 0.9, 0.1];
    for (i, score) in at(&actions).1.into_iter().enumerate() {
        let mut moved = |step: f64| {
            let mut moved = actions;
            moved[i] += step;
            at(&moved).0
        };
        let slope = (moved(1e-5) - moved(-1e-5)) / 2e-5;
        assert!(
            (score - slope).abs() < 1e-6 * (1.0 + slope.abs()),
            "{score} {slope}"
        );
    }
}

/// Held particles and direction are constants: the moved ones alone give the gradient.
#[test]
fn parameters_follow_the_moved_particles_along_the_direction() {
    let (agent, batch) = trained(Config {
        activation: Activation::Tanh,
        width: 4,
        ..tiny()
    });
    let seat = &agent.learner.seats[0];
    let outputs_with_slopes = |loss: &dyn for<'e> Fn(&'e Equations) -> [Expression<'e>; 2]| {
        outputs(["direction", "slopes"], &agent.state, &batch, |equations| {
            let [loss, direction] = loss(equations);
            equations.output("direction", direction * 1.0);
            let slopes = equations.gradients(loss, &seat.sampler.parameters(equations));
            let rows = slopes
                .iter()
                .map(|slope| slope.reshape([1, slope.n_rows() * slope.n_columns()]));
            equations.output("slopes", equations.join(&rows.collect::<Vec<_>>()));
        })
    };
    let [direction, slopes] = outputs_with_slopes(&|equations| {
        let (inputs, temperature) = write(&agent, equations);
        let movement = seat.movement(inputs.observations, temperature, &agent.config);
        [movement.loss(), movement.direction]
    });
    let direction: Vec<f64> = direction.iter().map(|x| f64::from(*x)).collect();
    // The same draws, numbered as those of the sampler's loss.
    fn of_moved<'e>(agent: &Masql, equations: &'e Equations, direction: &[f64]) -> [Expression<'e>; 2] {
        let seat = &agent.learner.seats[0];
        let seen = seat.seen(write(agent, equations).0.observations);
        let _held = seat.drawn(seen, 6);
        let direction = equations.constant([48, 2], direction);
        [-(seat.drawn(seen, 6) * direction).mean(), direction]
    }
    let [_, expected] = outputs_with_slopes(&|equations| of_moved(&agent, equations, &direction));
    let difference = |(a, b): (&f32, &f32)| (a - b).abs() < 1e-6 * (1.0 + b.abs());
    assert!(
        slopes.iter().zip(&expected).all(difference),
        "{slopes:?} {expected:?}"
    );
    assert_gradient(&[&seat.sampler], &agent.state, &batch, |equations| {
        equations.output("loss", of_moved(&agent, equations, &direction)[0]);
    });
}

#[test]
fn the_direction_is_that_of_each_row_by_hand() {
    let (agent, batch) = trained(Config {
        kernel_particles: 3,
        moved_particles: 1,
        ..tiny()
    });
    let seat = &agent.learner.seats[0];
    let [direction] = outputs(["direction"], &agent.state, &batch, |equations| {
        let (inputs, temperature) = write(&agent, equations);
        let movement = seat.movement(inputs.observations, temperature, &agent.config);
        equations.output("direction", movement.direction);
    });
    let [x, s, y] = outputs(["held", "scores", "moved"], &agent.state, &batch, |equations| {
        let (inputs, temperature) = write(&agent, equations);
        let seen = seat.seen(inputs.observations);
        let (held, moved) = (seat.drawn(seen, 2), seat.drawn(seen, 1));
        let (scores, _) = seat.scores(seen.repeat_rows(2), held, temperature);
        equations.output("held", held);
        equations.output("scores", scores * 1.0);
        equations.output("moved", moved);
    });
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
    let seat = &agent.learner.seats[0];
    let values = |n_per_row: usize, draw: &dyn for<'e> Fn(Expression<'e>) -> Expression<'e>| {
        let [q] = outputs(["q"], &agent.state, &batch, |equations| {
            let seen = seat.seen(write(&agent, equations).0.observations);
            equations.output("q", value(&seat.critic, seen.repeat_rows(n_per_row), draw(seen)));
        });
        q
    };
    let best = values(1, &|seen| seat.best_drawn(seen, 16));
    let all = values(16, &|seen| seat.drawn(seen, 16));
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
    let seat = &agent.learner.seats[1];
    let of_draws = |draw: &dyn for<'e> Fn(&'e Equations) -> Expression<'e>| {
        let equations = Equations::new();
        equations.routine("draw");
        equations.output("drawn", draw(&equations));
        let mut processor = Processor::<f32>::new(equations.into_graph());
        processor.run_seeded("draw", &mut agent.state.clone(), 5);
        processor.entries("drawn").to_vec()
    };
    let drawn = of_draws(&|equations| seat.drawn(equations.constant([1, 1], &[0.3]), 1));
    let latent = of_draws(&|equations| equations.normal([1, 2]));
    let exported = Policy::read(&dir.path().join("seat_1")).unwrap();
    let again = exported.act(&[0.3, f64::from(latent[0]), f64::from(latent[1])]);
    assert!(
        drawn
            .iter()
            .zip(&again)
            .all(|(a, b)| (f64::from(*a) - b).abs() < 1e-6)
    );
}

#[test]
fn members_of_a_population_learn_as_trials_alone() {
    crate::shared::population::assert_members_learn_as_alone(
        |rng| Masql::new(tiny(), &game::game(), rng).unwrap(),
        |agent| std::slice::from_mut(&mut agent.learning),
        |agent, rng| drop(game::train(agent, 5, rng)),
    );
}
