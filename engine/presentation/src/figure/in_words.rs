//! Describes a chart in one or two sentences, for readers who cannot see it: its kind, its axes, and the last values of
//! its series.

use super::{
    chart::{Chart, Panel, Point, Scale, Series},
    drawn,
    shape::Shape,
};
use crate::table::NumberFormat;

/// Largest number of values in the sentences; the tables and the file of the figure hold all.
const MOST: usize = 12;

impl Chart {
    /// The chart in one or two sentences, composed from its data.
    #[must_use]
    pub fn in_words(&self) -> String {
        if drawn::shapes(self).any(|(_, _, shape)| !shape.form().has_axes()) {
            return drawn_in_words(self);
        }
        if let Some(words) = upright_axes(self) {
            return words;
        }
        let all: Vec<String> = self.panels.iter().flat_map(panel_values).collect();
        let more = all.len().saturating_sub(MOST);
        let more = if more > 0 {
            format!("; and {more} more")
        } else {
            String::new()
        };
        let told: Vec<String> = all.into_iter().take(MOST).collect();
        let (drawing, values) = nouns(self);
        let told = if told.is_empty() {
            String::new()
        } else {
            format!(" {values}: {}{more}.", told.join("; "))
        };
        format!("{drawing}{}: {}.{told}", panels(self), axes(self))
    }
}

/// Nouns for the drawing and for its values, chosen by the first series that is not just a reference.
fn nouns(chart: &Chart) -> (&'static str, &'static str) {
    let mut series = chart.panels.iter().flat_map(|panel| &panel.series);
    let first = series.find(|series| !series.shape.form().is_reference());
    first.map_or(("Lines", "Last values"), |series| series.shape.form().nouns())
}

fn panels(chart: &Chart) -> String {
    let titles: Vec<&str> = chart
        .panels
        .iter()
        .map(|panel| panel.title.as_str())
        .filter(|title| !title.is_empty())
        .collect();
    match (chart.panels.len(), titles.is_empty()) {
        (0 | 1, true) => String::new(),
        (n, true) => format!(" in {n} panels"),
        (0 | 1, false) => format!(" in {}", titles[0]),
        (n, false) => format!(" in {n} panels ({})", titles.join(", ")),
    }
}

/// The vertical against the horizontal quantity, each label once; the horizontal axis with its ends.
fn axes(chart: &Chart) -> String {
    let labels = |axis: fn(&Panel) -> &Scale| {
        let mut labels: Vec<String> = Vec::new();
        for scale in chart
            .panels
            .iter()
            .map(axis)
            .filter(|scale| !scale.label.is_empty())
        {
            let log = if scale.log { ", logarithmic" } else { "" };
            let label = format!("{}{log}", scale.label);
            if !labels.contains(&label) {
                labels.push(label);
            }
        }
        labels.join(" and ")
    };
    let (x, y) = (labels(|panel| &panel.x), labels(|panel| &panel.y));
    let Some(panel) = chart.panels.first() else {
        return "nothing".into();
    };
    let ends = ends(panel.series.iter().flat_map(|series| series.shape.places()));
    let ends = match ends {
        Some((low, high)) if panel.x.categories.is_empty() => {
            let format = NumberFormat::fitting([low, high].into_iter());
            format!(", {} to {}", short(format, low), short(format, high))
        }
        _ => String::new(),
    };
    match (y.is_empty(), x.is_empty()) {
        (false, false) => format!("{y} against {x}{ends}"),
        (false, true) => y,
        (true, _) => format!("{x}{ends}"),
    }
}

/// The names of upright axes; `None` if there are none.
fn upright_axes(chart: &Chart) -> Option<String> {
    let panel = chart
        .panels
        .iter()
        .find(|panel| !panel.upright_axes().is_empty())?;
    Some(format!(
        "Lines over upright axes: {}.",
        panel.x.categories.join(", ")
    ))
}

fn ends(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    values
        .filter(|value| value.is_finite())
        .fold(None, |ends: Option<(f64, f64)>, value| {
            Some(ends.map_or((value, value), |(low, high)| (low.min(value), high.max(value))))
        })
}

/// A number, without its decimals if all of them are zero.
fn short(format: NumberFormat, value: f64) -> String {
    if value.fract() == 0.0 && value.abs() < 1e15 {
        format!("{value:.0}")
    } else {
        format.write(value)
    }
}

/// The values of a panel: a text for each series that has a name or is alone.
fn panel_values(panel: &Panel) -> Vec<String> {
    let told = panel
        .series
        .iter()
        .flat_map(|series| series.shape.form().told_values());
    let format = NumberFormat::fitting(told);
    let place = if panel.title.is_empty() {
        String::new()
    } else {
        format!("{}, ", panel.title)
    };
    let of_series = |series: &Series| {
        let name = if series.label.is_empty() {
            String::new()
        } else {
            format!("{} ", series.label)
        };
        let values = series.shape.form().in_words(panel, format)?;
        Some(format!("{place}{name}{values}"))
    };
    panel.series.iter().filter_map(of_series).collect()
}

/// The lowest and the highest of some values, each with its place if it has one; `None` if no value is finite.
pub(super) fn span_of(
    label: &str,
    values: impl Iterator<Item = f64>,
    place: impl Fn(f64) -> Option<String>,
) -> Option<String> {
    let (low, high) = ends(values)?;
    let format = NumberFormat::fitting([low, high].into_iter());
    let told = |value: f64| {
        let place = place(value).map_or_else(String::new, |place| format!(" ({place})"));
        format!("{}{place}", format.write(value))
    };
    Some(format!("{label} from {} to {}", told(low), told(high)))
}

