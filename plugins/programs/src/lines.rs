//! Lines of a program's output that hold metrics: JSON objects, or words `KEY=VALUE`.
//!
//! The declared keys of each such line are noted in a file of JSON lines, which is then read like any other
//! file. A text that no reader would take for a number is not a value of a metric, as in a line `loss=see
//! below`. One that is meant as a number and is none, as in `loss=1,5` or `loss=tensor(0.5)`, is noted as it stands, so
//! that the trial fails instead of losing the value.

use anstream::adapter::strip_str;
use imported::of_line;
use serde_json::{Map, Value, json};
use std::collections::{BTreeMap, BTreeSet};

/// Longest line, bytes; longer ones are ignored.
const LONGEST: usize = 1 << 20;
/// Most other keys that are kept for a message.
const MOST_KEYS: usize = 100;
/// The key of the step if a study names none.
const STEP: &str = "step";
/// Key of a noted line for the position in the output at which the line ends.
pub const AT: &str = "regimen_at";

/// Splits bytes into lines; a carriage return ends one too, as progress bars write it.
#[derive(Debug, Default)]
pub struct Lines {
    /// Position in the output after the bytes so far.
    at: u64,
    begun: Vec<u8>,
    is_passed_over: bool,
}

impl Lines {
    /// Lines of a file from a position on. The rest of a line that began before the position is skipped, unless
    /// the position is the end of a line.
    pub fn from(at: u64, is_end_of_line: bool) -> Self {
        Self {
            at,
            begun: Vec::new(),
            is_passed_over: !is_end_of_line,
        }
    }

    /// Position in the output after the bytes so far.
    pub fn at(&self) -> u64 {
        self.at
    }

    /// Adds bytes, and calls `line` with each line that ends in them and the position of its end.
    pub fn take(&mut self, bytes: &[u8], line: &mut dyn FnMut(&str, u64)) {
        for piece in bytes.split_inclusive(|byte| matches!(byte, b'\n' | b'\r')) {
            let is_whole = piece.ends_with(b"\n") || piece.ends_with(b"\r");
            self.at += piece.len() as u64;
            self.is_passed_over |= self.begun.len() + piece.len() > LONGEST;
            if !self.is_passed_over {
                self.begun.extend(piece);
            }
            if is_whole {
                self.end(line);
            }
        }
    }

    /// Passes on the last line, which has no line end.
    pub fn end(&mut self, line: &mut dyn FnMut(&str, u64)) {
        let text = String::from_utf8_lossy(&self.begun);
        let text = text.trim();
        if !text.is_empty() && !self.is_passed_over {
            line(text, self.at);
        }
        self.begun.clear();
        self.is_passed_over = false;
    }
}

/// Selects the metrics in the lines of a stream.
#[derive(Debug, Clone, Default)]
pub struct Filter {
    /// Keys of metrics.
    pub keys: BTreeSet<String>,
    /// Whether every key with a number is a metric.
    pub all: bool,
    /// Keys of steps that the study names.
    pub steps: BTreeSet<String>,
    /// Whether a metric has no named step: its steps stand under `step`, or its lines are numbered.
    pub numbers: bool,
    /// Count of the lines with metrics so far.
    pub counted: u64,
    /// Keys in the lines, for a message.
    pub seen: BTreeSet<String>,
    /// The first value of each metric that is no number, for a message.
    pub no_numbers: BTreeMap<String, String>,
}

/// A key in the lines of a program's output.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SeenKey {
    /// The key.
    pub name: String,
    /// A value of it that is no number.
    pub no_number: Option<String>,
}

impl Filter {
    /// The note of a line that ends at `at` in the output; `None` where it holds no metric.
    pub fn noted(&mut self, line: &str, at: u64) -> Option<String> {
        let line = strip_str(line).to_string();
        let values = values(&line)?;
        for (key, value) in &values {
            let is_declared = self.keys.contains(key);
            if is_declared || self.seen.len() < MOST_KEYS && !self.seen.contains(key) {
                self.seen.insert(key.clone());
            }
            if is_declared && !is_number(value) && !self.no_numbers.contains_key(key) {
                self.no_numbers.insert(key.clone(), value.clone());
            }
        }
        let is_metric = |key: &str, value: &str| {
            self.keys.contains(key) && is_meant_as_number(value) || self.all && is_number(value)
        };
        if !values.iter().any(|(key, value)| is_metric(key, value)) {
            return None;
        }
        self.counted += 1;
        let is_step = |key: &str| self.steps.contains(key) || self.numbers && key == STEP;
        let counts = |(key, value): &(String, String)| is_step(key) || is_metric(key, value);
        let noted = values.into_iter().filter(counts);
        let mut noted: Map<String, Value> = noted.map(|(key, value)| (key, value.into())).collect();
        if self.numbers && !noted.contains_key(STEP) {
            noted.insert(STEP.into(), json!(self.counted));
        }
        noted.insert(AT.into(), json!(at));
        Some(Value::Object(noted).to_string())
    }
}

