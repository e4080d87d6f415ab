//! Check of a store. It finds faulty files and sets them aside; their trials are then missing and run again.
//!
//! The check never leaves the store's folder: no link is followed, and the file names in a trial's acknowledgement are
//! used only inside the trial's folder.

use super::{
    LOOKS, OUTPUT, Store, TrialFile, announced,
    inside::{files_of, is_file, is_folder, is_link, read_in},
    lease::is_lease,
    merge::acknowledged_files,
    names, pack, partial, repeats, running,
};
use crate::world::fs;
use contract::{
    Error,
    digest::of_bytes as hash,
    metrics_file,
    trial_end::EndState::{self, Killed, Oom, Timeout},
};
use serde::Serialize;
use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
};

/// Reason why a file was set aside.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Fault {
    /// The file differs from the acknowledged one: truncated, changed, or of another trial.
    Damaged,
    /// A trial's result without the acknowledgement, or the acknowledgement of a missing result.
    Orphaned,
    /// A process that is gone left the file behind.
    Left,
    /// The file does not belong to the store.
    Foreign,
    /// A later program wrote the file; it is not moved.
    Newer,
    /// The file cannot be read; it is not moved.
    Unreadable,
}

impl Fault {
    /// Displayed name of the fault.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Fault::Damaged => "damaged",
            Fault::Orphaned => "orphaned",
            Fault::Left => "left",
            Fault::Foreign => "foreign",
            Fault::Newer => "newer",
            Fault::Unreadable => "unreadable",
        }
    }

    /// Whether files with this fault are set aside.
    #[must_use]
    pub fn is_moved(self) -> bool {
        !matches!(self, Fault::Newer | Fault::Unreadable)
    }
}

/// One fault of the store.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// The file or folder, as a path inside the store.
    pub path: PathBuf,
    /// Kind of the fault.
    pub fault: Fault,
    /// Description of the fault, for users.
    pub problem: String,
    /// The trial that has to run again because of it.
    pub trial: Option<String>,
}

impl Finding {
    /// Whether the finding is a result without its acknowledgement.
    pub(super) fn is_result(&self) -> bool {
        self.fault == Fault::Orphaned
    }
}

/// Result of a check.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Findings {
    /// Number of trials whose files are intact.
    pub whole: usize,
    /// Number of trials that have not ended and have an intact record of a pause.
    pub paused: usize,
    /// Number of trials that a living process computes; they were skipped.
    pub running: usize,
    /// The faults, in the order of their paths.
    pub findings: Vec<Finding>,
    /// Folder of the files that were set aside, inside the store; `None` if none was moved.
    pub aside: Option<PathBuf>,
}

/// Folders of a store besides `trials` whose content the check leaves alone.
const KNOWN: [&str; 3] = ["owners", "submissions", "aside"];
const NOT_FOLLOWED: &str = "it is a link, which is not followed";

impl Store {
    /// Checks every file of the store, and sets faulty ones aside if `mend` is set, together with `further`
    /// findings from the owners of other files in it.
    ///
    /// # Errors
    /// [`Error::File`] if the store cannot be read, or a file cannot be moved.
    pub fn check(&self, mend: bool, further: Vec<Finding>) -> Result<Findings, Error> {
        refuse_links(self)?;
        let mut check = Check::new(self);
        check.root();
        let mut found = check.found;
        found.findings.extend(further);
        found.findings.sort_by(|a, b| a.path.cmp(&b.path));
        if mend {
            found.aside = self.set_aside(&found.findings)?;
            self.begin_records_anew(&found)?;
        }
        Ok(found)
    }
}

/// A store whose own folders are links is in fact another store, and is not changed through them.
pub(super) fn refuse_links(store: &Store) -> Result<(), Error> {
    let linked = ["trials", "aside"]
        .map(|name| store.root.join(name))
        .into_iter()
        .find(|path| is_link(path));
    let problem = "it is a link, and none is followed: name the store that it leads into".into();
    linked.map_or(Ok(()), |path| Err(Error::Damaged { path, problem }))
}

/// A check in progress.
pub(super) struct Check<'a> {
    pub(super) store: &'a Store,
    pub(super) found: Findings,
    /// Paths with a finding; each is reported once and moved once.
    noted: BTreeSet<PathBuf>,
}

impl<'a> Check<'a> {
    /// A check that has examined no file yet.
    pub(super) fn new(store: &'a Store) -> Self {
        Self {
            store,
            found: Findings::default(),
            noted: BTreeSet::new(),
        }
    }

