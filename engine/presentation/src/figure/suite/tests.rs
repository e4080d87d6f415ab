//! Figures of a suite of synthetic results: their data by snapshot, and their notes on missing scores.

use super::*;
use crate::figure::{Chart, FigureSpec, LearningCurve, Series, Shape, tests::chart};
use analysis::results::Results;
use contract::Phase;
use serde_json::{Value, json};
use std::{collections::BTreeMap, path::Path};
use testing::synthetic::study;
use testing::synthetic::{AGENTS, noise, trial};

/// A figure of the synthetic study, with other options.
fn spec(kind: &str, options: Value) -> FigureSpec {
    let mut all = json!({
        "metric": "cycle_length", "normalise": { "low": "equal", "high": "bound" },
    });
    let own = options.as_object().cloned().unwrap_or_default();
    all.as_object_mut().unwrap().extend(own);
    let kinds = crate::figure::kinds();
    let kind = kinds.iter().find(|it| it.kind.name == kind).unwrap();
    FigureSpec {
        kind: kind.read(all, Path::new("")).unwrap(),
        labels: BTreeMap::from([("dsac".into(), "Dirichlet SAC".into())]),
        ..FigureSpec::of(LearningCurve::default())
    }
}

fn of(kind: &str, options: Value) -> Chart {
    chart(&spec(kind, options), &study())
}

/// Three agents with similar results in three environments.
fn close() -> Results {
    let one = |environment: &str, place: u64, agent: usize, seed: u64| {
        let value = 0.2 * agent as f64 + noise(place, agent as u64, seed);
        let rows = vec![(Phase::Final, 9, 0, "cycle_length", value)];
        trial(environment, AGENTS[agent], "", seed, &rows)
    };
    let mut trials = Vec::new();
    for (place, environment) in (0..).zip(["four_cells", "eight_cells", "ten_cells"]) {
        let seeds = (0..3).flat_map(|agent| (0..8).map(move |seed| (agent, seed)));
        trials.extend(seeds.map(|(agent, seed)| one(environment, place, agent, seed)));
    }
    Results::of(trials)
}

/// Figures for inspection by eye.
pub(in crate::figure) fn pictures() -> Vec<(&'static str, Chart)> {
    let narrow = FigureSpec {
        width_mm: Some(60.0),
        font_pt: Some(6.0),
        ..spec("performance_profile", json!({}))
    };
    let bounds = ["four_cells", "eight_cells", "ten_cells"].map(|name| (name, json!([-1.0, 1.0])));
    let bounds = json!({ "normalise": BTreeMap::from(bounds) });
    vec![
        ("interval-estimates", of("interval_estimates", json!({}))),
        ("performance-profile", of("performance_profile", json!({}))),
        ("performance-profile-narrow", chart(&narrow, &study())),
        (
            "probability-of-improvement",
            chart(&spec("probability_of_improvement", bounds), &close()),
        ),
        ("sample-efficiency", of("sample_efficiency", json!({}))),
    ]
}

/// Every n-th line of the data.
fn thinned(chart: &Chart, n: usize) -> String {
    let csv = chart.csv().unwrap();
    csv.lines().step_by(n).collect::<Vec<_>>().join("\n")
}

#[test]
fn the_data_of_suites() {
    insta::assert_snapshot!(
        "interval_estimates",
        thinned(&of("interval_estimates", json!({})), 1)
    );
    let profile = of(
        "performance_profile",
        json!({ "points": 21, "from": -0.5, "to": 1.5 }),
    );
    insta::assert_snapshot!("performance_profile", thinned(&profile, 3));
    let improvement = of("probability_of_improvement", json!({}));
    insta::assert_snapshot!("probability_of_improvement", thinned(&improvement, 1));
    insta::assert_snapshot!(
        "sample_efficiency",
        thinned(&of("sample_efficiency", json!({})), 5)
    );
}

#[test]
fn what_was_done_and_what_is_missing_is_said() {
    let chart = of("interval_estimates", json!({}));
    insta::assert_snapshot!("notes", chart.notes.join("\n"));
    assert_eq!(
        chart.panels[0].y.categories,
        ["equal", "Dirichlet SAC", "ddpg (n = 3 of 5)", "bound"]
    );
    let curves = of("sample_efficiency", json!({}));
    let legends: Vec<String> = curves.panels[0].series.iter().map(Series::legend).collect();
    assert_eq!(
        legends,
        [
            "equal (n = 5)",
            "Dirichlet SAC (n = 5)",
            "ddpg (n = 3 of 5)",
            "bound (n = 5)"
        ]
    );
    let level = |index: usize| matches!(curves.panels[0].series[index].shape, Shape::Level(_));
    assert_eq!([0, 1, 2, 3].map(level), [true, false, false, true]);
}

