//! The first lines of a report: a line for each published value and claim, with the finding and its meaning.

use super::{
    ClaimLine, Contents,
    sheet::{NONE, Sheet, SheetEntry, Tone},
};
use presentation::table::{Cell, Grid};
use statistics::Verdict;

const HEAD: [&str; 4] = ["question", "answer", "value or difference", "published"];
/// The most deviations at the head of a report; the study lists them by importance.
pub(super) const FIRST_DEVIATIONS: usize = 3;

/// The answers to the study's published values and claims, in its order; `None` where there are none. Exploratory
/// values and claims answer nothing.
pub(super) fn sheet(contents: &Contents) -> Option<Sheet> {
    let grids = contents.tables.iter().filter_map(|(_, grid)| grid.as_ref().ok());
    let values = grids.flat_map(values);
    let claims = contents.claims.iter().filter(|line| !line.is_exploratory());
    let rows: Vec<Vec<SheetEntry>> = values.chain(claims.map(claim)).collect();
    (!rows.is_empty()).then(|| Sheet {
        head: HEAD.map(String::from).to_vec(),
        words: 2,
        rows,
        ..Sheet::default()
    })
}

fn values(grid: &Grid) -> Vec<Vec<SheetEntry>> {
    let published = |(place, cell): (String, &Cell)| {
        let published = cell.published().filter(|_| !grid.is_exploratory(cell))?;
        let verdict = cell.verdict()?;
        Some(vec![
            SheetEntry::plain(place),
            SheetEntry::of(Tone::Verdict(verdict.word()), value_in_words(cell, verdict)),
            SheetEntry::plain(
                cell.estimate
                    .map_or(NONE.into(), |value| grid.format.write(value)),
            ),
            SheetEntry::plain(grid.format.published(published)),
        ])
    };
    grid.places().filter_map(published).collect()
}

fn value_in_words(cell: &Cell, verdict: Verdict) -> String {
    let words = cell.verdict_in_words();
    match cell.calibrated_on {
        Some(_) if verdict == Verdict::Differs => format!("{words}, in spite of calibration"),
        _ => words,
    }
}

fn claim(line: &ClaimLine) -> Vec<SheetEntry> {
    let about = match line.spec.about.as_str() {
        "" => line.spec.claim.clone(),
        about => about.to_owned(),
    };
    let place = match line.place.as_str() {
        "" => String::new(),
        place => format!(" ({place})"),
    };
    vec![
        SheetEntry::plain(format!("{about}{place}")),
        SheetEntry::of(Tone::Verdict(line.word()), line.verdict_in_words()),
        SheetEntry::plain(line.difference().unwrap_or_else(|| NONE.into())),
        SheetEntry::plain(NONE),
    ]
}
