//! Layout of a table on paper, with all its columns: upright, on a turned sheet, or smaller. A style sheet cannot
//! measure a table, so its width is estimated from the texts.

use maud::{Markup, html};
use presentation::table::{Grid, Heading, PrintedColumn, published_and_verdict};
use unicode_width::UnicodeWidthStr;

/// Size of text in tables on paper, in points.
const SIZE: f64 = 8.0;
/// Size below which values are broken at spaces, in points.
const SMALL: f64 = 5.0;
/// Width between the margins in points: the narrower of A4 and Letter, upright and turned.
const UPRIGHT: f64 = 527.0;
const TURNED: f64 = 723.0;
/// Width of a character and of the gap between columns, relative to the text size, for a wide typeface.
const CHARACTER: f64 = 0.64;
const GAP: f64 = 0.6;

/// Widths of the texts of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ColumnWidths {
    /// Characters of its longest text.
    whole: usize,
    /// Characters of its longest word.
    broken: usize,
}

impl ColumnWidths {
    /// A column with a heading and texts. The heading breaks at spaces; the texts do so where `words` is set.
    pub(super) fn of<'a>(head: &str, texts: impl Iterator<Item = &'a str>, words: bool) -> Self {
        let (mut whole, mut broken) = (longest_word(head), longest_word(head));
        for text in texts {
            broken = broken.max(longest_word(text));
            whole = whole.max(if words { longest_word(text) } else { text.width() });
        }
        Self { whole, broken }
    }
}

fn longest_word(text: &str) -> usize {
    text.split_whitespace()
        .map(UnicodeWidthStr::width)
        .max()
        .unwrap_or(0)
}

/// The columns of a table as the page has it.
pub(super) fn columns(grid: &Grid) -> Vec<ColumnWidths> {
    let labels = grid.rows.iter().map(|row| row.label.as_str());
    let first = ColumnWidths::of(grid.corner(), labels, true);
    let of_column = |(column, heading): (usize, &Heading)| {
        let texts = |row| {
            let under = published_and_verdict(grid, row, column).join(" ");
            [grid.text(row, PrintedColumn::Value(column)), under]
        };
        let texts: Vec<String> = (0..grid.rows.len()).flat_map(texts).collect();
        ColumnWidths::of(&heading.label, texts.iter().map(String::as_str), false)
    };
    std::iter::once(first)
        .chain(grid.columns.iter().enumerate().map(of_column))
        .collect()
}

/// Layout of a table on paper.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PaperFit {
    turned: bool,
    /// Whether values are broken at spaces.
    tight: bool,
    size: f64,
}

impl PaperFit {
    /// Upright where the table fits; else turned, then smaller, then with broken values, and then as small as needed.
    pub(super) fn of(columns: &[ColumnWidths]) -> Self {
        let width = |of: fn(&ColumnWidths) -> usize| {
            let characters = columns.iter().map(of).sum::<usize>();
            #[allow(
                clippy::cast_precision_loss,
                reason = "a table has far fewer than 2^52 characters in a row"
            )]
            let (characters, gaps) = (characters as f64, columns.len() as f64);
            CHARACTER * characters + GAP * gaps
        };
        let (whole, broken) = (width(|column| column.whole), width(|column| column.broken));
        let fitting = |width: f64| (TURNED / width.max(1.0)).min(SIZE);
        let (turned, tight) = (whole * SIZE > UPRIGHT, whole * SMALL > TURNED);
        Self {
            turned,
            tight,
            size: fitting(if tight { broken } else { whole }),
        }
    }

    /// The class of the element around the table and its title.
    pub(super) fn class(self) -> Option<&'static str> {
        self.turned.then_some("turned")
    }

    /// The table in a scrollable element.
    pub(super) fn around(self, table: &Markup) -> Markup {
        // Rounded down, so that the table still fits.
        let size = (self.size * 10.0).floor() / 10.0;
        let style = (self.size < SIZE).then(|| format!("--print-size: {size}pt"));
        html! { div.wide.tight[self.tight] style=[style] { (table) } }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(columns: usize, text: &str) -> PaperFit {
        PaperFit::of(&vec![
            ColumnWidths::of("a", std::iter::once(text), false);
            columns
        ])
    }

    #[test]
    fn tables_are_turned_before_they_are_made_smaller() {
        let open = |paper: PaperFit| paper.around(&Markup::default()).into_string();
        let small = table(4, "11.62 [11.4, 11.8]");
        assert_eq!(
            (small.class(), open(small).as_str()),
            (None, "<div class=\"wide\"></div>")
        );
        let turned = table(6, "11.62 [11.4, 11.8]");
        assert_eq!((turned.turned, turned.size), (true, SIZE));
        let smaller = table(9, "11.62 [11.4, 11.8]");
        assert!(
            !smaller.tight && (SMALL..SIZE).contains(&smaller.size),
            "{smaller:?}"
        );
        assert!(open(smaller).starts_with("<div class=\"wide\" style=\"--print-size: "));
        let tight = table(14, "11.62 [11.4, 11.8]");
        assert!(tight.tight && tight.size > SMALL, "{tight:?}");
        assert!(table(200, "11.62 [11.4, 11.8]").size < SMALL);
    }

    #[test]
    fn words_are_broken_and_values_are_not() {
        let column = |words| ColumnWidths::of("time per trial", ["one two", "three"].into_iter(), words);
        assert_eq!((column(true).whole, column(false).whole), (5, 7));
        assert_eq!(column(false).broken, 5);
    }
}
