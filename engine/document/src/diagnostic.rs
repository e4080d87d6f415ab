//! Mistakes in a study: message, position, and advice.
//!
//! A [`Diagnostic`] carries the text of the lines that it refers to, so that it can be shown without the original file.

use crate::{
    lookalikes,
    plain_text::{coloured, is_unprintable, printable},
    reach,
};
use serde::Serialize;
use std::{fmt::Write, path::Path};
use unicode_width::UnicodeWidthChar;

/// A range of characters on one line of one source.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub struct Span {
    /// Index into [`Sources`].
    pub source: usize,
    /// Line, from 1.
    pub line: usize,
    /// Column in characters, from 1.
    pub column: usize,
    /// Number of characters, at least 1 when shown.
    pub length: usize,
}

/// The texts to which spans refer: the study's file, and the words of the command line.
#[derive(Debug, Clone, Default)]
pub struct Sources {
    sources: Vec<SourceText>,
}

#[derive(Debug, Clone)]
struct SourceText {
    name: String,
    text: String,
    /// Byte offsets of the beginnings of lines.
    starts: Vec<usize>,
    numbered: bool,
    /// Whether messages quote no text of it.
    is_foreign: bool,
}

impl SourceText {
    /// A line, counted from 1; empty if there is none.
    fn line(&self, number: usize) -> &str {
        let start = number.checked_sub(1).and_then(|index| self.starts.get(index));
        let rest = start
            .and_then(|start| self.text.get(*start..))
            .unwrap_or_default();
        rest.lines().next().unwrap_or_default()
    }
}

impl Sources {
    /// Adds a file under the name that messages show, its path; returns its index. The text of a file outside the
    /// study's folder is not kept.
    pub fn add_file(&mut self, name: &str, text: &str) -> usize {
        let is_foreign = reach::is_foreign(Path::new(name));
        let index = self.add(name, if is_foreign { "" } else { text }, true);
        self.sources[index].is_foreign = is_foreign;
        index
    }

    /// Adds one option of the command line, as it was typed (`--set protocol.steps=1000`); returns its index.
    pub fn add_option(&mut self, option: &str) -> usize {
        self.add("command line", option, false)
    }

    fn add(&mut self, name: &str, text: &str, numbered: bool) -> usize {
        let behind = text.match_indices('\n').map(|(end, _)| end + 1);
        self.sources.push(SourceText {
            name: name.into(),
            starts: std::iter::once(0).chain(behind).collect(),
            text: text.into(),
            numbered,
            is_foreign: false,
        });
        self.sources.len() - 1
    }

    /// An error at `span`; `path` is the dotted path of the key, empty for the whole file.
    #[must_use]
    pub fn error(&self, span: Span, path: &str, message: impl Into<String>) -> Diagnostic {
        let place = self.place(span);
        let (message, path) = (place.said(&message.into(), 2000), shortened(path, 500));
        Diagnostic {
            severity: Severity::Error,
            message,
            path: if place.is_foreign { String::new() } else { path },
            place,
            about: None,
            help: None,
            notes: self.lookalike(span).into_iter().collect(),
        }
    }

    /// A letter in the text of a span that looks like another one. In longer texts, which are sentences, dashes and
    /// curly quotation marks are taken to be intended.
    fn lookalike(&self, span: Span) -> Option<(String, TextLocation)> {
        const LONGEST: usize = 60;
        let source = self.sources.get(span.source).filter(|_| span.length <= LONGEST)?;
        let letters = source.line(span.line).chars();
        let text: String = letters.skip(span.column - 1).take(span.length).collect();
        let found = lookalikes::first(&text)?;
        let at = Span {
            column: span.column + found.index,
            length: 1,
            ..span
        };
        Some((found.sentence(), self.place(at)))
    }

    /// Like [`error`](Self::error), for a setting that can be run but is probably not intended.
    #[must_use]
    pub fn warning(&self, span: Span, path: &str, message: impl Into<String>) -> Diagnostic {
        self.error(span, path, message).as_warning()
    }

