//! Sentences of a study with the values of its tables and the verdicts on its claims filled in.

use super::{Contents, StudyInfo};
use presentation::{
    summary::{CellField, LookupError, Piece, PlaceholderTarget, Summary, locate},
    table::Heading,
};

/// Replacement for a missing value.
const MISSING: &str = "–";

/// The summary of a study, in its own words; `None` where it has no sentence, and under the profile for trying it
/// out.
#[must_use]
pub fn sentence(study: &StudyInfo, contents: &Contents) -> Option<String> {
    let summary = study.summary.as_ref().filter(|_| !study.is_rehearsal)?;
    Some(filled(summary, contents))
}

/// A sentence with everything filled in, on one line.
pub(super) fn filled(sentence: &Summary, contents: &Contents) -> String {
    let piece = |piece: &Piece| match piece {
        Piece::Text(text) => text.clone(),
        Piece::Slot(slot) => answer(&slot.asks, contents).unwrap_or_else(|| MISSING.into()),
    };
    let text: String = sentence.pieces.iter().map(piece).collect();
    text.trim().replace('\n', " ")
}

/// Text of a placeholder; `None` where the value is missing.
fn answer(asks: &PlaceholderTarget, contents: &Contents) -> Option<String> {
    match asks {
        PlaceholderTarget::Claim(number) => claim(*number, contents),
        PlaceholderTarget::Cell { table, place, of } => cell(table, place, *of, contents),
    }
}

fn cell(table: &str, place: &str, of: CellField, contents: &Contents) -> Option<String> {
    let (_, grid) = contents.tables.iter().find(|(name, _)| name == table)?;
    let grid = grid.as_ref().ok()?;
    let names = |headings: &[Heading]| headings.iter().map(|it| it.name.clone()).collect::<Vec<_>>();
    let (rows, columns) = (names(&grid.rows), names(&grid.columns));
    let [rows, columns] = [&rows, &columns].map(|names| names.iter().map(String::as_str).collect::<Vec<_>>());
    let (row, column) = match locate(place, &rows, &columns) {
        Ok(found) => found,
        // A comparison of several agents may leave one column, under another name.
        Err(LookupError::Column(row, _)) if columns.len() == 1 => (row, 0),
        Err(_) => return None,
    };
    let cell = &grid.cells[row][column];
    match of {
        CellField::Value => cell.estimate.map(|value| grid.format.write(value)),
        CellField::Published => cell.published().map(|value| grid.format.published(value)),
        CellField::Verdict => cell.judgement.is_some().then(|| cell.verdict_in_words()),
    }
}

/// The verdict on a claim; one verdict per place where they differ.
fn claim(number: usize, contents: &Contents) -> Option<String> {
    let lines = || contents.claims.iter().filter(|line| line.number == number);
    let first = lines().next()?.verdict_in_words();
    if lines().all(|line| line.verdict_in_words() == first) {
        return Some(first);
    }
    let words = lines().map(|line| format!("{} in {}", line.verdict_in_words(), line.place));
    Some(words.collect::<Vec<_>>().join(", "))
}