    fn root(&mut self) {
        for name in self.names(Path::new("")) {
            let path = PathBuf::from(&name);
            let is_own = ["trials", LOOKS, pack::FOLDER, announced::FOLDER, repeats::FOLDER]
                .contains(&name.as_str())
                || KNOWN.contains(&name.as_str());
            if !is_own {
                self.foreign(path, "the store has no such file");
            } else if !is_folder(&self.store.root.join(&path)) {
                self.foreign(path, "the store keeps a folder of this name");
            } else if name == "trials" {
                self.groups(&path);
            } else if name == LOOKS {
                self.looks(&path);
            } else if name == pack::FOLDER {
                self.packs();
            }
        }
    }

    /// Names in a folder of the store; a folder that cannot be read is noted, and the check continues.
    pub(super) fn names(&mut self, folder: &Path) -> Vec<String> {
        names(&self.store.root.join(folder)).unwrap_or_else(|error| {
            self.unreadable(folder, &error);
            Vec::new()
        })
    }

    pub(super) fn unreadable(&mut self, path: &Path, error: &Error) {
        self.note(path.to_owned(), Fault::Unreadable, &problem(error), None);
    }

    /// Checks the records of seen verdicts, one file for each study.
    fn looks(&mut self, folder: &Path) {
        for name in self.names(folder) {
            let path = folder.join(&name);
            let is_file = is_file(&self.store.root.join(&path));
            let Some(study) = name.strip_suffix(".json").filter(|_| is_file) else {
                if name.starts_with('.') && name.ends_with(".tmp") {
                    self.note(path, Fault::Left, "its writing was never finished", None);
                } else {
                    self.foreign(path, "verdicts that were seen are kept in a file per study");
                }
                continue;
            };
            match self.store.seen_verdicts(study) {
                Ok(_) => {}
                Err(error @ Error::Newer { .. }) => self.note(path, Fault::Newer, &problem(&error), None),
                Err(error @ Error::Damaged { .. }) => {
                    self.note(path, Fault::Damaged, &problem(&error), None);
                }
                Err(error) => self.unreadable(&path, &error),
            }
        }
    }

    fn groups(&mut self, trials: &Path) {
        for group in self.names(trials) {
            let path = trials.join(&group);
            if !is_hexadecimal(&group, 2) || !is_folder(&self.store.root.join(&path)) {
                self.foreign(
                    path,
                    "the store groups trials by the first two digits of their ids",
                );
                continue;
            }
            for id in self.names(&path) {
                let path = path.join(&id);
                if is_hexadecimal(&id, 32)
                    && id.starts_with(&group)
                    && is_folder(&self.store.root.join(&path))
                {
                    self.trial(&path, &id);
                } else {
                    self.foreign(
                        path,
                        "it is not named by a trial's id, or lies in the wrong group",
                    );
                }
            }
        }
    }

    fn trial(&mut self, folder: &Path, id: &str) {
        if self.store.running(id).is_some() {
            self.found.running += 1;
            return;
        }
        let before = self.found.findings.len();
        let acknowledged = self.inspect(folder, id);
        let whole = acknowledged
            && self.found.findings[before..]
                .iter()
                .all(|finding| finding.trial.is_none());
        // Trials in a pack are counted there.
        let is_own = fs::is_taken(&self.store.root.join(folder).join("trial.json"));
        self.found.whole += usize::from(whole && is_own);
    }

