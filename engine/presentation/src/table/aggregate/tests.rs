//! Aggregates against an independent computation, and the notes on missing ones.

use super::*;
use crate::table::{PublishedCell, PublishedRow, TableSpec, csv, html, latex, markdown, terminal};
use contract::{Phase, standard_metrics::UPDATES, trial_end::EndState, trial_result::TrialResult};
use serde_json::Value;
use statistics::{SequentialDesign, Verdict};
use testing::synthetic::{ended, trial};

/// Scores and aggregates made by `tests/fixtures/statistics/aggregate.py`.
fn reference() -> Value {
    serde_json::from_str(include_str!(
        "../../../../../tests/fixtures/statistics/aggregate.json"
    ))
    .unwrap()
}

fn final_value(environment: &str, agent: &str, seed: u64, value: f64) -> TrialResult {
    trial(
        environment,
        agent,
        "",
        seed,
        &vec![(Phase::Final, 9, 0, "score", value)],
    )
}

/// The raw values of the reference; a seed without one failed.
fn results() -> Results {
    let mut trials = Vec::new();
    for (environment, agents) in reference()["raw"].as_object().unwrap() {
        for (agent, seeds) in agents.as_object().unwrap() {
            for (seed, value) in (0..).zip(seeds.as_array().unwrap()) {
                let trial = final_value(environment, agent, seed, value.as_f64().unwrap_or(0.0));
                trials.push(if value.is_null() {
                    ended(trial, EndState::Oom, "3 GB")
                } else {
                    trial
                });
            }
        }
    }
    Results::of(trials)
}

fn spec(normalise: &Value) -> Aggregate {
    serde_json::from_value(serde_json::json!({
        "value": "score", "normalise": normalise, "relative_to": "middling",
        "profile_at": reference()["profile_at"],
        "agents": ["weak", "middling", "able", "strong"],
    }))
    .unwrap()
}

#[test]
fn aggregates_agree_with_an_independent_computation() {
    for case in reference()["cases"].as_array().unwrap() {
        let spec = spec(&case["normalise"]);
        let grid = build(&spec, &results()).unwrap();
        for (heading, cells) in grid.rows.iter().zip(&grid.cells) {
            for (column, cell) in grid.columns.iter().zip(cells) {
                let expected = &case["rows"][&heading.name][&column.name];
                let place = format!("{}, {}: {cell:?} against {expected}", heading.name, column.name);
                let Some(estimate) = expected["estimate"].as_f64() else {
                    assert!(cell.estimate.is_none() && cell.planned == 0, "{place}");
                    continue;
                };
                assert!((cell.estimate.unwrap() - estimate).abs() < 1e-12, "{place}");
                let Some((low, high)) = cell.interval else {
                    let is_fixed = spec.fixed().iter().any(|(name, _)| *name == heading.name);
                    assert!(
                        is_fixed && ["median", "mean"].contains(&column.name.as_str()),
                        "{place}"
                    );
                    continue;
                };
                let ends = [&expected["low"], &expected["high"]].map(|end| end.as_f64().unwrap());
                // The reference uses other random numbers; a share moves in steps of one seed.
                let step = if column.name.starts_with("above") {
                    0.06
                } else {
                    0.0
                };
                let tolerance = 0.03 * (ends[1] - ends[0]) + step;
                assert!(
                    (low - ends[0]).abs() <= tolerance && (high - ends[1]).abs() <= tolerance,
                    "{place}"
                );
            }
        }
    }
}

#[test]
fn rows_that_are_fixed_by_construction_say_so() {
    let grid = build(
        &spec(&serde_json::json!({"low": "weak", "high": "strong"})),
        &results(),
    )
    .unwrap();
    let labels: Vec<&str> = grid.rows.iter().map(|row| row.label.as_str()).collect();
    assert_eq!(
        labels,
        [
            "weak (0 by construction)",
            "middling",
            "able",
            "strong (1 by construction)"
        ]
    );
    for (row, score) in [(0, 0.0), (3, 1.0)] {
        for column in [1, 2] {
            let cell = &grid.cells[row][column];
            assert!(
                (cell.estimate.unwrap() - score).abs() < 1e-12 && cell.interval.is_none(),
                "{cell:?}"
            );
        }
        assert!(grid.cells[row][0].interval.is_some());
    }
}

#[test]
fn every_renderer_writes_it() {
    let aggregate = spec(&serde_json::json!({"low": "weak", "high": "strong"}));
    let table = TableSpec {
        caption: "Three environments".into(),
        ..TableSpec::of(aggregate)
    };
    let grid = crate::table::build(&table, &results()).unwrap();
    insta::assert_snapshot!("aggregate_markdown", markdown(&grid));
    insta::assert_snapshot!("aggregate_csv", csv(&grid).unwrap());
    for text in [
        latex(&grid, "suite"),
        html(&grid).into_string(),
        terminal(&grid, 300),
    ] {
        assert!(
            text.contains("weak (0 by construction)") && text.contains("better than middling"),
            "{text}"
        );
    }
}

