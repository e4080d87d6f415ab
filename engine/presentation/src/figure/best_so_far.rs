//! The progress of a search towards its best setting.

use super::{
    Figure, FigureSpec,
    build::{Context, count, level},
    chart::{Chart, Panel, Point, Scale, Series},
    searched::CompletedSettings,
    shape::{Curve, CurveSource, RunLine, Shape},
};
use crate::{
    kinds::KindSpec,
    names::{Names, Place},
    table::Scope,
};
use analysis::search::Direction;
use contract::Error;
use document::count::count as count_in_words;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use statistics::Summary;

/// The settings of a search in the order in which they were tried, and the best one so far.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BestSoFar {
    /// The search.
    pub search: String,
    /// Vertical axis on a logarithmic scale.
    #[serde(default)]
    pub log_y: bool,
}

impl KindSpec for BestSoFar {
    fn name() -> &'static str {
        "best_so_far"
    }

    fn about() -> &'static str {
        "The value of each setting that a search tried, in their order, and the best one so far."
    }

    fn example() -> &'static str {
        "{ search: learner_rates }"
    }
}

impl Figure for BestSoFar {
    fn check(&self, names: &mut Names<'_>, at: &Place<'_>) {
        names.search(&self.search, at);
    }

    fn build(&self, spec: &FigureSpec, context: Context<'_>) -> Result<Chart, Error> {
        let searched = CompletedSettings::of(&self.search, context)?;
        let search = &searched.result.search;
        let style = context.style(&search.agent);
        let values = (0..searched.values.len()).map(|at| (number(&searched, at), searched.values[at]));
        let tried = Series {
            label: "settings and the best so far".into(),
            seeds: None,
            style,
            shape: Shape::Curve(Curve {
                of: CurveSource::Learner,
                points: best_so_far(values, search.direction),
                runs: settings(&searched),
                undrawn: Vec::new(),
                at_the_ends: None,
            }),
        };
        let fresh = fresh(&searched, context);
        let of_fresh = fresh.map(|it| level("the best on fresh seeds".into(), style, (it.n, it.n), it.mean));
        let panel = Panel {
            x: Scale {
                label: "settings tried".into(),
                ..Scale::default()
            },
            y: context.scale(spec, &search.metric, self.log_y),
            series: [tried].into_iter().chain(of_fresh).collect(),
            ..Panel::default()
        };
        Ok(Chart {
            panels: vec![panel],
            columns: 1,
            notes: vec![note(&searched, fresh.is_some())],
            ..Chart::default()
        })
    }
}

/// The number of a setting, from 1.
fn number(searched: &CompletedSettings<'_>, at: usize) -> f64 {
    count(searched.places[at] + 1)
}

/// Every setting with its value, as a run of one point with the name of the setting.
fn settings(searched: &CompletedSettings<'_>) -> Vec<RunLine> {
    let run = |at: usize| RunLine {
        name: searched.result.tried[searched.places[at]].setting.clone(),
        trial: String::new(),
        points: vec![Point {
            x: number(searched, at),
            y: searched.values[at],
            interval: None,
        }],
    };
    (0..searched.places.len()).map(run).collect()
}

/// The best value so far, in steps: it holds until a better one comes.
fn best_so_far(values: impl Iterator<Item = (f64, f64)>, direction: Direction) -> Vec<Point> {
    let point = |x, y| Point { x, y, interval: None };
    let mut points: Vec<Point> = Vec::new();
    for (x, value) in values {
        let best = points.last().map(|it| it.y);
        points.extend(best.map(|best| point(x, best)));
        if best.is_none_or(|best| direction.merit(value) > direction.merit(best)) {
            points.push(point(x, value));
        }
    }
    points
}

/// The value of the chosen setting on seeds that the search has not seen; `None` before such seeds have run.
fn fresh(searched: &CompletedSettings<'_>, context: Context<'_>) -> Option<Summary> {
    let result = searched.result;
    let trials = result.fresh_trials(&context.results.trials);
    let finals = Scope { trials }.finals(&result.search.metric);
    Summary::of(&finals.into_values().collect::<Vec<_>>())
}

fn note(searched: &CompletedSettings<'_>, has_fresh: bool) -> String {
    let seeds = count_in_words(searched.result.search.seeds.len(), "seed");
    let rest = if has_fresh {
        "; the dashed line is the chosen setting on seeds that the search has not seen"
    } else {
        ""
    };
    format!(
        "Each dot is a setting that went to its end, by {seeds} of the search; the line is the best of them so \
         far{rest}."
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn steps(direction: Direction) -> Vec<(f64, f64)> {
        let values = [(1.0, 2.0), (2.0, 1.0), (4.0, 3.0), (6.0, 0.5)];
        let points = best_so_far(values.into_iter(), direction);
        points.iter().map(|point| (point.x, point.y)).collect()
    }

    #[test]
    fn the_best_holds_until_a_better_one_ends() {
        let most = [(1.0, 2.0), (2.0, 2.0), (4.0, 2.0), (4.0, 3.0), (6.0, 3.0)];
        assert_eq!(steps(Direction::Maximize), most);
        let least = [
            (1.0, 2.0),
            (2.0, 2.0),
            (2.0, 1.0),
            (4.0, 1.0),
            (6.0, 1.0),
            (6.0, 0.5),
        ];
        assert_eq!(steps(Direction::Minimize), least);
    }
}