    /// The position of a span, with the text of its line.
    #[must_use]
    pub fn place(&self, span: Span) -> TextLocation {
        let source = self.sources.get(span.source);
        let (text, left_out) = piece(source.map_or("", |source| source.line(span.line)), span.column);
        TextLocation {
            file: source.map_or_else(String::new, |source| source.name.clone()),
            line: span.line,
            column: span.column,
            length: span.length,
            numbered: source.is_some_and(|source| source.numbered),
            text,
            left_out,
            source: span.source,
            is_foreign: source.is_some_and(|source| source.is_foreign),
        }
    }
}

/// A line, or the part of a long one around a column, with the number of characters before that part: no message
/// contains a line of unlimited length.
fn piece(line: &str, column: usize) -> (String, usize) {
    const LONGEST: usize = 2000;
    if line.len() <= LONGEST {
        return (line.into(), 0);
    }
    let left_out = column.saturating_sub(LONGEST / 2);
    (line.chars().skip(left_out).take(LONGEST).collect(), left_out)
}

/// A location in a text that can be shown on its own.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct TextLocation {
    /// Name of the file, or `command line`.
    pub file: String,
    /// Line, from 1.
    pub line: usize,
    /// Column in characters, from 1.
    pub column: usize,
    /// Length in characters.
    pub length: usize,
    /// The line's text; for a very long line the part around the column.
    pub text: String,
    /// Number of characters of the line before `text`.
    #[serde(skip)]
    left_out: usize,
    #[serde(skip)]
    numbered: bool,
    #[serde(skip)]
    source: usize,
    #[serde(skip)]
    is_foreign: bool,
}

impl TextLocation {
    /// The beginning of a text for a message, without words of a file outside the study's folder.
    fn said(&self, text: &str, longest: usize) -> String {
        if self.is_foreign {
            shortened(&reach::without_words(text), longest)
        } else {
            shortened(text, longest)
        }
    }
}

impl TextLocation {
    /// Whether it is an option of the command line.
    #[must_use]
    pub fn is_option(&self) -> bool {
        !self.numbered
    }
}

/// Severity of a mistake: whether the study can still be run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// The study cannot be run.
    Error,
    /// The study cannot be run on this machine, which lacks something that it needs.
    Unavailable,
    /// The study can be run, but its results would say little.
    Warning,
}

/// One mistake in a study.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Diagnostic {
    /// Severity, which decides whether the study can still be run.
    pub severity: Severity,
    /// The mistake, as one lower-case fragment.
    pub message: String,
    /// Dotted path of the key, empty for the whole file.
    pub path: String,
    /// Position of the mistake.
    pub place: TextLocation,
    /// Meaning of the key: description, type, range, unit.
    pub about: Option<String>,
    /// The advice.
    pub help: Option<String>,
    /// Other positions that belong to the mistake, each with a remark.
    pub notes: Vec<(String, TextLocation)>,
}

impl Diagnostic {
    /// The same diagnostic, as a warning about a setting that can be run but is probably not intended.
    #[must_use]
    pub fn as_warning(self) -> Self {
        Self {
            severity: Severity::Warning,
            ..self
        }
    }

    /// The same diagnostic, about something that this machine lacks.
    #[must_use]
    pub fn as_unavailable(self) -> Self {
        Self {
            severity: Severity::Unavailable,
            ..self
        }
    }

    /// The same diagnostic with advice.
    #[must_use]
    pub fn help(self, help: impl Into<String>) -> Self {
        let help = Some(self.place.said(&help.into(), 5000));
        Self { help, ..self }
    }

    /// The same diagnostic with the meaning of the key; unchanged if that is empty.
    #[must_use]
    pub fn about(self, about: String) -> Self {
        Self {
            about: Some(about).filter(|text| !text.is_empty()),
            ..self
        }
    }

    /// The same diagnostic with one more position.
    #[must_use]
    pub fn note(mut self, remark: impl Into<String>, place: TextLocation) -> Self {
        self.notes.push((place.said(&remark.into(), 2000), place));
        self
    }

    fn order(&self) -> (usize, usize, usize) {
        (self.place.source, self.place.line, self.place.column)
    }
}

