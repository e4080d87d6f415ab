//! Quarantine of the store. A faulty file is moved into a numbered folder of the store, under its own path, and none is
//! lost.

use super::{
    Claim, Finding, Findings, Leases, Store, absent_is_fine,
    fsck::{Check, refuse_links},
    inside, names, pack,
};
use crate::world::fs;
use contract::{
    Error,
    trial_end::{EndState, TrialEnd},
};
use rayon::prelude::*;
use std::{
    io::ErrorKind,
    path::{Path, PathBuf},
};

impl Store {
    /// Trials that ended `ok` whose metrics differ from the acknowledged ones.
    #[must_use]
    pub fn with_damaged_metrics<'a>(&self, ended: &[(&'a str, &TrialEnd)]) -> Vec<&'a str> {
        let is_damaged = |(id, end): &&(&str, &TrialEnd)| {
            end.state == EndState::Ok && matches!(self.recorded(id, end), Err(Error::Damaged { .. }))
        };
        ended.par_iter().filter(is_damaged).map(|(id, _)| *id).collect()
    }

    /// Sets aside damaged files of trials, after which the trials are missing. Trials that another process computes are
    /// left to that process.
    ///
    /// # Errors
    /// [`Error::File`] if a file cannot be moved.
    pub fn heal(&self, ids: &[&str], leases: &Leases) -> Result<Findings, Error> {
        refuse_links(self)?;
        let mut mine = Vec::new();
        let healed = self.heal_under_leases(ids, leases, &mut mine);
        let released = mine.iter().try_for_each(|id| leases.release(id));
        healed.and_then(|found| released.map(|()| found))
    }

    fn heal_under_leases<'a>(
        &self,
        ids: &[&'a str],
        leases: &Leases,
        mine: &mut Vec<&'a str>,
    ) -> Result<Findings, Error> {
        let mut found = Findings::default();
        for id in ids {
            match leases.claim(id) {
                Ok(Claim::Mine) => {
                    mine.push(id);
                    found.findings.extend(self.damage(id));
                }
                Ok(Claim::Held(_)) => {}
                // The process that runs the trial reports the obstacle.
                Err(_) if self.obstacle_to_writing(id).is_some() => {}
                Err(error) => return Err(error),
            }
        }
        found.aside = self.set_aside(&found.findings)?;
        Ok(found)
    }

    /// Faults that keep a trial from counting: damaged files with their acknowledgement, and results without
    /// one.
    fn damage(&self, id: &str) -> Vec<Finding> {
        let mut check = Check::new(self);
        let folder = self.folder(id);
        check.inspect(folder.strip_prefix(self.root()).unwrap_or(&folder), id);
        let mut findings = check.found.findings;
        if !findings.iter().any(|finding| finding.trial.is_some()) {
            // The trial was completed while its lease was waited for.
            return Vec::new();
        }
        findings.retain(|finding| finding.trial.is_some() || finding.is_result());
        findings
    }

    /// Sets aside the findings, if there are any.
    pub(crate) fn aside(&self, findings: Vec<Finding>) -> Result<Findings, Error> {
        if findings.is_empty() {
            return Ok(Findings::default());
        }
        refuse_links(self)?;
        Ok(Findings {
            aside: self.set_aside(&findings)?,
            findings,
            ..Findings::default()
        })
    }

    /// Moves the findings into a new folder and returns its path inside the store; `None` if no file must be moved.
    pub(super) fn set_aside(&self, findings: &[Finding]) -> Result<Option<PathBuf>, Error> {
        if !findings.iter().any(|finding| finding.fault.is_moved()) {
            return Ok(None);
        }
        let aside = self.new_folder()?;
        for finding in findings.iter().filter(|finding| finding.fault.is_moved()) {
            let to = self.root.join(&aside).join(&finding.path);
            let folder = to.parent().unwrap_or(&self.root);
            fs::create_dir_all(folder).map_err(Error::file("create", folder))?;
            if pack::is_path(&finding.path) && inside::is_file(&self.root.join(&finding.path)) {
                self.salvage(&finding.path, &to)?;
                continue;
            }
            // Another process may have been quicker.
            absent_is_fine(fs::rename(self.root.join(&finding.path), &to))
                .map_err(Error::file("set aside as", &to))?;
        }
        Ok(Some(aside))
    }

    /// Creates a numbered folder that no other process uses.
    fn new_folder(&self) -> Result<PathBuf, Error> {
        let all = self.root.join("aside");
        if fs::is_taken(&all) && !fs::is_folder(&all) {
            let problem =
                "it stands where the store keeps what is set aside: move it out of the store".into();
            return Err(Error::Damaged { path: all, problem });
        }
        fs::create_dir_all(&all).map_err(Error::file("create", &all))?;
        let mut number = names(&all)?
            .iter()
            .filter_map(|name| name.parse::<u64>().ok())
            .max()
            .unwrap_or(0);
        loop {
            number += 1;
            let folder = all.join(number.to_string());
            match fs::create_dir(&folder) {
                Err(source) if source.kind() == ErrorKind::AlreadyExists => {}
                outcome => {
                    outcome.map_err(Error::file("create", &folder))?;
                    return Ok(Path::new("aside").join(number.to_string()));
                }
            }
        }
    }
}
