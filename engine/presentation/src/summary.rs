//! The sentence that sums a study up, with placeholders for values of its tables and verdicts on its claims.
//!
//! ```text
//! summary     = { TEXT | "{{" | "}}" | "{" placeholder "}" }
//! placeholder = TABLE ":" ROW [ "," COLUMN ] [ "published" | "verdict" ] | "claim" NUMBER
//! ```
//!
//! `{table-3.3: rule_1}` is the value of a table with one column as the table prints it, without its interval;
//! `{table-3.2: four, learner}` is that of a table with several. `published` after it asks for the published value,
//! `verdict` for the verdict. `{claim 2}` is the verdict on the second claim. `{{` and `}}` are braces.

/// Grammar of a placeholder, for messages.
pub const PLACEHOLDERS: &str = "write `{TABLE: ROW}` or `{TABLE: ROW, COLUMN}`, with `published` or `verdict` \
                                after it where that is asked for, or `{claim N}`; `{{` and `}}` are braces";

/// A sentence as text and as its parts.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Summary {
    /// The text as the study gives it.
    pub text: String,
    /// Its parts, in order.
    pub pieces: Vec<Piece>,
}

/// A part of a sentence.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Piece {
    /// Literal words.
    Text(String),
    /// A placeholder.
    Slot(Slot),
}

/// A placeholder with its position.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Slot {
    /// The value or verdict that it stands for.
    pub asks: PlaceholderTarget,
    /// Byte from the start of the text at which it begins.
    pub start: usize,
    /// Length in bytes, braces included.
    pub length: usize,
}

/// The value or verdict that a placeholder stands for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum PlaceholderTarget {
    /// A value or verdict of a table's cell.
    Cell {
        /// Name of the table.
        table: String,
        /// Row, or row and column with a comma between them; see [`locate`].
        place: String,
        /// The part of the cell.
        of: CellField,
    },
    /// The verdict on a claim, by its number in the study, from 1.
    Claim(usize),
}

/// The part of a cell that a placeholder stands for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CellField {
    /// The reproduced value, without its interval.
    Value,
    /// The published value.
    Published,
    /// The verdict on the published value.
    Verdict,
}

/// Error of a sentence that does not fit the grammar.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{message} (at byte {start})")]
pub struct SummaryError {
    /// Byte from the start of the text at which the mistake begins.
    pub start: usize,
    /// Length of the mistake in bytes.
    pub length: usize,
    /// Sentence on the mistake.
    pub message: String,
}

impl Summary {
    /// Reads a sentence.
    ///
    /// # Errors
    /// An error for the first placeholder or brace that does not fit the grammar.
    pub fn parse(text: &str) -> Result<Self, SummaryError> {
        let mut pieces = Vec::new();
        let mut at = 0;
        while at < text.len() {
            let (piece, length) = piece(text, at)?;
            pieces.push(piece);
            at += length;
        }
        let text = text.to_owned();
        Ok(Self { text, pieces })
    }

    /// Reads a placeholder without its braces.
    ///
    /// # Errors
    /// A sentence on the mistake.
    pub fn asks(text: &str) -> Result<PlaceholderTarget, String> {
        asks(text.trim())
    }

    /// The placeholders, in order.
    pub fn slots(&self) -> impl Iterator<Item = &Slot> {
        self.pieces.iter().filter_map(|piece| match piece {
            Piece::Slot(slot) => Some(slot),
            Piece::Text(_) => None,
        })
    }
}

/// The piece that begins at a byte of the text, and its length.
fn piece(text: &str, at: usize) -> Result<(Piece, usize), SummaryError> {
    let rest = &text[at..];
    for (double, brace) in [("{{", "{"), ("}}", "}")] {
        if rest.starts_with(double) {
            return Ok((Piece::Text(brace.into()), double.len()));
        }
    }
    let wrong = |length, message: String| {
        Err(SummaryError {
            start: at,
            length,
            message,
        })
    };
    if rest.starts_with('}') {
        return wrong(1, "this brace closes nothing".into());
    }
    let Some(inner) = rest.strip_prefix('{') else {
        let length = rest.find(['{', '}']).unwrap_or(rest.len());
        return Ok((Piece::Text(rest[..length].into()), length));
    };
    let Some(end) = inner
        .find(['{', '}'])
        .filter(|end| inner[*end..].starts_with('}'))
    else {
        return wrong(1, "this brace is not closed".into());
    };
    let length = end + 2;
    match asks(inner[..end].trim()) {
        Ok(asks) => Ok((
            Piece::Slot(Slot {
                asks,
                start: at,
                length,
            }),
            length,
        )),
        Err(message) => wrong(length, message),
    }
}

fn asks(text: &str) -> Result<PlaceholderTarget, String> {
    let Some((table, place)) = text.split_once(':') else {
        return claim(text);
    };
    let (table, place) = (table.trim(), place.trim());
    let (place, of) = match place.rsplit_once(char::is_whitespace) {
        Some((place, "published")) => (place.trim_end(), CellField::Published),
        Some((place, "verdict")) => (place.trim_end(), CellField::Verdict),
        _ => (place, CellField::Value),
    };
    if table.is_empty() || place.is_empty() {
        return Err(format!("`{{{text}}}` names no cell of a table"));
    }
    Ok(PlaceholderTarget::Cell {
        table: table.into(),
        place: place.into(),
        of,
    })
}

fn claim(text: &str) -> Result<PlaceholderTarget, String> {
    let number = text
        .strip_prefix("claim")
        .filter(|rest| rest.starts_with(char::is_whitespace));
    let Some(number) = number else {
        return Err(format!("`{{{text}}}` is no placeholder"));
    };
    match number.trim().parse() {
        Ok(number) if number > 0 => Ok(PlaceholderTarget::Claim(number)),
        _ => Err(format!("`{}` is no number of a claim", number.trim())),
    }
}