/// Whether a study is refused only because this machine lacks something.
#[must_use]
pub fn are_unavailable(diagnostics: &[Diagnostic]) -> bool {
    let has = |severity| diagnostics.iter().any(|it| it.severity == severity);
    has(Severity::Unavailable) && !has(Severity::Error)
}

/// Sorts by position and removes repeated ones.
#[must_use]
pub fn in_order(mut diagnostics: Vec<Diagnostic>) -> Vec<Diagnostic> {
    diagnostics.sort_by_key(Diagnostic::order);
    let mut kept = Vec::with_capacity(diagnostics.len());
    diagnostics.into_iter().for_each(|it| say_once(&mut kept, it));
    kept
}

/// Adds a diagnostic, unless it repeats one of the last ones.
pub fn say_once(kept: &mut Vec<Diagnostic>, diagnostic: Diagnostic) {
    let said =
        |other: &Diagnostic| other.order() == diagnostic.order() && other.message == diagnostic.message;
    if !kept.iter().rev().take(8).any(said) {
        kept.push(diagnostic);
    }
}

/// Number of diagnostics that are shown; a file with more mistakes has one from which they all come.
pub const SHOWN: usize = 50;

/// The first diagnostics as text, and the number of the others.
#[must_use]
pub fn render_first(diagnostics: &[Diagnostic]) -> String {
    let (shown, more) = diagnostics.split_at(diagnostics.len().min(SHOWN));
    let mut text = render(shown, false);
    if !more.is_empty() {
        let _ = writeln!(text, "\nand {} more messages, which are not shown", more.len());
    }
    text
}

/// All diagnostics as text for a terminal or a log, separated by empty lines.
#[must_use]
pub fn render(diagnostics: &[Diagnostic], colour: bool) -> String {
    let text = diagnostics.iter().map(one).collect::<Vec<_>>().join("\n");
    if colour { coloured(&text) } else { text }
}

/// All diagnostics for programs.
#[must_use]
pub fn to_json(diagnostics: &[Diagnostic]) -> serde_json::Value {
    // These are only strings, numbers and lists, so this cannot fail.
    serde_json::to_value(diagnostics).unwrap_or_default()
}

fn one(diagnostic: &Diagnostic) -> String {
    let places = std::iter::once(&diagnostic.place).chain(diagnostic.notes.iter().map(|(_, place)| place));
    let gutter = places
        .map(|place| {
            if place.numbered {
                place.line.to_string().len()
            } else {
                1
            }
        })
        .max()
        .unwrap_or(1);
    let severity = match diagnostic.severity {
        Severity::Error | Severity::Unavailable => "error",
        Severity::Warning => "warning",
    };
    let mut out = format!("{severity}: {}\n", printable(&diagnostic.message));
    excerpt(&mut out, &diagnostic.place, gutter, '^');
    let margin = " ".repeat(gutter);
    let lines = [
        (
            "at",
            Some(diagnostic.path.clone()).filter(|path| !path.is_empty()),
        ),
        ("key", diagnostic.about.clone()),
        ("help", diagnostic.help.clone()),
    ];
    for (word, text) in lines.into_iter().filter_map(|(word, text)| Some((word, text?))) {
        line(&mut out, &format!("{margin} = {word}: {}", printable(&text)));
    }
    for (remark, place) in &diagnostic.notes {
        line(&mut out, &format!("note: {}", printable(remark)));
        excerpt(&mut out, place, gutter, '-');
    }
    out
}

/// Largest length of the part of a line that is shown, and the length of the text before the position in it.
const WINDOW: (usize, usize) = (150, 60);

