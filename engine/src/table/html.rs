//! A table in HTML: the verdict as a word, coloured by the page's style sheet.

use super::{Grid, Intervals, Part, prose};
use crate::plain_text::printable;
use std::fmt::Write as _;

/// A `table` element with caption and head, followed by its notes. It uses the classes `verdict`, `value` and
/// `notes`.
#[must_use]
pub fn html(grid: &Grid) -> String {
    let parts = grid.parts();
    let mut out = format!(
        "<table>\n<caption>{}</caption>\n<thead><tr><th scope=\"col\">{}</th>",
        prose::html(&grid.caption),
        escape(grid.corner())
    );
    for part in &parts {
        let _ = write!(
            out,
            "<th scope=\"col\" class=\"{}\">{}</th>",
            class(*part),
            escape(grid.heading(*part))
        );
    }
    out += "</tr></thead>\n<tbody>\n";
    for row in 0..grid.rows.len() {
        let _ = writeln!(
            out,
            "<tr><th scope=\"row\">{}</th>{}</tr>",
            escape(&grid.rows[row].label),
            cells(grid, row, &parts)
        );
    }
    out += "</tbody>\n</table>\n";
    let notes: String = grid
        .footnotes(Intervals::InBrackets)
        .iter()
        .map(|note| format!("<p>{}</p>\n", prose::html(note)))
        .collect();
    format!("{out}<div class=\"notes\">\n{notes}</div>\n")
}

fn cells(grid: &Grid, row: usize, parts: &[Part]) -> String {
    let cell = |part: &Part| match part {
        Part::Verdict(column) => {
            let verdict = grid.cells[row][*column]
                .verdict()
                .map(|verdict| word(verdict.word(), &grid.text(row, *part)));
            format!("<td class=\"verdict\">{}</td>", verdict.unwrap_or_default())
        }
        Part::Value(column) => {
            let seeds: Vec<String> = grid.cells[row][*column]
                .seeds
                .iter()
                .map(|(seed, value)| format!("{seed}: {value}"))
                .collect();
            format!(
                "<td class=\"value\" title=\"by seed: {}\">{}</td>",
                escape(&seeds.join(", ")),
                escape(&grid.text(row, *part))
            )
        }
        Part::Published(_) => format!("<td class=\"value\">{}</td>", escape(&grid.text(row, *part))),
    };
    parts.iter().map(cell).collect()
}

fn class(part: Part) -> &'static str {
    if matches!(part, Part::Verdict(_)) {
        "verdict"
    } else {
        "value"
    }
}

/// A text with the class of the word of a verdict, which carries its colour.
#[must_use]
pub fn word(verdict: &str, text: &str) -> String {
    let class = verdict.to_lowercase().replace(' ', "-");
    format!("<span class=\"word {class}\">{}</span>", escape(text))
}

/// Text with the characters that HTML reads as markup made plain, for text and for attributes in double
/// quotes.
#[must_use]
pub fn escape(text: &str) -> String {
    let mut out = String::new();
    for character in printable(text).chars() {
        match character {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            _ => out.push(character),
        }
    }
    out
}