    /// Checks the files of a trial that no process computes; true if the trial is acknowledged.
    pub(super) fn inspect(&mut self, folder: &Path, id: &str) -> bool {
        let files = match files_of(&self.store.root.join(folder)) {
            Ok(files) => files,
            Err(error) => {
                self.unreadable(folder, &error);
                return false;
            }
        };
        let path = folder.join("trial.json");
        let acknowledged = match self.store.file(id) {
            Ok(acknowledged) => acknowledged,
            // The other files of such a program are not known here.
            Err(error @ Error::Newer { .. }) => {
                self.note(path, Fault::Newer, &problem(&error), None);
                return false;
            }
            Err(error @ Error::File { .. }) => {
                self.unreadable(&path, &error);
                return false;
            }
            Err(error) => {
                self.note(path, Fault::Damaged, &problem(&error), Some(id));
                None
            }
        };
        let mut expected = vec!["trial.json".to_owned()];
        if let Some(file) = &acknowledged
            && !files.contains(&expected[0])
        {
            expected.extend(self.packed(folder, id, file));
        } else if let Some(file) = &acknowledged {
            expected.extend(self.results(folder, id, file));
        }
        self.kept(folder, id, acknowledged.as_ref());
        let mut partial: Vec<String> = files
            .iter()
            .filter(|name| partial::step_of(name).is_some())
            .cloned()
            .collect();
        partial.sort_by_key(|name| partial::step_of(name));
        if let Some(farthest) = partial.pop() {
            self.partial(folder.join(&farthest), id, acknowledged.as_ref());
            expected.push(farthest);
            // The process that wrote the latest record ended before it removed the others.
            for name in partial {
                self.note(folder.join(&name), Fault::Left, "a later pause is stored", None);
                expected.push(name);
            }
        }
        for name in files.iter().filter(|name| !expected.contains(name)) {
            self.unexpected(folder.join(name), name);
        }
        acknowledged.is_some()
    }

    /// Checks a trial in a pack; files that an interrupted packing left in its folder are accepted.
    fn packed(&mut self, folder: &Path, id: &str, file: &TrialFile) -> Option<String> {
        match self.store.metrics_in_pack(id, &file.end.digest) {
            Ok(Some(_)) => {}
            Ok(None) => {
                for path in self.store.packs_with(id) {
                    self.note_trial(
                        &path,
                        "the metrics of a trial in it are not the acknowledged ones",
                        id,
                    );
                }
            }
            Err(error) => self.unreadable(Path::new(pack::FOLDER), &error),
        }
        let metrics = "metrics.parquet".to_owned();
        let left = folder.join(&metrics);
        if !is_file(&self.store.root.join(&left)) {
            return None;
        }
        self.note(left, Fault::Left, "the trial lies in a pack", None);
        Some(metrics)
    }

    fn unexpected(&mut self, path: PathBuf, name: &str) {
        match name {
            "running" | "earlier.json" | OUTPUT => {}
            name if is_lease(name) => self.note(path, Fault::Left, "its owner is gone", None),
            name if name.starts_with('.') && name.ends_with(".tmp") => {
                self.note(path, Fault::Left, "its writing was never finished", None);
            }
            name if is_result(name) && !is_link(&self.store.root.join(&path)) => {
                self.note(
                    path,
                    Fault::Orphaned,
                    "the trial was never acknowledged, or without this file",
                    None,
                );
            }
            _ => self.foreign(path, "a trial has no such file"),
        }
    }

    /// Checks the files that an acknowledgement names; if one is faulty, the acknowledgement is set aside with it.
    fn results(&mut self, folder: &Path, id: &str, file: &TrialFile) -> Vec<String> {
        let named = acknowledged_files(file);
        let before = self.found.findings.len();
        for (name, digest) in &named {
            self.result(folder, id, name, digest);
        }
        if self.found.findings.len() > before {
            self.note(
                folder.join("trial.json"),
                Fault::Orphaned,
                "a file that it acknowledges is damaged or missing",
                Some(id),
            );
        }
        named.into_keys().collect()
    }

    fn result(&mut self, folder: &Path, id: &str, name: &str, digest: &str) {
        match read_in(&self.store.root.join(folder), name) {
            Ok(Some(bytes)) if hash(&bytes) == digest => self.readable(folder, id, name, bytes),
            Ok(Some(_)) => self.note(
                folder.join(name),
                Fault::Damaged,
                "its hash is not the acknowledged one",
                Some(id),
            ),
            Ok(None) => self.note(
                folder.join("trial.json"),
                Fault::Orphaned,
                &format!("`{name}`: it is not there"),
                Some(id),
            ),
            // The obstacle at the file's place, which may be the folder that should contain the file.
            Err(Error::Damaged { path, problem }) => {
                let path = path.strip_prefix(&self.store.root).unwrap_or(&path).to_owned();
                self.note(path, Fault::Damaged, &problem, Some(id));
            }
            Err(error) => self.unreadable(&folder.join(name), &error),
        }
    }

    /// Checks that metrics can be read, since an acknowledged file is not necessarily readable.
    fn readable(&mut self, folder: &Path, id: &str, name: &str, bytes: Vec<u8>) {
        if name == "metrics.parquet"
            && let Err(error) = metrics_file::decode(bytes, Path::new(name))
        {
            self.note(folder.join(name), Fault::Damaged, &problem(&error), Some(id));
        }
    }

