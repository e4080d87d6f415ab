//! The lines of learning curves as data for the page's own plot: the drawn lines, the single runs that are not drawn,
//! and the trial of each run.

use super::{
    chart::{Chart, Panel, Point, Series},
    on_dark::hex,
    shape::RunLine,
};
use serde_json::{Map, Value, json};

/// Largest number of points of a line. Longer lines are thinned, keeping the smallest and the largest value of each
/// stretch.
const MOST: usize = 400;

/// The panels of a chart that shows only lines with runs, and references; `None` for any other chart.
#[must_use]
pub fn plot_data(chart: &Chart) -> Option<Value> {
    let mut all = chart.panels.iter().flat_map(|panel| &panel.series);
    if all.all(|series| series.shape.form().is_reference()) {
        return None;
    }
    let panels: Vec<Value> = chart.panels.iter().map(panel).collect::<Option<_>>()?;
    Some(json!({ "columns": chart.columns.max(1), "panels": panels }))
}

fn panel(panel: &Panel) -> Option<Value> {
    let series = panel.series.iter().map(|it| series(it, panel.y.log));
    Some(json!({
        "title": panel.title, "x": panel.x.label, "y": panel.y.label, "log": panel.y.log,
        "series": series.collect::<Option<Vec<_>>>()?,
    }))
}

fn series(series: &Series, log: bool) -> Option<Value> {
    let style = series.style;
    let mut data = Map::from_iter([
        ("label".to_owned(), json!(series.label)),
        ("legend".to_owned(), json!(series.legend())),
        (
            "light".to_owned(),
            json!([hex(style.color()), hex(style.light())]),
        ),
        ("dark".to_owned(), json!([hex(style.on_dark()), hex(style.dim())])),
    ]);
    if series.is_other() {
        data.insert("other".into(), json!(true));
    }
    data.extend(series.shape.form().plot_data(style, log)?);
    Some(Value::Object(data))
}

/// The points of a line, and the band around it.
pub(super) fn line(points: &[Point], log: bool) -> Map<String, Value> {
    let points = thinned(points);
    let x = numbers(points.iter().map(|point| point.x));
    let mut data = Map::from_iter([("x".to_owned(), x), ("y".to_owned(), heights(&points, log))]);
    if points.iter().any(|point| point.interval.is_some()) {
        let end =
            |of: fn((f64, f64)) -> f64| numbers(points.iter().map(|it| it.interval.map_or(f64::NAN, of)));
        data.insert("low".into(), end(|(low, _)| low));
        data.insert("high".into(), end(|(_, high)| high));
    }
    data
}

/// A run; it has steps of its own only if they differ from those of the line.
pub(super) fn run(run: &RunLine, steps: &Value, log: bool) -> Value {
    let points = thinned(&run.points);
    let x = numbers(points.iter().map(|point| point.x));
    let mut data = json!({
        "name": run.name, "trial": run.trial, "y": heights(&points, log),
    });
    if x != *steps {
        data["x"] = x;
    }
    data
}

/// The points; too many are reduced to the lowest and the highest of each stretch, in order, with both ends.
fn thinned(points: &[Point]) -> Vec<Point> {
    if points.len() <= MOST {
        return points.to_vec();
    }
    let stretch = points.len().div_ceil(MOST / 2 - 1);
    let extremes = |points: &[Point]| {
        let by_height = |one: &&Point, other: &&Point| one.y.total_cmp(&other.y);
        let ends = [points.iter().min_by(by_height), points.iter().max_by(by_height)];
        let mut ends: Vec<Point> = ends.into_iter().flatten().copied().collect();
        ends.sort_by(|one, other| one.x.total_cmp(&other.x));
        ends.dedup();
        ends
    };
    let (last, inner) = points[1..]
        .split_last()
        .map_or((None, &points[1..]), |(last, inner)| (Some(last), inner));
    let first = points.first().copied();
    let inner = inner.chunks(stretch).flat_map(extremes);
    first.into_iter().chain(inner).chain(last.copied()).collect()
}

