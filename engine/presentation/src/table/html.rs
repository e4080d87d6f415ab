//! A table in HTML: the verdict as a word, coloured by the page's style sheet.

use super::{Grid, Intervals, Part, prose};
use document::plain_text::printable;
use std::fmt::Write as _;

/// A `table` element with caption and head, followed by its notes. A published value and its verdict stand under the
/// value that they belong to. It uses the classes `value`, `under` and `notes`.
#[must_use]
pub fn html(grid: &Grid) -> String {
    let heading = |label: &str| format!("<th scope=\"col\" class=\"value\">{}</th>", escape(label));
    let headings: String = grid.columns.iter().map(|column| heading(&column.label)).collect();
    let mut out = format!(
        "<table>\n<caption>{}</caption>\n<thead><tr><th scope=\"col\">{}</th>{headings}</tr></thead>\n<tbody>\n",
        prose::html(&grid.caption),
        escape(grid.corner())
    );
    for (row, heading) in grid.rows.iter().enumerate() {
        let cells: String = (0..grid.columns.len())
            .map(|column| cell(grid, row, column))
            .collect();
        let _ = writeln!(
            out,
            "<tr><th scope=\"row\">{}</th>{cells}</tr>",
            escape(&heading.label)
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

fn cell(grid: &Grid, row: usize, column: usize) -> String {
    let seeds = grid.cells[row][column].seeds.iter();
    let seeds: Vec<String> = seeds.map(|(seed, value)| format!("{seed}: {value}")).collect();
    format!(
        "<td class=\"value\" title=\"by seed: {}\">{}{}</td>",
        escape(&seeds.join(", ")),
        escape(&grid.text(row, Part::Value(column))),
        under(grid, row, column)
    )
}

/// The published value and the verdict of a cell; empty where there is neither.
fn under(grid: &Grid, row: usize, column: usize) -> String {
    let [published, words] = published_and_verdict(grid, row, column);
    let verdict = grid.cells[row][column].verdict();
    let verdict = verdict.map_or(String::new(), |verdict| word(verdict.word(), &words));
    match escape(&published) + &verdict {
        nothing if nothing.is_empty() => nothing,
        _ => format!("<div class=\"under\">{} {verdict}</div>", escape(&published)),
    }
}

/// What stands under a value: the published one, and the verdict.
#[must_use]
pub fn published_and_verdict(grid: &Grid, row: usize, column: usize) -> [String; 2] {
    let published = match grid.text(row, Part::Published(column)) {
        nothing if nothing.is_empty() => nothing,
        value => format!("published {value}"),
    };
    [published, grid.text(row, Part::Verdict(column))]
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