    /// Checks the files that are kept of a trial for its next attempt.
    fn kept(&mut self, folder: &Path, id: &str, acknowledged: Option<&TrialFile>) {
        let at = |name: &str| self.store.root.join(folder).join(name);
        let (running, earlier) = (at("running"), at("earlier.json"));
        // A trial that was ended from outside continues from its checkpoint when it is run again.
        let goes_on = acknowledged.is_none_or(|file| matches!(file.end.state, Timeout | Oom | Killed));
        if is_folder(&running) && goes_on {
            match running::faults(&running, id) {
                Ok(faults) => {
                    for (name, problem) in faults {
                        self.note(folder.join("running").join(name), Fault::Damaged, problem, None);
                    }
                }
                Err(error) => self.unreadable(&folder.join("running"), &error),
            }
        } else if is_folder(&running) {
            self.note(folder.join("running"), Fault::Left, "the trial has ended", None);
        } else if fs::is_taken(&running) {
            self.foreign(
                folder.join("running"),
                "a running trial keeps a folder of this name",
            );
        }
        if !fs::is_taken(&earlier) {
            return;
        }
        if acknowledged.is_some() {
            self.note(
                folder.join("earlier.json"),
                Fault::Left,
                "the trial has ended since",
                None,
            );
        } else if self.store.earlier(id).is_none() {
            self.note(
                folder.join("earlier.json"),
                Fault::Damaged,
                "it is not what was acknowledged",
                None,
            );
        }
    }

    /// Checks the record of a trial at a pause, or before a number was not finite. A trial with a damaged record runs
    /// again, even if it has ended this way.
    fn partial(&mut self, path: PathBuf, id: &str, acknowledged: Option<&TrialFile>) {
        let folder = path.parent().unwrap_or(Path::new("")).to_owned();
        let has_ended = acknowledged.is_some_and(|file| file.end.state == EndState::Ok);
        match self.store.partial(id) {
            Ok(_) if has_ended => self.note(path, Fault::Left, "the trial has ended", None),
            Ok(_) => self.found.paused += usize::from(acknowledged.is_none()),
            Err(error @ Error::Newer { .. }) => self.note(path, Fault::Newer, &problem(&error), None),
            Err(error @ Error::File { .. }) => self.unreadable(&path, &error),
            Err(error) if has_ended => self.note(path, Fault::Left, &problem(&error), None),
            Err(error) => {
                self.note(path, Fault::Damaged, &problem(&error), Some(id));
                if acknowledged.is_some() {
                    let problem = "what it recorded before is damaged";
                    self.note(folder.join("trial.json"), Fault::Orphaned, problem, Some(id));
                }
            }
        }
    }

    pub(super) fn foreign(&mut self, path: PathBuf, problem: &str) {
        let problem = if is_link(&self.store.root.join(&path)) {
            NOT_FOLLOWED
        } else {
            problem
        };
        self.note(path, Fault::Foreign, problem, None);
    }

    /// Notes a trial that is lost in a file of several trials.
    pub(super) fn note_trial(&mut self, path: &Path, problem: &str, trial: &str) {
        self.found.findings.push(Finding {
            path: path.to_owned(),
            fault: Fault::Damaged,
            problem: format!("{problem}: {trial}"),
            trial: Some(trial.into()),
        });
    }

    pub(super) fn note(&mut self, path: PathBuf, fault: Fault, problem: &str, trial: Option<&str>) {
        if self.noted.insert(path.clone()) {
            self.found.findings.push(Finding {
                path,
                fault,
                problem: problem.into(),
                trial: trial.map(Into::into),
            });
        }
    }
}

fn is_hexadecimal(name: &str, length: usize) -> bool {
    name.len() == length
        && name
            .bytes()
            .all(|byte| byte.is_ascii_digit() || (b'a'..=b'f').contains(&byte))
}

fn is_result(name: &str) -> bool {
    [".parquet", ".safetensors", ".json", ".onnx"]
        .iter()
        .any(|ending| name.ends_with(ending))
}

fn problem(error: &Error) -> String {
    match error {
        Error::Damaged { problem, .. } | Error::Newer { problem, .. } => problem.clone(),
        Error::File { doing, source, .. } => format!("cannot {doing} it: {source}"),
        other => other.to_string(),
    }
}
