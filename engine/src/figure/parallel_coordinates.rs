//! The settings that a search tried, a line each over its keys.

use super::{
    Figure, FigureSpec,
    build::{Context, count, label, spaced},
    chart::{Chart, Hue, Panel, Point, Scale, Series, Shape, Style},
    searched::Searched,
};
use crate::{
    Error,
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
    let search = &searched.result.search;
    let (low, high) = ends(&searched.values);
    let mut ranked: Vec<usize> = (0..searched.values.len()).collect();
    ranked.sort_by(|one, other| {
        let merit = |at: &usize| search.goal.merit(searched.values[*at]);
        merit(one).total_cmp(&merit(other)).then(one.cmp(other))
    });
    ranked.drain(..ranked.len().saturating_sub(best.unwrap_or(usize::MAX)));
    let width = ranked.len();
    let line = |(rank, at): (usize, &usize)| {
        let value = if high > low {
            (searched.values[*at] - low) / (high - low)
        } else {
            0.5
        };
        let places = searched.shares[*at].iter().copied().chain([value]);
        let point = |(x, y): (usize, f64)| Point {
            x: count(x),
            y,
            interval: None,
        };
        Series {
            label: String::new(),
            seeds: None,
            style: Style {
                // The best is the darkest, and is drawn last.
                hue: Hue::Ramp(width - 1 - rank, width.max(2)),
                variant: 0,
            },
            shape: Shape::Line(places.enumerate().map(point).collect()),
        }
    };
    let named = |(key, (_, range)): (&&str, &(String, crate::search::Range))| {
        format!("{} ({})", label(spec, key), range.in_words())
    };
    let metric = format!(
        "{} ({} to {})",
        label(spec, &spaced(&search.by)),
        short(low),
        short(high)
    );
    let keys = searched.keys();
    let panel = Panel {
        x: Scale {
            categories: keys.iter().zip(&search.keys).map(named).chain([metric]).collect(),
            ..Scale::default()
        },
        y: Scale {
            label: "place in the range".into(),
            includes: vec![0.0, 1.0],
            ..Scale::default()
        },
        series: ranked.iter().enumerate().map(line).collect(),
        ..Panel::default()
    };
    let untold = searched.result.tried.len() - width;
    let rest = if untold > 0 {
        format!(" {untold} more are worse, stopped early or failed, and are not drawn.")
    } else {
        String::new()
    };
    Chart {
        panels: vec![panel],
        columns: 1,
        notes: vec![format!(
            "A line for each of {width} settings, the best the darkest; listed values stand from the bottom up.{rest}"
        )],
        ..Chart::default()
    }
}

fn ends(values: &[f64]) -> (f64, f64) {
    let fold = |(low, high): (f64, f64), value: &f64| (low.min(*value), high.max(*value));
    values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), fold)
}

/// A number with about three digits.
fn short(value: f64) -> String {
    crate::table::NumberFormat::fitting([value].into_iter()).write(value)
}
