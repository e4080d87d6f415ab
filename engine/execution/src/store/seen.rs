//! Records of the verdicts that were seen, one file per study: `looks/<study>.json`, sealed like a `trial.json`.
//!
//! No computation can restore such a record, and without it a verdict that was chosen with knowledge of results looks
//! like one that was not. Therefore a damaged record is set aside and never overwritten, and the record that replaces
//! it reports this to every later report. Records of earlier programs have no seal; they are read, and sealed when they
//! are next written.

use super::{Fault, Finding, Findings, LOOKS, Store, inside, names, seal, write_durably};
use crate::world::fs;
use contract::{Error, form_version::form_version};
use serde::{Deserialize, Serialize};
use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

/// Version of the record: from 2 on it ends with a hash of the text before it.
const SCHEMA: u32 = 2;

/// Numbers of seeds at which verdicts were seen, by the subject of the verdict: table and cell, or claim and
/// place, and the trials of the first seeds, since another version of a trial is another experiment.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SeenVerdicts {
    /// Version of this form; absent in records of earlier programs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    schema: Option<u32>,
    /// Numbers of seeds with which each verdict was seen.
    pub verdicts: BTreeMap<String, BTreeSet<u32>>,
    /// Planned looks at the time when a number of seeds was first seen; empty if that number was fixed. Records of
    /// earlier programs have no plans.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub plans: BTreeMap<String, BTreeMap<u32, BTreeSet<u32>>>,
    /// Rule of the verdict when it was first seen, as text. Records of earlier programs have no rules.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub rules: BTreeMap<String, String>,
    /// The fixed round of a confirmation.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fixed: Option<Fixed>,
    /// Path of the earlier, damaged record inside the store; the verdicts that were seen then are not known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lost: Option<PathBuf>,
}

/// A round of a confirmation in the form in which it was first computed.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fixed {
    /// Hash of its claims, published values and seeds.
    pub digest: String,
    /// Time of the first computation, in UTC in the format of RFC 3339.
    pub at: String,
    /// Number of its trials that had ended then.
    pub ended: usize,
}

impl SeenVerdicts {
    /// Adds the verdicts of another record.
    pub fn extend(&mut self, more: Self) {
        for (place, seeds) in more.verdicts {
            self.verdicts.entry(place).or_default().extend(seeds);
        }
        for (place, plans) in more.plans {
            let own = self.plans.entry(place).or_default();
            plans.into_iter().for_each(|(seeds, plan)| {
                own.entry(seeds).or_insert(plan);
            });
        }
        for (place, rule) in more.rules {
            self.rules.entry(place).or_insert(rule);
        }
        self.fixed = self.fixed.take().or(more.fixed);
        self.lost = self.lost.take().or(more.lost);
    }

    /// Whether the record's file has a checksum.
    #[must_use]
    pub fn is_sealed(&self) -> bool {
        self.schema.is_some()
    }
}

impl Store {
    /// The record of the verdicts of a study that were seen; `None` if there is none.
    ///
    /// # Errors
    /// [`Error::Damaged`] if the file was changed, [`Error::Newer`] for that of a later program, and [`Error::File`] if
    /// it cannot be read.
    pub fn seen_verdicts(&self, study: &str) -> Result<Option<SeenVerdicts>, Error> {
        let path = self.root.join(file_of(study));
        let text = inside::read(&path)?;
        text.map(|text| parse(&text, &path)).transpose()
    }

    /// The record for further verdicts; a damaged one is set aside, and the new one reports this. The fault of the
    /// damaged record is returned as well.
    ///
    /// # Errors
    /// The errors of [`seen_verdicts`](Self::seen_verdicts) without the first, and [`Error::File`] if files cannot be
    /// moved or written.
    pub fn seen_or_begun(&self, study: &str) -> Result<(SeenVerdicts, Option<String>), Error> {
        let problem = match self.seen_verdicts(study) {
            Ok(seen) => return Ok((seen.unwrap_or_default(), None)),
            Err(Error::Damaged { problem, .. }) => problem,
            Err(error) => return Err(error),
        };
        let finding = Finding {
            path: file_of(study),
            fault: Fault::Damaged,
            problem: problem.clone(),
            trial: None,
        };
        let found = self.aside(vec![finding])?;
        self.begin_records_anew(&found)?;
        Ok((self.seen_verdicts(study)?.unwrap_or_default(), Some(problem)))
    }

