//! Figures built of synthetic results: lines of one point, settings side by side, agents that are left out, and long
//! names.

use super::{
    Band, Bars, Chart, Curve, FigureSpec, LearningCurve, Scatter, SeedLines, Shape, Trajectory,
    layout::draw,
    paint::Mark,
    tests::{chart, names},
};
use crate::table::{self, Comparison, Form, TableSpec};
use analysis::results::Results;
use contract::{Phase, standard_metrics::UPDATES, trial_end::EndState};
use std::collections::BTreeMap;
use testing::synthetic::{Rows, ended, noise, trial};

/// An agent that is measured once while it learns, beside one that is measured more often.
fn measured_once(seeds: u64) -> Results {
    let one = |seed: u64| {
        let rows: Rows = vec![
            (Phase::Evaluate, 100, 0, "return", 5.0 + noise(seed, 1, 1)),
            (Phase::Final, 100, 0, UPDATES, 9.0),
        ];
        trial("e", "once", "", seed, &rows)
    };
    let more = |seed: u64| {
        let at = |step: u64| (Phase::Evaluate, step, 0, "return", 4.0 + noise(seed, 2, step));
        let mut rows: Rows = [50, 100, 150].map(at).to_vec();
        rows.push((Phase::Final, 100, 0, UPDATES, 9.0));
        trial("e", "more", "", seed, &rows)
    };
    Results::of((0..seeds).flat_map(|seed| [one(seed), more(seed)]).collect())
}

fn curve_figure() -> FigureSpec {
    FigureSpec::of(LearningCurve::default())
}

fn the_curve<'a>(chart: &'a Chart, label: &str) -> &'a Curve {
    let mut series = chart.panels[0].series.iter();
    match series.find(|series| series.label == label).map(|it| &it.shape) {
        Some(Shape::Curve(curve)) => curve,
        _ => panic!("no curve"),
    }
}

/// Number of round areas of a drawing.
fn discs(chart: &Chart) -> usize {
    let is_disc = |mark: &&Mark| matches!(mark, Mark::Fill { points, .. } if points.len() == 12);
    draw(chart).marks.iter().filter(is_disc).count()
}

#[test]
fn a_line_of_one_measurement_is_a_disc_with_an_error_bar() {
    let many = chart(&curve_figure(), &measured_once(6));
    assert!(the_curve(&many, "once").is_point() && !the_curve(&many, "more").is_point());
    assert_eq!(discs(&many), 2, "one in the plot and one in the legend");
    let notes = many.notes.join(" ");
    assert!(
        notes.contains("A disc is a line of one measurement, with an error bar in place of the band."),
        "{notes}"
    );
    let one = chart(&curve_figure(), &measured_once(1));
    assert_eq!(discs(&one), 2);
    let plain = FigureSpec::of(LearningCurve {
        seeds: SeedLines::Said(false),
        band: Band::None,
        agents: names(&["once"]),
        ..LearningCurve::default()
    });
    let plain = chart(&plain, &measured_once(6));
    assert_eq!(discs(&plain), 2);
    assert!(
        plain
            .notes
            .contains(&"A disc is a line of one measurement.".to_owned())
    );
}

/// Two settings of a swept agent and one without settings, with a trace of some steps.
fn swept() -> Results {
    let rows = |value: f64, seed: u64| -> Rows {
        let mut rows = vec![
            (Phase::Final, 1, 0, "return", value + noise(seed, 3, 3)),
            (Phase::Final, 1, 0, "cost", value),
        ];
        rows.extend((0..4).map(|step| (Phase::Trace, step, 0, "height", value * step as f64)));
        rows
    };
    let of_seed = |seed: u64| {
        [
            trial("e", "sac", "sac.rate=0.1", seed, &rows(1.0, seed)),
            trial("e", "sac", "sac.rate=0.01", seed, &rows(2.0, seed)),
            trial("e", "rule", "", seed, &rows(3.0, seed)),
        ]
    };
    Results::of((0..3).flat_map(of_seed).collect())
}

fn scatter() -> FigureSpec {
    FigureSpec::of(Scatter {
        x: "return".into(),
        y: "cost".into(),
        ..Scatter::default()
    })
}

#[test]
fn a_scatter_tells_settings_apart() {
    let chart = chart(&scatter(), &swept());
    let series = &chart.panels[0].series;
    let legends: Vec<String> = series.iter().map(super::Series::legend).collect();
    assert_eq!(
        legends,
        ["sac, rate=0.1 (n = 3)", "sac, rate=0.01 (n = 3)", "rule (n = 3)"]
    );
    assert!(series.iter().all(|it| it.shape.points().len() == 3));
    assert_ne!(series[0].style, series[1].style);
}

fn trajectory() -> FigureSpec {
    FigureSpec::of(Trajectory {
        channels: names(&["height"]),
        ..Trajectory::default()
    })
}

#[test]
fn a_trajectory_has_a_column_for_each_setting() {
    let chart = chart(&trajectory(), &swept());
    let titles: Vec<&str> = chart.panels.iter().map(|panel| panel.title.as_str()).collect();
    assert_eq!(titles, ["sac, rate=0.1", "sac, rate=0.01", "rule"]);
    let last = |index: usize| chart.panels[index].series[0].shape.last_value();
    assert_eq!((last(0), last(1), last(2)), (Some(3.0), Some(6.0), Some(9.0)));
    assert_eq!(chart.notes, ["Episode 0 of seed 0 in e."]);
}

