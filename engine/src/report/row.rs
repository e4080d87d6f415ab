//! What a study came to in a sentence, and the study as a row of a table of all results.

use super::{Contents, StudyInfo, basis::seeds_as_used};
use crate::{
    results::Results,
    spec::summary::{Asks, Lost, OfCell, Piece, locate},
    table::{Heading, markdown_row, prose},
};

/// What stands for what is missing.
const MISSING: &str = "–";

/// The sentence of the study with everything filled in; `None` where it has none.
#[must_use]
pub fn sentence(study: &StudyInfo, contents: &Contents) -> Option<String> {
    if study.is_rehearsal {
        return None;
    }
    let filled = |piece: &Piece| match piece {
        Piece::Text(text) => text.clone(),
        Piece::Slot(slot) => answer(&slot.asks, contents).unwrap_or_else(|| MISSING.into()),
    };
    let pieces = &study.summary.as_ref()?.pieces;
    let text: String = pieces.iter().map(filled).collect();
    Some(text.trim().replace('\n', " "))
}

/// The study as a line of Markdown: its name, which leads to its report; title, seeds as used and whether
/// values in it were used to choose a setting; the sentence. `None` where it has no sentence, and where it
/// was not asked for as it is written.
pub(super) fn row(study: &StudyInfo, results: &Results, contents: &Contents) -> Option<String> {
    let sentence = sentence(study, contents).filter(|_| study.options.is_empty())?;
    let in_sample = is_in_sample(study).then(|| "in sample".to_owned());
    let title = Some(study.title.clone()).filter(|title| !title.is_empty());
    let what: Vec<String> = [title, Some(seeds_as_used(results)), in_sample]
        .into_iter()
        .flatten()
        .collect();
    let name = &study.name;
    let cells = [
        format!("[{name}](results/{name}/report.md)"),
        prose::markdown(&what.join(", ")),
        prose::markdown(&sentence),
    ];
    Some(markdown_row(cells.into_iter()))
}

/// True where something published or claimed was used to choose a setting.
fn is_in_sample(study: &StudyInfo) -> bool {
    study.tables.iter().any(|(_, spec)| spec.is_calibrated())
        || study.claims.iter().any(|spec| spec.calibrated_on.is_some())
}

/// What a placeholder stands for; `None` where it is missing.
fn answer(asks: &Asks, contents: &Contents) -> Option<String> {
    match asks {
        Asks::Claim(number) => claim(*number, contents),
        Asks::Cell { table, place, of } => cell(table, place, *of, contents),
    }
}

fn cell(table: &str, place: &str, of: OfCell, contents: &Contents) -> Option<String> {
    let (_, grid) = contents.tables.iter().find(|(name, _)| name == table)?;
    let grid = grid.as_ref().ok()?;
    let names = |headings: &[Heading]| headings.iter().map(|it| it.name.clone()).collect::<Vec<_>>();
    let (rows, columns) = (names(&grid.rows), names(&grid.columns));
    let [rows, columns] = [&rows, &columns].map(|names| names.iter().map(String::as_str).collect::<Vec<_>>());
    let (row, column) = match locate(place, &rows, &columns) {
        Ok(found) => found,
        // One of several agents that are compared with each other may leave one column, of another name.
        Err(Lost::Column(row, _)) if columns.len() == 1 => (row, 0),
        Err(_) => return None,
    };
    let cell = &grid.cells[row][column];
    match of {
        OfCell::Value => cell.estimate.map(|value| grid.format.write(value)),
        OfCell::Published => cell.published().map(|value| grid.format.published(value)),
        OfCell::Verdict => cell.judgement.is_some().then(|| cell.verdict_in_words()),
    }
}

/// The verdict on a claim; one for each place that it is held against where they are not the same.
fn claim(number: usize, contents: &Contents) -> Option<String> {
    let lines = || contents.claims.iter().filter(|line| line.number == number);
    let first = lines().next()?.verdict_in_words();
    if lines().all(|line| line.verdict_in_words() == first) {
        return Some(first);
    }
    let words = lines().map(|line| format!("{} in {}", line.verdict_in_words(), line.place));
    Some(words.collect::<Vec<_>>().join(", "))
}
