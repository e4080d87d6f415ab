//! Finds what is wrong in a store and sets it aside; what it held is then missing and runs again.

use super::{Store, names, policy::files_below, running, seal::hash};
use crate::{Error, results::EndState};
use serde::Serialize;
use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Path, PathBuf},
};

/// Why a file was set aside.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Fault {
    /// It is not what was acknowledged: cut off, changed, or of another trial.
    Damaged,
    /// A trial's result without the acknowledgement, or the acknowledgement of a result that is not there.
    Orphaned,
    /// What a process that is gone left behind.
    Left,
    /// It is none of the store's files.
    Foreign,
}

impl Fault {
    /// The word that is shown.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Fault::Damaged => "damaged",
            Fault::Orphaned => "orphaned",
            Fault::Left => "left",
            Fault::Foreign => "foreign",
        }
    }
}

/// One thing that is wrong.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// The file or folder, inside the store.
    pub path: PathBuf,
    /// What kind of fault it is.
    pub fault: Fault,
    /// What is wrong with it.
    pub problem: String,
    /// The trial that has to run again because of it.
    pub trial: Option<String>,
}

/// What a check found.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Findings {
    /// Trials whose files are whole.
    pub whole: usize,
    /// Trials that a living process works on; they were passed over.
    pub running: usize,
    /// What is wrong, in the order of paths.
    pub findings: Vec<Finding>,
    /// Where it was set aside, inside the store; `None` where nothing was moved.
    pub aside: Option<PathBuf>,
}

/// Folders of a store besides `trials`; what lies in them is not the store's to judge.
const KNOWN: [&str; 3] = ["owners", "submissions", "aside"];

impl Store {
    /// Checks every file of the store, and sets aside what is wrong if `mend` is set.
    ///
    /// # Errors
    /// Where the store cannot be read, or a file cannot be moved.
    pub fn check(&self, mend: bool) -> Result<Findings, Error> {
        let mut check = Check { store: self, found: Findings::default() };
        check.root()?;
        let mut found = check.found;
        found.findings.sort_by(|a, b| a.path.cmp(&b.path));
        if mend && !found.findings.is_empty() {
            found.aside = Some(self.set_aside(&found.findings)?);
        }
        Ok(found)
    }

    fn set_aside(&self, findings: &[Finding]) -> Result<PathBuf, Error> {
        let all = self.root.join("aside");
        fs::create_dir_all(&all).map_err(Error::file("create", &all))?;
        let used: BTreeSet<u64> = names(&all)?.iter().filter_map(|name| name.parse().ok()).collect();
        let aside = Path::new("aside").join(used.last().map_or(1, |last| last + 1).to_string());
        for finding in findings {
            let to = self.root.join(&aside).join(&finding.path);
            let folder = to.parent().unwrap_or(&all);
            fs::create_dir_all(folder).map_err(Error::file("create", folder))?;
            fs::rename(self.root.join(&finding.path), &to).map_err(Error::file("set aside as", &to))?;
        }
        Ok(aside)
    }
}

struct Check<'a> {
    store: &'a Store,
    found: Findings,
}

