//! The columns of a table as LaTeX: the texts of their cells, their widths, and their division over tables.

use super::{
    escape,
    layout::{LatexLayout, ValueForm},
    width::{self, Face},
};
use crate::table::{Cell, Grid, PrintedColumn};

/// Room between two columns, `\tabcolsep` on both sides of each.
const GAP: f64 = 12.0;

/// A printed column.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Column {
    /// Its letters between the braces of `tabular`.
    pub kind: &'static str,
    /// Heading of the column.
    pub heading: String,
    /// Texts of the rows.
    pub cells: Vec<String>,
    /// Width in points without the gap.
    width: f64,
    /// The column of the grid that it belongs to and is never separated from; `None` for the headings of the rows.
    group: Option<usize>,
}

/// Text of a cell in LaTeX and its width in points, each for the part before the decimal point and for the rest. The
/// first part is `None` if there is no number.
struct Text {
    before: Option<(String, f64)>,
    after: (String, f64),
}

impl Text {
    /// A text without a number to be aligned.
    fn words(latex: String, width: f64) -> Self {
        Self {
            before: None,
            after: (latex, width),
        }
    }

    fn plain(text: &str) -> Self {
        Self::words(signs(&escape(text)), width::width(text, Face::Plain))
    }

    /// A number and the text after it; `tail` is LaTeX with its width.
    fn number(number: &str, is_bold: bool, tail: (String, f64)) -> Self {
        let at = number.find(['.', 'e']).unwrap_or(number.len());
        let (before, after) = number.split_at(at);
        let face = if is_bold { Face::Bold } else { Face::Plain };
        let set = |text: &str| match signs(&escape(text)) {
            text if is_bold && !text.is_empty() => format!("\\textbf{{{text}}}"),
            text => text,
        };
        Self {
            before: Some((set(before), width::width(before, face))),
            after: (set(after) + &tail.0, width::width(after, face) + tail.1),
        }
    }

    /// The text in one column; bold text is in one piece.
    fn joined(&self) -> String {
        let text = self
            .before
            .as_ref()
            .map_or_else(String::new, |(text, _)| text.clone())
            + &self.after.0;
        text.replacen("}\\textbf{", "", 1)
    }

    fn width(&self) -> f64 {
        self.before.as_ref().map_or(0.0, |(_, width)| *width) + self.after.1
    }
}

/// All columns from left to right, that of the row headings first.
pub(super) fn columns(grid: &Grid, layout: &LatexLayout, best: &[Vec<bool>]) -> Vec<Column> {
    let rows = grid.rows.iter().map(|row| Text::plain(&row.label)).collect();
    let mut columns = vec![column("l", grid.corner(), rows, None)];
    for part in grid.parts() {
        let (PrintedColumn::Value(group) | PrintedColumn::Published(group) | PrintedColumn::Verdict(group)) =
            part;
        let texts: Vec<Text> = (0..grid.rows.len())
            .map(|row| text(grid, layout, (row, part), best[row][group]))
            .collect();
        let heading = grid.heading(part);
        match part {
            PrintedColumn::Verdict(_) if !layout.verdicts => {}
            PrintedColumn::Verdict(_) => columns.push(column("l", heading, texts, Some(group))),
            _ if layout.align_decimals => columns.push(aligned(heading, &texts, group)),
            _ => columns.push(column("r", heading, texts, Some(group))),
        }
    }
    columns
}

fn column(kind: &'static str, heading: &str, texts: Vec<Text>, group: Option<usize>) -> Column {
    let widest = texts
        .iter()
        .map(Text::width)
        .fold(width::width(heading, Face::Plain), f64::max);
    Column {
        kind,
        heading: escape(heading),
        cells: texts.iter().map(Text::joined).collect(),
        width: widest,
        group,
    }
}

