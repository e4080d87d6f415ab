//! Tests of the agent as a whole and of its equations.

use super::*;
use crate::shared::{
    batch::Batch,
    coordination as game,
    gradient_checks::{assert_gradient, outputs},
    soft_learner::joined,
};
use contract::random::stream;
use numerics::{
    activation::Activation,
    equations::network::{Network, lower},
};
use plan::Processor;

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

/// An agent after some updates, and a batch of its transitions.
fn trained(config: Config) -> (IndependentSac, Batch) {
    let mut agent = agent(config);
    game::train(&mut agent, 6, &mut stream(&["some"]));
    let batch = agent.replay.draw_distinct(8, &mut stream(&["batch"]));
    (agent, batch)
}

/// Begins a routine `loss` for a batch of 8, of which seat 1 reads its part.
fn write<'e>(agent: &IndependentSac, equations: &'e Equations) -> BatchInputs<'e> {
    let batch = BatchInputs::new(equations, 8, agent.replay.widths());
    equations.routine("loss");
    agent.seats.part(1, batch)
}

#[test]
fn a_seat_reads_its_own_part() {
    let read = |config| {
        let (agent, batch) = trained(config);
        let parts = outputs(
            ["seen", "next", "done", "earned"],
            &agent.state,
            &batch,
            |equations| {
                let own = write(&agent, equations);
                equations.output("seen", own.observations);
                equations.output("next", own.next_observations);
                equations.output("done", own.actions);
                equations.output("earned", own.rewards);
            },
        );
        (parts, batch)
    };
    let second = |joint: &[f32]| joint.iter().skip(1).step_by(2).copied().collect::<Vec<_>>();
    let ([seen, next, actions, rewards], batch) = read(tiny());
    assert_eq!(seen, second(&batch.observations));
    assert_eq!(next, second(&batch.next_observations));
    assert_eq!(actions, second(&batch.actions));
    assert_eq!(rewards, second(&batch.rewards));
    let ([seen, ..], batch) = read(Config {
        sight: ObservationScope::Joint,
        ..tiny()
    });
    assert_eq!(seen, batch.observations);
}

#[test]
fn the_soft_target_by_hand() {
    let (agent, mut batch) = trained(tiny());
    let learner = &agent.seats.learners[1];
    batch.continues.fill(1.0);
    // Draws of a routine are numbered, so that the target's draw is that of `next`.
    let [y] = outputs(["target"], &agent.state, &batch, |equations| {
        equations.output("target", learner.soft_target(write(&agent, equations)));
    });
    let names = ["lower", "log_pi", "earned"];
    let [q, log_pi, r] = outputs(names, &agent.state, &batch, |equations| {
        let own = write(&agent, equations);
        let next = learner.draw(own.next_observations);
        let seen = joined(own.next_observations, next.action);
        equations.output("lower", lower(&learner.target_critics, seen));
        equations.output("log_pi", next.log_density);
        equations.output("earned", own.rewards);
    });
    let alpha = learner.temperature.value(&agent.state) as f32;
    assert!((0..8).all(|i| (y[i] - (r[i] + 0.95 * (q[i] - alpha * log_pi[i]))).abs() < 1e-5));
}

#[test]
fn the_gradients_agree_with_finite_differences() {
    let (agent, batch) = trained(Config {
        width: 5,
        activation: Activation::Tanh,
        ..tiny()
    });
    let learner = &agent.seats.learners[1];
    assert_gradient(&[&learner.policy], &agent.state, &batch, |equations| {
        let loss = learner.policy_loss(write(&agent, equations)).0;
        equations.output("loss", loss);
    });
    let [first, second] = &learner.critics;
    assert_gradient(&[first, second], &agent.state, &batch, |equations| {
        let own = write(&agent, equations);
        let loss = learner.critic_loss(own, learner.soft_target(own));
        equations.output("loss", loss);
    });
}

/// Whether each parameter of a network differs between two states.
fn changes(network: &Network, before: &State<f32>, after: &State<f32>) -> Vec<bool> {
    let names = network.parameter_names();
    let differs = |name: &String| before.entries(name) != after.entries(name);
    names.iter().map(differs).collect()
}

#[test]
fn a_step_of_the_policy_reaches_no_critic_and_no_other_seat() {
    let (agent, batch) = trained(Config {
        critic_learning_rate: 0.0,
        ..tiny()
    });
    let (learners, mut after) = (&agent.seats.learners, agent.state.clone());
    let equations = Equations::new();
    let all = BatchInputs::new(&equations, 8, agent.replay.widths());
    agent.seats.update(1, all);
    let mut processor = Processor::new(equations.into_graph());
    batch.write(&mut processor);
    processor.run_seeded("update", &mut after, 3);
    let changed = |network| changes(network, &agent.state, &after);
    assert!(changed(&learners[1].policy).iter().all(|changed| *changed));
    let [own, other] = [1, 0].map(|seat| &learners[seat]);
    let still = own.critics.iter().chain(&other.critics).chain([&other.policy]);
    assert!(still.flat_map(changed).all(|changed| !changed));
}

#[test]
fn a_fixed_temperature_stays_and_an_automatic_one_moves() {
    let (fixed, _) = trained(Config {
        temperature: Temperature::Fixed,
        target_entropy: None,
        ..tiny()
    });
    let temperature = |agent: &IndependentSac| agent.seats.learners[0].temperature.value(&agent.state);
    assert!((temperature(&fixed) - 0.005).abs() < 1e-9);
    let mut automatic = agent(Config {
        temperature_learning_rate: 0.1,
        ..tiny()
    });
    let before = temperature(&automatic);
    let mut update = |log_density: f64| {
        let equations = Equations::new();
        equations.routine("steer");
        let log_density = equations.constant([1, 1], &[log_density]);
        automatic.seats.learners[0].steer_temperature(log_density);
        Processor::new(equations.into_graph()).run("steer", &mut automatic.state);
        temperature(&automatic)
    };
    // An entropy of 1 is above the target of -2, one of -3 is below it.
    assert!(update(-1.0) < before);
    let after = (0..20).map(|_| update(3.0)).last();
    assert!(after.unwrap() > before);
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

#[test]
fn members_of_a_population_learn_as_trials_alone() {
    crate::shared::population::assert_members_learn_as_alone(
        |rng| IndependentSac::new(tiny(), &game::game(), rng).unwrap(),
        |agent| &mut agent.learning,
        |agent, rng| drop(game::train(agent, 5, rng)),
    );
}