/// Number of some points, as text.
pub(super) fn number_of(points: &[Point]) -> String {
    match points.len() {
        1 => "1 point".into(),
        n => format!("{n} points"),
    }
}

/// Values with the names of their places; bars of a group lie near the place of its name.
pub(super) fn at_names(points: &[Point], names: &Scale, format: NumberFormat) -> String {
    let one = |point: &Point| {
        let name = names.name_at(point.x).unwrap_or_default();
        format!("{name} {}", format.write(point.y)).trim().to_owned()
    };
    points
        .iter()
        .filter(|point| point.y.is_finite())
        .map(one)
        .collect::<Vec<_>>()
        .join(", ")
}

/// Drawings without axes, panel by panel, as text.
fn drawn_in_words(chart: &Chart) -> String {
    let one = |(index, panel, shape): (usize, &Panel, &Shape)| {
        let form = shape.form();
        let words = form.in_words(panel, NumberFormat::fitting(form.told_values()));
        let words = words.filter(|_| !form.has_axes())?;
        Some(format!("{}: {words}", panel.name(index)))
    };
    let parts: Vec<String> = drawn::shapes(chart).filter_map(one).collect();
    format!("Drawings without axes. {}.", parts.join("; "))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::figure::{Curve, CurveSource, Style, Tiles};
    use contract::drawing::{Edge, Graph, Node};

    fn point(x: f64, y: f64) -> Point {
        Point { x, y, interval: None }
    }

    fn series(label: &str, shape: Shape) -> Series {
        Series {
            label: label.into(),
            seeds: Some((5, 5)),
            style: Style::default(),
            shape,
        }
    }

    fn curve(last: f64) -> Shape {
        Shape::Curve(Curve {
            of: CurveSource::Learner,
            points: vec![point(0.0, 1.0), point(60_000.0, last), point(60_000.0, f64::NAN)],
            runs: Vec::new(),
            undrawn: Vec::new(),
            at_the_ends: None,
        })
    }

    fn chart(panels: Vec<Panel>) -> Chart {
        Chart {
            panels,
            columns: 1,
            ..Chart::default()
        }
    }

    fn panel(title: &str, x: &str, y: &str, series: Vec<Series>) -> Panel {
        let scale = |label: &str| Scale {
            label: label.into(),
            ..Scale::default()
        };
        Panel {
            title: title.into(),
            x: scale(x),
            y: scale(y),
            series,
        }
    }

    #[test]
    fn learning_curves_are_told_with_axes_and_last_values() {
        let lines = |last| vec![series("dsac", curve(last)), series("equal", Shape::Level(10.0))];
        let mut one = panel("four", "environment steps", "cycle length (h)", lines(11.62));
        one.y.log = true;
        assert_eq!(
            chart(vec![one.clone()]).in_words(),
            "Curves in four: cycle length (h), logarithmic against environment steps, 0 to 60000. Last values: \
             four, dsac 11.62; four, equal 10.00."
        );
        let two = Panel {
            title: "eight".into(),
            series: lines(20.0),
            ..one.clone()
        };
        let words = chart(vec![one, two]).in_words();
        assert!(
            words.starts_with("Curves in 2 panels (four, eight): cycle length (h)"),
            "{words}"
        );
        assert!(
            words.ends_with("eight, dsac 20.00; eight, equal 10.00."),
            "{words}"
        );
    }

    #[test]
    fn long_lists_are_cut() {
        let many = (0..20)
            .map(|n| series(&format!("a{n}"), curve(f64::from(n))))
            .collect();
        let words = chart(vec![panel("", "x", "y", many)]).in_words();
        assert!(
            words.contains("a11 11.00; and 8 more.") && !words.contains("a12"),
            "{words}"
        );
    }

    #[test]
    fn bars_points_and_drawings_are_told_by_what_they_show() {
        let mut bars = panel(
            "",
            "",
            "cycle length (h)",
            vec![series(
                "dsac",
                Shape::Bars(vec![point(0.1, 3.0), point(1.1, 4.0)], 0.2),
            )],
        );
        bars.x.categories = vec!["four".into(), "eight".into()];
        assert_eq!(
            chart(vec![bars]).in_words(),
            "Bars: cycle length (h). Values: dsac four 3.000, eight 4.000."
        );
        let points = series("dsac", Shape::Points(vec![point(0.5, 1.0), point(1.0, 2.0)]));
        assert_eq!(
            chart(vec![panel("", "a", "b", vec![points])]).in_words(),
            "Points: b against a, 0.500 to 1. Shown: dsac 2 points."
        );
        let node = |label: &str| Node {
            label: label.into(),
            ..Node::default()
        };
        let graph = Graph {
            nodes: vec![node("input"), node("sum")],
            edges: vec![Edge::default()],
            ..Graph::default()
        };
        let shapes = [Shape::Graph(graph), Shape::Images(Tiles::default())];
        let panels = shapes.map(|shape| drawn::panel("best".into(), shape));
        assert_eq!(
            chart(panels.into()).in_words(),
            "Drawings without axes. best: 2 boxes and 1 arrows, from input to sum; best: 0 images."
        );
    }

    #[test]
    fn a_chart_of_nothing_is_told_too() {
        assert_eq!(Chart::default().in_words(), "Lines: nothing.");
    }
}