/// The vertical values, without those that have no place on a logarithmic axis.
fn heights(points: &[Point], log: bool) -> Value {
    let height = |point: &Point| if log && point.y <= 0.0 { f64::NAN } else { point.y };
    numbers(points.iter().map(height))
}

fn numbers(values: impl Iterator<Item = f64>) -> Value {
    values.map(number).collect()
}

/// A number with six digits, more than a screen shows; whole numbers stay whole.
pub(super) fn number(value: f64) -> Value {
    #[allow(clippy::cast_possible_truncation, reason = "a whole number below 2^53")]
    if value.fract() == 0.0 && value.abs() < 9e15 {
        return json!(value as i64);
    }
    format!("{value:.5e}")
        .parse::<f64>()
        .map_or(Value::Null, |value| json!(value))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::figure::{Curve, CurveSource, Shape, Style};
    use proptest::prelude::*;

    fn points(values: &[f64]) -> Vec<Point> {
        let place = |(step, y): (usize, &f64)| Point {
            x: u32::try_from(step).unwrap().into(),
            y: *y,
            interval: None,
        };
        values.iter().enumerate().map(place).collect()
    }

    fn chart(shapes: Vec<Shape>) -> Chart {
        let one = |shape| Series {
            label: "dsac".into(),
            seeds: Some((2, 3)),
            style: Style::of_agent(0),
            shape,
        };
        Chart {
            panels: vec![Panel {
                series: shapes.into_iter().map(one).collect(),
                ..Panel::default()
            }],
            columns: 0,
            ..Chart::default()
        }
    }

    fn curve() -> Curve {
        let run = |name: &str, values: &[f64]| RunLine {
            name: name.into(),
            trial: format!("id-{name}"),
            points: points(values),
        };
        Curve {
            of: CurveSource::Learner,
            points: points(&[1.0, 1.0 / 3.0]),
            runs: Vec::new(),
            undrawn: vec![run("seed 0", &[1.0, 0.5]), run("seed 1", &[f64::NAN])],
            at_the_ends: None,
        }
    }

    #[test]
    fn lines_runs_and_levels_are_there_with_their_looks() {
        let data = plot_data(&chart(vec![Shape::Curve(curve()), Shape::Level(2.5)])).unwrap();
        let series = &data["panels"][0]["series"];
        assert_eq!(data["columns"], 1);
        assert_eq!(
            series[0],
            json!({
                "label": "dsac", "legend": "dsac (n = 2 of 3)", "light": ["#0072b2", "#9ac7e1"], "dark": series[0]["dark"],
                "dash": [], "x": [0, 1], "y": [1, 0.333_333], "drawn": false,
                "runs": [{ "name": "seed 0", "trial": "id-seed 0", "y": [1, 0.5] },
                    { "name": "seed 1", "trial": "id-seed 1", "x": [0], "y": [null] }],
            })
        );
        assert_eq!(
            (&series[1]["level"], &series[1]["dash"]),
            (&json!(2.5), &json!([2.4, 1.6]))
        );
    }

    #[test]
    fn what_has_no_curve_or_more_than_curves_is_not_plotted() {
        assert_eq!(plot_data(&chart(vec![Shape::Level(1.0)])), None);
        assert_eq!(
            plot_data(&chart(vec![Shape::Curve(curve()), Shape::Points(points(&[1.0]))])),
            None
        );
    }

    proptest! {
        #[test]
        fn thinned_lines_keep_their_ends_and_extremes(values in prop::collection::vec(-1e3f64..1e3, 2..3000)) {
            let all = points(&values);
            let thin = thinned(&all);
            prop_assert!(thin.len() <= MOST.max(2));
            prop_assert_eq!((thin.first(), thin.last()), (all.first(), all.last()));
            prop_assert!(thin.is_sorted_by(|one, next| one.x < next.x));
            let most = |points: &[Point]| points.iter().map(|it| it.y).fold(f64::MIN, f64::max);
            let least = |points: &[Point]| points.iter().map(|it| it.y).fold(f64::MAX, f64::min);
            prop_assert_eq!((most(&thin), least(&thin)), (most(&all), least(&all)));
        }
    }
}