/// Reason why a place is not found in a table.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum LookupError {
    /// No row has this name.
    Row(String),
    /// The row with this index exists, but no column has this name.
    Column(usize, String),
    /// The row exists, but the table has several columns and the place names none.
    WhichColumn,
}

/// Row and column of `ROW`, in a table of one column, or of `ROW, COLUMN`. Names may have commas themselves, so every
/// comma is tried.
///
/// # Errors
/// The name that is in no table, or the missing column.
pub fn locate(place: &str, rows: &[&str], columns: &[&str]) -> Result<(usize, usize), LookupError> {
    let row_of = |name: &str| rows.iter().position(|known| *known == name);
    if let Some(row) = row_of(place) {
        return if columns.len() > 1 {
            Err(LookupError::WhichColumn)
        } else {
            Ok((row, 0))
        };
    }
    let mut lost = None;
    for (comma, _) in place.match_indices(',') {
        let (row, column) = (place[..comma].trim(), place[comma + 1..].trim());
        let Some(row) = row_of(row) else { continue };
        match columns.iter().position(|known| *known == column) {
            Some(column) => return Ok((row, column)),
            None => lost = Some(LookupError::Column(row, column.into())),
        }
    }
    let first = place.split(',').next().unwrap_or(place).trim();
    Err(lost.unwrap_or_else(|| LookupError::Row(first.into())))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn cell(table: &str, place: &str, of: CellField) -> PlaceholderTarget {
        PlaceholderTarget::Cell {
            table: table.into(),
            place: place.into(),
            of,
        }
    }

    #[test]
    fn every_placeholder_of_the_grammar_is_read() {
        let text = "Ours {t: a} against {t: a published}: { t:a,b  verdict }, {claim 12}; {{x}}.";
        let summary = Summary::parse(text).unwrap();
        let asked: Vec<PlaceholderTarget> = summary.slots().map(|slot| slot.asks.clone()).collect();
        let expected = [
            cell("t", "a", CellField::Value),
            cell("t", "a", CellField::Published),
            cell("t", "a,b", CellField::Verdict),
            PlaceholderTarget::Claim(12),
        ];
        assert_eq!(asked, expected);
        let written = |slot: &Slot| text[slot.start..slot.start + slot.length].to_owned();
        assert_eq!(
            summary.slots().map(written).collect::<Vec<_>>(),
            ["{t: a}", "{t: a published}", "{ t:a,b  verdict }", "{claim 12}"]
        );
        assert_eq!(summary.pieces[0], Piece::Text("Ours ".into()));
        assert!(summary.pieces.contains(&Piece::Text("{".into())));
    }

    #[test]
    fn a_row_may_be_called_like_what_is_asked_for() {
        let asked = |text: &str| Summary::parse(text).unwrap().slots().next().unwrap().asks.clone();
        assert_eq!(asked("{t: published}"), cell("t", "published", CellField::Value));
        assert_eq!(asked("{claim: 2}"), cell("claim", "2", CellField::Value));
    }

    #[test]
    fn what_is_no_placeholder_is_refused_where_it_stands() {
        let wrong = |text: &str| {
            let error = Summary::parse(text).unwrap_err();
            (error.start, error.length, error.message)
        };
        assert_eq!(wrong("ab {t: a"), (3, 1, "this brace is not closed".into()));
        assert_eq!(wrong("{t {u: a}"), (0, 1, "this brace is not closed".into()));
        assert_eq!(wrong("a } b"), (2, 1, "this brace closes nothing".into()));
        assert_eq!(wrong("ä {t}"), (3, 3, "`{t}` is no placeholder".into()));
        assert_eq!(wrong("{claims 2}").2, "`{claims 2}` is no placeholder");
        assert_eq!(wrong("{claim 0}").2, "`0` is no number of a claim");
        assert_eq!(wrong("{t: }").2, "`{t:}` names no cell of a table");
        assert_eq!(wrong("{: a}").2, "`{: a}` names no cell of a table");
    }

    #[test]
    fn names_with_commas_are_found_among_those_that_are_there() {
        let (rows, columns) = (["a", "a, b", "c"], ["b", "x, y"]);
        let found = |place: &str| locate(place, &rows, &columns);
        assert_eq!(found("a,b"), Ok((0, 0)));
        assert_eq!(found("a, b, b"), Ok((1, 0)));
        assert_eq!(found("c, x, y"), Ok((2, 1)));
        assert_eq!(found("a, b"), Err(LookupError::WhichColumn));
        assert_eq!(found("c, z"), Err(LookupError::Column(2, "z".into())));
        assert_eq!(found("z, b"), Err(LookupError::Row("z".into())));
        assert_eq!(locate("c", &rows, &[]), Ok((2, 0)));
    }

    proptest! {
        #[test]
        fn any_text_is_read_or_refused_inside_itself(text in "[{}a: ,ä1claim]{0,24}") {
            match Summary::parse(&text) {
                Ok(summary) => {
                    let ends = summary.slots().map(|slot| slot.start + slot.length);
                    prop_assert!(ends.into_iter().all(|end| end <= text.len()));
                }
                Err(error) => prop_assert!(text.get(error.start..error.start + error.length).is_some()),
            }
        }

        #[test]
        fn doubled_braces_stand_for_themselves(text in "[{}ab ]{0,12}") {
            let doubled = text.replace('{', "{{").replace('}', "}}");
            let pieces = Summary::parse(&doubled).unwrap().pieces;
            let read: String = pieces.iter().map(|piece| match piece {
                Piece::Text(text) => text.as_str(),
                Piece::Slot(_) => "?",
            }).collect();
            prop_assert_eq!(read, text);
        }
    }
}