fn is_number(text: &str) -> bool {
    text.parse::<f64>().is_ok()
}

/// Whether a text is a number or looks like one: it begins with digits, or a call around such a text ends it.
fn is_meant_as_number(text: &str) -> bool {
    let begins = |text: &str| {
        let digits = text.trim_start_matches(['+', '-']).trim_start_matches('.');
        digits.starts_with(|sign: char| sign.is_ascii_digit())
    };
    let inner = text.strip_suffix(')').and_then(|text| text.split_once('('));
    is_number(text) || begins(text) || inner.is_some_and(|(_, inner)| begins(inner))
}

/// The values of a line by their keys.
fn values(line: &str) -> Option<Vec<(String, String)>> {
    if line.starts_with('{') {
        return of_line(line);
    }
    let word = |word: &str| {
        let (key, value) = word.split_once('=')?;
        let value = value.trim_end_matches([',', ';']);
        let is_key = !key.is_empty() && !key.starts_with('-');
        (is_key && !value.is_empty()).then(|| (key.to_owned(), value.to_owned()))
    };
    let words: Vec<_> = line.split_whitespace().filter_map(word).collect();
    (!words.is_empty()).then_some(words)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(pieces: &[&[u8]]) -> Vec<String> {
        let (mut lines, mut all) = (Lines::default(), Vec::new());
        for piece in pieces {
            lines.take(piece, &mut |line, _| all.push(line.to_owned()));
        }
        lines.end(&mut |line, _| all.push(line.to_owned()));
        all
    }

    #[test]
    fn lines_end_where_they_end_however_they_arrive() {
        assert_eq!(
            lines(&[b"a b\nc", b"d\r\n\r 50 %\r100 %\n", b"", b"e"]),
            ["a b", "cd", "50 %", "100 %", "e"]
        );
        let long = vec![b'x'; LONGEST];
        assert_eq!(
            lines(&[&long, b"yy", b"z\nshort\n"]),
            ["short"],
            "one that is too long is none"
        );
        assert_eq!(lines(&[b"\xff=1\n"]), ["\u{fffd}=1"]);
    }

    fn filter(steps: &[&str]) -> Filter {
        Filter {
            keys: ["loss", "charts/return"].map(str::to_owned).into(),
            steps: steps.iter().map(|it| (*it).to_owned()).collect(),
            numbers: steps.is_empty(),
            ..Filter::default()
        }
    }

    #[test]
    fn only_declared_keys_of_a_line_are_noted() {
        let mut filter = filter(&["t"]);
        for (line, noted) in [
            (
                r#"{"t": 5, "loss": 0.5, "lr": 1}"#,
                Some(r#"{"loss":"0.5","regimen_at":9,"t":"5"}"#),
            ),
            (
                r#"{"charts": {"return": NaN}, "t": 6}"#,
                Some(r#"{"charts/return":"NaN","regimen_at":9,"t":"6"}"#),
            ),
            (
                "INFO t=7 loss=1e-3, done=true",
                Some(r#"{"loss":"1e-3","regimen_at":9,"t":"7"}"#),
            ),
            ("loss=inf;", Some(r#"{"loss":"inf","regimen_at":9}"#)),
            (r#"{"t": 5}"#, None),
            (r#"{"loss": "#, None),
            ("loss = 3", None),
            ("loss=later", None),
            ("loss=1,5 t=8", Some(r#"{"loss":"1,5","regimen_at":9,"t":"8"}"#)),
            ("loss=-1.#IND", Some(r#"{"loss":"-1.#IND","regimen_at":9}"#)),
            (
                "loss=tensor(-.5)",
                Some(r#"{"loss":"tensor(-.5)","regimen_at":9}"#),
            ),
            ("loss=huber(delta)", None),
            (
                "\u{1b}[32mloss=2\u{1b}[0m",
                Some(r#"{"loss":"2","regimen_at":9}"#),
            ),
            ("--loss=3", None),
            ("[1, 2]", None),
        ] {
            assert_eq!(filter.noted(line, 9).as_deref(), noted, "{line}");
        }
        assert!(filter.seen.contains("lr") && filter.seen.contains("done"));
        assert_eq!(filter.no_numbers["loss"], "later");
    }

    #[test]
    fn lines_without_a_step_are_numbered() {
        let mut filter = filter(&[]);
        let mut noted = |line: &str| filter.noted(line, 9).unwrap();
        assert_eq!(noted("loss=3"), r#"{"loss":"3","regimen_at":9,"step":1}"#);
        assert_eq!(
            noted("loss=2 step=40"),
            r#"{"loss":"2","regimen_at":9,"step":"40"}"#
        );
        assert_eq!(noted("loss=1"), r#"{"loss":"1","regimen_at":9,"step":3}"#);
    }
}
