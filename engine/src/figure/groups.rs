//! Bars, lines over a swept key, and scatter: final values, grouped.

use super::{
    Bars, FigureSpec, GroupedLines, Scatter,
    build::{Context, by_environment, label, label_with_setting, level},
    chart::{Chart, Hue, Panel, Point, Scale, Series, Shape, Style},
};
use crate::{
    Error,
    statistics::Summary,
    table::{self, Axis, Grid, Scope},
};
use std::collections::BTreeMap;

/// Groups of bars: the rows of a comparison are groups, its columns bars, with 95 % intervals.
pub(super) fn bars(kind: &Bars, spec: &FigureSpec, context: Context<'_>) -> Result<Chart, Error> {
    let grid = table::compare(&kind.of, context.results)?;
    let named = |name: &str, printed: &str| spec.labels.get(name).cloned().unwrap_or_else(|| printed.into());
    let categories = grid.rows.iter().map(|row| named(&row.name, &row.label)).collect();
    let mut y = context.scale(spec, &kind.of.value, false);
    if kind.of.relative_to.is_some() {
        y.label = if grid.unit.is_empty() { grid.quantity.clone() } else { format!("{} ({})", grid.quantity, grid.unit) };
        y.label = y.label.replace(", by seed", "").replace('_', " ");
    }
    y.includes = vec![0.0];
    let series = (0..grid.columns.len()).map(|column| {
        let style = bar_style(&grid, column, context);
        let label =
            if grid.columns.len() == 1 { String::new() } else { named(&grid.columns[column].name, &grid.columns[column].label) };
        Series { label, seeds: None, style, shape: Shape::Bars(bar_points(&grid, column), 0.8 / count(grid.columns.len())) }
    });
    let panel = Panel { series: series.collect(), x: Scale { categories, ..Scale::default() }, y, ..Panel::default() };
    let notes = grid.footnotes().iter().map(|note| note.replace("in brackets", "as lines").replace("* ", "")).collect();
    Ok(Chart { panels: vec![panel], columns: 1, notes, ..Chart::default() })
}

fn bar_style(grid: &Grid, column: usize, context: Context<'_>) -> Style {
    let name = &grid.columns[column].name;
    if context.agents.contains(name) {
        context.style(name)
    } else {
        Style { hue: Hue::Ramp(column, grid.columns.len().max(2)), variant: column }
    }
}

fn bar_points(grid: &Grid, column: usize) -> Vec<Point> {
    let width = 0.8 / count(grid.columns.len());
    let offset = (count(column) + 0.5) * width - 0.4;
    let point = |(row, cells): (usize, &Vec<table::Cell>)| {
        let cell = &cells[column];
        Some(Point { x: count(row) + offset, y: cell.estimate?, interval: cell.interval })
    };
    grid.cells.iter().enumerate().filter_map(point).collect()
}

/// A metric against a swept key: a line per agent and remaining setting, agents without the key as levels.
pub(super) fn lines(kind: &GroupedLines, spec: &FigureSpec, context: Context<'_>) -> Result<Chart, Error> {
    let scope = Scope::of(context.results, &kind.agents, &kind.environments);
    let categories = categories(&scope, &kind.x);
    let x = context.scale(spec, &kind.x, kind.log_x && categories.is_empty());
    let scales = (Scale { categories: categories.clone(), ..x }, context.scale(spec, &kind.metric, kind.log_y));
    let mut chart = by_environment(spec, &scope, &kind.environments, scales, |scope| {
        let agents = scope.names(Axis::Agent, &kind.agents);
        agents.iter().flat_map(|agent| swept(kind, spec, context, &scope.at(Axis::Agent, agent), agent, &categories)).collect()
    })?;
    chart
        .notes
        .push("Means over seeds with 95 % intervals; dashed lines across are agents that the key does not concern.".into());
    Ok(chart)
}

/// The values of the key where not all of them are numbers, in the order of the plan; else none.
fn categories(scope: &Scope<'_>, key: &str) -> Vec<String> {
    let mut values: Vec<String> = Vec::new();
    for value in scope.trials.iter().filter_map(|trial| Some(split(&trial.trial.setting, key)?.0)) {
        if !values.contains(&value) {
            values.push(value);
        }
    }
    if values.iter().all(|value| value.parse::<f64>().is_ok()) { Vec::new() } else { values }
}

/// Points of a line, the fewest seeds of a point, and the seeds planned.
type Group = (Vec<Point>, usize, usize);