/// A column of two parts that meet at the decimal point.
fn aligned(heading: &str, texts: &[Text], group: usize) -> Column {
    let both = |text: &str| format!("\\multicolumn{{2}}{{c}}{{{text}}}");
    let cell = |text: &Text| match &text.before {
        Some((before, _)) => format!("{before} & {}", text.after.0),
        None if text.after.0.is_empty() => " & ".into(),
        None => both(&text.after.0),
    };
    let numbers = || {
        texts
            .iter()
            .filter_map(|text| Some((text.before.as_ref()?.1, text.after.1)))
    };
    let left = numbers().map(|(before, _)| before).fold(0.0, f64::max);
    let right = numbers().map(|(_, after)| after).fold(0.0, f64::max);
    let words = texts.iter().filter(|text| text.before.is_none()).map(Text::width);
    Column {
        kind: "r@{}l",
        heading: both(&escape(heading)),
        cells: texts.iter().map(cell).collect(),
        width: words.fold(width::width(heading, Face::Plain).max(left + right), f64::max),
        group: Some(group),
    }
}

fn text(grid: &Grid, layout: &LatexLayout, (row, part): (usize, PrintedColumn), is_best: bool) -> Text {
    let text = grid.text(row, part);
    match part {
        _ if text.is_empty() => Text::words(String::new(), 0.0),
        PrintedColumn::Verdict(_) => {
            let text = text.to_lowercase();
            let width = width::width(&text, Face::SmallCapitals);
            Text::words(format!("\\textsc{{{}}}", escape(&text)), width)
        }
        PrintedColumn::Published(_) => Text::number(&text, false, (String::new(), 0.0)),
        PrintedColumn::Value(column) => match grid.cells[row][column].estimate {
            Some(estimate) => value(grid, layout, &grid.cells[row][column], estimate, is_best),
            None => Text::plain(&text),
        },
    }
}

fn value(grid: &Grid, layout: &LatexLayout, cell: &Cell, estimate: f64, is_best: bool) -> Text {
    let write = |number: f64| grid.format.write(number);
    let plain = |text: String| (signs(&escape(&text)), width::width(&text, Face::Plain));
    let (mut latex, mut width) = match (layout.value, cell.interval) {
        (ValueForm::Alone, _) | (_, None) => (String::new(), 0.0),
        (ValueForm::Brackets, Some((low, high))) => plain(format!(" [{}, {}]", write(low), write(high))),
        (ValueForm::SmallInterval, Some((low, high))) => {
            let text = format!("[{}, {}]", write(low), write(high));
            let latex = format!(" {{\\scriptsize {}}}", signs(&escape(&text)));
            (
                latex,
                width::width(" ", Face::Plain) + width::width(&text, Face::Small),
            )
        }
        (ValueForm::HalfWidth, Some((low, high))) => {
            let half = write((estimate - low).max(high - estimate));
            let width = width::width(&format!(" ± {half}"), Face::Plain);
            (format!(" $\\pm$ {}", signs(&escape(&half))), width)
        }
    };
    let remark = plain(grid.remark(cell));
    latex += &remark.0;
    width += remark.1;
    Text::number(&write(estimate), is_best, (latex, width))
}

/// Width of some columns side by side in points.
pub(super) fn width(columns: &[Column]) -> f64 {
    columns.iter().map(|column| column.width + GAP).sum()
}

/// The columns in groups that fit into some room, each with the headings of the rows. A column that is too wide has a
/// table of its own.
pub(super) fn split(columns: &[Column], room: f64) -> Vec<Vec<&Column>> {
    let Some((rows, rest)) = columns.split_first() else {
        return Vec::new();
    };
    let mut parts: Vec<Vec<&Column>> = vec![vec![rows]];
    let mut used = rows.width + GAP;
    for group in rest.chunk_by(|one, next| one.group == next.group) {
        let wide = width(group);
        if used + wide > room && parts.last().is_some_and(|part| part.len() > 1) {
            parts.push(vec![rows]);
            used = rows.width + GAP;
        }
        used += wide;
        if let Some(part) = parts.last_mut() {
            part.extend(group);
        }
    }
    parts
}

/// Hyphens before digits as minus signs.
pub(super) fn signs(text: &str) -> String {
    let mut out = String::new();
    let mut rest = text.chars().peekable();
    while let Some(character) = rest.next() {
        let is_sign = character == '-' && rest.peek().is_some_and(char::is_ascii_digit);
        if is_sign {
            out.push_str("$-$");
        } else {
            out.push(character);
        }
    }
    out
}
