//! Learning curves of synthetic results: lines, bands, seeds, published curves, and their notes.

use super::{
    Band, Chart, Context, CurveSource, FigureSpec, LearningCurve, Line, SeedLines, Shape, build,
    tests::{chart, learning_curve, with_options},
};
use analysis::{published_curve::PublishedCurve, results::Results};
use contract::{Phase, standard_metrics::UPDATES};
use std::{collections::BTreeMap, path::Path};
use testing::synthetic::study;
use testing::synthetic::{Rows, noise, trial};

/// Agents that learn to reach at most 10, from seeds that mostly succeed, and a rule.
fn climbers(agents: usize, seeds: u64) -> Results {
    let mut trials = Vec::new();
    for (index, seed) in (0..agents).flat_map(|index| (0..seeds).map(move |seed| (index, seed))) {
        let top = if noise(seed, index as u64, 5) > 0.8 {
            2.0
        } else {
            10.0 - 0.6 * index as f64
        };
        let learns = index + 1 < agents;
        let at = |step: u64| {
            let grown = if learns {
                1.0 - (-(step as f64) / (200.0 + 120.0 * index as f64)).exp()
            } else {
                0.8
            };
            (top * grown + 1.5 * noise(step, index as u64, seed)).clamp(0.05, 10.0)
        };
        let mut rows: Rows = (0..=2000)
            .step_by(20)
            .map(|step| (Phase::Evaluate, step, 0, "return", at(step)))
            .collect();
        rows.push((Phase::Final, 2000, 0, "return", at(2000)));
        if learns {
            rows.push((Phase::Final, 2000, 0, UPDATES, 2000.0));
        }
        trials.push(trial(
            "e",
            CLIMBERS[index + CLIMBERS.len() - agents],
            "",
            seed,
            &rows,
        ));
    }
    Results::of(trials)
}

/// Agents of [`climbers`]; the last one does not learn.
const CLIMBERS: [&str; 6] = ["one", "two", "three", "four", "five", "rule"];

fn climb(change: impl Fn(&mut LearningCurve), agents: usize, seeds: u64) -> Chart {
    let mut kind = LearningCurve {
        smooth: 0.7,
        ..LearningCurve::default()
    };
    change(&mut kind);
    let spec = FigureSpec::of(kind);
    let (names, units) = (
        CLIMBERS[CLIMBERS.len() - agents..]
            .iter()
            .map(|name| (*name).into())
            .collect::<Vec<_>>(),
        BTreeMap::new(),
    );
    build(
        &spec,
        Context {
            results: &climbers(agents, seeds),
            agents: &names,
            units: &units,
            better: &BTreeMap::new(),
        },
    )
    .unwrap()
}

/// Logs of two authors that continue after the study has ended. The first author has three runs, one with an early end.
fn logs(dir: &Path) -> Vec<PublishedCurve> {
    let mut text = String::from("author,run,step,return\n");
    for (author, run, last) in [
        ("first", 1, 4000),
        ("first", 2, 4000),
        ("first", 3, 1300),
        ("second", 1, 4000),
    ] {
        for step in (0..=last).step_by(100) {
            let grown = 1.0 - (-f64::from(step) / (300.0 + 60.0 * f64::from(run))).exp();
            let value =
                if author == "first" { 8.5 } else { 6.0 } * grown + 0.5 * noise(step as u64, run as u64, 3);
            text += &format!("{author},{run},{step},{value}\n");
        }
    }
    std::fs::write(dir.join("logs.csv"), text).unwrap();
    let curve = |label: &str, author: &str| PublishedCurve {
        label: label.into(),
        file: dir.join("logs.csv"),
        step: "step".into(),
        value: "return".into(),
        rows: BTreeMap::from([("author".into(), author.into())]),
        ..PublishedCurve::default()
    };
    let first = PublishedCurve {
        agent: Some("four".into()),
        by: Some("run".into()),
        ..curve("four, as published", "first")
    };
    vec![first, curve("others", "second")]
}

