//! Figures of synthetic results: their data by snapshot, their drawing by properties.

use super::{
    Band, Bars, Chart, Context, Contour, Figure, FigureSpec, GroupedLines, HeatMap, LearningCurve, Scatter,
    Shape, Trajectory, build, built_tests, curve_tests, drawn_tests, png, svg,
};
use crate::kinds::KindSpec;
use crate::table::{Axis, Comparison, TableAxis};
use analysis::results::Results;
use contract::{Phase, standard_metrics::UPDATES};
use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};
use testing::synthetic::study;
use testing::synthetic::{AGENTS, Rows, noise, trial};

pub(super) fn chart(spec: &FigureSpec, results: &Results) -> Chart {
    let agents = AGENTS.map(String::from);
    let units = BTreeMap::from([
        ("cycle_length".into(), "h".into()),
        ("voltage".into(), "V".into()),
        ("load".into(), "W".into()),
    ]);
    build(
        spec,
        Context {
            results,
            agents: &agents,
            units: &units,
            better: &BTreeMap::new(),
        },
    )
    .unwrap()
}

pub(super) fn names(names: &[&str]) -> Vec<String> {
    names.iter().map(|name| (*name).into()).collect()
}

pub(super) fn learning_curve(band: Band) -> FigureSpec {
    let kind = LearningCurve {
        metric: "cycle_length".into(),
        band,
        ..LearningCurve::default()
    };
    FigureSpec {
        labels: BTreeMap::from([("dsac".into(), "Dirichlet SAC".into())]),
        ..FigureSpec::of(kind)
    }
}

/// The same figure with other options of its kind.
pub(super) fn with_options<K: Figure + KindSpec + Clone>(
    spec: &FigureSpec,
    change: impl FnOnce(&mut K),
) -> FigureSpec {
    let mut options = spec.kind.downcast::<K>().unwrap().clone();
    change(&mut options);
    FigureSpec {
        kind: FigureSpec::of(options).kind,
        ..spec.clone()
    }
}

fn trajectory() -> FigureSpec {
    let kind = Trajectory {
        channels: names(&["voltage", "load"]),
        agents: names(&["equal", "dsac", "ddpg"]),
        threshold: Some(3.2),
        ..Trajectory::default()
    };
    FigureSpec::of(kind)
}

#[test]
fn a_heat_map_has_its_numbers_in_the_order_of_axes() {
    let with =
        |setting: &str, value| trial("e", "a", setting, 0, &vec![(Phase::Final, 1, 0, "return", value)]);
    let results = Results::of(vec![
        with("rate=0.1 width=16", 1.0),
        with("rate=0.01 width=16", 2.0),
        with("rate=0.1 width=8", 3.0),
    ]);
    let of = Comparison {
        rows: TableAxis::Key("rate".into()),
        columns: Some(TableAxis::Key("width".into())),
        ..Comparison::default()
    };
    let chart = chart(&FigureSpec::of(HeatMap { of }), &results);
    let panel = &chart.panels[0];
    assert_eq!(
        (&panel.y.categories[..], &panel.x.categories[..]),
        (&names(&["0.1", "0.01"])[..], &names(&["8", "16"])[..])
    );
    let Shape::Cells(cells) = &panel.series[0].shape else {
        panic!("no cells")
    };
    assert_eq!(cells.values, [[Some(3.0), Some(1.0)], [None, Some(2.0)]]);
    let csv = chart.csv().unwrap();
    assert!(csv.contains("16,0.01,,,2,"), "{csv}");
    assert!(svg(&chart).unwrap().contains("rate"));
}

fn bars() -> FigureSpec {
    let of = Comparison {
        rows: Axis::Environment.into(),
        value: "cycle_length".into(),
        ..Comparison::default()
    };
    FigureSpec::of(Bars { of })
}

