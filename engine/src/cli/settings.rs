//! Machine-level settings from `regimen.toml`: they can never reach a result.
//!
//! ```toml
//! store = "store"
//! workers = 2
//!
//! [profile.big]        # chosen by --machine big or REGIMEN_MACHINE=big
//! workers = 16
//! ```

use super::{BAD_SPEC, Common, Failure};
use serde::Deserialize;
use std::{collections::BTreeMap, path::PathBuf};

const FILE: &str = "regimen.toml";

/// What holds on this machine.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Settings {
    /// Folder of the store.
    pub(super) store: PathBuf,
    /// Worker processes.
    pub(super) workers: usize,
}

#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct Table {
    store: Option<PathBuf>,
    workers: Option<usize>,
}

#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct Document {
    store: Option<PathBuf>,
    workers: Option<usize>,
    profile: BTreeMap<String, Table>,
}

/// Reads `regimen.toml` of the current folder, where there is one.
pub(super) fn read(common: &Common) -> Result<Settings, Failure> {
    let text = match std::fs::read_to_string(FILE) {
        Ok(text) => text,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => String::new(),
        Err(error) => return Err(wrong(&error.to_string())),
    };
    combine(&text, common)
}

fn combine(text: &str, common: &Common) -> Result<Settings, Failure> {
    let document: Document = toml::from_str(text).map_err(|error| wrong(&error.to_string()))?;
    let profile = match &common.machine {
        None => Table::default(),
        Some(name) => document.profile.get(name).cloned().ok_or_else(|| {
            let known = document.profile.keys().cloned().collect::<Vec<_>>().join(", ");
            wrong(&format!("there is no [profile.{name}]; known: {known}"))
        })?,
    };
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    Ok(Settings {
        store: common.store.clone().or(profile.store).or(document.store).unwrap_or_else(|| "store".into()),
        workers: profile.workers.or(document.workers).unwrap_or(cores).max(1),
    })
}

fn wrong(problem: &str) -> Failure {
    Failure { code: BAD_SPEC, text: format!("error: {FILE}: {problem}") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::Format;

    fn common(machine: Option<&str>) -> Common {
        Common { store: None, machine: machine.map(Into::into), format: Format::Text }
    }

    #[test]
    fn a_profile_overrides_the_top() {
        let text = "store = \"a\"\nworkers = 2\n[profile.big]\nworkers = 16\n";
        let settings = combine(text, &common(Some("big"))).ok().unwrap();
        assert_eq!(settings, Settings { store: "a".into(), workers: 16 });
    }

    #[test]
    fn unknown_keys_and_profiles_are_refused() {
        assert!(combine("wrokers = 2\n", &common(None)).err().unwrap().text.contains("wrokers"));
        assert!(combine("", &common(Some("big"))).err().unwrap().text.contains("[profile.big]"));
    }
}
