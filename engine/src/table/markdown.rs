//! A table in Markdown.

use super::{Grid, Intervals, Part, prose};

/// The table, its caption above it and its notes below it.
#[must_use]
pub fn markdown(grid: &Grid) -> String {
    let parts = grid.parts();
    let header = std::iter::once(grid.corner()).chain(parts.iter().map(|part| grid.heading(*part)));
    let mut lines = vec![
        line(header),
        format!(
            "|---{}|",
            parts.iter().map(|part| rule(*part)).collect::<String>()
        ),
    ];
    for (index, row) in grid.rows.iter().enumerate() {
        let cells: Vec<String> = parts.iter().map(|part| grid.text(index, *part)).collect();
        lines.push(line(
            std::iter::once(row.label.as_str()).chain(cells.iter().map(String::as_str)),
        ));
    }
    let notes: String = grid
        .footnotes(Intervals::InBrackets)
        .iter()
        .map(|note| format!("\n{}\n", prose::markdown(note)))
        .collect();
    let caption = if grid.caption.is_empty() {
        String::new()
    } else {
        format!("{}\n\n", prose::markdown(&grid.caption))
    };
    format!("{caption}{}\n{notes}", lines.join("\n"))
}

fn line<'a>(cells: impl Iterator<Item = &'a str>) -> String {
    row(cells.map(escape))
}

/// A line of a table; the cells are escaped already.
pub fn row(cells: impl Iterator<Item = String>) -> String {
    format!("| {} |", cells.collect::<Vec<_>>().join(" | "))
}

fn rule(part: Part) -> &'static str {
    if matches!(part, Part::Verdict(_)) {
        "|---"
    } else {
        "|--:"
    }
}

/// Text with the characters that Markdown reads as markup made plain.
#[must_use]
pub fn escape(text: &str) -> String {
    let mut out = String::new();
    for character in text.chars() {
        match character {
            '|' | '*' | '_' | '`' | '\\' | '<' | '#' => out.extend(['\\', character]),
            '\n' | '\r' => out.push(' '),
            _ => out.push(character),
        }
    }
    out
}
