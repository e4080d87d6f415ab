//! Tests of the agent as a whole and of its equations.

use super::*;
use crate::shared::{
    bandit,
    gradient_checks::{assert_gradient, outputs},
};
use contract::random::stream;
use numerics::gamma::log_gamma_slope;
use plan::{Equations, Processor};

fn tiny() -> Config {
    Config {
        width: 16,
        batch_size: 32,
        learning_starts: 32,
        updates_per_step: 0.125,
        ..Config::default()
    }
}

fn agent(config: Config) -> DirichletSac {
    DirichletSac::new(config, &bandit::interface(), &mut stream(&["dsac"])).unwrap()
}

/// Entries of an output of equations without inputs, in `f64`.
fn computed(agent: &DirichletSac, write: impl FnOnce(&Equations) -> Expression<'_>) -> Vec<f64> {
    let equations = Equations::new();
    equations.routine("loss");
    let found = write(&equations);
    equations.output("found", found);
    let mut processor = Processor::<f64>::new(equations.into_graph());
    processor.run_seeded("loss", &mut agent.state.widened(), 3);
    processor.entries("found").to_vec()
}

#[test]
fn the_soft_target_has_the_lower_critic_and_the_entropy() {
    let mut agent = agent(Config {
        first_temperature: 0.5,
        shifted_entropy_bonus: true,
        ..tiny()
    });
    for x in [0.25, -0.5] {
        let observe = |x: f64| Observation {
            seats: vec![vec![x]],
            state: Vec::new(),
        };
        let (observation, next_observation) = (observe(0.0), observe(x));
        let (action, rewards) = (vec![vec![0.2, 0.3, 0.5]], vec![2.0]);
        let transition = Transition {
            observation,
            action,
            rewards,
            next_observation,
            end: None,
        };
        agent.replay.push_scaled(&transition, &agent.scaling);
    }
    let batch = agent.replay.draw(4, &mut stream(&["batch"]));
    let learner = &agent.learner;
    // Draws of a routine are numbered, so that the target's draw is that of the parts.
    let [target] = outputs(["target"], &agent.state, &batch, |equations| {
        let inputs = BatchInputs::new(equations, 4, agent.replay.widths());
        equations.routine("loss");
        equations.output("target", learner.soft_target(inputs, &agent.config));
    });
    let names = ["alpha", "action", "q1", "q2"];
    let [alpha, action, q1, q2] = outputs(names, &agent.state, &batch, |equations| {
        let inputs = BatchInputs::new(equations, 4, agent.replay.widths());
        equations.routine("loss");
        let alpha = learner.concentrations(inputs.next_observations);
        let action = sample(alpha).action;
        let [q1, q2] = learner.values(&learner.target_critics, inputs.next_observations, action);
        equations.output("alpha", alpha);
        equations.output("action", action);
        equations.output("q1", q1);
        equations.output("q2", q2);
    });
    for i in 0..4 {
        let row = |x: &[f32]| {
            x[3 * i..3 * i + 3]
                .iter()
                .map(|v| f64::from(*v))
                .collect::<Vec<_>>()
        };
        let log_action: Vec<f64> = row(&action).iter().map(|a| a.ln()).collect();
        let log_pi = numerics::dirichlet::log_density(&row(&alpha), &log_action);
        let expected = 2.0 + 0.99 * (f64::from(q1[i].min(q2[i])) - 0.5 * (log_pi + learner.target_entropy));
        assert!(
            (f64::from(target[i]) - expected).abs() < 1e-3,
            "{} {expected}",
            target[i]
        );
    }
}

#[test]
fn critics_see_shares_or_centred_ones() {
    let (plain, centred) = (
        agent(tiny()),
        agent(Config {
            critic_action_scaling: ActionScaling::Centred,
            ..tiny()
        }),
    );
    let q = |agent: &DirichletSac, shares: [f64; 3]| {
        computed(agent, |equations| {
            let (seen, shares) = (
                equations.constant([1, 1], &[7.0]),
                equations.constant([1, 3], &shares),
            );
            agent.learner.values(&agent.learner.target_critics, seen, shares)[0]
        })
    };
    // Both agents have the same critics, so that scaled shares passed to the plain one have the same value.
    assert_eq!(q(&centred, [0.5, 0.5, 0.0]), q(&plain, [0.5, 0.5, -1.0]));
    assert_ne!(q(&centred, [0.5, 0.5, 0.0]), q(&plain, [0.5, 0.5, 0.0]));
}

#[test]
fn the_temperature_rises_where_the_entropy_is_too_low() {
    let mut agent = agent(tiny());
    let learner = &agent.learner;
    let before = learner.temperature.value(&agent.state);
    let equations = Equations::new();
    equations.routine("steer");
    let log_density = equations.constant([1, 1], &[-learner.target_entropy + 1.0]);
    learner.steer_temperature(log_density, 3e-4);
    Processor::new(equations.into_graph()).run("steer", &mut agent.state);
    let after = learner.temperature.value(&agent.state);
    // The logarithm is an `f32` near -2.3, with a spacing of 2.4e-7.
    assert!((after / before - 3e-4f64.exp()).abs() < 3e-7);
}