/// Learning curves for inspection by eye.
pub(super) fn pictures(dir: &Path) -> Vec<(&'static str, Chart)> {
    let logs = logs(dir);
    vec![
        ("three-seeds", climb(|_| (), 4, 3)),
        ("six-agents", climb(|_| (), 6, 5)),
        ("ten-seeds", climb(|kind| kind.line = Line::Median, 4, 10)),
        (
            "fifty-seeds",
            climb(|kind| kind.seeds = SeedLines::Said(true), 3, 50),
        ),
        ("fifty-seeds-band", climb(|_| (), 3, 50)),
        ("sd", climb(|kind| kind.band = Band::Sd, 3, 5)),
        ("log", climb(|kind| kind.log_y = true, 4, 6)),
        (
            "log-seeds",
            climb(|kind| (kind.log_y, kind.smooth) = (true, 0.0), 4, 3),
        ),
        ("published", climb(|kind| kind.published.clone_from(&logs), 4, 5)),
    ]
}

fn curves(chart: &Chart) -> Vec<&super::Curve> {
    let series = chart.panels.iter().flat_map(|panel| &panel.series);
    series
        .filter_map(|series| {
            if let Shape::Curve(curve) = &series.shape {
                Some(curve)
            } else {
                None
            }
        })
        .collect()
}

#[test]
fn smoothed_lines_stay_in_their_bands() {
    let spec = |band, line| {
        with_options(&learning_curve(band), |curve: &mut LearningCurve| {
            (curve.smooth, curve.line) = (0.95, line);
        })
    };
    for (band, line) in [
        (Band::Interval, Line::Mean),
        (Band::Sd, Line::Median),
        (Band::Range, Line::Iqm),
        (Band::Interval, Line::Iqm),
    ] {
        for curve in curves(&chart(&spec(band, line), &study())) {
            for point in &curve.points {
                let (low, high) = point.interval.unwrap();
                assert!(low <= point.y && point.y <= high, "{band:?} {line:?} {point:?}");
            }
        }
    }
}

#[test]
fn few_seeds_are_thin_lines_and_many_have_a_band() {
    let (few, many) = (climb(|_| (), 4, 5), climb(|_| (), 4, 6));
    assert!(
        curves(&few)
            .iter()
            .all(|it| it.runs.len() == 5 && it.points.iter().all(|point| point.interval.is_none()))
    );
    assert!(
        curves(&many)
            .iter()
            .all(|it| it.runs.is_empty() && it.points.iter().all(|point| point.interval.is_some()))
    );
    let names: Vec<&str> = curves(&few)[0].runs.iter().map(|run| run.name.as_str()).collect();
    assert_eq!(names, ["seed 0", "seed 1", "seed 2", "seed 3", "seed 4"]);
    let ends = |chart: &Chart| {
        chart.panels[0]
            .series
            .iter()
            .flat_map(|series| series.shape.heights())
            .fold(0.0, f64::max)
    };
    assert!(
        ends(&few) <= 10.0 && ends(&many) <= 10.0,
        "no axis shows more than the return can be"
    );
    assert!(
        curves(&climb(|_| (), 2, 1)).iter().all(|it| it.runs.is_empty()),
        "a single seed is the line"
    );
    // Each thin line is a smoothed seed, and each point of the line is their mean.
    let (curve, last) = (curves(&few)[0], curves(&few)[0].points.len() - 1);
    let mean = curve.runs.iter().map(|run| run.points[last].y).sum::<f64>() / 5.0;
    assert!((mean - curve.points[last].y).abs() < 1e-12);
}

#[test]
fn the_legend_has_one_entry_per_agent() {
    let drawing = super::layout::draw(&climb(|_| (), 6, 5));
    let texts = drawing.marks.iter().filter_map(|mark| match mark {
        super::paint::Mark::Text { text, .. } if text.contains("n =") => Some(text.as_str()),
        _ => None,
    });
    assert_eq!(
        texts.collect::<Vec<_>>(),
        CLIMBERS.map(|name| format!("{name} (n = 5)"))
    );
}

#[test]
fn a_published_curve_of_the_same_name_has_its_own_entry() {
    let dir = tempfile::tempdir().unwrap();
    let named = PublishedCurve {
        label: "three".into(),
        agent: Some("three".into()),
        by: None,
        ..logs(dir.path()).remove(1)
    };
    let drawing = super::layout::draw(&climb(|kind| kind.published = vec![named.clone()], 4, 5));
    let is_entry = |mark: &&super::paint::Mark| {
        matches!(mark, super::paint::Mark::Text { text,
        .. } if text.starts_with("three"))
    };
    assert_eq!(drawing.marks.iter().filter(is_entry).count(), 2);
}