/// A sweep of one agent's learning rate, beside an agent without it.
fn sweep() -> (FigureSpec, Results) {
    let mut trials = Vec::new();
    for seed in 0..3 {
        let value = |value| {
            vec![
                (Phase::Final, 1, 0, "return", value),
                (Phase::Final, 1, 0, "cost", 2.0 * value + noise(seed, 1, 2)),
            ]
        };
        for (index, rate) in ["1e-5", "1e-4", "1e-3", "1e-2"].into_iter().enumerate() {
            let mean = [2.0, 5.0, 6.0, 1.0][index] + noise(seed, index as u64, 0);
            trials.push(trial(
                "e",
                "dsac",
                &format!("dsac.learning_rate={rate}"),
                seed,
                &value(mean),
            ));
        }
        trials.push(trial("e", "equal", "", seed, &value(3.0)));
    }
    let kind = GroupedLines {
        metric: "return".into(),
        x: "learning_rate".into(),
        log_x: true,
        ..GroupedLines::default()
    };
    (FigureSpec::of(kind), Results::of(trials))
}

/// A valley with a path down it.
fn contour(size: u64) -> (FigureSpec, Results) {
    let mut rows: Rows = Vec::new();
    let at = |index: u64| 4.0 * index as f64 / (size - 1) as f64 - 2.0;
    for (x, y) in (0..size).flat_map(|x| (0..size).map(move |y| (at(x), at(y)))) {
        let z = (1.0 - x).powi(2) + 5.0 * (y - x * x / 2.0).powi(2);
        rows.extend(
            [("x", x), ("y", y), ("loss", z.ln_1p())].map(|(name, value)| (Phase::Trace, 0, 0, name, value)),
        );
    }
    for step in 0..=40_u32 {
        let x = -1.5 + 2.5 * f64::from(step) / 40.0;
        let y = x * x / 2.0 + 0.4 * (-f64::from(step) / 10.0).exp();
        rows.extend(
            [("path_x", x), ("path_y", y)]
                .map(|(name, value)| (Phase::Evaluate, 10 * u64::from(step), 0, name, value)),
        );
    }
    let trials = ["dsac", "ddpg"]
        .map(|agent| trial("e", agent, "", 0, &rows))
        .into();
    let kind = Contour {
        surface: names(&["x", "y", "loss"]),
        path: names(&["path_x", "path_y"]),
        ..Contour::default()
    };
    (FigureSpec::of(kind), Results::of(trials))
}

fn scatter() -> FigureSpec {
    FigureSpec::of(Scatter {
        x: "return".into(),
        y: "cost".into(),
        ..Scatter::default()
    })
}

/// Five environments on a logarithmic axis, long names, small numbers, and a seed that stopped early.
fn many() -> (FigureSpec, Results) {
    let agents = [
        "soft_actor_critic",
        "deterministic_policy_gradient",
        "random_allocation_by_draw",
        "rule_of_thumb",
    ];
    let mut trials = Vec::new();
    for (place, environment) in ["one", "two_cells", "three_cells", "four_cells_in_series", "five"]
        .into_iter()
        .enumerate()
    {
        for (index, agent) in agents.into_iter().enumerate() {
            for seed in 0..3 {
                let at = |step: u64| {
                    1e-5 * 10f64.powf(
                        1.5 * (place as f64 - step as f64 / 1e6) + 0.1 * noise(step, index as u64, seed),
                    )
                };
                let last = if seed == 2 { 1_000_000 } else { 2_000_000 };
                let steps = (0..=last).step_by(if index < 2 { 100_000 } else { 4_000_000 });
                let mut rows: Rows = steps
                    .map(|step| (Phase::Evaluate, step, 0, "loss", at(step)))
                    .collect();
                rows.push((Phase::Final, last, 0, "loss", at(500_000 * index as u64)));
                if index < 2 {
                    rows.push((Phase::Final, last, 0, UPDATES, 1.0));
                }
                trials.push(trial(environment, agent, "", seed, &rows));
            }
        }
    }
    let kind = LearningCurve {
        metric: "loss".into(),
        band: Band::Range,
        log_y: true,
        ..LearningCurve::default()
    };
    (FigureSpec::of(kind), Results::of(trials))
}

