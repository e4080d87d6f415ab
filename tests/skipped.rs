//! How a test says that it is not tried, and where that is a failure.
//!
//! One line for each thing that is missing goes to standard error past the test runner, which keeps what a test that
//! passes prints. The number in front counts the tests of this program that were skipped or tried in part, so that the
//! last line of a run says how many there are. Where `CI` is set the same line is a failure.

#![allow(
    clippy::disallowed_methods,
    reason = "the environment says who reads this, and no result depends on it"
)]

use std::{
    collections::BTreeSet,
    io::Write as _,
    panic::Location,
    sync::{Mutex, PoisonError},
    thread,
};

/// The variable that names a file to which the names of skipped tests are added, one a line.
const RECORD: &str = "REGIMEN_SKIPPED";

/// Skipped tests, and what was said of each.
static SAID: Mutex<(BTreeSet<String>, BTreeSet<String>)> = Mutex::new((BTreeSet::new(), BTreeSet::new()));

/// Says that the test that asks is not tried: what is missing here, and how to get it. The test then returns.
///
/// # Panics
/// Where `CI` is set.
#[track_caller]
#[allow(dead_code, reason = "a program of tests may have skipped parts alone")]
pub(crate) fn skip(missing: &str, remedy: &str) {
    say(&format!("{missing}; {remedy}"));
}

/// As [`skip`], of one part of a test, of which the rest is tried.
#[track_caller]
#[allow(dead_code, reason = "not every program of tests has a test of several parts")]
pub(crate) fn skip_part(part: &str, missing: &str, remedy: &str) {
    say(&format!("without {part}: {missing}; {remedy}"));
}

#[track_caller]
fn say(why: &str) {
    let test = test();
    assert!(!in_ci(), "{test}: {why} (`CI` is set, so nothing is skipped)");
    let number = {
        let mut said = SAID.lock().unwrap_or_else(PoisonError::into_inner);
        said.0.insert(test.clone());
        said.1.insert(format!("{test}: {why}")).then_some(said.0.len())
    };
    if let Some(number) = number {
        print(&format!("skipped ({number}): {test}: {why}"));
        record(&test);
    }
}

/// Past the runner, whose capture is of `eprint!` alone. One write a line: tests run beside each other.
fn print(line: &str) {
    let _ = std::io::stderr().write_all(format!("{line}\n").as_bytes());
}

/// The test that asks: the runner calls a thread by its name. A runner with one thread does not, and where the test
/// asks stands for it.
#[track_caller]
fn test() -> String {
    let place = Location::caller();
    match thread::current().name() {
        Some(name) if name != "main" => name.to_owned(),
        _ => format!("{}:{}", place.file(), place.line()),
    }
}

fn record(test: &str) {
    if let Some(file) = std::env::var_os(RECORD) {
        let opened = std::fs::OpenOptions::new().append(true).create(true).open(&file);
        let written = opened.and_then(|mut file| file.write_all(format!("{test}\n").as_bytes()));
        assert!(written.is_ok(), "{RECORD}: {}: {written:?}", file.display());
    }
}

/// True where tests run without anyone who reads what they say.
fn in_ci() -> bool {
    std::env::var_os("CI").is_some_and(|value| !value.is_empty() && value != "false")
}
