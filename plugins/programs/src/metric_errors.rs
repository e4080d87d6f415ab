//! Errors about the metrics of a program, in the words of its study: its streams, and its files by their names in the
//! working folder, which is gone when somebody reads the error.

use crate::{
    lines::{AT, SeenKey},
    output::{LOG, STREAMS, is_noted, whole_lines},
};
use contract::Error;
use document::{plain_text::cut, reach::excerpt};
use imported::{BEGINS_AGAIN, PatternError, RunCollection, columns};
use serde_json::Value;
use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
};

/// Longest quote of a line, in characters.
const LONGEST: usize = 80;
/// Sign with which codes for the colours of a terminal begin.
const ESCAPE: char = '\u{1b}';

/// An error about a source, with the name of the source in the study instead of a path.
pub fn in_words_of_the_study(error: Error, from: &str, folder: &Path) -> Error {
    let Error::Input {
        path,
        line,
        column,
        problem,
    } = error
    else {
        return error;
    };
    if is_noted(from) {
        let lines = whole_lines(&path).unwrap_or_default();
        let problem = match (line, &column) {
            (None, Some(_)) => lacking(&lines),
            _ => problem + &about_lines(&lines, from, line),
        };
        return Error::Input {
            problem,
            path: from.into(),
            line: None,
            column,
        };
    }
    Error::Input {
        problem: problem.replace(&format!("{}/", folder.display()), ""),
        path: path.strip_prefix(folder).map(Path::to_owned).unwrap_or(path),
        line,
        column,
    }
}

/// The problem of lines that all lack a key.
fn lacking(lines: &[Value]) -> String {
    let keys: BTreeSet<&str> = lines
        .iter()
        .filter_map(Value::as_object)
        .flat_map(|line| line.keys().map(String::as_str))
        .filter(|key| ![AT, BEGINS_AGAIN].contains(key))
        .collect();
    let keys: Vec<&str> = keys.into_iter().collect();
    format!(
        "no line with metrics has this key; of those of the study they have `{}`",
        keys.join("`, `")
    )
}

/// The line at fault, and a remark on lines without a step.
fn about_lines(lines: &[Value], from: &str, line: Option<u64>) -> String {
    let place = line.and_then(|line| usize::try_from(line.checked_sub(1)?).ok());
    let quote = place.and_then(|place| lines.get(place)).map(written);
    let quote = quote.map_or(String::new(), |line| format!("; its line has `{line}`"));
    let steps = || lines.iter().filter_map(|line| line.get("step"));
    let numbered = steps().filter(|step| step.is_u64()).count();
    if !STREAMS.contains(&from) || numbered == 0 || steps().all(Value::is_u64) {
        return quote;
    }
    format!("{quote}; {numbered} of its lines with metrics have no `step` and are numbered: print it in each")
}

/// The values of a noted line as words, without those that the program did not print.
fn written(line: &Value) -> String {
    let said = |(key, value): (&String, &Value)| match value {
        _ if key == AT => None,
        Value::String(text) => Some(format!("{key}={}", excerpt(text))),
        Value::Number(_) if key == "step" && line.get(AT).is_some() => None,
        other => Some(format!("{key}={}", excerpt(&other.to_string()))),
    };
    let words: Vec<String> = line.as_object().into_iter().flatten().filter_map(said).collect();
    cut(&words.join(" "), LONGEST).into_owned()
}

/// The error for files that cannot be listed.
pub fn unlisted(error: PatternError) -> Error {
    let problem = match error {
        PatternError::Outside(outside) => {
            format!("`{}` leads out of the working folder of the trial", outside.name)
        }
        other => other.to_string(),
    };
    Error::config("metrics", problem)
}

/// The error for a metric without a value; `files` are those of its source.
pub fn missing(name: &str, key: &str, from: &str, files: &[PathBuf], seen: &[SeenKey]) -> Error {
    let there = if STREAMS.contains(&from) {
        in_lines(key, seen)
    } else if files.is_empty() && from == LOG {
        "the program wrote nothing to the file that `REGIMEN_LOG` names, as `trial.log` does".into()
    } else if files.is_empty() {
        "the program wrote no such file".into()
    } else {
        in_files(key, files)
    };
    Error::Input {
        path: from.into(),
        line: None,
        column: Some(key.to_owned()),
        problem: format!("no value of it, which is to be `{name}`; {there}"),
    }
}

fn in_lines(key: &str, seen: &[SeenKey]) -> String {
    let Some(found) = seen.iter().find(|it| it.name == key) else {
        let names: Vec<&str> = seen.iter().map(|it| it.name.as_str()).collect();
        return match &names[..] {
            [] => "no line of it is a JSON object or has words KEY=VALUE".into(),
            names => format!("keys that were there: `{}`", names.join("`, `")),
        };
    };
    let value = found.no_number.as_deref().unwrap_or_default();
    let advice = if value.contains(ESCAPE) {
        ", which has codes for colours: print it without them"
    } else {
        ""
    };
    format!("its values are no numbers, as `{}`{advice}", excerpt(value))
}

fn in_files(key: &str, files: &[PathBuf]) -> String {
    match columns(files) {
        Ok(columns) if !columns.names.iter().any(|name| name == key) => {
            format!("columns that are there: {}", columns.for_a_question().0)
        }
        Ok(columns) if columns.has_rows => "the cells of this column are empty".into(),
        Ok(_) => "there is a line with the names of the columns, and no row".into(),
        Err(error) => error.to_string(),
    }
}

/// The error for files that hold several runs.
pub fn several(from: &str, found: &RunCollection) -> Error {
    let names: Vec<&str> = found.runs.iter().map(|run| run.name.as_str()).collect();
    Error::Input {
        path: from.into(),
        line: None,
        column: None,
        problem: format!(
            "a trial is one run, and these files hold {}: {}; name those of one",
            names.len(),
            names.join(", ")
        ),
    }
}
