//! A comparison as coloured cells; rows and columns are two swept keys, or any two axes of a comparison.

use super::{
    Figure, FigureSpec,
    build::Context,
    chart::{Chart, Panel, Scale, Series, Style},
    shape::{Cells, Shape},
};
use crate::{
    axis::TableAxis,
    kinds::{Contradiction, KindSpec},
    names::{Names, Place},
    table::{self, Comparison, Grid, Heading, Intervals, Table},
    vocabulary::Vocabulary,
};
use contract::Error;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// One metric as coloured cells.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct HeatMap {
    /// The table whose cells are coloured. Values that are all numbers rise upwards and to the right.
    pub of: Comparison,
}

impl KindSpec for HeatMap {
    fn name() -> &'static str {
        "heat_map"
    }

    fn about() -> &'static str {
        "A comparison as coloured cells, as over two swept keys."
    }

    fn example() -> &'static str {
        "{ of: { rows: agent, columns: environment, value: return, agents: [learner, rule] } }"
    }

    fn contradiction(value: &Value) -> Option<Contradiction> {
        Comparison::contradiction(value.get("of")?).map(|it| it.below("of"))
    }
}

impl Figure for HeatMap {
    fn check(&self, names: &mut Names<'_>, at: &Place<'_>) {
        let of = at.below("of").unwrap_or(at.clone());
        self.of.check(names, &of, None);
    }

    fn further_names(&self, vocabulary: &Vocabulary) -> Vec<String> {
        let axes = std::iter::once(&self.of.rows).chain(&self.of.columns);
        let keys = axes.filter_map(TableAxis::key);
        keys.flat_map(|key| vocabulary.swept_values(key, None)).collect()
    }

    fn build(&self, spec: &FigureSpec, context: Context<'_>) -> Result<Chart, Error> {
        build(self, spec, context)
    }
}

fn build(kind: &HeatMap, spec: &FigureSpec, context: Context<'_>) -> Result<Chart, Error> {
    let grid = table::compare(&kind.of, context.results)?;
    let (rows, columns) = (order(&grid.rows, true), order(&grid.columns, false));
    let named = |heading: &Heading| spec.labels.get(&heading.name).unwrap_or(&heading.label).clone();
    let names =
        |headings: &[Heading], order: &[usize]| order.iter().map(|at| named(&headings[*at])).collect();
    let of_cells = |of: &dyn Fn(usize, usize) -> String| -> Vec<Vec<String>> {
        rows.iter()
            .map(|row| columns.iter().map(|column| of(*row, *column)).collect())
            .collect()
    };
    let cells = Cells {
        label: quantity(&grid, context.scale(spec, &kind.of.value, false).label),
        values: rows
            .iter()
            .map(|row| {
                columns
                    .iter()
                    .map(|column| grid.cells[*row][*column].estimate)
                    .collect()
            })
            .collect(),
        texts: of_cells(&|row, column| short(&grid, row, column)),
    };
    let along = |categories, label: String| Scale {
        categories,
        label,
        ..Scale::default()
    };
    let column_axis = kind.of.columns.as_ref().map(TableAxis::title);
    let panel = Panel {
        series: vec![Series {
            label: String::new(),
            seeds: None,
            style: Style::default(),
            shape: Shape::Cells(cells),
        }],
        x: along(names(&grid.columns, &columns), column_axis.unwrap_or_default()),
        y: along(names(&grid.rows, &rows), kind.of.rows.title()),
        ..Panel::default()
    };
    Ok(Chart {
        panels: vec![panel],
        columns: 1,
        notes: grid.footnotes(Intervals::NotShown),
        ..Chart::default()
    })
}

/// Meaning of the colours.
fn quantity(grid: &Grid, of_metric: String) -> String {
    match grid.quantity.relative {
        None => of_metric,
        Some(_) if grid.unit.is_empty() => grid.quantity.label(),
        Some(_) => format!("{} ({})", grid.quantity.label(), grid.unit),
    }
}

/// The headings in the order in which they are drawn. Names keep the order of the table; numbers follow an axis: rows
/// from the highest down, columns from the lowest up.
fn order(headings: &[Heading], falling: bool) -> Vec<usize> {
    let numbers: Option<Vec<f64>> = headings.iter().map(|heading| heading.number).collect();
    let mut order: Vec<usize> = (0..headings.len()).collect();
    if let Some(numbers) = numbers {
        order.sort_by(|one, other| numbers[*one].total_cmp(&numbers[*other]));
        if falling {
            order.reverse();
        }
    }
    order
}

/// The value of a cell, without its interval.
fn short(grid: &Grid, row: usize, column: usize) -> String {
    let estimate = grid.cells[row][column].estimate;
    estimate.map_or_else(|| "–".into(), |value| grid.format.write(value))
}
