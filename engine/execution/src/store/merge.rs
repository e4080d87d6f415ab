//! Merges the trials of one store into another.
//!
//! A trial is copied file by file: each is compared with its acknowledged hash, written beside its place, flushed and
//! renamed. `trial.json` comes last, with its original bytes. Therefore the destination never shows an incomplete
//! trial, and an interrupted trial is copied again. A trial is written under its lease, like one that is computed. The
//! record of a trial at a pause is copied in the same way, if the other store knows less of the trial.

mod pauses;

use super::{
    Claim, Fault, Finding, Fingerprint, Leases, OUTPUT, Owner, RunningTrial, Store, TrialFile,
    artifacts::flush_within,
    earlier,
    fsck::{Check, refuse_links},
    inside::{files_of, is_folder, is_link, read_in},
    lease::is_lease,
    names, partial, remove,
    sealed_folder::flush_way_to,
    write_durably,
};
use crate::world::fs;
use contract::{
    Error,
    digest::of_bytes as hash,
    trial::TrialKey,
    trial_end::{EndState, is_missing},
};
use serde::Serialize;
use std::{collections::BTreeMap, path::Path};

/// One of the two stores.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Side {
    /// The store that is read.
    Source,
    /// The store that is written.
    Destination,
}

/// Result of the merge for a trial of the source.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "fate", rename_all = "snake_case")]
pub enum Fate {
    /// The trial is new, and the destination now has it.
    Taken,
    /// The destination had the same bytes.
    Same,
    /// The destination has other bytes, which are kept.
    Conflict {
        /// Fingerprint of the source's copy.
        source: Fingerprint,
        /// Fingerprint of the destination's copy.
        destination: Fingerprint,
    },
    /// The destination has another run of an agent that trains itself and does not repeat bit by bit; the run that was
    /// stored first is kept.
    Another {
        /// Fingerprint of the source's copy.
        source: Fingerprint,
        /// Fingerprint of the destination's copy.
        destination: Fingerprint,
    },
    /// One of the two copies differs from its acknowledgement; no file was taken.
    Damaged {
        /// Store of the damaged copy.
        side: Side,
        /// Faults of the copy.
        findings: Vec<Finding>,
    },
    /// A living process computes the trial; no file was taken.
    Running {
        /// Store in which it runs.
        side: Side,
        /// Process that computes it.
        owner: Owner,
    },
    /// The trial has not ended in the source, or was killed there from outside.
    Unfinished,
}

/// A trial of the source.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Merged {
    /// Id of the trial.
    pub trial: String,
    /// Names of the trial's plugins; empty if they cannot be read.
    pub title: String,
    /// Result of the merge for it.
    #[serde(flatten)]
    pub fate: Fate,
}

/// A merge of stores into one.
#[derive(Debug)]
pub struct Merge<'a> {
    into: &'a Store,
    /// Leases in the destination; `None` for a dry run.
    leases: Option<&'a Leases>,
    /// Trials that a dry run has taken so far, by id, with their stores.
    would_have: BTreeMap<String, (TrialFile, Store)>,
}

/// Result of checking a copy: its acknowledgement, `None` if it has none, or its faults.
type CopyCheck = Result<Option<TrialFile>, Vec<Finding>>;

impl<'a> Merge<'a> {
    /// A merge into the store `into` under `leases`; without leases no file is written.
    ///
    /// # Errors
    /// [`Error::Damaged`] if folders of the store are links.
    pub fn new(into: &'a Store, leases: Option<&'a Leases>) -> Result<Self, Error> {
        refuse_links(into)?;
        Ok(Self {
            into,
            leases,
            would_have: BTreeMap::new(),
        })
    }

    /// Copies the new trials of `source` in the order of ids, and reports the fate of each trial.
    ///
    /// # Errors
    /// [`Error::File`] if a store cannot be read or written.
    pub fn take(&mut self, source: &Store, told: &mut dyn FnMut(Merged)) -> Result<(), Error> {
        refuse_links(source)?;
        for id in ids(source)? {
            let fate = self.one(&id, source)?;
            let title = source
                .file(&id)
                .ok()
                .flatten()
                .map_or_else(String::new, |file| title(&file.key));
            told(Merged {
                trial: id,
                title,
                fate,
            });
        }
        if self.leases.is_some() {
            self.into.take_repeats(source);
        }
        Ok(())
    }

    fn one(&mut self, id: &str, source: &Store) -> Result<Fate, Error> {
        if let Some(owner) = source.running(id) {
            let side = Side::Source;
            return Ok(Fate::Running { side, owner });
        }
        let file = match look(source, id)? {
            Err(findings) => {
                let side = Side::Source;
                return Ok(Fate::Damaged { side, findings });
            }
            Ok(Some(file)) if !is_missing(Some(&file.end)) => file,
            Ok(_) => return self.paused(id, source),
        };
        if let Some(fate) = self.held_against(id, &file, source)? {
            return Ok(fate);
        }
        match self.leases {
            None => Ok(self.imagine(id, &file, source)),
            Some(leases) => self.under_lease(id, source, &file, leases),
        }
    }

