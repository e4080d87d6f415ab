//! Best values of a table: the largest mean and every value that its interval does not separate from it.

use super::layout::{BestScope, Direction, LatexLayout};
use crate::table::{Cell, Grid};

/// Whether each value is the best of its row or column, or its interval overlaps that of the best one;
/// `[row][column]`. A value without an interval counts as exact. No value is best among fewer than two, or without a
/// known direction.
pub(super) fn best(grid: &Grid, layout: &LatexLayout) -> Vec<Vec<bool>> {
    let mut best = vec![vec![false; grid.columns.len()]; grid.rows.len()];
    if !layout.bold_best {
        return best;
    }
    for line in lines(grid, of(grid, layout)) {
        for (row, column) in best_of(grid, &line) {
            best[row][column] = true;
        }
    }
    best
}

/// The values among which the best one is sought.
pub(super) fn of(grid: &Grid, layout: &LatexLayout) -> BestScope {
    let usual = if grid.row_axis == "environment" {
        BestScope::Row
    } else {
        BestScope::Column
    };
    layout.best_of.unwrap_or(usual)
}

type Places = Vec<(usize, usize)>;

fn lines(grid: &Grid, of: BestScope) -> Vec<Places> {
    let (rows, columns) = (grid.rows.len(), grid.columns.len());
    match of {
        BestScope::Row => (0..rows)
            .map(|row| (0..columns).map(|column| (row, column)).collect())
            .collect(),
        BestScope::Column => (0..columns)
            .map(|column| (0..rows).map(|row| (row, column)).collect())
            .collect(),
    }
}

fn best_of(grid: &Grid, line: &[(usize, usize)]) -> Places {
    let values: Vec<((usize, usize), (f64, f64, f64))> = line
        .iter()
        .filter_map(|(row, column)| {
            let sign = match grid.better.get(*column).copied().flatten()? {
                Direction::Higher => 1.0,
                Direction::Lower => -1.0,
            };
            Some(((*row, *column), oriented(&grid.cells[*row][*column], sign)?))
        })
        .collect();
    let top = values
        .iter()
        .map(|(_, it)| *it)
        .reduce(|top, it| if it.1 > top.1 { it } else { top });
    match top {
        Some((low, _, _)) if values.len() > 1 => values
            .into_iter()
            .filter(|(_, (_, _, high))| *high >= low)
            .map(|(place, _)| place)
            .collect(),
        _ => Vec::new(),
    }
}

/// Lower end, value and upper end, multiplied by the sign with which more is better.
fn oriented(cell: &Cell, sign: f64) -> Option<(f64, f64, f64)> {
    let value = cell.estimate?;
    let (low, high) = cell.interval.unwrap_or((value, value));
    let (one, other) = (sign * low, sign * high);
    Some((one.min(other), sign * value, one.max(other)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::Heading;

    fn grid(cells: Vec<Vec<Option<(f64, f64, f64)>>>, better: Direction) -> Grid {
        let heading = |name: String| Heading::of(&name, name.as_str());
        let cell = |it: Option<(f64, f64, f64)>| Cell {
            estimate: it.map(|it| it.1),
            interval: it.map(|it| (it.0, it.2)).filter(|ends| ends.0 < ends.1),
            ..Cell::default()
        };
        Grid {
            row_axis: "agent".into(),
            rows: (0..cells.len()).map(|row| heading(row.to_string())).collect(),
            columns: (0..cells[0].len())
                .map(|column| heading(column.to_string()))
                .collect(),
            better: vec![Some(better); cells[0].len()],
            cells: cells
                .into_iter()
                .map(|row| row.into_iter().map(cell).collect())
                .collect(),
            ..Grid::default()
        }
    }

    fn layout(best_of: Option<BestScope>) -> LatexLayout {
        LatexLayout {
            bold_best: true,
            best_of,
            ..LatexLayout::default()
        }
    }

    #[test]
    fn what_overlaps_the_best_is_best_too() {
        // The second mean is the largest. The interval of the first reaches into its own, that of the third ends below,
        // and the fourth is missing.
        let column = vec![
            vec![Some((0.0, 1.0, 4.5))],
            vec![Some((4.0, 5.0, 6.0))],
            vec![Some((3.0, 3.5, 3.9))],
            vec![None],
        ];
        let higher = best(&grid(column.clone(), Direction::Higher), &layout(None));
        assert_eq!(higher, [[true], [true], [false], [false]]);
        // If less is better, the first is the best, and the others reach into its interval.
        let lower = best(&grid(column.clone(), Direction::Lower), &layout(None));
        assert_eq!(lower, [[true], [true], [true], [false]]);
        let unknown = Grid {
            better: vec![None],
            ..grid(column, Direction::Higher)
        };
        assert_eq!(
            best(&unknown, &layout(None)),
            [[false], [false], [false], [false]]
        );
    }

    #[test]
    fn values_without_intervals_are_exact_and_one_alone_is_not_best() {
        let cells = vec![vec![Some((1.0, 1.0, 1.0)), Some((2.0, 2.0, 2.0))]];
        let grid = grid(cells, Direction::Higher);
        assert_eq!(best(&grid, &layout(Some(BestScope::Row))), [[false, true]]);
        assert_eq!(best(&grid, &layout(Some(BestScope::Column))), [[false, false]]);
        let environments = Grid {
            row_axis: "environment".into(),
            ..grid
        };
        assert_eq!(best(&environments, &layout(None)), [[false, true]]);
        assert_eq!(best(&environments, &LatexLayout::default()), [[false, false]]);
    }
}