    /// Writes the record of a study.
    ///
    /// # Errors
    /// [`Error::File`] if it cannot be written.
    pub fn keep_seen(&self, study: &str, seen: &SeenVerdicts) -> Result<(), Error> {
        let path = self.root.join(file_of(study));
        let folder = path.parent().unwrap_or(&self.root);
        fs::create_dir_all(folder).map_err(Error::file("create", folder))?;
        write_durably(&path, &bytes_of(seen, &path)?)
    }

    /// Studies with a record, intact or not.
    ///
    /// # Errors
    /// [`Error::File`] if the folder cannot be read.
    pub fn studies_seen(&self) -> Result<Vec<String>, Error> {
        let names = names(&self.root.join(LOOKS))?;
        let studies = names.iter().filter_map(|name| name.strip_suffix(".json"));
        Ok(studies.map(str::to_owned).collect())
    }

    /// Replaces each record that was set aside by one that names the loss.
    pub(super) fn begin_records_anew(&self, found: &Findings) -> Result<(), Error> {
        let Some(aside) = &found.aside else { return Ok(()) };
        for finding in found.findings.iter().filter(|finding| is_record(finding)) {
            let begun = SeenVerdicts {
                lost: Some(aside.join(&finding.path)),
                ..SeenVerdicts::default()
            };
            let path = self.root.join(&finding.path);
            write_durably(&path, &bytes_of(&begun, &path)?)?;
        }
        Ok(())
    }
}

/// Whether the finding is a damaged record of verdicts.
pub fn is_record(finding: &Finding) -> bool {
    let is_json = finding.path.extension().is_some_and(|ending| ending == "json");
    finding.fault == Fault::Damaged && is_json && finding.path.parent() == Some(Path::new(LOOKS))
}

/// Path of a study's record inside the store. A confirmation is named after its study, with a slash between.
fn file_of(study: &str) -> PathBuf {
    Path::new(LOOKS).join(format!("{}.json", study.replace('/', "+")))
}

fn bytes_of(seen: &SeenVerdicts, path: &Path) -> Result<Vec<u8>, Error> {
    let seen = SeenVerdicts {
        schema: Some(SCHEMA),
        ..seen.clone()
    };
    let text = serde_json::to_vec(&seen).map_err(|source| damaged(path, source.to_string()))?;
    Ok(seal::sealed(text))
}

fn parse(text: &[u8], path: &Path) -> Result<SeenVerdicts, Error> {
    let Some(object) = seal::unsealed(text) else {
        // A record of an earlier program has neither a checksum nor a version.
        let seen = serde_json::from_slice(text).ok();
        let earlier = seen.filter(|seen: &SeenVerdicts| seen.schema.is_none());
        return earlier
            .ok_or_else(|| damaged(path, "it was changed or cut off: its check does not hold".into()));
    };
    if let Some(schema) = form_version(&object).ok().filter(|schema| *schema > SCHEMA) {
        let (path, problem) = (path.to_owned(), format!("version {schema} of its form"));
        return Err(Error::Newer { path, problem });
    }
    serde_json::from_slice(&object).map_err(|source| damaged(path, source.to_string()))
}