/// Observations that are no batch of a replay.
const SEEN: [f64; 16] = {
    let mut seen = [0.0; 16];
    let mut at = 0;
    while at < 16 {
        seen[at] = (at as f64 + 0.5) / 8.0 - 1.0;
        at += 1;
    }
    seen
};

/// Entries of the gradient of a loss in all parameters of the policy.
fn policy_gradient(
    agent: &DirichletSac,
    loss: impl for<'e> FnOnce(Expression<'e>) -> Expression<'e>,
) -> Vec<f64> {
    computed(agent, |equations| {
        let loss = loss(equations.constant([16, 1], &SEEN));
        let wanted = parameters(&agent.learner.policy.networks(), equations);
        let gradients = equations.gradients(loss, &wanted).into_iter();
        let rows: Vec<_> = gradients
            .map(|gradient| gradient.reshape([1, gradient.n_rows() * gradient.n_columns()]))
            .collect();
        equations.join(&rows)
    })
}

/// Concentrations at [`SEEN`].
fn alphas<'e>(learner: &Learner, equations: &'e Equations) -> Expression<'e> {
    learner.concentrations(equations.constant([16, 1], &SEEN))
}

/// The loss of eq. 3.18 at draws that move with the concentrations along their known slopes `d ln g / d alpha`,
/// which finite differences see, too.
fn at_fixed_quantiles<'e>(learner: &Learner, seen: Expression<'e>, parts: [&[f64]; 3]) -> Expression<'e> {
    let [start, log_gamma, slope] = parts.map(|part| seen.equations().constant([16, 3], part));
    let alpha = learner.concentrations(seen);
    let log_action = (log_gamma + slope * (alpha - start)).log_softmax();
    let action = log_action.exp();
    learner.policy_loss(seen, alpha, Draw { action, log_action }).0
}

#[test]
fn the_policy_gradient_agrees_with_finite_differences_through_the_sample() {
    let agent = agent(Config { width: 4, ..tiny() });
    let learner = &agent.learner;
    let start = computed(&agent, |equations| alphas(learner, equations));
    let log_gamma = computed(&agent, |equations| alphas(learner, equations).log_gamma_draw());
    let slope: Vec<f64> = start
        .iter()
        .zip(&log_gamma)
        .map(|(alpha, log)| log_gamma_slope(*alpha, *log))
        .collect();
    let parts = [&start[..], &log_gamma, &slope];
    let fixed = policy_gradient(&agent, |seen| at_fixed_quantiles(learner, seen, parts));
    let drawn = policy_gradient(&agent, |seen| {
        let alpha = learner.concentrations(seen);
        learner.policy_loss(seen, alpha, sample(alpha)).0
    });
    let largest = fixed.iter().fold(0.0_f64, |largest, g| largest.max(g.abs()));
    assert!(largest > 1e-3, "{largest}");
    assert!(
        fixed
            .iter()
            .zip(&drawn)
            .all(|(a, b)| (a - b).abs() < 1e-9 * largest),
        "{fixed:?} {drawn:?}"
    );
    let batch = Batch {
        n_rows: 1,
        observations: vec![0.0],
        actions: vec![0.0; 3],
        rewards: vec![0.0],
        next_observations: vec![0.0],
        continues: vec![0.0],
    };
    assert_gradient(&learner.policy.networks(), &agent.state, &batch, |equations| {
        let _ = BatchInputs::new(equations, 1, agent.replay.widths());
        equations.routine("loss");
        let seen = equations.constant([16, 1], &SEEN);
        equations.output("loss", at_fixed_quantiles(learner, seen, parts));
    });
}

#[test]
fn the_critics_gradient_agrees_with_finite_differences() {
    for network in [NetworkKind::Dense, NetworkKind::Equivariant] {
        let interface =
            crate::shared::seat::tests::allocation(&["voltage_1", "voltage_2", "voltage_3", "power"], &[], 3);
        let config = Config {
            network,
            width: 4,
            ..tiny()
        };
        let agent = DirichletSac::new(config, &interface, &mut stream(&["critics"])).unwrap();
        let batch = Batch {
            n_rows: 2,
            observations: vec![0.1, -0.2, 0.4, 1.0, 0.5, 0.7, -0.3, 0.2],
            actions: vec![0.2, 0.3, 0.5, 0.6, 0.3, 0.1],
            rewards: vec![0.5, -1.0],
            next_observations: vec![0.3, 0.2, -0.4, 0.9, 0.1, -0.7, 0.3, 0.4],
            continues: vec![1.0, 0.0],
        };
        let learner = &agent.learner;
        assert_gradient(&of_critics(&learner.critics), &agent.state, &batch, |equations| {
            let inputs = BatchInputs::new(equations, 2, agent.replay.widths());
            equations.routine("loss");
            let target = learner.soft_target(inputs, &agent.config);
            equations.output("loss", learner.critic_loss(inputs, target));
        });
    }
}

