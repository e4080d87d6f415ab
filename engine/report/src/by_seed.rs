//! The values of single seeds behind the cells of a table.

use super::sheet::{NONE, Sheet, SheetEntry};
use contract::Error;
use presentation::table::{Cell, Grid, write_csv};
use std::collections::{BTreeMap, BTreeSet};

/// One line per cell and seed, all digits.
///
/// # Errors
/// [`Error::Render`] where the writer refuses, which a buffer in memory does not do.
pub(super) fn csv(grid: &Grid) -> Result<String, Error> {
    let mut lines = vec![["row", "column", "seed", "value"].map(String::from).to_vec()];
    for (row, cells) in grid.rows.iter().zip(&grid.cells) {
        for (column, cell) in grid.columns.iter().zip(cells) {
            let line = |(seed, value): &(u64, f64)| {
                vec![
                    row.name.clone(),
                    column.name.clone(),
                    seed.to_string(),
                    value.to_string(),
                ]
            };
            lines.extend(cell.seeds.iter().map(line));
        }
    }
    write_csv(lines)
}

/// Number of values by seed in a table.
pub(super) fn count(grid: &Grid) -> usize {
    grid.cells.iter().flatten().map(|cell| cell.seeds.len()).sum()
}

/// A row per cell, a column per seed.
pub(super) fn sheet(grid: &Grid) -> Sheet {
    let seeds: BTreeSet<u64> = grid
        .cells
        .iter()
        .flatten()
        .flat_map(|cell| cell.seeds.iter().map(|(seed, _)| *seed))
        .collect();
    let head = std::iter::once("cell".into())
        .chain(seeds.iter().map(|seed| format!("seed {seed}")))
        .collect();
    let row = |(place, cell): (String, &Cell)| {
        let values: BTreeMap<u64, f64> = cell.seeds.iter().copied().collect();
        let value = |seed: &u64| {
            values
                .get(seed)
                .map_or(NONE.into(), |value| grid.format.write(*value))
        };
        std::iter::once(place)
            .chain(seeds.iter().map(value))
            .map(SheetEntry::plain)
            .collect()
    };
    // Cells without a trial are left out.
    let rows = grid
        .places()
        .filter(|(_, cell)| cell.planned > 0)
        .map(row)
        .collect();
    Sheet {
        head,
        words: 1,
        rows,
        ..Sheet::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use presentation::table::{self, Axis, Comparison};
    use testing::synthetic::study;

    fn grid() -> Grid {
        let comparison = Comparison {
            rows: Axis::Environment.into(),
            value: "cycle_length".into(),
            agents: vec!["dsac".into(), "ddpg".into()],
            labels: [("dsac".to_owned(), "SAC <1>".to_owned())].into(),
            ..Comparison::default()
        };
        table::compare(&comparison, &study()).unwrap()
    }

    #[test]
    fn every_value_of_every_cell_is_there() {
        let grid = grid();
        let text = csv(&grid).unwrap();
        assert_eq!(text.lines().count(), 1 + count(&grid));
        assert_eq!(count(&grid), 5 + 5 + 5 + 3);
        let (seed, value) = grid.cells[1][0].seeds[4];
        assert!(
            text.contains(&format!("eight_cells,dsac,{seed},{value}\n")),
            "{text}"
        );
    }

    #[test]
    fn a_missing_seed_leaves_a_gap_in_its_column() {
        let page = sheet(&grid()).html().into_string();
        assert_eq!(page.matches("<th scope=\"col\" class=\"value\">seed ").count(), 5);
        assert_eq!(page.matches("<td class=\"value\">–</td>").count(), 2);
        assert!(page.contains("four_cells, SAC &lt;1&gt;"), "{page}");
    }
}