fn damaged(path: &Path, problem: String) -> Error {
    Error::Damaged {
        path: path.to_owned(),
        problem,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn seen() -> SeenVerdicts {
        let (place, seeds) = ("returns: sac, return @ 12ab".to_owned(), BTreeSet::from([3, 6]));
        SeenVerdicts {
            verdicts: BTreeMap::from([(place.clone(), seeds.clone())]),
            plans: BTreeMap::from([(place.clone(), BTreeMap::from([(3, seeds)]))]),
            rules: BTreeMap::from([(place, "a band from -1260 to -1140".to_owned())]),
            ..SeenVerdicts::default()
        }
    }

    fn store() -> (tempfile::TempDir, Store) {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::at(folder.path());
        store.keep_seen("study", &seen()).unwrap();
        (folder, store)
    }

    fn file(store: &Store) -> PathBuf {
        store.root().join(file_of("study"))
    }

    #[test]
    fn a_record_comes_back_sealed_and_that_of_an_earlier_program_is_read() {
        let (_folder, store) = store();
        let read = store.seen_verdicts("study").unwrap().unwrap();
        assert!(read.is_sealed());
        assert_eq!((&read.verdicts, &read.rules), (&seen().verdicts, &seen().rules));
        fs::write(file(&store), serde_json::to_vec(&seen()).unwrap()).unwrap();
        let earlier = store.seen_verdicts("study").unwrap().unwrap();
        assert!(!earlier.is_sealed());
        assert_eq!(earlier, seen());
        assert_eq!(store.seen_verdicts("another").unwrap(), None);
    }

    #[test]
    fn what_is_damaged_is_set_aside_with_its_bytes_and_its_successor_says_so() {
        let (folder, store) = store();
        let mut bytes = fs::read(file(&store)).unwrap();
        bytes.truncate(60);
        fs::write(file(&store), &bytes).unwrap();
        let (begun, problem) = store.seen_or_begun("study").unwrap();
        assert!(problem.is_some() && begun.verdicts.is_empty());
        let aside = begun.lost.clone().unwrap();
        assert_eq!(fs::read(folder.path().join(&aside)).unwrap(), bytes);
        // A later reader gets the same result, even after the record was merged into another store.
        assert_eq!(store.seen_or_begun("study").unwrap(), (begun.clone(), None));
        let mut other = seen();
        other.extend(begun);
        assert_eq!(other.lost, Some(aside));
    }

    #[test]
    fn fsck_finds_a_damaged_record_and_leaves_one_that_says_so() {
        let (_folder, store) = store();
        assert_eq!(store.check(true, Vec::new()).unwrap().findings, []);
        fs::write(file(&store), "{\"verdicts\":{}} ").unwrap();
        assert_eq!(
            store.check(true, Vec::new()).unwrap().findings,
            [],
            "of an earlier program"
        );
        fs::write(file(&store), "{\"verdicts\":{}").unwrap();
        let found = store.check(true, Vec::new()).unwrap();
        assert!(found.findings.len() == 1 && is_record(&found.findings[0]));
        assert!(store.seen_verdicts("study").unwrap().unwrap().lost.is_some());
        assert_eq!(store.check(true, Vec::new()).unwrap().findings, []);
    }

    #[test]
    fn that_of_a_later_program_stays_where_it_is() {
        let (_folder, store) = store();
        let later = seal::sealed(br#"{"schema":3,"of_later":1}"#.to_vec());
        fs::write(file(&store), &later).unwrap();
        assert!(matches!(store.seen_or_begun("study"), Err(Error::Newer { .. })));
        store.check(true, Vec::new()).unwrap();
        assert_eq!(fs::read(file(&store)).unwrap(), later);
    }

    #[test]
    fn every_changed_bit_and_every_cut_is_found() {
        let (_folder, store) = store();
        let whole = fs::read(file(&store)).unwrap();
        for place in 0..whole.len() {
            assert!(parse(&whole[..place], Path::new("cut")).is_err(), "{place}");
            for bit in 0..8 {
                let mut changed = whole.clone();
                changed[place] ^= 1 << bit;
                assert!(
                    parse(&changed, Path::new("changed")).is_err(),
                    "bit {bit} of byte {place}"
                );
            }
        }
    }

    proptest! {
        #[test]
        fn whatever_lies_there_is_read_whole_or_refused(bytes: Vec<u8>) {
            let _ = parse(&bytes, Path::new("any"));
        }
    }
}
