//! The environment as a whole, also compared with trajectories of imprl
//! (`tests/fixtures/component_replacement`).

use super::components::COMPONENTS;
use super::*;
use contract::random::stream;
use serde_json::json;
use std::path::PathBuf;

fn environment(values: serde_json::Value) -> ComponentReplacement {
    ComponentReplacement::new(serde_json::from_value(values).unwrap()).unwrap()
}

#[derive(Debug, Deserialize)]
struct Run {
    required: usize,
    kind: String,
    #[serde(rename = "return")]
    sum: f64,
    steps: Vec<RecordedStep>,
}

/// A step, and the beliefs after it.
#[derive(Debug, Deserialize)]
struct RecordedStep {
    action: Vec<usize>,
    next_state: Vec<usize>,
    observation: Vec<usize>,
    reward: f64,
    belief: Vec<Vec<f64>>,
}

#[test]
fn the_published_program_is_followed() {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("../../tests/fixtures/component_replacement/imprl.json");
    let runs: Vec<Run> = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    assert_eq!(runs.len(), 4);
    for run in runs {
        let mut environment = environment(json!({ "required": run.required }));
        environment.reset(&mut stream(&[])).unwrap();
        let mut sum = 0.0;
        for (t, recorded) in run.steps.iter().enumerate() {
            let place = format!("{} of 5, {}, step {t}", run.required, run.kind);
            let treatments: Vec<Treatment> =
                recorded.action.iter().map(|choice| TREATMENTS[*choice]).collect();
            let step = environment.advance(&treatments, |component, _| {
                (recorded.next_state[component], recorded.observation[component])
            });
            assert!(
                (step.rewards[0] - recorded.reward).abs() < 1e-9,
                "{place}: {} {}",
                step.rewards[0],
                recorded.reward
            );
            let beliefs = environment.progress.beliefs.concat();
            assert!(
                beliefs
                    .iter()
                    .zip(recorded.belief.iter().flatten())
                    .all(|(a, b)| (a - b).abs() < 1e-11),
                "{place}: {beliefs:?}"
            );
            assert_eq!(step.end.is_some(), t == 49, "{place}");
            sum += step.rewards[0];
        }
        assert!((sum - run.sum).abs() < 1e-8, "{}: {sum} {}", run.kind, run.sum);
    }
}

#[test]
fn draws_follow_the_probabilities() {
    let mut environment = environment(json!({ "required": 1, "horizon": 1 }));
    let mut rng = stream(&["draws"]);
    let (mut states, mut readings) = ([0.0; N_STATES], [0.0; N_STATES]);
    for _ in 0..20_000 {
        environment.reset(&mut rng).unwrap();
        environment.step(&vec![vec![2.0]; 5], &mut rng).unwrap();
        states[environment.progress.damage[1]] += 1.0 / 20_000.0;
        readings[environment.progress.readings[1]] += 1.0 / 20_000.0;
    }
    let of = &COMPONENTS[1];
    let next = of.transition(false)[0];
    let read: [f64; N_STATES] = std::array::from_fn(|o| {
        (0..N_STATES)
            .map(|state| next[state] * of.readings(true)[state][o])
            .sum()
    });
    // A share of one half of 20 000 has a standard deviation of 0.0035.
    for (found, expected) in [(states, next), (readings, read)] {
        assert!(
            found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 0.014),
            "{found:?} {expected:?}"
        );
    }
    assert_eq!(drawn(&[0.5, 0.5, 0.0, 0.0], 1.0), 1);
    assert_eq!(drawn(&[0.0, 0.5, 0.5, 0.0], 0.0), 1);
}

#[test]
fn inspections_that_are_not_read_cost_as_much_and_show_nothing() {
    let mut environment = environment(json!({ "unread_inspections": true }));
    let mut rng = stream(&["unread"]);
    environment.reset(&mut rng).unwrap();
    let choices = [3.0, 4.0, 0.0, 0.0, 0.0].map(|choice| vec![choice]);
    let step = environment.step(&choices, &mut rng).unwrap();
    // Inspections of the first two (20, 40), a replacement of the second (90).
    let costs = ["cost", "replacement_cost", "inspection_cost", "failure_cost"];
    assert_eq!(
        costs.map(|cost| step.metric(cost).unwrap()),
        [150.0, 90.0, 60.0, 0.0]
    );
    assert_eq!(step.rewards, [-150.0; 5]);
    let prediction = COMPONENTS[0].transition(false)[0];
    assert!(
        environment.progress.beliefs[0]
            .iter()
            .zip(prediction)
            .all(|(a, b)| (a - b).abs() < 1e-15)
    );
    assert!(
        super::ComponentReplacement::new(ComponentReplacementConfig::default())
            .unwrap()
            .step(&choices, &mut rng)
            .is_err()
    );
}

#[test]
fn metrics_add_up_and_the_bound_is_one_number() {
    let mut environment = environment(json!({ "required": 5, "horizon": 6 }));
    let mut rng = stream(&["sums"]);
    environment.reset(&mut rng).unwrap();
    let least = least_cost(&environment.config.problem());
    for t in 0..6 {
        let step = environment
            .step(&[1.0, 0.0, 2.0, 1.0, 0.0].map(|choice| vec![choice]), &mut rng)
            .unwrap();
        let parts = ["replacement_cost", "inspection_cost", "failure_cost"];
        let sum: f64 = parts.iter().filter_map(|cost| step.metric(cost)).sum();
        assert!((step.metric("cost").unwrap() - sum).abs() < 1e-12);
        assert!(
            (step.metric("replacement_cost").unwrap() - 280.0 * 0.99_f64.powi(t)).abs() < 1e-10
                && step.metric("least_cost").unwrap() == least
        );
        assert_eq!(step.end, (t == 5).then_some(End::Terminated));
    }
}

#[test]
fn impossible_configs_are_refused() {
    for (values, text) in [
        (json!({ "required": 6 }), "`required`: 6 is not in 1 to 5"),
        (json!({ "horizon": 0 }), "`horizon`: 0 is not in 1 to 1000"),
        (json!({ "discount": 1.1 }), "`discount`: 1.1 is not in 0 to 1"),
        (
            json!({ "failure_cost": -1.0 }),
            "`failure_cost`: -1 is not in 0 to",
        ),
    ] {
        let config: ComponentReplacementConfig = serde_json::from_value(values).unwrap();
        let refusal = ComponentReplacement::new(config).unwrap_err().to_string();
        assert!(refusal.contains(text), "{refusal}");
    }
}
