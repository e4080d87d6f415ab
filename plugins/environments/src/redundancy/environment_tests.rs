use super::*;
use rand::Rng as _;

fn redundancy(values: serde_json::Value) -> Redundancy {
    Redundancy::new(serde_json::from_value(values).unwrap()).unwrap()
}

/// The action that buys these components.
fn buying(environment: &Redundancy, counts: &Counts) -> Vec<f64> {
    let mut taken: Vec<usize> = (0..MOST_TYPES)
        .flat_map(|of| std::iter::repeat_n(of + 1, counts[of]))
        .collect();
    taken.resize(environment.config.places, 0);
    contract::choice::vector(&environment.choices, &taken)
}

/// Returns the rewards of all steps, and the last step.
fn play(environment: &mut Redundancy, design: &[Counts]) -> (Vec<f64>, Step) {
    let mut rng = contract::random::stream(&[]);
    environment.reset(&mut rng).unwrap();
    let mut steps: Vec<Step> = Vec::new();
    for counts in design {
        let action = buying(environment, counts);
        steps.push(environment.step(&[action], &mut rng).unwrap());
    }
    (
        steps.iter().map(|step| step.rewards[0]).collect(),
        steps.pop().unwrap(),
    )
}

#[test]
fn the_best_design_has_no_gap() {
    for weight in [159, 175, 191] {
        let mut environment = redundancy(json!({ "weight_budget": weight }));
        let budget = environment.config.budget();
        let best = optimum::optimum(&SUBSYSTEMS, 4, budget).unwrap();
        let (rewards, last) = play(&mut environment, &best.counts);
        for (metric, value) in [
            ("reliability", best.reliability),
            ("optimum", best.reliability),
            ("gap", 0.0),
            ("feasible", 1.0),
        ] {
            assert_eq!(last.metric(metric), Some(value), "{metric}");
        }
        assert_eq!((last.end, rewards.len()), (Some(End::Terminated), 14));
        environment.designed.clear();
        let start = environment.present_system().score(budget);
        let earned: f64 = rewards.iter().sum();
        assert!((earned - (-(1.0 - best.reliability).ln() - start)).abs() < 1e-12);
    }
}

/// Subsystem 1 with two of type 1 and one of type 4, subsystem 2 with one of type 1.
#[test]
fn two_steps_by_hand() {
    let mut environment = redundancy(json!({ "subsystems": 2, "cost_budget": 10, "weight_budget": 20 }));
    let mut rng = contract::random::stream(&[]);
    let seen = environment.reset(&mut rng).unwrap();
    assert_eq!(seen, [[1.0, 0.0, 1.0, 1.0, 1.0]]);
    let first = buying(&environment, &[2, 0, 0, 1]);
    let step = environment.step(&[first], &mut rng).unwrap();
    let close = |found: &[f64], expected: &[f64]| {
        let near = |(a, b): (&f64, &f64)| (a - b).abs() < 1e-12;
        assert!(
            found.len() == expected.len() && found.iter().zip(expected).all(near),
            "{found:?} {expected:?}"
        );
    };
    close(&step.observations[0], &[0.0, 1.0, 0.6, 0.45, 0.9995]);
    // The initial components are types 3 (0.91) and 1 (0.95).
    close(
        &step.rewards,
        &[((1.0 - 0.91 * 0.95) / (1.0 - 0.9995 * 0.95_f64)).ln()],
    );
    assert_eq!(step.end, None);
    let second = buying(&environment, &[2, 0, 0, 0]);
    let step = environment.step(&[second], &mut rng).unwrap();
    close(&step.observations[0], &[0.0, 0.0, 0.2, -0.35, 0.9995 * 0.9975]);
    // Weight 11 + 16 against 20.
    close(&step.rewards, &[-0.35 + (1.0 - 0.9995 * 0.95_f64).ln()]);
    assert_eq!(
        (
            step.metric("reliability").unwrap(),
            step.metric("feasible").unwrap(),
            step.end
        ),
        (0.0, 0.0, Some(End::Terminated))
    );
    assert_eq!(environment.trace()[..3], [2.0, 8.0, 27.0]);
    let again = vec![0.0; 20];
    assert!(matches!(
        environment.step(&[again], &mut rng),
        Err(Error::Model { .. })
    ));
}

#[test]
fn a_type_that_a_subsystem_lacks_leaves_its_place_empty() {
    assert_eq!(bought(&[4, 1, 4, 0], 3), [1, 0, 0, 0]);
    assert_eq!(bought(&[4, 1, 4, 0], 4), [1, 0, 0, 2]);
}

#[test]
fn no_design_is_better_than_the_optimum() {
    let mut environment = redundancy(json!({ "weight_budget": 300, "cost_budget": 200 }));
    let mut rng = contract::random::stream(&["designs"]);
    let mut feasible = 0;
    for _ in 0..300 {
        environment.reset(&mut rng).unwrap();
        let mut last = None;
        for _ in 0..14 {
            let action: Vec<f64> = (0..20).map(|_| rng.random_range(-1.0..1.0)).collect();
            last = Some(environment.step(&[action], &mut rng).unwrap());
        }
        let last = last.unwrap();
        let value = |metric| last.metric(metric).unwrap();
        assert!(
            value("gap") >= 0.0 && value("reliability") <= value("optimum"),
            "{last:?}"
        );
        feasible += usize::from(value("feasible") == 1.0);
    }
    assert!(feasible > 100, "{feasible} of 300 within the budgets");
}

#[test]
fn an_episode_is_restored_between_steps() {
    let mut one = redundancy(json!({ "subsystems": 3 }));
    let mut rng = contract::random::stream(&[]);
    one.reset(&mut rng).unwrap();
    let action = buying(&one, &[0, 1, 0, 2]);
    one.step(std::slice::from_ref(&action), &mut rng).unwrap();
    let mut two = redundancy(json!({ "subsystems": 3 }));
    two.restore(&one.snapshot()).unwrap();
    let steps = [&mut one, &mut two]
        .map(|environment| environment.step(std::slice::from_ref(&action), &mut rng).unwrap());
    assert_eq!(steps[0], steps[1]);
    for snapshot in [
        json!([[0, 1]]),
        json!([[0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0]]),
    ] {
        assert!(matches!(
            two.restore(&snapshot),
            Err(Error::Checkpoint {
                what: "redundancy",
                ..
            })
        ));
    }
}

#[test]
fn impossible_configs_are_refused() {
    for (values, text) in [
        (json!({ "subsystems": 15 }), "`subsystems`: 15 is not in 1 to 14"),
        (json!({ "places": 0 }), "`places`: 0 is not in 1 to 8"),
        (
            json!({ "weight_budget": 60 }),
            "`weight_budget`: no design of 14 subsystems",
        ),
        (json!({ "cost_budget": 20 }), "costs at most 20"),
    ] {
        let refusal = build(serde_json::from_value(values).unwrap())
            .err()
            .unwrap()
            .to_string();
        assert!(refusal.contains(text), "{refusal}");
    }
}

#[test]
fn presets_state_their_optimum() {
    for preset in <RedundancyConfig as contract::Config>::presets() {
        let environment = redundancy(preset.values);
        let stated = format!("optimum {:.6}", environment.optimal_reliability);
        assert!(preset.about.ends_with(&stated), "{}: {stated}", preset.name);
    }
}