#[test]
fn an_agent_that_plays_only_a_part_is_left_out_by_name() {
    let mut results = study();
    results
        .trials
        .retain(|trial| trial.trial.cell.agent != "ddpg" || trial.trial.cell.environment == "four_cells");
    let chart = chart(&spec("performance_profile", json!({})), &results);
    assert_eq!(chart.panels[0].series.len(), AGENTS.len() - 1);
    assert!(
        chart
            .notes
            .contains(&"ddpg is left out: it has no score in eight_cells.".into()),
        "{:?}",
        chart.notes
    );
}

#[test]
fn means_that_are_fixed_by_construction_have_no_interval() {
    let chart = of("interval_estimates", json!({}));
    let interval = |panel: usize, row: usize| chart.panels[panel].series[row].shape.points()[0].interval;
    for row in [0, 3] {
        assert_eq!((interval(0, row), interval(2, row)), (None, None));
        assert!(interval(1, row).is_some());
    }
    assert!((0..4).all(|panel| interval(panel, 1).is_some()));
    // A number instead of an agent in one environment leaves no score fixed there.
    let normalise = json!({ "four_cells": ["equal", 13.0], "eight_cells": ["equal", "bound"] });
    let mixed = of("interval_estimates", json!({ "normalise": normalise }));
    assert!(mixed.panels[0].series[3].shape.points()[0].interval.is_some());
}

#[test]
fn profiles_span_all_runs_or_what_is_asked_for() {
    let whole = of("performance_profile", json!({}));
    for series in &whole.panels[0].series {
        let points = series.shape.points();
        assert_eq!((points.len(), points[100].y), (101, 0.0));
        assert!(points.iter().all(|point| {
            let (low, high) = point.interval.unwrap();
            low <= point.y && point.y <= high
        }));
    }
    let asked = of(
        "performance_profile",
        json!({ "from": 0.25, "to": 0.75, "points": 3 }),
    );
    let places: Vec<f64> = asked.panels[0].series[0]
        .shape
        .points()
        .iter()
        .map(|point| point.x)
        .collect();
    assert_eq!(places, [0.25, 0.5, 0.75]);
}

#[test]
fn pairs_are_all_or_those_asked_for() {
    let rows = |options| {
        of("probability_of_improvement", options).panels[0]
            .y
            .categories
            .clone()
    };
    assert_eq!(rows(json!({})).len(), 6);
    assert_eq!(
        rows(json!({ "relative_to": "equal" })),
        ["Dirichlet SAC > equal", "ddpg > equal", "bound > equal"]
    );
    let pairs = of(
        "probability_of_improvement",
        json!({ "pairs": [["bound", "dsac"], ["dsac", "bound"]] }),
    );
    let value = |row: usize| pairs.panels[0].series[1 + row].shape.points()[0].y;
    assert_eq!(
        pairs.panels[0].y.categories,
        ["bound > Dirichlet SAC", "Dirichlet SAC > bound"]
    );
    assert!((value(0) + value(1) - 1.0).abs() < 1e-12 && value(0) > 0.9);
}

#[test]
fn an_agent_has_its_colour_in_figures_of_suites() {
    let usual = chart(
        &crate::figure::tests::learning_curve(crate::figure::Band::None),
        &study(),
    );
    let color = |chart: &Chart, index: usize| chart.panels[0].series[index].style.color();
    for kind in ["interval_estimates", "performance_profile", "sample_efficiency"] {
        let chart = of(kind, json!({}));
        assert!(
            (0..4).all(|index| color(&chart, index) == color(&usual, index)),
            "{kind}"
        );
    }
    let pair = of(
        "probability_of_improvement",
        json!({ "pairs": [["dsac", "equal"]] }),
    );
    assert_eq!(color(&pair, 1), color(&usual, 1));
}

#[test]
fn settings_are_not_pooled() {
    let mut results = study();
    results.trials[0].trial_mut().cell_mut().point =
        contract::sweep_point::SweepPoint::of_words("dsac.learning_rate=1");
    let spec = spec("sample_efficiency", json!({}));
    let context = Context {
        results: &results,
        agents: &[],
        units: &BTreeMap::new(),
        better: &BTreeMap::new(),
    };
    let error = crate::figure::build(&spec, context).unwrap_err().to_string();
    assert!(error.contains("settings are not pooled"), "{error}");
}
