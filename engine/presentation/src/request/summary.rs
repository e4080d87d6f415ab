//! Checks the sentences of a study against its tables and claims.

use super::claims::Text;
use crate::{
    answers::{Answer, AnswerText},
    names::Names,
    summary::{LookupError, PLACEHOLDERS, PlaceholderTarget, Summary, SummaryError, locate},
};
use document::{
    Node,
    diagnostic::{Span, suggest},
};

impl Names<'_> {
    /// Reads a line of the answers; `None` if it cannot be read, after a diagnostic.
    pub(super) fn answer(
        &mut self,
        text: &AnswerText,
        node: &Node,
        at: &str,
        claims: usize,
    ) -> Option<Answer> {
        let here = match node.get("here") {
            Some(here) => self.sentence(&text.here, (here.span, &format!("{at}.here")), claims)?,
            None => Summary::default(),
        };
        let mut by = Vec::new();
        let items = node.get("by").map_or(&[][..], Node::items);
        for (index, (words, item)) in text.by.iter().zip(items).enumerate() {
            let place = (item.span, format!("{at}.by[{index}]"));
            match Summary::asks(words) {
                Ok(asks) => {
                    self.asked(&asks, claims, place);
                    by.push(asks);
                }
                Err(message) => self.say(place, message, "write `claim N`, or `TABLE: ROW, COLUMN`"),
            }
        }
        let text = text.clone();
        Some(Answer { text, here, by })
    }

    /// Checks every placeholder of the sentence; `None` if it cannot be read, after a diagnostic. `claims` is the
    /// number of claims.
    pub(super) fn sentence(
        &mut self,
        text: &str,
        (span, at): (Span, &str),
        claims: usize,
    ) -> Option<Summary> {
        let text = Text { text, span, at };
        match Summary::parse(text.text) {
            Err(SummaryError {
                start,
                length,
                message,
            }) => {
                self.say(within(&text, start, length), message, PLACEHOLDERS);
                None
            }
            Ok(summary) => {
                for slot in summary.slots() {
                    self.asked(&slot.asks, claims, within(&text, slot.start, slot.length));
                }
                Some(summary)
            }
        }
    }

    fn asked(&mut self, asks: &PlaceholderTarget, claims: usize, place: (Span, String)) {
        match asks {
            PlaceholderTarget::Claim(number) if *number > claims => {
                let help = match claims {
                    0 => "write them under `claims`".to_owned(),
                    _ => format!("it has {claims}, numbered from 1"),
                };
                self.say(place, format!("the study has no claim {number}"), help);
            }
            PlaceholderTarget::Claim(_) => {}
            PlaceholderTarget::Cell {
                table, place: cell, ..
            } => self.cell(table, cell, place),
        }
    }

    fn cell(&mut self, table: &str, cell: &str, place: (Span, String)) {
        let Some((rows, columns)) = self.shown.get(table) else {
            let help = suggest(table, self.shown.keys().map(String::as_str));
            return self.say(place, format!("no table is named `{table}`"), help);
        };
        let [rows, columns] =
            [rows, columns].map(|names| names.iter().map(String::as_str).collect::<Vec<_>>());
        // A table without rows has a diagnostic of its own.
        if rows.is_empty() {
            return;
        }
        let (message, help) = match locate(cell, &rows, &columns) {
            Ok(_) => return,
            Err(LookupError::Row(row)) => (
                format!("the table `{table}` has no row `{row}`"),
                suggest(&row, rows),
            ),
            Err(LookupError::Column(row, _)) if columns.len() < 2 => (
                format!("the table `{table}` has one column"),
                format!("write `{{{table}: {}}}`", rows[row]),
            ),
            Err(LookupError::Column(_, column)) => (
                format!("the table `{table}` has no column `{column}`"),
                suggest(&column, columns),
            ),
            Err(LookupError::WhichColumn) => (
                format!("the table `{table}` has several columns"),
                format!("write `{{{table}: {cell}, COLUMN}}`, {}", suggest("", columns)),
            ),
        };
        self.say(place, message, help);
    }
}

/// The position of a part of a text on one line of the file, or that of the whole text if it spans several lines.
fn within(text: &Text<'_>, start: usize, length: usize) -> (Span, String) {
    let characters = text.text.chars().count();
    if [characters, characters + 2].contains(&text.span.length) {
        text.place(start, length)
    } else {
        (text.span, text.at.into())
    }
}