fn swept(
    kind: &GroupedLines,
    spec: &FigureSpec,
    context: Context<'_>,
    scope: &Scope<'_>,
    agent: &str,
    categories: &[String],
) -> Vec<Series> {
    let mut groups: BTreeMap<Option<String>, Group> = BTreeMap::new();
    for setting in scope.names(Axis::Setting, &[]) {
        let scope = scope.at(Axis::Setting, &setting);
        let values: Vec<f64> = scope.finals(&kind.metric).into_values().collect();
        let Some(summary) = Summary::of(&values) else { continue };
        let (place, rest) = split(&setting, &kind.x).map_or((None, None), |(value, rest)| (Some(value), Some(rest)));
        let x = place.map_or(0.0, |value| position(&value, categories));
        let group = groups.entry(rest).or_insert((Vec::new(), usize::MAX, 0));
        group.0.push(Point { x, y: summary.mean, interval: summary.interval.map(|interval| (interval.low, interval.high)) });
        (group.1, group.2) = (group.1.min(summary.n), group.2.max(scope.planned()));
    }
    let several = groups.len() > 1;
    let series = |(index, (rest, group)): (usize, (Option<String>, Group))| {
        let (mut points, n, planned) = group;
        points.sort_by(|a, b| a.x.total_cmp(&b.x));
        let style = Style { variant: if several { index } else { context.style(agent).variant }, ..context.style(agent) };
        match rest {
            None => level(label(spec, agent), style, (n, planned), points[0].y),
            Some(rest) => {
                let label = label_with_setting(spec, agent, &rest);
                Series { label, seeds: Some((n, planned)), style, shape: Shape::MarkedLine(points) }
            }
        }
    };
    groups.into_iter().enumerate().map(series).collect()
}

/// The value of a key in a setting, and the setting without it; `None` where it has no such key.
fn split(setting: &str, key: &str) -> Option<(String, String)> {
    let is_key = |word: &&str| word.split_once('=').is_some_and(|(name, _)| name == key || name.rsplit('.').next() == Some(key));
    let word = setting.split_whitespace().find(is_key)?;
    let rest: Vec<&str> = setting.split_whitespace().filter(|other| *other != word).collect();
    Some((word.split_once('=')?.1.into(), rest.join(" ")))
}

fn position(value: &str, categories: &[String]) -> f64 {
    categories.iter().position(|name| name == value).map_or_else(|| value.parse().unwrap_or(0.0), count)
}

/// One metric against another: a point per seed.
pub(super) fn scatter(kind: &Scatter, spec: &FigureSpec, context: Context<'_>) -> Result<Chart, Error> {
    let scope = Scope::of(context.results, &kind.agents, &kind.environments);
    let scales = (context.scale(spec, &kind.x, false), context.scale(spec, &kind.y, false));
    let mut chart = by_environment(spec, &scope, &kind.environments, scales, |scope| {
        let agents = scope.names(Axis::Agent, &kind.agents);
        agents.iter().filter_map(|agent| cloud(kind, spec, context, &scope.at(Axis::Agent, agent), agent)).collect()
    })?;
    chart.notes.push("One point per seed.".into());
    Ok(chart)
}

fn cloud(kind: &Scatter, spec: &FigureSpec, context: Context<'_>, scope: &Scope<'_>, agent: &str) -> Option<Series> {
    let point = |trial: &&crate::results::TrialResult| {
        let mean = |metric: &str| trial.mean(crate::Phase::Final, metric);
        Some(Point { x: mean(&kind.x)?, y: mean(&kind.y)?, interval: None })
    };
    let points: Vec<Point> = scope.trials.iter().filter(|trial| trial.is_ok()).filter_map(point).collect();
    let seeds = Some((scope.finals(&kind.y).len(), scope.planned()));
    let style = context.style(agent);
    (!points.is_empty()).then(|| Series { label: label(spec, agent), seeds, style, shape: Shape::Points(points) })
}

#[allow(clippy::cast_precision_loss, reason = "a count of rows or columns")]
fn count(number: usize) -> f64 {
    number as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_setting_is_split_by_the_last_word_of_the_key() {
        assert_eq!(split("dsac.rate=1e-4 cells=4", "rate"), Some(("1e-4".into(), "cells=4".into())));
        assert_eq!(split("dsac.rate=1e-4", "dsac.rate"), Some(("1e-4".into(), String::new())));
        assert_eq!(split("dsac.rate=1e-4", "ate"), None);
        assert_eq!(split("", "rate"), None);
    }
}
