//! The claims of a study with their verdicts, as a table.

use super::{
    Contents,
    claim_line::ClaimLine,
    sheet::{Sheet, SheetEntry, Tone},
};
use analysis::claim::ClaimVerdict;
use contract::standard_metrics::{TIMES_ARE_OF_THE_MACHINE, names_times};
use std::collections::BTreeSet;

const HEAD: [&str; 5] = ["claim", "environment", "verdict", "left minus right", "notes"];

/// A row for each claim and place of its evaluation; `None` without claims.
pub(super) fn sheet(contents: &Contents) -> Option<Sheet> {
    let row = |line: &ClaimLine| {
        vec![
            SheetEntry::of(Tone::Code, &line.spec.claim),
            SheetEntry::plain(&line.place),
            SheetEntry::of(Tone::Verdict(line.word()), line.verdict_in_words()),
            SheetEntry::plain(line.numbers()),
            SheetEntry::of(Tone::Sentence, in_one_line(&line.notes())),
        ]
    };
    let rows: Vec<_> = contents.claims.iter().map(row).collect();
    let head = HEAD.map(String::from).to_vec();
    (!rows.is_empty()).then(|| Sheet {
        title: String::new(),
        head,
        words: HEAD.len(),
        rows,
        notes: notes(contents),
    })
}

/// Notes in a row; one that is a sentence of its own loses its full stop.
fn in_one_line(notes: &[String]) -> String {
    let notes: Vec<_> = notes.iter().map(|note| note.trim_end_matches('.')).collect();
    notes.join("; ")
}

/// Notes under the claims: causes of refuted claims that the study states, numbers of seeds too small for a
/// permutation test to decide anything, and the dependence of times on the machine.
pub(super) fn notes(contents: &Contents) -> Vec<String> {
    let note = |claim: &ClaimVerdict| Some(format!("{}: {}.", claim.size(), claim.permutation?.note(0.05)?));
    let claims = contents
        .claims
        .iter()
        .filter_map(|line| line.verdict.as_ref().ok());
    let mut notes = causes(contents);
    notes.extend(claims.filter_map(note).collect::<BTreeSet<_>>());
    let of_times = contents.claims.iter().any(|line| names_times(&line.spec));
    notes.extend(of_times.then(|| TIMES_ARE_OF_THE_MACHINE.to_owned()));
    notes
}

/// Causes of refuted claims, each once, in however many environments the claim is refuted.
fn causes(contents: &Contents) -> Vec<String> {
    let mut causes: Vec<String> = Vec::new();
    for line in &contents.claims {
        let cause = line
            .cause()
            .map(|text| format!("Cause (`{}`): {text}", line.spec.claim));
        causes.extend(cause.filter(|cause| !causes.contains(cause)));
    }
    causes
}
