//! Contours: a surface that a trial traced point by point, with measurements during learning as a path over it.

use super::{
    Figure, FigureSpec,
    build::{Context, label, problem},
    chart::{Chart, Panel, Point, Series, Style},
    shape::{Shape, Surface},
};
use crate::{
    kinds::KindSpec,
    names::{Names, Picked, Place},
    table::{Axis, Scope},
};
use contract::{Error, Phase, trial_result::TrialResult};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A surface that was traced, with a path over it that was measured during learning.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Contour {
    /// Trace metrics that hold x, y and z of the surface, a grid point per row.
    pub surface: Vec<String>,
    /// Metrics that hold x and y of the path, a point per measurement during learning, from light to dark.
    pub path: Vec<String>,
    /// Agents to show, one panel each; all where empty.
    pub agents: Vec<String>,
    /// Environment to show; the first where absent.
    pub environment: Option<String>,
    /// Seed to show; the first where absent.
    pub seed: Option<u64>,
}

impl KindSpec for Contour {
    fn name() -> &'static str {
        "contour"
    }

    fn about() -> &'static str {
        "A surface traced as x, y, z, as filled contours, with what was measured during learning as \
             points over it."
    }

    fn example() -> &'static str {
        "{ surface: [height_1, height_2, height_1], path: [return, length], agents: [learner] }"
    }
}

impl Figure for Contour {
    fn check(&self, names: &mut Names<'_>, at: &Place<'_>) {
        let picked = names.pick(at).of_one_environment();
        names.channels(at, "surface", 3, 3, &picked);
        check_path(names, at, &picked);
        names.seed(self.seed, at);
    }

    fn is_recorded(&self) -> bool {
        false
    }

    fn build(&self, spec: &FigureSpec, context: Context<'_>) -> Result<Chart, Error> {
        build(self, spec, context)
    }
}

/// Checks the two metrics of the path, which are measured during learning.
fn check_path(names: &mut Names<'_>, at: &Place<'_>, picked: &Picked) {
    let Some(list) = at.below("path") else { return };
    let items = list.node.items();
    if ![0, 2].contains(&items.len()) {
        names.say(
            at.value("path"),
            format!("`path` needs 2 names, but has {}", items.len()),
            "",
        );
    }
    let recorded = names.recorded(picked);
    for item in items {
        if let Some(name) = item.as_str().filter(|name| !recorded.contains(*name)) {
            names.unknown_metric(name, (item.span, list.at.clone()), &recorded);
        }
    }
}

/// One panel per agent.
fn build(kind: &Contour, spec: &FigureSpec, context: Context<'_>) -> Result<Chart, Error> {
    let [x, y, _] = kind.surface.as_slice() else {
        return Err(problem("`surface` must name three metrics: x, y and z"));
    };
    let trials = trials(kind, context);
    if trials.is_empty() {
        return Err(problem("no trial has recorded the surface"));
    }
    let titled = trials.len() > 1;
    let panel = |trial: &&TrialResult| {
        Ok(Panel {
            title: if titled {
                label(spec, &trial.trial.cell.agent)
            } else {
                String::new()
            },
            x: context.scale(spec, x, false),
            y: context.scale(spec, y, false),
            series: series(kind, spec, context, trial)?,
        })
    };
    let panels = trials.iter().map(panel).collect::<Result<Vec<_>, Error>>()?;
    let columns = if panels.len() == 4 { 2 } else { panels.len().min(3) };
    let notes = vec![format!(
        "{}; a point is the mean over the episodes of a measurement.",
        seeds(&trials)
    )];
    Ok(Chart {
        columns,
        panels,
        shared_y: true,
        notes,
        ..Chart::default()
    })
}

/// The seeds of the panels: one text for all panels, unless some have no result.
fn seeds(trials: &[&TrialResult]) -> String {
    let seeds: Vec<String> = trials
        .iter()
        .map(|trial| trial.trial.key.seed.to_string())
        .collect();
    if seeds.iter().all(|seed| *seed == seeds[0]) {
        return format!("Seed {}", seeds[0]);
    }
    format!("Seeds {}, panel by panel", seeds.join(", "))
}

fn trials<'a>(kind: &Contour, context: Context<'a>) -> Vec<&'a TrialResult> {
    let environments: Vec<String> = kind.environment.iter().cloned().collect();
    let scope = Scope::of(context.results, &kind.agents, &environments);
    let environment = scope
        .names(Axis::Environment, &[])
        .into_iter()
        .next()
        .unwrap_or_default();
    let scope = scope.at(Axis::Environment, &environment);
    let fits = |trial: &&TrialResult| {
        let has_seed = kind.seed.is_none_or(|seed| trial.trial.key.seed == seed);
        has_seed && trial.select(Phase::Trace, &kind.surface[0]).next().is_some()
    };
    let agents = scope.names(Axis::Agent, &kind.agents);
    agents
        .iter()
        .filter_map(|agent| scope.at(Axis::Agent, agent).trials.into_iter().find(fits))
        .collect()
}