/// Negative bars under long names.
fn changes() -> FigureSpec {
    let of = Comparison {
        value: "cycle_length".into(),
        relative_to: Some("dsac".into()),
        ..Comparison::default()
    };
    let labels = [
        ("equal", "equal split of the load"),
        ("bound", "upper bound, solved with foresight"),
    ];
    let labels = labels
        .map(|(name, label)| (name.to_owned(), label.to_owned()))
        .into();
    FigureSpec {
        labels,
        ..FigureSpec::of(Bars { of })
    }
}

/// Every kind, and hard cases.
fn all(dir: &Path) -> Vec<(&'static str, Chart)> {
    let (sweep, sweep_results) = sweep();
    let (contour, contour_results) = contour(41);
    let one = Results::of(
        study()
            .trials
            .into_iter()
            .filter(|trial| trial.trial.cell.environment == "four_cells")
            .collect(),
    );
    let mut all = vec![
        ("learning-curves", chart(&learning_curve(Band::Sd), &study())),
        ("learning-curve", chart(&learning_curve(Band::Interval), &one)),
        ("trajectory", chart(&trajectory(), &study())),
        ("bars", chart(&bars(), &study())),
        ("changes", chart(&changes(), &study())),
        ("many", chart(&many().0, &many().1)),
        ("sweep", chart(&sweep, &sweep_results)),
        ("scatter", chart(&scatter(), &sweep_results)),
        ("contour", chart(&contour, &contour_results)),
    ];
    all.extend(curve_tests::pictures(dir));
    all.extend(built_tests::pictures());
    all.extend(drawn_tests::pictures());
    all.extend(super::suite::tests::pictures());
    all
}

/// Whether a number in an SVG file is NaN; the pixels of an image are letters, which may spell `NaN`.
pub(super) fn has_nan(svg: &str) -> bool {
    ["\"NaN", " NaN", ",NaN", ">NaN"]
        .iter()
        .any(|it| svg.contains(it))
}

#[test]
#[expect(
    clippy::disallowed_methods,
    reason = "whoever looks at the pictures says where they go"
)]
fn every_kind_is_drawn_in_both_formats_and_to_the_same_bytes() {
    let dir = tempfile::tempdir().unwrap();
    // `FIGURES=DIR` keeps the pictures for inspection by eye.
    let dir: PathBuf = std::env::var_os("FIGURES").map_or_else(|| dir.path().to_owned(), Into::into);
    for (name, chart) in all(&dir) {
        let text = svg(&chart).unwrap();
        assert_eq!(text, svg(&chart).unwrap(), "{name}");
        assert!(
            text.starts_with("<svg width=\"") && text.contains("mm\"") && !has_nan(&text),
            "{name}"
        );
        std::fs::write(dir.join(name).with_extension("pdf"), super::pdf(&text).unwrap()).unwrap();
        std::fs::write(dir.join(name).with_extension("svg"), text).unwrap();
        let path = dir.join(name).with_extension("png");
        png(&chart, &path).unwrap();
        let first = std::fs::read(&path).unwrap();
        png(&chart, &path).unwrap();
        assert!(
            first == std::fs::read(&path).unwrap() && first.starts_with(b"\x89PNG"),
            "{name}"
        );
    }
}

#[test]
fn the_data_of_learning_curves() {
    let chart = chart(&learning_curve(Band::Sd), &study());
    let csv = chart.csv().unwrap();
    let thinned: Vec<&str> = csv
        .lines()
        .enumerate()
        .filter(|(index, _)| index % 12 == 0)
        .map(|(_, line)| line)
        .collect();
    insta::assert_snapshot!(thinned.join("\n"));
    let legends: Vec<String> = chart.panels[1].series.iter().map(super::Series::legend).collect();
    assert_eq!(
        legends,
        [
            "equal (n = 5)",
            "Dirichlet SAC (n = 5)",
            "ddpg (n = 3 of 5)",
            "bound (n = 5)"
        ]
    );
    assert_eq!(
        (chart.panels[0].x.label.as_str(), chart.panels[0].y.label.as_str()),
        ("environment steps", "cycle length (h)")
    );
}