#[test]
fn another_suite_is_no_aggregate() {
    let mut results = results();
    for it in results
        .trials
        .iter_mut()
        .filter(|it| it.trial.cell.environment == "maze")
    {
        match it.trial.cell.agent.as_str() {
            "able" => *it = ended(it.clone(), EndState::Failed, "it failed"),
            "middling" => it.trial_mut().cell_mut().agent = "strong".into(),
            _ => {}
        }
    }
    let spec = Aggregate {
        agents: Vec::new(),
        relative_to: None,
        ..spec(&serde_json::json!({"low": "weak", "high": "strong"}))
    };
    let grid = build(&spec, &results).unwrap();
    let rows: Vec<&str> = grid.rows.iter().map(|row| row.name.as_str()).collect();
    assert_eq!(
        rows,
        ["able", "strong", "weak"],
        "`middling` has no trials in the maze"
    );
    assert!(
        grid.notes
            .iter()
            .any(|note| note.starts_with("middling is left out")),
        "{:?}",
        grid.notes
    );
    let able = &grid.cells[0][0];
    assert_eq!((able.estimate, able.seeds.len()), (None, 0));
    assert!(
        able.incompleteness().contains("maze: 6 failed"),
        "{}",
        able.incompleteness()
    );
}

#[test]
fn what_cannot_be_scaled_or_pooled_is_said() {
    let numbers = serde_json::json!({"maze": [0, 1], "race": [2, 2], "climb": [0, 1]});
    let grid = build(&spec(&numbers), &results()).unwrap();
    assert!(grid.cells.iter().flatten().all(|cell| cell.estimate.is_none()));
    assert!(
        grid.cells[0][0]
            .incompleteness()
            .contains("race: nothing tells the scores 0 and 1 apart")
    );
    let message = |spec: &Aggregate, results: &Results| build(spec, results).unwrap_err().to_string();
    let one = Aggregate {
        environments: vec!["maze".into()],
        ..spec(&numbers)
    };
    assert_eq!(
        message(&one, &results()),
        "table: an aggregate needs trials in at least two environments"
    );
    let mut swept = results();
    swept.trials[0].trial_mut().cell_mut().point = contract::sweep_point::SweepPoint::of_words("rate=1");
    assert!(
        message(
            &Aggregate {
                agents: Vec::new(),
                ..spec(&numbers)
            },
            &swept
        )
        .contains("settings of a sweep")
    );
}

/// Agents that stand for 0 and 1 affect every score: published values wait for their trials and their training too.
#[test]
fn published_means_rest_on_the_looks_of_all_agents_behind_them() {
    let mut results = results();
    results.design = Some(SequentialDesign::new(vec![6, 12]));
    let aggregate = spec(&serde_json::json!({"low": "weak", "high": "strong"}));
    let means = PublishedRow::Columns(BTreeMap::from([(
        SUITE_MEAN.to_owned(),
        PublishedCell::Value(0.6),
    )]));
    let table = TableSpec {
        published: BTreeMap::from([("able".to_owned(), means)]),
        ..TableSpec::of(aggregate)
    };
    let able = |results: &Results| crate::table::build(&table, results).unwrap().cells[2][2].clone();
    let cell = able(&results);
    // Later seeds of the agent that stands for 0 move the scale, but no verdict of the first look.
    let mut grown = results.clone();
    grown
        .trials
        .extend((20..26).map(|seed| final_value("maze", "weak", seed, -1e3)));
    let judged = |cell: &Cell| {
        let judgement = cell.judgement.clone().unwrap();
        (judgement.verdict, judgement.mean, judgement.interval)
    };
    assert_ne!(able(&grown).estimate, cell.estimate);
    assert_eq!(judged(&able(&grown)), judged(&cell));
    let agents: BTreeSet<&str> = cell.rests_on.iter().map(|it| it.agent.as_str()).collect();
    assert_eq!(
        (cell.rests_on.len(), agents),
        (9, BTreeSet::from(["able", "strong", "weak"]))
    );
    assert_eq!(
        (
            cell.looks.complete(),
            cell.judgement.unwrap().stage.map(|stage| stage.of)
        ),
        (1, Some(2))
    );
    let of_weak = results
        .trials
        .iter()
        .position(|it| it.trial.cell.agent == "weak")
        .unwrap();
    let untrained = [
        (Phase::Final, 9, 0, "score", 0.1),
        (Phase::Final, 9, 0, UPDATES, 0.0),
    ];
    results.trials[of_weak] = trial("maze", "weak", "", 0, &untrained.to_vec());
    assert_eq!(able(&results).verdict(), Some(Verdict::NotTrained));
    results.trials[of_weak].end = None;
    assert_eq!(able(&results).looks.complete(), 0);
}
