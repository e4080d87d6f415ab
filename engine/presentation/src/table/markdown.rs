//! A table in Markdown.

use super::{Grid, Intervals, PrintedColumn, prose};
use document::plain_text::printable;

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

/// A line of a table; the cells are already escaped.
pub fn row(cells: impl Iterator<Item = String>) -> String {
    format!("| {} |", cells.collect::<Vec<_>>().join(" | "))
}

fn rule(part: PrintedColumn) -> &'static str {
    if matches!(part, PrintedColumn::Verdict(_)) {
        "|---"
    } else {
        "|--:"
    }
}

/// Text with Markdown's special characters escaped.
#[must_use]
pub fn escape(text: &str) -> String {
    let mut out = String::new();
    let text = printable(text);
    let refers = text.trim_start().starts_with('[');
    let mut rest = text.chars();
    while let Some(character) = rest.next() {
        match character {
            // Text in brackets is a link or an image depending on its next character, and a link definition at the
            // beginning of a text.
            ']' if rest.as_str().starts_with(['(', '[']) || refers && rest.as_str().starts_with(':') => {
                out.push_str("\\]");
            }
            '|' | '*' | '_' | '`' | '\\' | '<' | '#' => out.extend(['\\', character]),
            '\n' => out.push(' '),
            _ => out.push(character),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_and_images_are_text() {
        for text in [
            "[press](javascript:alert(1))",
            "![seen](https://example.org/a.png)",
            "[a][b]",
            "[b]: javascript:alert(1)",
            "<javascript:alert(1)>",
        ] {
            let escaped = escape(text);
            assert!(
                !["](", "][", "]:"]
                    .iter()
                    .any(|mark| escaped.replace("\\]", "").contains(mark))
            );
            assert!(!escaped.replace("\\<", "").contains('<'), "{escaped}");
        }
        assert_eq!(
            escape("![seen](https://a.b/c.png)"),
            "![seen\\](https://a.b/c.png)"
        );
        assert_eq!(escape("1.5 [1.2, 1.8] and [0, 1]"), "1.5 [1.2, 1.8] and [0, 1]");
        assert_eq!(escape("a\u{1b}[2Jb"), "a\u{fffd}[2Jb");
    }
}