#[test]
fn the_data_of_bars_and_sweeps() {
    let (sweep, results) = sweep();
    insta::assert_snapshot!("bars", chart(&bars(), &study()).csv().unwrap());
    insta::assert_snapshot!("sweep", chart(&sweep, &results).csv().unwrap());
    insta::assert_snapshot!("scatter", chart(&scatter(), &results).csv().unwrap());
}

#[test]
fn trajectories_have_a_row_per_channel_and_a_column_per_agent() {
    let chart = chart(&trajectory(), &study());
    assert_eq!((chart.panels.len(), chart.columns), (6, 3));
    let labels: Vec<&str> = chart.panels[0]
        .series
        .iter()
        .map(|series| series.label.as_str())
        .collect();
    assert_eq!(
        labels,
        [
            "voltage 1",
            "voltage 2",
            "voltage 3",
            "voltage 4",
            "threshold 3.2"
        ]
    );
    assert_eq!(chart.panels[4].series.len(), 1);
    assert_eq!(chart.notes, ["Episode 0 of seed 0 in four_cells."]);
}

#[test]
fn references_lie_behind_and_episodes_follow_each_other() {
    let mut results = study();
    let of_first = |results: &Results| {
        let kind = Trajectory {
            channels: names(&["load"]),
            references: names(&["voltage_1"]),
            agents: names(&["equal"]),
            episodes: Some(2),
            ..Trajectory::default()
        };
        chart(&FigureSpec::of(kind), results)
    };
    let points = |chart: &Chart, series: usize| match &chart.panels[0].series[series].shape {
        Shape::Line(points) => points.iter().map(|point| point.x).collect::<Vec<f64>>(),
        other => panic!("{other:?}"),
    };
    let once = of_first(&results);
    assert_eq!(once.panels[0].series[0].label, "voltage 1");
    assert_eq!(once.panels[0].series[1].label, "");
    for trial in &mut results.trials {
        let second = trial.rows.iter().filter(|row| row.phase == Phase::Trace);
        let second: Vec<_> = second
            .map(|row| contract::recorder::Row { episode: 1, ..*row })
            .collect();
        trial.rows.extend(second);
    }
    let twice = of_first(&results);
    let (one, two) = (points(&once, 1), points(&twice, 1));
    let last = one.iter().copied().fold(0.0, f64::max);
    let after: Vec<f64> = one.iter().map(|x| x + last).collect();
    assert_eq!(two, [one, after].concat());
    assert_eq!(twice.notes, ["Episodes 0 to 1 of seed 0 in four_cells."]);
}

#[test]
fn several_references_share_a_name_and_steps_are_cut_out() {
    let kind = Trajectory {
        channels: names(&["load", "voltage_3"]),
        references: names(&["voltage_1", "voltage_2"]),
        agents: names(&["equal"]),
        steps: Some([1, 2]),
        ..Trajectory::default()
    };
    let chart = chart(&FigureSpec::of(kind), &study());
    for panel in &chart.panels {
        assert_eq!(panel.series[0].label, "voltage");
        let Shape::Line(points) = &panel.series[1].shape else {
            panic!("{:?}", panel.series[1].shape);
        };
        assert_eq!(points.iter().map(|point| point.x).collect::<Vec<_>>(), [1.0, 2.0]);
    }
}

