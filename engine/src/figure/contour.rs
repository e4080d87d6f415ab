//! Contours: a surface that a trial recorded point by point, with a path over it.

use super::{
    Contour, FigureSpec,
    build::{Context, label, problem},
    chart::{Chart, Panel, Point, Series, Shape, Style, Surface},
};
use crate::{
    Error, Phase,
    results::TrialResult,
    table::{Axis, Scope},
};

/// One panel per agent.
pub(super) fn build(kind: &Contour, spec: &FigureSpec, context: Context<'_>) -> Result<Chart, Error> {
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
            title: if titled { label(spec, &trial.trial.agent) } else { String::new() },
            x: context.scale(spec, x, false),
            y: context.scale(spec, y, false),
            series: series(kind, spec, context, trial)?,
        })
    };
    let panels = trials.iter().map(panel).collect::<Result<Vec<_>, Error>>()?;
    Ok(Chart { columns: panels.len().min(2), panels, shared_y: true, ..Chart::default() })
}

fn trials<'a>(kind: &Contour, context: Context<'a>) -> Vec<&'a TrialResult> {
    let environments: Vec<String> = kind.environment.iter().cloned().collect();
    let scope = Scope::of(context.results, &kind.agents, &environments);
    let environment = scope.names(Axis::Environment, &[]).into_iter().next().unwrap_or_default();
    let scope = scope.at(Axis::Environment, &environment);
    let fits = |trial: &&TrialResult| {
        let has_seed = kind.seed.is_none_or(|seed| trial.trial.key.seed == seed);
        has_seed && trial.select(Phase::Trace, &kind.surface[0]).next().is_some()
    };
    let agents = scope.names(Axis::Agent, &kind.agents);
    agents.iter().filter_map(|agent| scope.at(Axis::Agent, agent).trials.into_iter().find(fits)).collect()
}

fn series(kind: &Contour, spec: &FigureSpec, context: Context<'_>, trial: &TrialResult) -> Result<Vec<Series>, Error> {
    let values = |metric: &String| trial.select(Phase::Trace, metric).map(|row| row.value).collect::<Vec<f64>>();
    let columns: Vec<Vec<f64>> = kind.surface.iter().map(values).collect();
    let surface = surface(&columns, context.scale(spec, &kind.surface[2], false).label)?;
    let style = Style::default();
    let mut series = vec![Series { label: String::new(), seeds: None, style, shape: Shape::Surface(surface) }];
    if let [x, y] = kind.path.as_slice() {
        let points = values(x).into_iter().zip(values(y)).map(|(x, y)| Point { x, y, interval: None }).collect();
        series.push(Series { label: String::new(), seeds: None, style, shape: Shape::Path(points) });
    }
    Ok(series)
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
        let columns = [vec![1.0, 0.0, 0.0, 1.0], vec![0.0, 0.0, 2.0, 2.0], vec![10.0, 0.0, 2.0, 12.0]];
        let grid = surface(&columns, String::new()).unwrap();
        assert_eq!((grid.x, grid.y, grid.z), (vec![0.0, 1.0], vec![0.0, 2.0], vec![vec![0.0, 10.0], vec![2.0, 12.0]]));
        let short: Vec<Vec<f64>> = columns.iter().map(|column| column[..3].to_vec()).collect();
        assert!(surface(&short, String::new()).unwrap_err().to_string().contains("no full grid"));
    }
}
