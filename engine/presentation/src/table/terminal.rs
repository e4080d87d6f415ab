//! A table as aligned text for a terminal.

use super::{Grid, Intervals, PrintedColumn};
use unicode_width::UnicodeWidthStr;

/// The table in at most `width` columns of characters; one line per cell if the whole table is wider.
#[must_use]
pub fn terminal(grid: &Grid, width: usize) -> String {
    with_notes(grid, width, &grid.footnotes(Intervals::InBrackets))
}

/// The table with only the notes on reading it.
#[must_use]
pub fn terminal_in_short(grid: &Grid, width: usize) -> String {
    with_notes(grid, width, &grid.how_read(Intervals::InBrackets))
}

fn with_notes(grid: &Grid, width: usize, notes: &[String]) -> String {
    let lines = wide(grid);
    let fits =
        |lines: &[Vec<String>]| widths(lines).iter().map(|column| column + 2).sum::<usize>() <= width + 2;
    let left = |part: &PrintedColumn| matches!(part, PrintedColumn::Verdict(_));
    let body = if fits(&lines) {
        let alignment: Vec<bool> = std::iter::once(true)
            .chain(grid.parts().iter().map(left))
            .collect();
        align(&lines, &alignment)
    } else {
        align(&long(grid), &[true, true, false, false, true])
    };
    let caption = if grid.caption.is_empty() {
        String::new()
    } else {
        format!("{}\n", wrap(&grid.caption, width))
    };
    let notes: String = notes
        .iter()
        .map(|note| format!("{}\n", wrap(note, width)))
        .collect();
    format!("{caption}{body}{notes}")
}

fn wide(grid: &Grid) -> Vec<Vec<String>> {
    let parts = grid.parts();
    let header =
        std::iter::once(grid.corner().into()).chain(parts.iter().map(|part| grid.heading(*part).into()));
    let row = |index: usize| {
        std::iter::once(grid.rows[index].label.clone())
            .chain(parts.iter().map(|part| grid.text(index, *part)))
            .collect()
    };
    std::iter::once(header.collect())
        .chain((0..grid.rows.len()).map(row))
        .collect()
}

fn long(grid: &Grid) -> Vec<Vec<String>> {
    let mut lines = vec![
        [grid.corner(), "", "value", "published", "verdict"]
            .map(String::from)
            .to_vec(),
    ];
    for row in 0..grid.rows.len() {
        // Cells without a trial in the study are left out.
        let cells = grid.cells[row].iter().enumerate();
        let cells = cells
            .filter(|(_, cell)| cell.planned > 0 || cell.estimate.is_some() || cell.published().is_some());
        for (column, _) in cells {
            let texts = [
                PrintedColumn::Value(column),
                PrintedColumn::Published(column),
                PrintedColumn::Verdict(column),
            ]
            .map(|part| grid.text(row, part));
            let headings = [grid.rows[row].label.clone(), grid.columns[column].label.clone()];
            lines.push(headings.into_iter().chain(texts).collect());
        }
    }
    lines
}

/// Lines under a head in aligned columns; words begin at the left.
pub fn align(lines: &[Vec<String>], left: &[bool]) -> String {
    let widths = widths(lines);
    let mut out = String::new();
    for (index, line) in lines.iter().enumerate() {
        let cells = line
            .iter()
            .zip(&widths)
            .zip(left)
            .map(|((cell, width), left)| pad(cell, *width, *left));
        out += cells.collect::<Vec<_>>().join("  ").trim_end();
        out.push('\n');
        if index == 0 {
            out += &widths
                .iter()
                .map(|width| "-".repeat(*width))
                .collect::<Vec<_>>()
                .join("  ");
            out.push('\n');
        }
    }
    out
}

fn widths(lines: &[Vec<String>]) -> Vec<usize> {
    let columns = lines.first().map_or(0, Vec::len);
    (0..columns)
        .map(|column| lines.iter().map(|line| line[column].width()).max().unwrap_or(0))
        .collect()
}

fn pad(text: &str, width: usize, left: bool) -> String {
    let space = " ".repeat(width.saturating_sub(text.width()));
    if left {
        format!("{text}{space}")
    } else {
        format!("{space}{text}")
    }
}

/// Text broken between words into lines of at most `width` columns.
#[must_use]
pub fn wrap(text: &str, width: usize) -> String {
    let (mut out, mut used) = (String::new(), 0);
    for word in text.split_whitespace() {
        let length = word.width();
        if used > 0 && used + 1 + length > width {
            out.push('\n');
            used = 0;
        } else if used > 0 {
            out.push(' ');
            used += 1;
        }
        out += word;
        used += length;
    }
    out
}