#[test]
fn a_contour_has_the_measurements_in_their_order_and_the_highest_point() {
    let (spec, results) = contour(5);
    let chart = chart(&spec, &results);
    let labels: Vec<&str> = chart.panels[1]
        .series
        .iter()
        .map(|series| series.label.as_str())
        .collect();
    assert_eq!(
        labels,
        ["", "measurements from step 0 to step 400", "highest point"]
    );
    let path = chart.panels[0].series[1].shape.points();
    assert!(path.len() == 41 && path.windows(2).all(|ends| ends[0].x < ends[1].x));
    let highest = chart.panels[0].series[2].shape.points()[0];
    assert_eq!((highest.x, highest.y), (-2.0, -2.0));
    assert_eq!(
        chart.notes,
        ["Seed 0; a point is the mean over the episodes of a measurement."]
    );
}

#[test]
fn an_agent_has_one_colour_in_all_figures() {
    let color = |chart: &Chart, label: &str| {
        let series = chart
            .panels
            .iter()
            .flat_map(|panel| &panel.series)
            .find(|series| series.label == label);
        series.map(|series| series.style.color())
    };
    let (sweep, results) = sweep();
    let (curve, bars, sweep) = (
        chart(&learning_curve(Band::None), &study()),
        chart(&bars(), &study()),
        chart(&sweep, &results),
    );
    assert_eq!(color(&curve, "Dirichlet SAC"), color(&bars, "dsac"));
    assert_eq!(color(&curve, "equal"), color(&sweep, "equal"));
    assert_ne!(color(&curve, "equal"), color(&curve, "Dirichlet SAC"));
}

#[test]
fn nothing_to_draw_is_said() {
    let agents = Vec::new();
    let units = BTreeMap::new();
    let results = study();
    let message = |spec: &FigureSpec| {
        build(
            spec,
            Context {
                results: &results,
                agents: &agents,
                units: &units,
                better: &BTreeMap::new(),
            },
        )
        .unwrap_err()
        .to_string()
    };
    let unknown = LearningCurve {
        metric: "nothing".into(),
        ..LearningCurve::default()
    };
    assert!(message(&FigureSpec::of(unknown)).contains("no trial has recorded"));
    let untraced = Trajectory {
        channels: names(&["pressure"]),
        ..Trajectory::default()
    };
    assert!(message(&FigureSpec::of(untraced)).contains("no trial has recorded a trace"));
}

#[test]
fn measurements_before_a_step_are_left_out_of_line_and_average() {
    let spec = learning_curve(Band::Sd);
    let of = |spec: &FigureSpec| {
        let series = chart(spec, &study()).panels[0].series.clone();
        let line = series.into_iter().find_map(|series| match series.shape {
            Shape::Curve(curve) => Some(curve.points),
            _ => None,
        });
        line.unwrap()
    };
    let whole = of(&spec);
    let from = whole[2].x;
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a step")]
    let step = from as u64;
    let late = of(&with_options(&spec, |curve: &mut LearningCurve| {
        (curve.from_step, curve.smooth) = (step, 0.9);
    }));
    assert_eq!((late.len() + 2, &late[0]), (whole.len(), &whole[2]));
    assert_ne!(late[1], whole[3]);
    let after_the_end = with_options(&spec, |curve: &mut LearningCurve| curve.from_step = u64::MAX);
    assert!(of(&after_the_end).is_empty());
}

#[test]
fn a_long_label_of_an_axis_stays_on_the_paper() {
    let long = "a label of the vertical axis that is far longer than one line beside the plot can be";
    let spec = FigureSpec {
        y_label: Some(long.into()),
        ..learning_curve(Band::Sd)
    };
    let drawing = super::layout::draw(&chart(&spec, &study()));
    let upright = drawing.marks.iter().filter_map(|mark| match mark {
        super::paint::Mark::Text {
            at,
            text,
            upright: true,
            ..
        } => Some((at.0, text.clone())),
        _ => None,
    });
    let lines: Vec<_> = upright.collect();
    assert!(
        lines.len() > 1 && lines.iter().all(|(x, _)| *x > 4.0),
        "{lines:?}"
    );
    assert_eq!(
        lines
            .iter()
            .map(|(_, text)| text.as_str())
            .collect::<Vec<_>>()
            .join(" "),
        long
    );
}
