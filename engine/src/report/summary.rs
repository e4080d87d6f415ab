//! The report in short, for a terminal.

use super::{Contents, StudyInfo, basis, budgets, claims, head, sentence};
use crate::{
    results::Results,
    table::{terminal, wrap},
};
use std::path::Path;

/// Tables, claims, what was not trained, profiles, counts of verdicts and the path of the page, as plain text
/// of at most `width` characters a line.
#[must_use]
pub fn summary(
    study: &StudyInfo,
    results: &Results,
    contents: &Contents,
    page: &Path,
    width: usize,
) -> String {
    let mut parts = vec![wrap(
        if study.title.is_empty() {
            &study.name
        } else {
            &study.title
        },
        width,
    )];
    parts.extend(study.asked_with().map(|options| wrap(&options, width)));
    parts.extend(study.rehearsal().map(|banner| wrap(banner, width)));
    parts.extend(study.outdated().iter().map(|sentence| wrap(sentence, width)));
    parts.extend(sentence(study, contents).map(|sentence| wrap(&sentence, width)));
    for (name, grid) in &contents.tables {
        parts.push(match grid {
            Ok(grid) => format!("{name}\n{}", terminal(grid, width).trim_end()),
            Err(reason) => wrap(&format!("{name}: could not be made: {reason}"), width),
        });
    }
    let failed = contents
        .figures
        .iter()
        .filter(|(name, _)| !contents.kept.contains_key(name))
        .filter_map(|(name, chart)| chart.as_ref().err().map(|reason| (name, reason)));
    parts.extend(failed.map(|(name, reason)| wrap(&format!("{name}: could not be drawn: {reason}"), width)));
    if !contents.claims.is_empty() {
        parts.push(verdicts(contents, width));
    }
    let mut last: Vec<String> = budgets::untrained(results);
    last.push(basis(study, results, contents));
    last.extend(counts(study, contents));
    last.push(format!("Time: {}", contents.cost(results).sentence()));
    last.extend(
        study
            .profiles
            .iter()
            .map(|it| format!("Profile {}: {}", it.name(), it.sentence())),
    );
    let mut last: Vec<String> = last.iter().map(|line| wrap(line, width)).collect();
    last.push(format!("Report: {}", page.display()));
    parts.push(last.join("\n"));
    parts.join("\n\n") + "\n"
}

fn verdicts(contents: &Contents, width: usize) -> String {
    let line = |line: &super::ClaimLine| {
        let place = if line.place.is_empty() || line.spec.claim.ends_with(&line.place) {
            String::new()
        } else {
            format!(" in {}", line.place)
        };
        let numbers = line.numbers();
        let numbers = if numbers.is_empty() {
            String::new()
        } else {
            format!(": difference {numbers}")
        };
        let together = line
            .together()
            .map(|outcome| format!("all claims together (Holm): {outcome}"));
        let notes: String = line
            .notes()
            .into_iter()
            .chain(together)
            .map(|note| format!("; {note}"))
            .collect();
        let text = wrap(
            &format!("{}{place}{numbers}{notes}", line.spec.claim),
            width.saturating_sub(14).max(20),
        );
        format!("{:<12}  {}", line.word(), text.replace('\n', "\n              "))
    };
    let notes = claims::notes(contents).into_iter().map(|note| wrap(&note, width));
    contents
        .claims
        .iter()
        .map(line)
        .chain(notes)
        .collect::<Vec<_>>()
        .join("\n")
}

fn counts(study: &StudyInfo, contents: &Contents) -> Vec<String> {
    let line = |counts: &head::Line| {
        let words: Vec<String> = counts
            .words
            .iter()
            .map(|(word, n)| format!("{n} {word}"))
            .collect();
        format!("{}: {}", counts.what, words.join(", "))
    };
    head::lines(study, contents).iter().map(line).collect()
}