impl Check<'_> {
    fn root(&mut self) -> Result<(), Error> {
        for name in names(&self.store.root)? {
            let path = PathBuf::from(&name);
            if name == "trials" {
                self.groups(&path)?;
            } else if !KNOWN.contains(&name.as_str()) {
                self.note(path, Fault::Foreign, "the store has no such file", None);
            }
        }
        Ok(())
    }

    fn groups(&mut self, trials: &Path) -> Result<(), Error> {
        for group in names(&self.store.root.join(trials))? {
            let path = trials.join(&group);
            if !is_hexadecimal(&group, 2) || !self.store.root.join(&path).is_dir() {
                self.note(path, Fault::Foreign, "the store groups trials by the first two digits of their ids", None);
                continue;
            }
            for id in names(&self.store.root.join(&path))? {
                let path = path.join(&id);
                if is_hexadecimal(&id, 32) && id.starts_with(&group) && self.store.root.join(&path).is_dir() {
                    self.trial(&path, &id)?;
                } else {
                    self.note(path, Fault::Foreign, "it is not named by a trial's id, or lies in the wrong group", None);
                }
            }
        }
        Ok(())
    }

    fn trial(&mut self, folder: &Path, id: &str) -> Result<(), Error> {
        if self.store.running(id).is_some() {
            self.found.running += 1;
            return Ok(());
        }
        let files = files_below(&self.store.root.join(folder))?;
        let before = self.found.findings.len();
        let has = |name: &str| files.iter().any(|file| file == name);
        let mut expected = vec!["trial.json".to_owned(), "running".to_owned()];
        let acknowledged = match self.store.file(id) {
            Ok(file) => file,
            Err(error) => {
                self.note(folder.join("trial.json"), Fault::Damaged, &problem(&error), Some(id));
                None
            }
        };
        if let Some(file) = &acknowledged {
            expected.extend(file.files.keys().cloned());
            if file.end.state == EndState::Ok {
                expected.push("metrics.parquet".into());
                self.results(folder, id, &file.end.digest, &file.files);
            }
            if has("running") {
                self.note(folder.join("running"), Fault::Left, "the trial has ended", None);
            }
        } else if has("running") {
            self.checkpoints(&folder.join("running"), id)?;
        }
        for name in files.iter().filter(|name| !expected.contains(name)) {
            let (fault, problem) = match name.as_str() {
                "lease" | "takeover" => (Fault::Left, "its owner is gone"),
                name if name.starts_with('.') && name.ends_with(".tmp") => (Fault::Left, "its writing was never finished"),
                name if is_result(name) => (Fault::Orphaned, "the trial was never acknowledged, or without this file"),
                _ => (Fault::Foreign, "a trial has no such file"),
            };
            self.note(folder.join(name), fault, problem, None);
        }
        let whole = acknowledged.is_some() && self.found.findings[before..].iter().all(|finding| finding.trial.is_none());
        self.found.whole += usize::from(whole);
        Ok(())
    }

    /// The files that an acknowledgement names; where one is not right, the acknowledgement goes with it.
    fn results(&mut self, folder: &Path, id: &str, digest: &str, others: &BTreeMap<String, String>) {
        let metrics = [("metrics.parquet", digest)].into_iter();
        let mut wrong = false;
        for (name, digest) in metrics.chain(others.iter().map(|(name, digest)| (name.as_str(), digest.as_str()))) {
            let path = self.store.root.join(folder).join(name);
            let problem = match fs::read(&path) {
                Err(_) => Some("it is not there or cannot be read"),
                Ok(bytes) if hash(&bytes) != digest => Some("its hash is not the acknowledged one"),
                Ok(_) => None,
            };
            if let Some(problem) = problem {
                wrong = true;
                if path.exists() {
                    self.note(folder.join(name), Fault::Damaged, problem, Some(id));
                } else {
                    self.note(folder.join("trial.json"), Fault::Orphaned, &format!("`{name}`: {problem}"), Some(id));
                }
            }
        }
        let acknowledgement = folder.join("trial.json");
        if wrong && !self.found.findings.iter().any(|finding| finding.path == acknowledgement) {
            self.note(acknowledgement, Fault::Orphaned, "a file that it acknowledges is damaged", Some(id));
        }
    }

    fn checkpoints(&mut self, folder: &Path, id: &str) -> Result<(), Error> {
        for (name, problem) in running::faults(&self.store.root.join(folder), id)? {
            self.note(folder.join(name), Fault::Damaged, problem, None);
        }
        Ok(())
    }

    fn note(&mut self, path: PathBuf, fault: Fault, problem: &str, trial: Option<&str>) {
        self.found.findings.push(Finding { path, fault, problem: problem.into(), trial: trial.map(Into::into) });
    }
}

fn is_hexadecimal(name: &str, length: usize) -> bool {
    name.len() == length && name.bytes().all(|byte| byte.is_ascii_digit() || (b'a'..=b'f').contains(&byte))
}

fn is_result(name: &str) -> bool {
    [".parquet", ".safetensors", ".json"].iter().any(|ending| name.ends_with(ending))
}

fn problem(error: &Error) -> String {
    match error {
        Error::Damaged { problem, .. } => problem.clone(),
        other => other.to_string(),
    }
}