    /// Fate of a trial that the destination already has; `None` if it is missing there.
    fn held_against(&self, id: &str, file: &TrialFile, source: &Store) -> Result<Option<Fate>, Error> {
        let (here, store) = match self.would_have.get(id) {
            Some((file, store)) => (file.clone(), store),
            None => match look(self.into, id)? {
                Err(findings) => {
                    let side = Side::Destination;
                    return Ok(Some(Fate::Damaged { side, findings }));
                }
                Ok(Some(here)) if !is_missing(Some(&here.end)) => (here, self.into),
                Ok(_) => return self.held_against_pause(id, file, source),
            },
        };
        if file.names_same_bytes(&here) {
            return Ok(Some(Fate::Same));
        }
        let (there, here) = (Fingerprint::of(file, source), Fingerprint::of(&here, store));
        if there.differences(&here).is_empty() {
            return Ok(Some(Fate::Same));
        }
        let may_differ = there.may_differ_from(&here);
        let (source, destination) = (there, here);
        Ok(Some(if may_differ {
            Fate::Another { source, destination }
        } else {
            Fate::Conflict { source, destination }
        }))
    }

    /// Fate of a trial in a dry run.
    fn imagine(&mut self, id: &str, file: &TrialFile, source: &Store) -> Fate {
        if let Some(owner) = self.into.running(id) {
            let side = Side::Destination;
            return Fate::Running { side, owner };
        }
        self.would_have
            .insert(id.to_owned(), (file.clone(), source.clone()));
        Fate::Taken
    }

    fn under_lease(
        &self,
        id: &str,
        source: &Store,
        file: &TrialFile,
        leases: &Leases,
    ) -> Result<Fate, Error> {
        leases.beat()?;
        if let Claim::Held(owner) = leases.claim(id)? {
            let side = Side::Destination;
            return Ok(Fate::Running { side, owner });
        }
        // Another program may have ended it before the lease was taken.
        let fate = match self.held_against(id, file, source) {
            Ok(None) => self.bring(id, source, file),
            Ok(Some(fate)) => Ok(fate),
            Err(error) => Err(error),
        };
        leases.release(id)?;
        fate
    }

    /// Copies one trial whose lease the caller already holds.
    ///
    /// # Errors
    /// [`Error::Damaged`] if the source changes meanwhile, and errors of reading or writing a store.
    pub(super) fn bring_under_own_lease(
        &self,
        id: &str,
        source: &Store,
        file: &TrialFile,
    ) -> Result<(), Error> {
        match self.bring(id, source, file)? {
            Fate::Damaged { findings, .. } => Err(first_of(source, findings)),
            _ => Ok(()),
        }
    }

    /// Copies a trial, the acknowledgement last.
    fn bring(&self, id: &str, source: &Store, file: &TrialFile) -> Result<Fate, Error> {
        let (from, to) = (source.folder(id), self.into.folder(id));
        let named = acknowledged_files(file);
        self.clear(id, &named)?;
        for (name, digest) in &named {
            let changed = || gone_since(source, id, &from.join(name));
            let bytes = match read_in(&from, name)? {
                None if name == "metrics.parquet" => source.metrics_in_pack(id, digest)?,
                bytes => bytes,
            };
            let Some(bytes) = bytes.filter(|bytes| hash(bytes) == *digest) else {
                return Ok(changed());
            };
            let path = to.join(name);
            let folder = path.parent().unwrap_or(&to);
            fs::create_dir_all(folder).map_err(Error::file("create", folder))?;
            write_durably(&path, &bytes)?;
            flush_within(&to, &path)?;
        }
        flush_way_to(&to)?;
        if file.end.state != EndState::Ok
            && let Some((bytes, there)) = source.partial_bytes(id)?
            && self.known_of(id, &there, source)?.is_none()
        {
            self.into.write_partial(id, &bytes, &there)?;
        }
        let Some((text, _)) = source.acknowledged(id)? else {
            return Ok(gone_since(source, id, &from.join("trial.json")));
        };
        write_durably(&to.join("trial.json"), &text)?;
        if file.end.state == EndState::Ok {
            partial::forget(&to)?;
        }
        RunningTrial::discard(&to)?;
        earlier::forget(&to)?;
        Ok(Fate::Taken)
    }

