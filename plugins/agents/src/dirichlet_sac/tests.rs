use super::*;
use crate::shared::bandit;
use contract::random::stream;
use numerics::parameters::{parameters, with_parameters};

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

fn column(values: &[f32]) -> Tensor<2> {
    matrix(values.to_vec(), 1)
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
    let batch = agent.replay.sample_with_replacement(4, &mut stream(&["batch"]));
    let target = values(agent.soft_target(&batch, &mut stream(&["noise"])).unwrap());
    let alpha = agent.concentrations(&agent.policy.network().valid(), &batch.next_observations);
    let drawn = sample(alpha.clone(), &mut stream(&["noise"]));
    let (q1, q2) = agent.q_values(
        &agent.target_critics,
        &batch.next_observations,
        drawn.action.clone(),
    );
    let (q1, q2, alpha, action) = (values(q1), values(q2), values(alpha), values(drawn.action));
    for i in 0..4 {
        let row = |x: &[f32]| {
            x[3 * i..3 * i + 3]
                .iter()
                .map(|v| f64::from(*v))
                .collect::<Vec<_>>()
        };
        let log_action: Vec<f64> = row(&action).iter().map(|a| a.ln()).collect();
        let log_pi = numerics::dirichlet::log_density(&row(&alpha), &log_action);
        let expected = 2.0 + 0.99 * (f64::from(q1[i].min(q2[i])) - 0.5 * (log_pi + agent.target_entropy));
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
    let q = |agent: &DirichletSac, shares: [f32; 3]| {
        values(
            agent
                .q_values(&agent.target_critics, &column(&[7.0]), matrix(shares.to_vec(), 3))
                .0,
        )[0]
    };
    // Both agents have the same critics, so that scaled shares passed to the plain one have the same value.
    assert_eq!(q(&centred, [0.5, 0.5, 0.0]), q(&plain, [0.5, 0.5, -1.0]));
    assert_ne!(q(&centred, [0.5, 0.5, 0.0]), q(&plain, [0.5, 0.5, 0.0]));
}

#[test]
fn the_temperature_rises_where_the_entropy_is_too_low() {
    let mut agent = agent(tiny());
    let before = agent.temperature();
    agent.update_temperature(-agent.target_entropy + 1.0);
    assert!((agent.temperature() / before - 3e-4f64.exp()).abs() < 1e-9);
}

/// The loss of eq. 3.18 at draws that move with the concentrations along their known slopes `d ln g / d
/// alpha`.
fn loss_at_fixed_quantiles(agent: &DirichletSac, policy: &PolicyNetwork, observations: &Tensor<2>) -> f64 {
    let start = agent.concentrations(&agent.policy.network().valid(), observations);
    let mut rng = stream(&["fixed"]);
    let draws: Vec<_> = values(start.clone())
        .chunks(3)
        .map(|row| {
            let row: Vec<f64> = row.iter().map(|alpha| f64::from(*alpha)).collect();
            numerics::dirichlet::sample_with_gradient(&row, &mut rng)
        })
        .collect();
    #[allow(clippy::cast_possible_truncation, reason = "tensors are f32")]
    let tensor = |pick: fn(&numerics::dirichlet::Draw) -> &Vec<f64>| {
        matrix(
            draws
                .iter()
                .flat_map(|draw| pick(draw).iter().map(|x| *x as f32))
                .collect(),
            3,
        )
    };
    let alpha = agent.concentrations(policy, observations);
    let log_gamma = tensor(|draw| &draw.log_action) + tensor(|draw| &draw.slope) * (alpha.clone() - start);
    let log_action = burn::tensor::activation::log_softmax(log_gamma, 1);
    let (q1, q2) = agent.q_values(
        &agent.critics.network().valid(),
        observations,
        log_action.clone().exp(),
    );
    f64::from(mean(
        log_density(alpha, log_action) * agent.temperature() - q1.min_pair(q2),
    ))
}

#[test]
fn the_policy_gradient_agrees_with_finite_differences_through_the_sample() {
    let agent = agent(Config { width: 4, ..tiny() });
    let observations = matrix((0..16u8).map(|i| (f32::from(i) + 0.5) / 8.0 - 1.0).collect(), 1);
    let (loss, _) = agent.policy_loss(&observations, &mut stream(&["fixed"])).unwrap();
    let analytic = numerics::optimizer::gradients(agent.policy.network(), &mut loss.backward());
    let plain = agent.policy.network().valid();
    let numbers = parameters(&plain);
    for p in 0..numbers.len() {
        let at = |step: f32| {
            let mut moved = numbers.clone();
            moved[p].values[0] += step;
            loss_at_fixed_quantiles(
                &agent,
                &with_parameters(plain.clone(), &moved).unwrap(),
                &observations,
            )
        };
        let (difference, gradient) = ((at(2e-3) - at(-2e-3)) / 4e-3, f64::from(analytic[p][0]));
        assert!(
            (difference - gradient).abs() < 1e-3 + 0.01 * gradient.abs(),
            "{}: {difference} {gradient}",
            numbers[p].name
        );
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
fn a_cap_limits_the_concentrations() {
    let agent = agent(Config {
        concentration_cap: Some(1.2),
        ..tiny()
    });
    let alpha = values(agent.concentrations(&agent.policy.network().valid(), &column(&[-1.0, 0.0, 1.0])));
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
