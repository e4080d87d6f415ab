//! Groups of bars: the rows of a comparison are groups, its columns bars, with 95 % intervals.

use super::{
    Figure, FigureSpec,
    build::{Context, count, spaced},
    chart::{Chart, Hue, Panel, Point, Scale, Series, Style},
    shape::Shape,
};
use crate::{
    kinds::{Contradiction, KindSpec},
    names::{Names, Place},
    table::{self, Comparison, Grid, Intervals, Table},
};
use contract::Error;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// One metric by groups of bars.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Bars {
    /// The table's rows become groups, its columns bars.
    pub of: Comparison,
}

impl KindSpec for Bars {
    fn name() -> &'static str {
        "bars"
    }

    fn about() -> &'static str {
        "One metric by groups of bars, with intervals over seeds."
    }

    fn example() -> &'static str {
        "{ of: { rows: environment, value: return, agents: [learner, rule] } }"
    }

    fn contradiction(value: &Value) -> Option<Contradiction> {
        Comparison::contradiction(value.get("of")?).map(|it| it.below("of"))
    }
}

impl Figure for Bars {
    fn check(&self, names: &mut Names<'_>, at: &Place<'_>) {
        let of = at.below("of").unwrap_or(at.clone());
        self.of.check(names, &of, None);
    }

    fn build(&self, spec: &FigureSpec, context: Context<'_>) -> Result<Chart, Error> {
        build(self, spec, context)
    }
}

fn build(kind: &Bars, spec: &FigureSpec, context: Context<'_>) -> Result<Chart, Error> {
    let grid = table::compare(&kind.of, context.results)?;
    let named = |name: &str, printed: &str| spec.labels.get(name).cloned().unwrap_or_else(|| printed.into());
    let categories = grid.rows.iter().map(|row| named(&row.name, &row.label)).collect();
    let mut y = context.scale(spec, &kind.of.value, false);
    if kind.of.relative_to.is_some() {
        let label = grid.quantity.label();
        y.label = spaced(&if grid.unit.is_empty() {
            label
        } else {
            format!("{label} ({})", grid.unit)
        });
    }
    y.includes = vec![0.0];
    let series = (0..grid.columns.len()).map(|column| {
        let style = bar_style(&grid, column, context);
        let label = if grid.columns.len() == 1 {
            String::new()
        } else {
            named(&grid.columns[column].name, &grid.columns[column].label)
        };
        Series {
            label,
            seeds: None,
            style,
            shape: Shape::Bars(bar_points(&grid, column), 0.8 / count(grid.columns.len())),
        }
    });
    let panel = Panel {
        series: series.collect(),
        x: Scale {
            categories,
            ..Scale::default()
        },
        y,
        ..Panel::default()
    };
    Ok(Chart {
        panels: vec![panel],
        columns: 1,
        notes: grid.footnotes(Intervals::AsLines),
        ..Chart::default()
    })
}

fn bar_style(grid: &Grid, column: usize, context: Context<'_>) -> Style {
    let name = &grid.columns[column].name;
    if context.agents.contains(name) {
        context.style(name)
    } else {
        Style {
            hue: Hue::Ramp(column, grid.columns.len().max(2)),
            variant: column,
        }
    }
}

fn bar_points(grid: &Grid, column: usize) -> Vec<Point> {
    let width = 0.8 / count(grid.columns.len());
    let offset = (count(column) + 0.5) * width - 0.4;
    let point = |(row, cells): (usize, &Vec<table::Cell>)| {
        let cell = &cells[column];
        Some(Point {
            x: count(row) + offset,
            y: cell.estimate?,
            interval: cell.interval,
        })
    };
    grid.cells.iter().enumerate().filter_map(point).collect()
}
