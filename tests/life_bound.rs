//! The bound on the life of a pack beside what registered agents reach, episode by episode.

use contract::{NoKeeper, Phase, cast::Actors, part::Part, trial::TrialKey};
use plugins::registry;
use serde_json::{Value, json};

const AGENTS: [(&str, &str); 8] = [
    ("equal_split", "{}"),
    ("random_allocation", "{}"),
    ("rank_rule", r#"{"weights": [0.15, 0.25, 0.25, 0.35]}"#),
    ("rank_rule", r#"{"weights": [0.1, 0.2, 0.3, 0.4]}"#),
    ("rank_rule", r#"{"weights": [0.1, 0.2, 0.2, 0.5]}"#),
    ("rank_rule", r#"{"weights": [0.05, 0.2, 0.35, 0.45]}"#),
    ("water_filling", "{}"),
    ("water_filling_true_state", "{}"),
];

/// A metric of each final episode.
fn finals(cells: &Value, agent: (&str, &str), metric: &str) -> Vec<f64> {
    let registry = registry();
    let environment = (registry.environments["battery"].about.resolve)(&json!({"cells": cells})).unwrap();
    let config = (registry.agents[agent.0].about.resolve)(&serde_json::from_str(agent.1).unwrap()).unwrap();
    let protocol = json!({"steps": 0, "final_episodes": 60, "trace_episodes": 0});
    let key = TrialKey {
        environment: Part::new("battery", 2, environment).into(),
        agent: Actors::Agent(Part::new(agent.0, 1, config)).into(),
        protocol: Part::new(
            "train_evaluate",
            1,
            (registry.protocols["train_evaluate"].about.resolve)(&protocol).unwrap(),
        )
        .into(),
        seed: 3,
        numerics: registry.numerics_version,
    };
    let record = key.run(&registry, None, &mut |_, _| {}, &mut NoKeeper).unwrap();
    let index = record.names().iter().position(|name| name == metric).unwrap();
    let rows = record
        .rows()
        .iter()
        .filter(|row| row.phase == Phase::Final && usize::from(row.metric) == index);
    rows.map(|row| row.value).collect()
}

/// Rows are stored in the order in which episodes end, so that they are compared by agent as sorted lists of
/// both metrics.
#[test]
fn no_registered_rule_outlives_the_bound_and_all_agents_meet_the_same_one() {
    for cells in [json!(4), json!(8), json!("second_life")] {
        let agents = AGENTS
            .into_iter()
            .filter(|(name, _)| *name != "rank_rule" || cells != json!(8));
        let mut first: Option<Vec<f64>> = None;
        for agent in agents {
            let (lives, bounds) = (
                finals(&cells, agent, "cycle_length"),
                finals(&cells, agent, "cycle_length_bound"),
            );
            assert_eq!((lives.len(), bounds.len()), (60, 60));
            assert!(
                lives.iter().zip(&bounds).all(|(life, bound)| life <= bound),
                "{cells} {agent:?}"
            );
            let mut sorted = bounds;
            sorted.sort_by(f64::total_cmp);
            assert_eq!(
                *first.get_or_insert_with(|| sorted.clone()),
                sorted,
                "{cells} {agent:?}"
            );
        }
        assert!(
            first.unwrap().iter().all(|bound| *bound > 20.0),
            "a bound that says something"
        );
    }
}