#[test]
fn agents_that_do_not_learn_have_curves_where_they_were_measured_and_levels_where_not() {
    let measured = climb(|_| (), 4, 5);
    let kinds: Vec<CurveSource> = curves(&measured).iter().map(|curve| curve.of).collect();
    assert_eq!(
        kinds,
        [
            CurveSource::Learner,
            CurveSource::Learner,
            CurveSource::Learner,
            CurveSource::NonLearner
        ]
    );
    assert_eq!(curves(&measured)[3].points.len(), 101);
    let note = |chart: &Chart| chart.notes.join(" ");
    assert!(
        note(&measured).contains("Short dashes are agents that do not learn.")
            && !note(&measured).contains("levels")
    );
    let earlier = chart(&learning_curve(Band::Auto), &study());
    assert!(matches!(earlier.panels[0].series[0].shape, Shape::Level(_)));
    assert!(note(&earlier).contains("levels are final measurements on other episodes than the curves."));
}

#[test]
fn published_curves_end_with_the_study_and_are_in_its_data() {
    let dir = tempfile::tempdir().unwrap();
    let logs = logs(dir.path());
    let chart = climb(|kind| kind.published.clone_from(&logs), 4, 5);
    let series = &chart.panels[0].series[4..];
    let legends: Vec<String> = series.iter().map(super::Series::legend).collect();
    assert_eq!(legends, ["four, as published (n = 3)", "others"]);
    let four = chart.panels[0]
        .series
        .iter()
        .find(|series| series.label == "four")
        .unwrap();
    assert_eq!(series[0].style.color(), four.style.color());
    assert_ne!(series[1].style.color(), four.style.color());
    // The mean ends with the shortest run; the runs end with the study.
    let ends = |shape: &Shape| {
        (
            shape.points().last().unwrap().x,
            shape.runs().first().map(|run| run.points.last().unwrap().x),
        )
    };
    assert_eq!(
        (ends(&series[0].shape), ends(&series[1].shape)),
        ((1300.0, Some(2000.0)), (2000.0, None))
    );
    let csv = chart.csv().unwrap();
    let line = |start: &str| {
        csv.lines()
            .find(|line| line.starts_with(start))
            .unwrap()
            .to_owned()
    };
    assert!(line("1,\"four, as published\",3,1300,").ends_with(','));
    assert!(
        csv.lines()
            .any(|line| line.starts_with("1,\"four, as published\",3,1400,") && line.ends_with(",1"))
    );
    assert!(line("1,others,,2000,").ends_with(','));
    let hidden = climb(
        |kind| (kind.seeds, kind.published) = (SeedLines::Said(false), logs.clone()),
        4,
        5,
    );
    assert!(curves(&hidden).iter().all(|curve| curve.runs.is_empty()));
}

#[test]
fn published_curves_are_smoothed_as_the_seeds_are() {
    let dir = tempfile::tempdir().unwrap();
    let logs = logs(dir.path());
    let of = |smooth| {
        climb(
            |kind| (kind.smooth, kind.published) = (smooth, logs[1..].to_vec()),
            4,
            5,
        )
    };
    let heights = |chart: &Chart| {
        curves(chart)[4]
            .points
            .iter()
            .map(|point| point.y)
            .collect::<Vec<f64>>()
    };
    let average = statistics::estimators::moving_average(&heights(&of(0.0)), 0.8);
    assert_eq!(heights(&of(0.8)), average);
}

#[test]
fn a_published_curve_that_cannot_be_read_is_said() {
    let dir = tempfile::tempdir().unwrap();
    let published = PublishedCurve {
        value: "score".into(),
        ..logs(dir.path()).remove(1)
    };
    let kind = LearningCurve {
        published: vec![published],
        ..LearningCurve::default()
    };
    let spec = FigureSpec::of(kind);
    let (agents, units) = (Vec::new(), BTreeMap::new());
    let error = build(
        &spec,
        Context {
            results: &climbers(2, 2),
            agents: &agents,
            units: &units,
            better: &BTreeMap::new(),
        },
    )
    .unwrap_err()
    .to_string();
    assert!(
        error.starts_with("published curve `others`: ") && error.ends_with("has no column `score`"),
        "{error}"
    );
}