fn series(
    kind: &Contour,
    spec: &FigureSpec,
    context: Context<'_>,
    trial: &TrialResult,
) -> Result<Vec<Series>, Error> {
    let values = |metric: &String| {
        trial
            .select(Phase::Trace, metric)
            .map(|row| row.value)
            .collect::<Vec<f64>>()
    };
    let columns: Vec<Vec<f64>> = kind.surface.iter().map(values).collect();
    let surface = surface(&columns, context.scale(spec, &kind.surface[2], false).label)?;
    let highest = highest(&surface);
    let unnamed = |shape| Series {
        label: String::new(),
        seeds: None,
        style: Style::default(),
        shape,
    };
    let mut series = vec![unnamed(Shape::Surface(surface))];
    series.extend(path(kind, trial).map(|(label, points)| Series {
        label,
        ..unnamed(Shape::Path(points))
    }));
    series.push(Series {
        label: "highest point".into(),
        ..unnamed(Shape::Crosses(vec![highest]))
    });
    Ok(series)
}

/// The path of measurements during learning, in order, with its name; `None` if the study asks for no path or the trial
/// measured none.
fn path(kind: &Contour, trial: &TrialResult) -> Option<(String, Vec<Point>)> {
    let [x, y] = kind.path.as_slice() else { return None };
    let (x, y) = (trial.curve(Phase::Evaluate, x), trial.curve(Phase::Evaluate, y));
    let (first, last) = (x.first()?.0, x.last()?.0);
    let y: BTreeMap<u64, f64> = y.into_iter().collect();
    // A point needs both measurements.
    let points = x
        .into_iter()
        .filter_map(|(step, x)| Some((x, *y.get(&step)?)))
        .map(|(x, y)| Point { x, y, interval: None })
        .collect();
    Some((format!("measurements from step {first} to step {last}"), points))
}

fn highest(surface: &Surface) -> Point {
    let row = |(y, heights): (&f64, &Vec<f64>)| {
        let cells: Vec<_> = surface
            .x
            .iter()
            .zip(heights)
            .map(|(x, height)| {
                (
                    *height,
                    Point {
                        x: *x,
                        y: *y,
                        interval: None,
                    },
                )
            })
            .collect();
        cells
    };
    let cells = surface.y.iter().zip(&surface.z).flat_map(row);
    cells
        .max_by(|one, other| one.0.total_cmp(&other.0))
        .map_or(Point::default(), |(_, point)| point)
}

/// Points in any order as a full grid.
fn surface(columns: &[Vec<f64>], label: String) -> Result<Surface, Error> {
    let distinct = |values: &[f64]| {
        let mut values = values.to_vec();
        values.sort_by(f64::total_cmp);
        values.dedup();
        values
    };
    let (x, y) = (distinct(&columns[0]), distinct(&columns[1]));
    let mut z = vec![vec![f64::NAN; x.len()]; y.len()];
    let place = |values: &[f64], value: f64| values.iter().position(|other| *other == value);
    for ((px, py), pz) in columns[0].iter().zip(&columns[1]).zip(&columns[2]) {
        if let (Some(column), Some(row)) = (place(&x, *px), place(&y, *py)) {
            z[row][column] = *pz;
        }
    }
    if x.len() < 2 || y.len() < 2 || z.iter().flatten().any(|height| !height.is_finite()) {
        return Err(problem("the recorded surface is no full grid of finite numbers"));
    }
    Ok(Surface { label, x, y, z })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_become_a_grid_or_are_refused() {
        let columns = [
            vec![1.0, 0.0, 0.0, 1.0],
            vec![0.0, 0.0, 2.0, 2.0],
            vec![10.0, 0.0, 2.0, 12.0],
        ];
        let grid = surface(&columns, String::new()).unwrap();
        assert_eq!(
            (grid.x, grid.y, grid.z),
            (
                vec![0.0, 1.0],
                vec![0.0, 2.0],
                vec![vec![0.0, 10.0], vec![2.0, 12.0]]
            )
        );
        let short: Vec<Vec<f64>> = columns.iter().map(|column| column[..3].to_vec()).collect();
        assert!(
            surface(&short, String::new())
                .unwrap_err()
                .to_string()
                .contains("no full grid")
        );
    }

    #[test]
    fn the_highest_point_is_found() {
        let grid = Surface {
            x: vec![1.0, 2.0],
            y: vec![3.0, 4.0],
            z: vec![vec![-5.0, -1.0], vec![-2.0, -3.0]],
            label: String::new(),
        };
        assert_eq!(
            highest(&grid),
            Point {
                x: 2.0,
                y: 3.0,
                interval: None
            }
        );
    }
}