fn excerpt(out: &mut String, place: &TextLocation, gutter: usize, mark: char) {
    let margin = " ".repeat(gutter);
    if place.line == 0 {
        let file = printable(&place.file);
        return line(out, &format!("{margin}--> {file}"));
    }
    let number = if place.numbered {
        place.line.to_string()
    } else {
        String::new()
    };
    let position = if place.numbered {
        format!("{}:{}:{}", printable(&place.file), place.line, place.column)
    } else {
        printable(&place.file).into_owned()
    };
    line(out, &format!("{margin}--> {position}"));
    if place.is_foreign {
        let why = "its text is not shown: the file lies outside the study's folder";
        return line(out, &format!("{margin} = {why}"));
    }
    line(out, &format!("{margin} |"));
    let (shown, before) = window(place);
    line(out, &format!("{number:>gutter$} | {shown}"));
    let indent: String = shown
        .chars()
        .take(before)
        .flat_map(|letter| std::iter::repeat_n(' ', columns(letter)))
        .collect();
    // A position after the end of the line (a missing value, an open bracket) lies beyond every character.
    let beyond = before.saturating_sub(shown.chars().count()).min(1);
    let width: usize = shown
        .chars()
        .skip(before)
        .take(place.length.max(1))
        .map(columns)
        .sum();
    let marks: String = std::iter::repeat_n(mark, width.max(1)).collect();
    line(out, &format!("{margin} | {indent}{}{marks}", " ".repeat(beyond)));
}

/// The line around the position, and the number of its characters before the position.
fn window(place: &TextLocation) -> (String, usize) {
    let visible = |letter: char| match letter {
        '\t' => '→',
        letter if is_unprintable(letter) => '\u{fffd}',
        letter => letter,
    };
    let before = place.column.saturating_sub(1 + place.left_out);
    let count = place.text.chars().count();
    let start = if count > WINDOW.0 {
        before.saturating_sub(WINDOW.1)
    } else {
        0
    };
    let mut shown: String = place
        .text
        .chars()
        .skip(start)
        .take(WINDOW.0)
        .map(visible)
        .collect();
    if start + place.left_out > 0 {
        shown = format!("… {}", shown.chars().skip(2).collect::<String>());
    }
    if count > start + WINDOW.0 {
        shown.push_str(" …");
    }
    (shown, before - start)
}

/// Terminal columns of a character: two for East Asian wide ones and emoji, none for combining marks.
fn columns(letter: char) -> usize {
    letter.width().unwrap_or(0)
}

/// The beginning of a long text, for a message, which must not grow with the size of a file.
#[must_use]
pub fn shortened(word: &str, longest: usize) -> String {
    match word.char_indices().nth(longest) {
        Some((end, _)) => format!("{}…", &word[..end]),
        None => word.into(),
    }
}

fn line(out: &mut String, text: &str) {
    // Writing to a string cannot fail.
    let _ = writeln!(out, "{}", text.trim_end());
}

/// `did you mean ...?` and the known names, for a name that is not among them.
#[must_use]
pub fn suggest<'a>(wrong: &str, known: impl IntoIterator<Item = &'a str>) -> String {
    let known: Vec<&str> = known.into_iter().collect();
    let list = known
        .iter()
        .map(|name| format!("`{name}`"))
        .collect::<Vec<_>>()
        .join(", ");
    match nearest(wrong, &known) {
        _ if known.is_empty() => "none is known here".into(),
        Some(name) if known.len() > 1 => format!("did you mean `{name}`? known: {list}"),
        Some(name) => format!("did you mean `{name}`?"),
        None => format!("known: {list}"),
    }
}

/// The known name that was probably intended.
#[must_use]
pub fn nearest<'a>(wrong: &str, known: &[&'a str]) -> Option<&'a str> {
    let wrong = wrong.to_lowercase();
    let scored = known.iter().map(|name| {
        let lower = name.to_lowercase();
        let part = wrong.len() >= 4 && (lower.contains(&wrong) || wrong.contains(&lower) && lower.len() >= 4);
        let at_least = match () {
            () if is_short_for(&wrong, &lower) => 0.9,
            () if part => 0.61,
            () => 0.0,
        };
        (
            strsim::normalized_damerau_levenshtein(&wrong, &lower).max(at_least),
            *name,
        )
    });
    // The first of equals wins, so that the advice depends only on the order of the names.
    let best = scored.fold((0.0, ""), |best, next| if next.0 > best.0 { next } else { best });
    (best.0 > 0.6).then_some(best.1)
}

