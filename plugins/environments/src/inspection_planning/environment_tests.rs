//! The environment as a whole.

use super::*;
use contract::random::stream;
use serde_json::json;

fn environment(values: serde_json::Value) -> InspectionPlanning {
    InspectionPlanning::new(serde_json::from_value(values).unwrap()).unwrap()
}

/// The return of an episode in which all seats take the same choice in every step.
fn constant(environment: &mut InspectionPlanning, choice: f64) -> (f64, Vec<f64>) {
    let mut rng = stream(&["constant"]);
    environment.reset(&mut rng).unwrap();
    let (mut sum, mut metrics) = (0.0, vec![0.0; 6]);
    loop {
        let step = environment
            .step(&vec![vec![choice]; environment.seats.len()], &mut rng)
            .unwrap();
        sum += step.rewards[0];
        let values = step.metrics.iter().map(|(_, value)| value);
        metrics
            .iter_mut()
            .zip(values)
            .for_each(|(sum, value)| *sum += value);
        if step.end.is_some() {
            return (sum, metrics);
        }
    }
}

/// Values of the published program: -40.24126096000002 by its table, -40.1228 by a quadrature of the same law,
/// and 30 steps with two repairs.
#[test]
fn returns_of_constant_policies_are_the_published_ones() {
    let one_of_two = json!({ "components": 2, "discount": 1.0 });
    let mut computed = environment(one_of_two.clone());
    assert!(
        (constant(&mut computed, 0.0).0 + 40.1228).abs() < 5e-3,
        "{}",
        constant(&mut computed, 0.0).0
    );
    // Repaired components fail with a probability of about 1e-9.
    assert!((constant(&mut computed, 2.0).0 + 1200.0).abs() < 1e-3);
    let mut sampled = one_of_two;
    sampled["crack_growth"] = json!({ "file": oracle_tests::table() });
    let mut sampled = environment(sampled);
    assert!((constant(&mut sampled, 0.0).0 + 40.241_260_960_000_02).abs() < 1e-9);
    assert!((constant(&mut sampled, 2.0).0 + 1200.0).abs() < 1e-9);
}

#[test]
fn metrics_add_up_to_the_return_and_campaigns_cost() {
    for (campaign, once) in [(false, 3.0 * 1.0), (true, 3.0 * 0.2 + 5.0)] {
        let mut environment = environment(json!({ "components": 3, "campaign": campaign }));
        let (sum, metrics) = constant(&mut environment, 1.0);
        assert!((sum + metrics[..4].iter().sum::<f64>()).abs() < 1e-10);
        let weights: f64 = (0..30).map(|t| 0.95_f64.powi(t)).sum();
        assert!(
            (metrics[0] + metrics[2] - once * weights).abs() < 1e-10,
            "{metrics:?}"
        );
        assert_eq!((metrics[4], metrics[5]), (90.0, 0.0));
    }
}

#[test]
fn a_seat_observes_its_belief_the_time_and_the_factor() {
    for (correlated, width) in [(false, 31), (true, 111)] {
        let mut environment = environment(json!({ "components": 2, "correlated": correlated }));
        let seen = environment.reset(&mut stream(&[])).unwrap();
        assert_eq!((seen[0].len(), seen[1].len()), (width, width));
        assert!((seen[0][..30].iter().sum::<f64>() - 1.0).abs() < 1e-12 && seen[0][30] == 0.0);
        assert_eq!(environment.state().len(), 2 * 32 + 1 + width - 31);
        let step = environment
            .step(&[vec![1.0], vec![2.0]], &mut stream(&["one"]))
            .unwrap();
        assert!((step.observations[0][30] - 1.0 / 30.0).abs() < 1e-15);
        let state = environment.state();
        assert_eq!((state[30], state[32 + 30], state[64]), (1.0, 0.0, 1.0));
    }
}

#[test]
fn draws_do_not_depend_on_what_is_done() {
    let (mut one, mut other) = (environment(json!({})), environment(json!({})));
    let (mut first, mut second) = (stream(&["draws"]), stream(&["draws"]));
    one.reset(&mut first).unwrap();
    other.reset(&mut second).unwrap();
    one.step(&vec![vec![0.0]; 5], &mut first).unwrap();
    other.step(&vec![vec![1.0]; 5], &mut second).unwrap();
    assert_eq!(first, second);
}

#[test]
fn a_snapshot_of_another_system_is_refused() {
    let (small, mut large) = (environment(json!({ "components": 3 })), environment(json!({})));
    let problem = large.restore(&small.snapshot()).unwrap_err().to_string();
    assert!(problem.contains("not of 5 components and 1 levels"), "{problem}");
    assert!(large.restore(&json!({ "step": "x" })).is_err());
}
