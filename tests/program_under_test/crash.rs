//! Ends the whole group of processes, with SIGKILL, the first time that any of them comes to a boundary it
//! never died at.
//!
//! `REGIMEN_TEST_CRASHES` names the file that remembers the boundaries; started again and again, the program
//! dies once at every boundary of every trial and in the end lives.

#![expect(
    clippy::disallowed_methods,
    reason = "the test says what shall be remembered where"
)]

use std::{
    fs::{self, OpenOptions},
    io::Write,
    path::Path,
    process::Command,
};

/// Installs the hook where the environment asks for it.
pub(crate) fn install() {
    if std::env::var_os("REGIMEN_TEST_CRASHES").is_some() {
        execution::store::install_boundary_hook(at_boundary);
    }
}

fn at_boundary(name: &'static str, path: &Path) {
    let Some(log) = std::env::var_os("REGIMEN_TEST_CRASHES") else {
        return;
    };
    let place = format!("{name}: {}\n", place(path));
    let known = fs::read_to_string(&log).unwrap_or_default();
    if known.split_inclusive('\n').any(|line| line == place) {
        return;
    }
    let remembered = OpenOptions::new()
        .create(true)
        .append(true)
        .open(&log)
        .and_then(|mut file| file.write_all(place.as_bytes()));
    if remembered.is_ok() {
        end_group();
    }
}

/// The file within its trial, without the numbers that differ between processes.
fn place(path: &Path) -> String {
    let words: Vec<String> = path
        .iter()
        .map(|part| part.to_string_lossy().into_owned())
        .collect();
    match words.iter().position(|word| word == "trials") {
        Some(trials) => {
            let inside: Vec<String> = words[trials + 3..]
                .iter()
                .map(|word| word.replace(|c: char| c.is_ascii_digit(), ""))
                .collect();
            format!("{} {}", words[trials + 2], inside.join("/"))
        }
        None => "an owner".into(),
    }
}

fn end_group() -> ! {
    let stat = fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let group = stat
        .rsplit_once(')')
        .and_then(|(_, fields)| fields.split_whitespace().nth(2))
        .unwrap_or("0");
    let _ = Command::new("kill")
        .args(["-KILL", "--", &format!("-{group}")])
        .status();
    std::process::abort();
}
