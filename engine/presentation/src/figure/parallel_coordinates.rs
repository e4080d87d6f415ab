//! The settings that a search tried, one line each over its keys.

use super::{
    Figure, FigureSpec,
    build::{Context, count, spaced},
    chart::{Chart, Hue, Panel, Point, Scale, Series, Style},
    searched::{CompletedSettings, key_names},
    shape::Shape,
    ticks::{self, Tick},
};
use crate::{
    kinds::KindSpec,
    names::{Names, Place},
    vocabulary::Vocabulary,
};
use analysis::search::Range;
use contract::{Error, sweep_point::word};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

/// Number of ticks to aim for on an axis.
const TICKS: usize = 5;

/// The settings that a search tried.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ParallelCoordinates {
    /// The search.
    pub search: String,
    /// Number of the best settings that are drawn; all where absent.
    #[serde(default)]
    #[schemars(range(min = 1))]
    pub best: Option<usize>,
}

impl KindSpec for ParallelCoordinates {
    fn name() -> &'static str {
        "parallel_coordinates"
    }

    fn about() -> &'static str {
        "The settings that a search tried, a line each over its keys and its metric, with values on every axis."
    }

    fn example() -> &'static str {
        "{ search: learner_rates }"
    }
}

impl Figure for ParallelCoordinates {
    fn check(&self, names: &mut Names<'_>, at: &Place<'_>) {
        names.search(&self.search, at);
    }

    fn further_names(&self, vocabulary: &Vocabulary) -> Vec<String> {
        key_names(&self.search, vocabulary)
    }

    fn build(&self, spec: &FigureSpec, context: Context<'_>) -> Result<Chart, Error> {
        Ok(chart(
            &CompletedSettings::of(&self.search, context)?,
            self.best,
            spec,
        ))
    }
}

fn chart(searched: &CompletedSettings<'_>, best: Option<usize>, spec: &FigureSpec) -> Chart {
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
    let axes = Series {
        label: String::new(),
        seeds: None,
        style: Style::default(),
        shape: Shape::Axes(axes(searched, range)),
    };
    let panel = Panel {
        x: Scale {
            categories: names(searched, spec),
            ..Scale::default()
        },
        series: drawn.iter().enumerate().map(line).chain([axes]).collect(),
        ..Panel::default()
    };
    Chart {
        panels: vec![panel],
        columns: 1,
        notes: vec![note(searched, drawn.len())],
        ..Chart::default()
    }
}

/// The drawn settings, the best last.
fn ranked(searched: &CompletedSettings<'_>, best: Option<usize>) -> Vec<usize> {
    let merit = |at: &usize| searched.result.search.direction.merit(searched.values[*at]);
    let mut all: Vec<usize> = (0..searched.values.len()).collect();
    all.sort_by(|one, other| merit(one).total_cmp(&merit(other)).then(one.cmp(other)));
    all.drain(..all.len().saturating_sub(best.unwrap_or(usize::MAX)));
    all
}

/// Places of a setting on the axes of the keys, and then on that of the metric.
fn points(searched: &CompletedSettings<'_>, at: usize, (low, high): (f64, f64)) -> Vec<Point> {
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

/// The names of the axes: the keys, and the metric.
fn names(searched: &CompletedSettings<'_>, spec: &FigureSpec) -> Vec<String> {
    let by = searched.result.search.metric.as_str();
    let labelled = |name: &str| spec.labels.get(name).cloned().unwrap_or_else(|| spaced(name));
    searched.keys().into_iter().chain([by]).map(labelled).collect()
}

/// The ticks of the axes: the values of each key, and those of the metric between the drawn ends.
fn axes(searched: &CompletedSettings<'_>, (low, high): (f64, f64)) -> Vec<Vec<Tick>> {
    let keys = searched.result.search.keys.iter();
    let of_metric = if high > low {
        placed(ticks::linear(low, high, TICKS), |value| {
            (value - low) / (high - low)
        })
    } else {
        vec![Tick {
            value: 0.5,
            text: short(low),
        }]
    };
    keys.map(|(_, range)| of_range(range))
        .chain([of_metric])
        .collect()
}

fn of_range(range: &Range) -> Vec<Tick> {
    let share = |value: &Value| range.share_of(value).unwrap_or(0.0);
    match range {
        Range::Choice(values) => {
            let tick = |value: &Value| Tick {
                value: share(value),
                text: word(value),
            };
            values.iter().map(tick).collect()
        }
        Range::Numbers(numbers) => {
            let ticks = if numbers.log {
                ticks::logarithmic(numbers.low, numbers.high, TICKS)
            } else {
                ticks::linear(numbers.low, numbers.high, TICKS)
            };
            let is_a_value = |tick: &Tick| !numbers.integer || tick.value.fract() == 0.0;
            let written = |tick: Tick| Tick {
                text: if numbers.integer {
                    tick.text.trim_end_matches(".0").to_owned()
                } else {
                    tick.text
                },
                ..tick
            };
            let ticks = ticks.into_iter().filter(is_a_value).map(written);
            placed(ticks, |value| share(&json!(value)))
        }
    }
}

/// Ticks at their places on an axis from 0 to 1.
fn placed(ticks: impl IntoIterator<Item = Tick>, place: impl Fn(f64) -> f64) -> Vec<Tick> {
    let at_place = |tick: Tick| Tick {
        value: place(tick.value),
        ..tick
    };
    ticks.into_iter().map(at_place).collect()
}

fn note(searched: &CompletedSettings<'_>, drawn: usize) -> String {
    let rest = match searched.result.tried.len() - drawn {
        0 => String::new(),
        more => format!(
            " {more} more are worse, were looked at up to a pause alone or failed, and are not drawn."
        ),
    };
    format!("A line for each of {drawn} settings, the best the darkest.{rest}")
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

#[cfg(test)]
mod tests {
    use super::*;

    fn numbers(low: f64, high: f64, log: bool, integer: bool) -> Range {
        Range::Numbers(analysis::search::Numbers {
            low,
            high,
            log,
            integer,
        })
    }

    fn texts(range: &Range) -> Vec<(String, f64)> {
        let ticks = of_range(range).into_iter().filter(|tick| !tick.text.is_empty());
        ticks
            .map(|tick| (tick.text, (100.0 * tick.value).round()))
            .collect()
    }

    fn named<const N: usize>(ticks: [(&str, f64); N]) -> Vec<(String, f64)> {
        ticks.map(|(text, place)| (text.to_owned(), place)).into()
    }

    #[test]
    fn axes_have_the_values_of_their_keys() {
        let rates = named([("10⁻⁵", 0.0), ("10⁻⁴", 50.0), ("10⁻³", 100.0)]);
        assert_eq!(texts(&numbers(1e-5, 1e-3, true, false)), rates);
        // No layers between one and two.
        let layers = named([("1", 0.0), ("2", 50.0), ("3", 100.0)]);
        assert_eq!(texts(&numbers(1.0, 3.0, false, true)), layers);
        let listed = Range::Choice(vec![json!(64), json!("minus_sqrt_d")]);
        assert_eq!(texts(&listed), named([("64", 0.0), ("minus_sqrt_d", 100.0)]));
    }
}
