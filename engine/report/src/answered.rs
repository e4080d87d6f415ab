//! Findings of studies on printed items of their source, or on questions: one line each, with an answer that follows
//! from its verdicts.

use super::{
    sheet::{NONE, Sheet, SheetEntry, Tone},
    verdicts::{AnswerLine, Verdicts, Word},
};
use presentation::table::{escape_markdown, markdown_row};
use std::collections::BTreeMap;

const SHARE: &str = "share of the source's training";

/// The answers of some studies by family, each study with the link to its report. Studies without a family stand
/// together under an empty name. Lines without verdicts, and families without a line, are left out.
pub(super) fn sheets(studies: &[(String, &Verdicts)]) -> Vec<(String, Sheet)> {
    let mut families: BTreeMap<String, Vec<AnswerRow<'_>>> = BTreeMap::new();
    for (way, study) in studies {
        let family = study.family.clone().unwrap_or_default();
        let lines = study.answers.iter().filter(|it| !it.lines.is_empty());
        let lines = lines.map(|answered| AnswerRow { way, study, answered });
        families.entry(family).or_default().extend(lines);
    }
    families.retain(|_, lines| !lines.is_empty());
    let sheet = |(family, mut lines): (String, Vec<AnswerRow<'_>>)| {
        lines.sort_by_key(|line| natural(&line.answered.item));
        (family, sheet(&lines))
    };
    families.into_iter().map(sheet).collect()
}

/// The answers of some studies by family, in Markdown.
#[must_use]
pub fn answers_as_markdown(studies: &[(String, &Verdicts)]) -> Vec<(String, String)> {
    let sheets = sheets(studies).into_iter();
    sheets.map(|(family, sheet)| (family, sheet.markdown())).collect()
}

/// Number of lines with each answer, by family.
#[must_use]
pub fn counts_as_markdown<'a>(studies: impl Iterator<Item = &'a Verdicts>) -> String {
    let mut families: BTreeMap<String, [usize; Word::ALL.len()]> = BTreeMap::new();
    for study in studies {
        let words = study.answers.iter().filter_map(|answered| answered.word(study));
        for word in words {
            let counts = families
                .entry(study.family.clone().unwrap_or_default())
                .or_default();
            counts[word as usize] += 1;
        }
    }
    families.remove("");
    let row = |(family, counts): (String, [usize; Word::ALL.len()])| {
        let counts = counts.map(|count| SheetEntry::plain(count.to_string()));
        std::iter::once(SheetEntry::plain(family)).chain(counts).collect()
    };
    let head = std::iter::once("family").chain(Word::ALL.map(Word::text));
    let sheet = Sheet {
        head: head.map(String::from).collect(),
        words: 1,
        rows: families.into_iter().map(row).collect(),
        ..Sheet::default()
    };
    sheet.markdown()
}

/// The items of sources in their order, each with the studies about it and the links to their files.
#[must_use]
pub fn items_as_markdown(studies: &[(String, &Verdicts)]) -> String {
    let mut items: BTreeMap<Vec<(String, u64)>, (&str, Vec<SheetEntry>)> = BTreeMap::new();
    for (way, study) in studies {
        for answered in study.answers.iter().filter(|it| !it.item.is_empty()) {
            let (_, found) = items
                .entry(natural(&answered.item))
                .or_insert((&answered.item, Vec::new()));
            let entry = SheetEntry::plain(&study.study).to(way);
            if !found.contains(&entry) {
                found.push(entry);
            }
        }
    }
    let rows = items.into_values().map(|(item, studies)| {
        let studies: Vec<String> = studies.iter().map(SheetEntry::markdown).collect();
        markdown_row([escape_markdown(item), studies.join(", ")].into_iter())
    });
    let rows: Vec<String> = rows.collect();
    format!("| item | studies |\n|---|---|\n{}", rows.join("\n"))
}

struct AnswerRow<'a> {
    way: &'a str,
    study: &'a Verdicts,
    answered: &'a AnswerLine,
}

/// The answers of one study; `None` where it has none.
pub(super) fn of_study(study: &Verdicts) -> Option<Sheet> {
    let lines = study.answers.iter().filter(|it| !it.lines.is_empty());
    let lines = lines.map(|answered| AnswerRow {
        way: "",
        study,
        answered,
    });
    let mut sheet = sheet(&lines.collect::<Vec<_>>());
    // The page belongs to one study, so it needs no column with the study.
    sheet.head.pop();
    sheet.words -= 1;
    sheet.rows.iter_mut().for_each(|row| drop(row.pop()));
    (!sheet.rows.is_empty()).then_some(sheet)
}

