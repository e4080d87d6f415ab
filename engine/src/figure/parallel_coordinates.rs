//! The settings that a search tried, a line each over its keys.

use super::{
    Figure, FigureSpec,
    build::{Context, count, label, spaced},
    chart::{Chart, Hue, Panel, Point, Scale, Series, Shape, Style},
    searched::Searched,
};
use crate::{
    Error,
    search::Range,
    spec::names::{Names, Place},
    table::metric_of_search,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The settings that a search tried.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ParallelCoordinates {
    /// The search.
    pub search: String,
    /// How many of the best settings are drawn; all where absent.
    #[serde(default)]
    #[schemars(range(min = 1))]
    pub best: Option<usize>,
}

impl Figure for ParallelCoordinates {
    fn example() -> &'static str {
        "{ search: learner_rates }"
    }

    fn check(&self, names: &mut Names<'_>, at: &Place<'_>) {
        metric_of_search(&self.search, names, at);
    }

    fn build(&self, spec: &FigureSpec, context: Context<'_>) -> Result<Chart, Error> {
        Ok(chart(&Searched::of(&self.search, context)?, self.best, spec))
    }
}

fn chart(searched: &Searched<'_>, best: Option<usize>, spec: &FigureSpec) -> Chart {
    let drawn = ranked(searched, best);
    let range = ends(drawn.iter().map(|at| searched.values[*at]));
    let line = |(rank, at): (usize, &usize)| Series {
        label: String::new(),
        seeds: None,
        style: Style {
            // The best is the darkest, and is drawn last.
            hue: Hue::Ramp(drawn.len() - 1 - rank, drawn.len().max(2)),
            variant: 0,
        },
        shape: Shape::Line(points(searched, *at, range)),
    };
    let panel = Panel {
        x: Scale {
            categories: axes(searched, range, spec),
            ..Scale::default()
        },
        y: Scale {
            label: "place in the range".into(),
            includes: vec![0.0, 1.0],
            ..Scale::default()
        },
        series: drawn.iter().enumerate().map(line).collect(),
        ..Panel::default()
    };
    Chart {
        panels: vec![panel],
        columns: 1,
        notes: vec![note(searched, drawn.len())],
        ..Chart::default()
    }
}

/// The settings that are drawn, the best last.
fn ranked(searched: &Searched<'_>, best: Option<usize>) -> Vec<usize> {
    let merit = |at: &usize| searched.result.search.goal.merit(searched.values[*at]);
    let mut all: Vec<usize> = (0..searched.values.len()).collect();
    all.sort_by(|one, other| merit(one).total_cmp(&merit(other)).then(one.cmp(other)));
    all.drain(..all.len().saturating_sub(best.unwrap_or(usize::MAX)));
    all
}

/// Where a setting lies on the axes of the keys, and then on that of the metric.
fn points(searched: &Searched<'_>, at: usize, (low, high): (f64, f64)) -> Vec<Point> {
    let value = searched.values[at];
    let value = if high > low {
        (value - low) / (high - low)
    } else {
        0.5
    };
    let places = searched.shares[at].iter().copied().chain([value]);
    let point = |(x, y): (usize, f64)| Point {
        x: count(x),
        y,
        interval: None,
    };
    places.enumerate().map(point).collect()
}

/// The names of the axes with their ends.
fn axes(searched: &Searched<'_>, (low, high): (f64, f64), spec: &FigureSpec) -> Vec<String> {
    let search = &searched.result.search;
    let named =
        |(key, (_, range)): (&str, &(String, Range))| format!("{} ({})", label(spec, key), range.in_words());
    let keys = searched.keys().into_iter().zip(&search.keys).map(named);
    let metric = label(spec, &spaced(&search.by));
    keys.chain([format!("{metric} ({} to {})", short(low), short(high))])
        .collect()
}

fn note(searched: &Searched<'_>, drawn: usize) -> String {
    let rest = match searched.result.tried.len() - drawn {
        0 => String::new(),
        more => format!(
            " {more} more are worse, were looked at up to a pause alone or failed, and are not drawn."
        ),
    };
    format!(
        "A line for each of {drawn} settings, the best the darkest; listed values stand from the bottom up.{rest}"
    )
}

fn ends(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| {
        (low.min(value), high.max(value))
    })
}

/// A number with about three digits.
fn short(value: f64) -> String {
    crate::table::NumberFormat::fitting([value].into_iter()).write(value)
}
