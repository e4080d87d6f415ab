//! Tests of the controller by hand and by finite differences, and of the stages on a small space.

use super::*;
use crate::shared::designs::tests::{BEST, interface, scored, search};
use numerics::parameters::{parameters, with_parameters};

fn agent(config: Config, seed: &str) -> AutoGan {
    AutoGan::new(
        config,
        &interface(),
        &mut contract::random::stream(&["autogan", seed]),
    )
    .unwrap()
}

fn quick() -> Config {
    Config {
        growth_at: vec![120],
        width: 12,
        learning_rate: 0.02,
        ..Config::default()
    }
}

#[test]
fn it_learns_the_cells_one_after_the_other() {
    let (mut agent, mut rng) = (agent(quick(), "learns"), contract::random::stream(&["search"]));
    let values = search(&mut agent, 400, &mut rng);
    // 120 designs of one cell, of which the best is worth 2, then 10 derived designs.
    assert!(values[..130].iter().all(|value| *value <= 2.0));
    assert_eq!(agent.state.stage, 1);
    assert!(agent.state.beginnings.len() <= 5 && agent.state.beginnings.iter().all(|one| one.len() == 1));
    let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
    assert!(mean(&values[110..120]) > mean(&values[..20]) + 0.3, "{values:?}");
    assert!(mean(&values[380..]) > mean(&values[130..150]) + 0.5, "{values:?}");
    assert!(scored(&mut agent, &mut rng) >= BEST - 1.0);
    assert_eq!(agent.updates().unwrap().made, 120 + 270);
}

#[test]
fn the_best_derived_designs_are_the_beginnings_of_the_next_stage() {
    let mut agent = agent(quick(), "grows");
    let tried = |first: usize, value: f64| EvaluatedDesign {
        options: vec![vec![first % 2, first % 3]],
        value,
    };
    let derived = [1.0, 5.0, 3.0, 5.5, 2.0, 4.0];
    agent.state.derived = Some(
        derived
            .iter()
            .enumerate()
            .map(|(at, value)| tried(at, *value))
            .collect(),
    );
    agent.state.derived.as_mut().unwrap().push(tried(3, 0.0));
    agent.config.kept_designs = 3;
    agent.grow(&mut contract::random::stream(&["grow"]));
    assert_eq!(agent.state.beginnings, [3, 1, 5].map(|at| tried(at, 0.0).options));
    assert_eq!((agent.state.stage, agent.state.baseline), (1, None));
}

#[test]
fn probabilities_of_all_designs_of_a_cell_add_up_to_one() {
    let controller = Controller::new(&[2, 3], 7, &mut contract::random::stream(&["sum"]));
    let mut sum = 0.0;
    for first in 0..2 {
        for second in 0..3 {
            let (log_probability, entropy) = controller.judged(&[vec![1, 2], vec![first, second]]);
            sum += values(log_probability)[0].exp();
            let entropy = values(entropy)[0];
            assert!(entropy > 0.0 && entropy < 2f32.ln() + 3f32.ln() + 1e-5);
        }
    }
    assert!((sum - 1.0).abs() < 1e-5, "{sum}");
}

#[test]
fn draws_have_the_judged_probabilities() {
    let controller = Controller::new(&[2, 3], 5, &mut contract::random::stream(&["drawn"]));
    let mut rng = contract::random::stream(&["draws"]);
    let before = vec![vec![0, 1]];
    let mut count = 0.0;
    for _ in 0..3000 {
        let taken = controller.decide(&before, &mut |probabilities| drawn(probabilities, rng.random()));
        count += f64::from(u8::from(taken == [1, 0])) / 3000.0;
    }
    let (log_probability, _) = controller.judged(&[before[0].clone(), vec![1, 0]]);
    let expected = f64::from(values(log_probability)[0].exp());
    assert!((count - expected).abs() < 0.025, "{count} {expected}");
}

#[test]
fn gradients_agree_with_finite_differences() {
    let controller = Controller::new(&[2, 3], 3, &mut contract::random::stream(&["gradients"]));
    let design = [vec![1, 0], vec![0, 2]];
    let of = |controller: &Controller| f64::from(values(controller.judged(&design).0)[0]);
    let mut loss = controller.judged(&design).0.backward();
    let found = numerics::optimizer::gradients(&controller, &mut loss);
    let all = parameters(&controller);
    for (at, parameter) in all.iter().enumerate() {
        let entry = parameter.values.len() / 2;
        let moved = |by: f32| {
            let mut changed = all.clone();
            changed[at].values[entry] += by;
            of(&with_parameters(controller.clone(), &changed).unwrap())
        };
        let expected = (moved(1e-2) - moved(-1e-2)) / 2e-2;
        let gradient = found[at].get(entry).copied().unwrap_or_default();
        assert!(
            (f64::from(gradient) - expected).abs() < 2e-4,
            "{at}: {gradient} {expected}"
        );
    }
}

#[test]
fn settings_that_contradict_each_other_are_refused() {
    let problem = |config: Config| {
        AutoGan::new(config, &interface(), &mut contract::random::stream(&[]))
            .unwrap_err()
            .to_string()
    };
    let text = problem(Config {
        growth_at: vec![90, 40],
        ..Config::default()
    });
    assert!(text.contains("`growth_at`: [90, 40] do not rise"), "{text}");
    let text = problem(Config {
        kept_designs: 11,
        ..Config::default()
    });
    assert!(text.contains("`kept_designs`: 11 are kept of 10"), "{text}");
}
