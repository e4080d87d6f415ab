//! A table in HTML. A verdict is a word coloured by the page's style sheet.

use super::{Grid, Intervals, PrintedColumn, prose};
use maud::{Markup, html};
use statistics::Verdict;

/// A `table` element with caption and head, followed by its notes. A published value and its verdict are printed under
/// their value. It uses the classes `value`, `under` and `notes`.
#[must_use]
pub fn html(grid: &Grid) -> Markup {
    html! {
        table {
            caption { (prose::html(&grid.caption)) }
            thead {
                tr {
                    th scope="col" { (grid.corner()) }
                    @for column in &grid.columns { th.value scope="col" { (column.label) } }
                }
            }
            tbody {
                @for (row, heading) in grid.rows.iter().enumerate() {
                    tr {
                        th scope="row" { (heading.label) }
                        @for column in 0..grid.columns.len() { (cell(grid, row, column)) }
                    }
                }
            }
        }
        div.notes {
            @for note in grid.footnotes(Intervals::InBrackets) { p { (prose::html(&note)) } }
        }
    }
}

fn cell(grid: &Grid, row: usize, column: usize) -> Markup {
    let seeds = grid.cells[row][column].seeds.iter();
    let seeds: Vec<String> = seeds.map(|(seed, value)| format!("{seed}: {value}")).collect();
    let [published, verdict] = published_and_verdict(grid, row, column);
    let word_of_verdict = grid.cells[row][column].verdict().map(Verdict::word);
    html! {
        td.value title={ "by seed: " (seeds.join(", ")) } {
            (grid.text(row, PrintedColumn::Value(column)))
            @if !published.is_empty() || word_of_verdict.is_some() {
                div.under {
                    (published) " "
                    @if let Some(name) = word_of_verdict { (word(name, &verdict)) }
                }
            }
        }
    }
}

/// Lines under a value: the published one, and the verdict.
#[must_use]
pub fn published_and_verdict(grid: &Grid, row: usize, column: usize) -> [String; 2] {
    let published = match grid.text(row, PrintedColumn::Published(column)) {
        nothing if nothing.is_empty() => nothing,
        value => format!("published {value}"),
    };
    [published, grid.text(row, PrintedColumn::Verdict(column))]
}

/// A text with the class of a verdict's word, which gives its colour.
#[must_use]
pub fn word(verdict: &str, text: &str) -> Markup {
    let class = verdict.to_lowercase().replace(' ', "-");
    html! { span.word.(class) { (text) } }
}