/// Whether a word consists of the first letters of a name's words, like `sac` for `soft_actor_critic`.
fn is_short_for(word: &str, name: &str) -> bool {
    let letters: String = name.split('_').filter_map(|part| part.chars().next()).collect();
    letters.len() > 1 && letters == word
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(text: &str, column: usize, length: usize) -> (Sources, Diagnostic) {
        let mut sources = Sources::default();
        let source = sources.add_file("a.yaml", text);
        let error = sources.error(
            Span {
                source,
                line: 1,
                column,
                length,
            },
            "a.b",
            "unknown key `b`",
        );
        (sources, error)
    }

    #[test]
    fn carets_stand_under_the_characters() {
        let (_, error) = sample("größe: {b: 1}", 9, 1);
        let text = render(&[error], false);
        let lines: Vec<&str> = text.lines().collect();
        let column = |line: &str, wanted: char| line.chars().position(|letter| letter == wanted).unwrap();
        assert_eq!(column(lines[4], '^'), column(lines[3], 'b'));
        assert_eq!(lines[4].matches('^').count(), 1);
        assert_eq!(lines[1], " --> a.yaml:1:9");
    }

    #[test]
    fn wide_characters_take_two_columns() {
        let (_, error) = sample("電池: {b: 1}", 1, 2);
        assert!(
            render(&[error], false)
                .lines()
                .nth(4)
                .unwrap()
                .ends_with("| ^^^^")
        );
    }

    #[test]
    fn of_a_long_line_the_part_around_the_place_is_shown() {
        let text = format!("{}b{}", "a".repeat(500), "c".repeat(500));
        let (_, error) = sample(&text, 501, 1);
        let rendered = render(&[error], false);
        let lines: Vec<&str> = rendered.lines().collect();
        let column = |line: &str, wanted: char| line.chars().position(|letter| letter == wanted).unwrap();
        assert_eq!(column(lines[4], '^'), column(lines[3], 'b'));
        assert!(lines[3].chars().count() < 170);
    }

    #[test]
    fn control_characters_do_not_reach_the_terminal() {
        let (_, error) = sample("a: \u{1b}[31m", 1, 1);
        assert!(!render(&[error], false).contains('\u{1b}'));
    }

    #[test]
    fn colour_adds_codes_only() {
        let (_, error) = sample("a: {b: 1}", 5, 1);
        let coloured = render(std::slice::from_ref(&error), true);
        assert!(coloured.contains("\x1b[1;31merror\x1b[0m"));
        let mut plain = coloured;
        for code in ["\x1b[1;31m", "\x1b[1;34m", "\x1b[1m", "\x1b[0m"] {
            plain = plain.replace(code, "");
        }
        assert_eq!(plain, render(&[error], false));
    }

    #[test]
    fn a_warning_says_that_it_is_one() {
        let (sources, error) = sample("a: {b: 1}", 5, 1);
        let warning = sources.warning(
            Span {
                source: 0,
                line: 1,
                column: 5,
                length: 1,
            },
            "a.b",
            "unknown key `b`",
        );
        let text = |diagnostic: &Diagnostic| render(std::slice::from_ref(diagnostic), false);
        assert_eq!(text(&warning), text(&error).replace("error: ", "warning: "));
        let severities = to_json(&[error, warning]);
        assert_eq!(
            [&severities[0]["severity"], &severities[1]["severity"]],
            ["error", "warning"]
        );
    }

    #[test]
    fn diagnostics_are_sorted_and_said_once() {
        let (sources, first) = sample("a: {b: 1}\nc: 2", 5, 1);
        let second = sources.error(
            Span {
                source: 0,
                line: 2,
                column: 1,
                length: 1,
            },
            "c",
            "unknown key `c`",
        );
        assert_eq!(
            in_order(vec![second.clone(), first.clone(), first.clone()]),
            vec![first, second]
        );
    }

    #[test]
    fn names_that_are_far_off_get_no_suggestion() {
        assert_eq!(
            nearest("cycle_lenght", &["return", "cycle_length"]),
            Some("cycle_length")
        );
        assert_eq!(nearest("zzz", &["return", "cycle_length"]), None);
        let names = ["lac", "soft_actor_critic", "learning_starts", "learning_rate"];
        assert_eq!(nearest("sac", &names), Some("soft_actor_critic"));
        assert_eq!(nearest("lr", &names), Some("learning_rate"));
        assert_eq!(suggest("zzz", ["a", "b"]), "known: `a`, `b`");
    }
}