#[test]
fn titles_that_would_overlap_stand_in_lines() {
    let long = "soft actor critic, entropy learned, delayed policy, wide critics";
    let with = |label: &str| FigureSpec {
        labels: BTreeMap::from([("sac".into(), label.into())]),
        ..trajectory()
    };
    let titles = |chart: &Chart| -> Vec<(f64, String)> {
        let marks = draw(chart).marks.into_iter();
        let texts = marks.filter_map(|mark| match mark {
            Mark::Text { at, text, .. } if text.contains("rate") || text.contains("soft") => {
                Some((at.1, text))
            }
            _ => None,
        });
        texts.collect()
    };
    let (short, long) = (chart(&with("sac"), &swept()), chart(&with(long), &swept()));
    assert_eq!(titles(&short).len(), 2);
    let lines = titles(&long);
    assert_eq!(lines.len(), 4, "{lines:?}");
    assert!(lines.iter().all(|(y, _)| *y > 0.0), "{lines:?}");
    assert!(draw(&long).height > draw(&short).height);
}

#[test]
fn of_very_many_settings_a_trajectory_shows_the_first_and_says_so() {
    let rows = vec![(Phase::Trace, 1, 0, "height", 1.0)];
    let with = |rate: u64| trial("e", "sac", &format!("sac.rate={rate}"), 0, &rows);
    let mut trials: Vec<_> = (1..=7).map(with).collect();
    trials.push(trial("e", "rule", "", 0, &rows));
    let chart = chart(&trajectory(), &Results::of(trials));
    let titles: Vec<&str> = chart.panels.iter().map(|panel| panel.title.as_str()).collect();
    assert_eq!(titles, ["sac, rate=1", "rule"]);
    assert_eq!(
        chart.notes[1],
        "Of several settings of an agent the first one is drawn."
    );
}

#[test]
fn agents_without_a_curve_or_cloud_are_named() {
    let mut results = measured_once(2);
    let rows: Rows = vec![
        (Phase::Final, 1, 0, "return", 1.0),
        (Phase::Final, 1, 0, "cost", 1.0),
    ];
    for seed in 0..2 {
        results.trials.push(ended(
            trial("e", "broken", "", seed, &Vec::new()),
            EndState::Failed,
            "",
        ));
        let other = vec![
            (Phase::Final, 1, 0, "cost", 1.0),
            (Phase::Final, 1, 0, UPDATES, 1.0),
        ];
        results.trials.push(trial("e", "other", "", seed, &other));
        results.trials.push(trial("e", "rule", "", seed, &rows));
    }
    let notes = chart(&curve_figure(), &results).notes;
    assert_eq!(
        notes[notes.len() - 2..],
        [
            "broken is left out: 0 of 2 seeds; 2 failed.",
            "other is left out: 0 of 2 seeds; no `return` recorded while it learned."
        ]
    );
    let notes = chart(&scatter(), &results).notes.join(" ");
    assert!(
        notes.contains("broken is left out: 0 of 2 seeds; 2 failed."),
        "{notes}"
    );
    assert!(
        notes.contains("other is left out: 0 of 2 seeds; no seed has both `return` and `cost`."),
        "{notes}"
    );
    let complete = chart(&curve_figure(), &measured_once(2)).notes.join(" ");
    assert!(!complete.contains("left out"), "{complete}");
}

#[test]
fn a_break_in_a_label_becomes_a_space() {
    let labels = BTreeMap::from([("rule".into(), "rule\nof thumb".into())]);
    let spec = FigureSpec {
        labels: labels.clone(),
        x_label: Some("one\r\ntwo".into()),
        ..scatter()
    };
    let drawn = chart(&spec, &swept());
    assert_eq!(drawn.panels[0].series[2].label, "rule of thumb");
    assert_eq!(drawn.panels[0].x.label, "one two");
    let of = Comparison {
        agents: names(&["rule"]),
        form: Some(Form::Value),
        labels,
        ..Comparison::default()
    };
    let bars = chart(&FigureSpec::of(Bars { of: of.clone() }), &swept());
    assert_eq!(bars.panels[0].x.categories, ["rule of thumb"]);
    let grid = table::build(&TableSpec::of(of), &swept()).unwrap();
    assert_eq!(grid.rows[0].label, "rule of thumb");
}

/// Bars of agents with long names.
fn many_bars(agents: usize) -> Chart {
    let all = (0..agents).flat_map(|index| {
        let name = format!("value_decomposition_{}", index + 1);
        (0..3).map(move |seed| {
            let value = 3.0 + index as f64 + noise(seed, index as u64, 7);
            trial("e", &name, "", seed, &vec![(Phase::Final, 1, 0, "return", value)])
        })
    });
    let of = Comparison::default();
    chart(&FigureSpec::of(Bars { of }), &Results::of(all.collect()))
}

/// Figures for inspection by eye.
pub(super) fn pictures() -> Vec<(&'static str, Chart)> {
    let long = "with an entropy temperature that is learned, a batch of 256 and a target that moves slowly";
    let labelled = FigureSpec {
        labels: BTreeMap::from([("once".into(), long.into())]),
        ..curve_figure()
    };
    let bars_by_agent = {
        let mut chart = many_bars(12);
        let panel = &mut chart.panels[0];
        let points = panel.series[0].shape.points().to_vec();
        let bar = |(index, point): (usize, &super::Point)| super::Series {
            label: format!("agent {}", index + 1),
            seeds: None,
            style: super::Style::of_agent(index),
            shape: Shape::Bars(vec![*point], 0.8),
        };
        panel.series = points.iter().enumerate().map(bar).collect();
        chart
    };
    vec![
        ("one-point", chart(&curve_figure(), &measured_once(6))),
        ("one-point-few", chart(&curve_figure(), &measured_once(3))),
        ("long-legend", chart(&labelled, &measured_once(6))),
        ("six-bars", many_bars(6)),
        ("twelve-bars", bars_by_agent),
        ("scatter-settings", chart(&scatter(), &swept())),
        ("trajectory-settings", chart(&trajectory(), &swept())),
    ]
}