#[test]
fn it_learns_a_bandit() {
    let config = Config {
        actor_learning_rate: 3e-3,
        critic_learning_rate: 3e-3,
        target_concentration: 100.0,
        first_temperature: 0.01,
        ..tiny()
    };
    let mut rng = stream(&["bandit"]);
    let mut agent = agent(config);
    let before = bandit::error(&mut agent, &mut rng);
    let record = bandit::train(&mut agent, 700, &mut rng);
    let after = bandit::error(&mut agent, &mut rng);
    assert!(before > 0.25 && after < 0.08, "{before} {after} {record:?}");
}

#[test]
fn a_saved_agent_continues() {
    bandit::assert_continues(|rng| build(tiny(), &bandit::interface(), rng).unwrap());
}

#[test]
fn recorded_metrics_are_declared() {
    bandit::assert_declared(&mut agent(tiny()), &metrics());
}

#[test]
fn the_exported_policy_takes_the_evaluation_actions() {
    for evaluation_action in [EvaluationAction::Mean, EvaluationAction::Mode] {
        bandit::assert_exports(&mut agent(Config {
            evaluation_action,
            ..tiny()
        }));
    }
    bandit::assert_imports(|interface, rng| build(tiny(), interface, rng).unwrap());
}

#[test]
fn a_policy_is_taken_up_by_an_agent_of_the_same_shape_and_head_only() {
    let interface =
        crate::shared::seat::tests::allocation(&["voltage_1", "voltage_2", "voltage_3", "power"], &[], 3);
    let start =
        |config: Config, name: &str| DirichletSac::new(config, &interface, &mut stream(&[name])).unwrap();
    let alike = || Config {
        network: NetworkKind::Equivariant,
        ..tiny()
    };
    let (mut one, mut two) = (start(alike(), "one"), start(alike(), "two"));
    let dir = tempfile::tempdir().unwrap();
    one.export(dir.path()).unwrap();
    assert!(two.import(dir.path()).unwrap());
    let seen = [Observation {
        seats: vec![vec![0.1, -0.2, 0.4, 1.0]],
        state: Vec::new(),
    }];
    let act = |agent: &mut DirichletSac| agent.act(&seen, Mode::Evaluate, &mut stream(&["act"])).unwrap();
    assert_eq!(act(&mut one), act(&mut two));
    let refusal = |config| start(config, "other").import(dir.path()).unwrap_err().to_string();
    assert!(
        refusal(tiny()).contains("there is no `policy.layers.0.weight`"),
        "{}",
        refusal(tiny())
    );
    assert!(refusal(Config { width: 8, ..alike() }).contains("expected"));
    let other_head = Config {
        evaluation_action: EvaluationAction::Mode,
        ..alike()
    };
    assert!(
        refusal(other_head).contains("`head` of the policy is \"dirichlet_mean\", here \"dirichlet_mode\"")
    );
}

#[test]
fn a_trial_begins_from_the_networks_of_another() {
    let mut one = agent(Config {
        first_temperature: 0.3,
        ..tiny()
    });
    bandit::train(&mut one, 5, &mut stream(&["one"]));
    let dir = tempfile::tempdir().unwrap();
    one.export(dir.path()).unwrap();
    let mut two = DirichletSac::new(tiny(), &bandit::interface(), &mut stream(&["two"])).unwrap();
    two.begin_from(dir.path()).unwrap();
    for network in one.learner.networks() {
        for name in network.parameter_names() {
            assert_eq!(one.state.entries(&name), two.state.entries(&name), "{name}");
        }
    }
    let temperature = |agent: &DirichletSac| agent.learner.temperature.value(&agent.state);
    assert_eq!(temperature(&one), temperature(&two));
    let file = TensorFile::read(&dir.path().join(NETWORKS_FILE)).unwrap();
    assert!(file.get("target_critics.Dense.second.layers.0.bias").is_ok());
}

#[test]
fn a_cap_limits_the_concentrations() {
    let agent = agent(Config {
        concentration_cap: Some(1.2),
        ..tiny()
    });
    let alpha = computed(&agent, |equations| {
        let seen = equations.constant([3, 1], &[-1.0, 0.0, 1.0]);
        agent.learner.concentrations(seen)
    });
    assert!(alpha.iter().all(|alpha| (1.0..=1.2).contains(alpha)));
}

#[test]
fn a_loss_that_is_not_finite_is_an_error() {
    let mut agent = agent(tiny());
    let mut rng = stream(&["nan"]);
    let mut transitions = bandit::decide(&mut agent, 64, &mut rng);
    transitions[0].rewards[0] = f64::NAN;
    transitions
        .iter_mut()
        .for_each(|step| step.rewards[0] *= f64::NAN);
    assert!(matches!(
        agent.learn(&transitions, &mut rng, &mut Recorder::default()),
        Err(Error::NotFinite { .. })
    ));
}

#[test]
fn members_of_a_population_learn_as_trials_alone() {
    crate::shared::population::assert_members_learn_as_alone(
        |rng| DirichletSac::new(tiny(), &bandit::interface(), rng).unwrap(),
        |agent| std::slice::from_mut(&mut agent.learning),
        |agent, rng| drop(bandit::train(agent, 5, rng)),
    );
}