fn sheet(lines: &[AnswerRow<'_>]) -> Sheet {
    let has_items = lines.iter().any(|line| !line.answered.item.is_empty());
    let has_shares = has_items && lines.iter().any(|line| line.study.training_share.is_some());
    let mut head = if has_items {
        vec!["item", "printed", "here", "same system"]
    } else {
        vec!["question", "here"]
    };
    head.extend(has_shares.then_some(SHARE));
    head.extend(["answer", "study"]);
    let rows = lines.iter().map(|line| line.entries(has_items, has_shares));
    Sheet {
        words: head.len(),
        head: head.into_iter().map(String::from).collect(),
        rows: rows.collect(),
        ..Sheet::default()
    }
}

impl AnswerRow<'_> {
    fn entries(&self, has_items: bool, has_shares: bool) -> Vec<SheetEntry> {
        let Self { way, study, answered } = self;
        let text = |text: &str| match text {
            "" => SheetEntry::plain(NONE),
            text => SheetEntry::of(Tone::Sentence, text),
        };
        let system = match answered.system.as_str() {
            "" => "yes",
            system => system,
        };
        let share = study.training_share.as_deref().unwrap_or_default();
        let item = has_items.then(|| text(&answered.item));
        let words = [text(&answered.printed), text(&answered.here)];
        let entries = item.into_iter().chain(words);
        let entries = entries.chain(has_items.then(|| text(system)));
        let entries = entries.chain(has_shares.then(|| text(share)));
        entries
            .chain([self.answer(), SheetEntry::plain(&study.study).to(*way)])
            .collect()
    }

    fn answer(&self) -> SheetEntry {
        let verdicts = &self.study.verdicts;
        let Some(word) = self.answered.word(self.study) else {
            return SheetEntry::plain(NONE);
        };
        let (word, colour) = word.written();
        let is_exploratory = |at: &usize| verdicts.get(*at).is_some_and(|it| it.exploratory);
        let note = if self.answered.lines.iter().any(is_exploratory) {
            " (exploratory)"
        } else {
            ""
        };
        SheetEntry::of(Tone::Verdict(colour), format!("{word}{note}"))
    }
}

/// A key of a text that sorts numbers in it as numbers.
fn natural(text: &str) -> Vec<(String, u64)> {
    let mut parts = vec![(String::new(), 0_u64)];
    for letter in text.chars() {
        let last = parts.len() - 1;
        match letter.to_digit(10) {
            Some(digit) => parts[last].1 = parts[last].1.saturating_mul(10).saturating_add(digit.into()),
            None if parts[last].1 > 0 => parts.push((letter.to_string(), 0)),
            None => parts[last].0.push(letter),
        }
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::passed::Passed;

    fn passed(about: &str, verdict: &str) -> Passed {
        Passed {
            about: about.into(),
            verdict: verdict.into(),
            ..Passed::default()
        }
    }

    #[test]
    fn items_stand_in_the_order_of_their_numbers_and_questions_have_fewer_columns() {
        let line = |item: &str| AnswerLine {
            item: item.into(),
            printed: "a > b".into(),
            here: "`a` 2, b 1".into(),
            lines: vec![0],
            ..AnswerLine::default()
        };
        let study = |family: &str, answers| Verdicts {
            study: "one".into(),
            family: Some(family.into()),
            answers,
            verdicts: vec![passed("claim 1: a.x > b.x", "SUPPORTED")],
            ..Verdicts::default()
        };
        let drawn = AnswerLine {
            lines: Vec::new(),
            ..line("figure 1.1")
        };
        let first = study("chapter 1", vec![line("table 1.10"), line("table 1.2"), drawn]);
        let second = study("beyond", vec![line("")]);
        let silent = study("chapter 9", Vec::new());
        let all = [
            ("one/report.md".to_owned(), &first),
            (String::new(), &second),
            (String::new(), &silent),
        ];
        let counts = counts_as_markdown(all.iter().map(|(_, study)| *study));
        assert!(counts.contains("| chapter 1 | 2 | 0 | 0 | 0 | 0 |"), "{counts}");
        let sheets = sheets(&all);
        let names: Vec<&str> = sheets.iter().map(|(family, _)| family.as_str()).collect();
        assert_eq!(names, ["beyond", "chapter 1"]);
        let [beyond, chapter] = [&sheets[0].1, &sheets[1].1].map(Sheet::markdown);
        assert!(beyond.contains("| a > b | `a` 2, b 1 | yes | one |"), "{beyond}");
        let row = "| table 1.2 | a > b | `a` 2, b 1 | yes | yes | [one](one/report.md) |";
        assert!(
            chapter.contains(row) && !chapter.contains("figure 1.1"),
            "{chapter}"
        );
        assert!(
            chapter.find("table 1.2 ") < chapter.find("table 1.10"),
            "{chapter}"
        );
    }
}