    /// Clears the place of a trial that the destination lacks: removes unfinished files, and sets aside results that no
    /// acknowledgement names, so that none of them is mistaken for the trial's.
    fn clear(&self, id: &str, named: &BTreeMap<String, String>) -> Result<(), Error> {
        let folder = self.into.folder(id);
        let mut others = Vec::new();
        for name in files_of(&folder)? {
            let last = name.rsplit('/').next().unwrap_or(&name);
            if last.starts_with('.') && last.ends_with(".tmp") {
                remove(&folder.join(&name))?;
            } else if !is_lease(&name)
                && !KEPT.contains(&name.as_str())
                && partial::step_of(&name).is_none()
                && !named.contains_key(&name)
            {
                others.push(orphan(self.into, &folder.join(&name)));
            }
        }
        if !others.is_empty() {
            self.into.set_aside(&others)?;
        }
        Ok(())
    }
}

/// Files that a trial's folder may contain while the trial is missing.
const KEPT: [&str; 4] = ["running", "earlier.json", "trial.json", OUTPUT];

fn orphan(store: &Store, path: &Path) -> Finding {
    Finding {
        path: path.strip_prefix(store.root()).unwrap_or(path).to_owned(),
        fault: Fault::Orphaned,
        problem: "the trial was never acknowledged".into(),
        trial: None,
    }
}

/// The fate of a trial with a file that changed in the source between its check and its copy.
fn gone_since(source: &Store, id: &str, path: &Path) -> Fate {
    let finding = Finding {
        path: path.strip_prefix(source.root()).unwrap_or(path).to_owned(),
        fault: Fault::Damaged,
        problem: "it changed while it was copied".into(),
        trial: Some(id.to_owned()),
    };
    Fate::Damaged {
        side: Side::Source,
        findings: vec![finding],
    }
}

/// Hashes of all files that an acknowledgement names.
pub(super) fn acknowledged_files(file: &TrialFile) -> BTreeMap<String, String> {
    let metrics =
        (file.end.state == EndState::Ok).then(|| ("metrics.parquet".to_owned(), file.end.digest.clone()));
    let output = file.output.clone().map(|digest| (OUTPUT.to_owned(), digest));
    file.files
        .clone()
        .into_iter()
        .chain(metrics)
        .chain(output)
        .collect()
}

/// Checks every byte of a copy.
fn look(store: &Store, id: &str) -> Result<CopyCheck, Error> {
    let folder = store.folder(id);
    let inside = folder.strip_prefix(store.root()).unwrap_or(&folder);
    if is_link(&folder) {
        return Ok(Err(vec![Finding {
            path: inside.to_owned(),
            fault: Fault::Foreign,
            problem: "it is a link, which is not followed".into(),
            trial: Some(id.to_owned()),
        }]));
    }
    let mut check = Check::new(store);
    check.inspect(inside, id);
    let mut findings = check.found.findings;
    findings.retain(|finding| finding.trial.is_some());
    if findings.is_empty() {
        Ok(Ok(store.file(id)?))
    } else {
        Ok(Err(findings))
    }
}

impl Store {
    /// The acknowledgement of a trial, after every file was compared with its acknowledged hash; `None` if the trial
    /// has not ended.
    ///
    /// # Errors
    /// [`Error::Damaged`] for the first file that differs from the acknowledged one.
    pub fn sound(&self, id: &str) -> Result<Option<TrialFile>, Error> {
        look(self, id)?.map_err(|findings| first_of(self, findings))
    }
}

/// The error for the first finding.
fn first_of(store: &Store, findings: Vec<Finding>) -> Error {
    let first = findings.into_iter().next();
    let (path, problem) = first.map_or_else(Default::default, |it| (it.path, it.problem));
    Error::Damaged {
        path: store.root().join(path),
        problem,
    }
}

/// Ids of the trials that have a place in a store, in order. Other entries there do not belong to the store, as `fsck`
/// reports.
fn ids(store: &Store) -> Result<Vec<String>, Error> {
    let root = store.root().join("trials");
    let mut ids = Vec::new();
    for group in names(&root)? {
        let path = root.join(&group);
        if is_link(&path) {
            let problem = "it is a link, and none is followed".into();
            return Err(Error::Damaged { path, problem });
        }
        if is_folder(&path) {
            let is_id = |name: &String| name.len() == 32 && name.starts_with(&group);
            ids.extend(names(&path)?.into_iter().filter(is_id));
        }
    }
    for pack in store.packs()? {
        ids.extend(pack.ids());
    }
    ids.sort_unstable();
    ids.dedup();
    Ok(ids)
}

/// Names of a trial's plugins, for users.
fn title(key: &TrialKey) -> String {
    let (environment, agents) = (&key.environment.plugin, key.agents_by_plugin());
    format!("{environment} {agents} seed {}", key.seed)
}
