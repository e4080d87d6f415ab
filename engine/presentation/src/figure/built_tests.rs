//! Figures built of synthetic results: lines of one point.

use super::{
    Band, Chart, Curve, FigureSpec, LearningCurve, SeedLines, Shape, 
    layout::draw,
    paint::Mark,
    tests::{chart, names},
};
use analysis::results::Results;
use contract::{Phase, standard_metrics::UPDATES};
use testing::synthetic::{Rows, noise, trial};

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
