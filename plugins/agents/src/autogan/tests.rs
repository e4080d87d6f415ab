//! Tests of the controller by hand and by finite differences, and of the stages on a small space.

use super::*;
use crate::shared::designs::tests::{BEST, interface, scored, search};
use plan::{Equations, differences::largest_error};

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
    let mut controller = Controller::new(&[2, 3], 7, 0.01, &mut contract::random::stream(&["sum"]));
    let mut sum = 0.0;
    for first in 0..2 {
        for second in 0..3 {
            let (log_probability, entropy) = controller.judge(&[vec![1, 2], vec![first, second]]);
            sum += log_probability.exp();
            assert!(entropy > 0.0 && entropy < 2f64.ln() + 3f64.ln() + 1e-5);
        }
    }
    assert!((sum - 1.0).abs() < 1e-5, "{sum}");
}

#[test]
fn draws_have_the_judged_probabilities() {
    let mut controller = Controller::new(&[2, 3], 5, 0.01, &mut contract::random::stream(&["drawn"]));
    let mut rng = contract::random::stream(&["draws"]);
    let before = vec![vec![0, 1]];
    let mut count = 0.0;
    for _ in 0..3000 {
        let taken = controller.decide(&before, &mut |probabilities| drawn(probabilities, rng.random()));
        count += f64::from(u8::from(taken == [1, 0])) / 3000.0;
    }
    let (log_probability, _) = controller.judge(&[before[0].clone(), vec![1, 0]]);
    let expected = log_probability.exp();
    assert!((count - expected).abs() < 0.025, "{count} {expected}");
}

#[test]
fn gradients_agree_with_finite_differences() {
    let controller = Controller::new(&[2, 3], 3, 0.01, &mut contract::random::stream(&["gradients"]));
    let design = [vec![1, 0], vec![0, 2]];
    let (layers, state) = controller.parts();
    let equations = Equations::new();
    let (before, taken) = layers.design(&equations, 2);
    equations.routine("judge");
    let (log_probability, entropy) = layers.judged(before, taken);
    equations.output("loss", log_probability + entropy * 0.3);
    let names: Vec<&str> = state.tensors().map(|(name, ..)| name).collect();
    assert_eq!(names.len(), 1 + 4 + 4);
    let wide = |entries: Vec<f32>| entries.into_iter().map(f64::from).collect::<Vec<f64>>();
    let (before, taken) = layers.inputs(&design);
    let inputs = [("before", wide(before)), ("taken", wide(taken))];
    let graph = equations.into_graph();
    let error = largest_error(graph, ["judge", "loss"], &names, &state.widened(), &inputs, 0);
    assert!(error < 1e-6, "{error:e}");
}

/// A design of a single choice begins with no option, so that the embedding is not moved.
#[test]
fn a_step_raises_the_probability_of_what_was_worth_more() {
    for design in [vec![vec![1]], vec![vec![0], vec![1]]] {
        let mut controller = Controller::new(&[2], 4, 0.01, &mut contract::random::stream(&["step"]));
        let embedding = controller.parts().1.entries("embedding").to_vec();
        let before = controller.judge(&design).0;
        controller.descend(&design, -2.0);
        assert!(controller.judge(&design).0 > before);
        let is_moved = controller.parts().1.entries("embedding") != embedding;
        assert_eq!(is_moved, design.len() > 1);
    }
}

/// The state of the LSTM goes from choice to choice as in the judgement of a whole design.
#[test]
fn decisions_follow_the_judgement() {
    let mut controller = Controller::new(&[2, 3], 5, 0.01, &mut contract::random::stream(&["follow"]));
    let before = vec![vec![1, 2]];
    for taken in [[0, 1], [1, 2]] {
        let mut picked = Vec::new();
        let mut options = taken.iter();
        controller.decide(&before, &mut |probabilities| {
            let option = *options.next().unwrap();
            picked.push(f64::from(probabilities[option]));
            option
        });
        let (log_probability, _) = controller.judge(&[before[0].clone(), taken.to_vec()]);
        let product: f64 = picked.iter().product();
        assert!((product - log_probability.exp()).abs() < 1e-6, "{picked:?}");
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

#[test]
fn members_of_a_population_learn_as_trials_alone() {
    crate::shared::population::assert_members_learn_as_alone(
        |rng| AutoGan::new(quick(), &interface(), rng).unwrap(),
        |agent| std::slice::from_mut(agent.controller.learning()),
        |agent, rng| drop(search(agent, 10, rng)),
    );
}