/// The complete note of a figure with every element, and the sentences of other figures that differ.
#[test]
fn notes_say_what_is_drawn() {
    let dir = tempfile::tempdir().unwrap();
    let logs = logs(dir.path());
    let note = |change: &dyn Fn(&mut LearningCurve), seeds| climb(change, 4, seeds).notes.join(" ");
    assert_eq!(
        note(&|kind| (kind.from_step, kind.published) = (100, logs.clone()), 5),
        "Lines are means over n seeds, from step 100 on. \
         The curve of each seed was smoothed first, by a moving average (weight of the past 0.7). \
         Thin lines are the seeds. Short dashes are agents that do not learn. \
         Dotted lines are published curves, means over their runs where all of these have a value, with \
         thin lines for the runs, \
         smoothed in the same way, as far as the curves of this study go."
    );
    let plain = note(
        &|kind| (kind.smooth, kind.published) = (0.0, logs[1..].to_vec()),
        6,
    );
    assert!(
        plain.ends_with(" Dotted lines are published curves, as far as the curves of this study go."),
        "{plain}"
    );
    let bands = |change: &dyn Fn(&mut LearningCurve), seeds| {
        let note = note(change, seeds);
        let sentence = note.split(". ").find(|sentence| sentence.starts_with("Bands"));
        sentence
            .unwrap_or_default()
            .trim_start_matches("Bands are ")
            .to_owned()
    };
    assert_eq!(
        bands(&|_| (), 6),
        "95 % Student-t intervals of the mean, cut at the smallest and the largest seed"
    );
    assert_eq!(
        bands(&|kind| kind.seeds = SeedLines::Said(false), 5),
        "95 % Student-t intervals of the mean, cut at the smallest and the largest seed from 6 seeds on; \
         with fewer they may leave the range of possible values"
    );
    assert_eq!(
        bands(&|kind| kind.line = Line::Median, 6),
        "95 % percentile bootstrap intervals of the median"
    );
    assert_eq!(
        bands(&|kind| kind.line = Line::Iqm, 6),
        "95 % percentile bootstrap intervals of the interquartile mean"
    );
    assert_eq!(
        bands(&|kind| kind.band = Band::Sd, 5),
        "one standard deviation to each side, which may leave the range of possible values"
    );
    assert_eq!(
        bands(&|kind| kind.band = Band::Range, 6),
        "from the smallest to the largest seed"
    );
    assert_eq!(
        (bands(&|kind| kind.band = Band::None, 6), bands(&|_| (), 5)),
        (String::new(), String::new())
    );
}

#[test]
fn notes_tell_panels_with_few_seeds_from_others() {
    let mut results = climbers(3, 6);
    let few = climbers(3, 4).trials.into_iter().map(|mut it| {
        it.trial_mut().cell_mut().environment = "few".into();
        it
    });
    results.trials.extend(few);
    let spec = FigureSpec::of(LearningCurve::default());
    let notes = chart(&spec, &results).notes.join(" ");
    assert!(
        notes.contains("Thin lines are the seeds, in panels where an agent has at most 5."),
        "{notes}"
    );
    assert!(
        notes.contains("smallest and the largest seed, in the other panels."),
        "{notes}"
    );
}

#[test]
fn what_an_agent_records_of_itself_is_drawn_where_nobody_measures_it() {
    let rows: Rows = vec![
        (Phase::Train, 10, 0, "loss", 4.0),
        (Phase::Train, 20, 0, "loss", 2.0),
        (Phase::Train, 20, 0, "return", 7.0),
        (Phase::Evaluate, 20, 0, "return", 5.0),
        (Phase::Final, 20, 0, UPDATES, 20.0),
    ];
    let results = Results::of(vec![trial("e", "learner", "", 0, &rows)]);
    assert_eq!(results.trials[0].while_learning("loss"), [(10, 4.0), (20, 2.0)]);
    assert_eq!(results.trials[0].while_learning("return"), [(20, 5.0)]);
    let spec = FigureSpec::of(LearningCurve {
        metric: "loss".into(),
        ..LearningCurve::default()
    });
    let Shape::Curve(curve) = &chart(&spec, &results).panels[0].series[0].shape else {
        panic!("no curve")
    };
    let points: Vec<(f64, f64)> = curve.points.iter().map(|point| (point.x, point.y)).collect();
    assert_eq!(points, [(10.0, 4.0), (20.0, 2.0)]);
}
