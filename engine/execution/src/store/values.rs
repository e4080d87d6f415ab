//! Digests of the values in a trial's tables. A result is the same if its values are, so that a library or a codec may
//! change without changing a trial. The bytes of a file are compared with the hash in `trial.json`.

use super::{METRICS, Store, TrialFile, inside::read_in};
use contract::{parquet::values_digest, trial_end::EndState};
use std::collections::BTreeMap;

impl Store {
    /// Digests of the values in the tables of a trial, by path inside its folder, from the files themselves. A file
    /// that cannot be read has none: its bytes are compared with their hash elsewhere.
    pub(super) fn values_of(&self, file: &TrialFile) -> BTreeMap<String, String> {
        let id = file.key.id();
        let folder = self.folder(&id);
        let tables = file.files.keys().filter(|name| name.ends_with(".parquet"));
        let tables = tables.filter_map(|name| Some((name.clone(), read_in(&folder, name).ok()??)));
        let digest = |(name, bytes): (String, Vec<u8>)| {
            let digest = values_digest(bytes, &folder.join(&name)).ok()?;
            Some((name, digest))
        };
        tables
            .chain(self.recorded_metrics(&id, file))
            .filter_map(digest)
            .collect()
    }

    /// The metrics of a trial that has ended or paused, with their name.
    fn recorded_metrics(&self, id: &str, file: &TrialFile) -> Option<(String, Vec<u8>)> {
        let bytes = match file.end.state {
            EndState::Ok => self.metrics(id, &file.end.digest).ok()?,
            _ => {
                let at_pause = self.files_at_pause(id).ok()?;
                at_pause.into_iter().find(|(name, _)| name == METRICS)?.1
            }
        };
        Some((METRICS.to_owned(), bytes))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::{Fingerprint, stub::trial, write_durably};
    use contract::{Phase, Recorder, metrics_file};
    use std::path::Path;

    /// A store with one trial that recorded a value.
    fn stored(folder: &Path, value: f64) -> (Store, TrialFile) {
        let (store, trial) = (Store::at(folder), trial(1, 0));
        let mut record = Recorder::default();
        record.add(Phase::Final, 7, 0, 0, "return", value);
        store.finish(&trial, &record, 1.0).unwrap();
        let file = store.file(&trial.id).unwrap().unwrap();
        (store, file)
    }

    #[test]
    fn a_table_with_other_bytes_and_the_same_values_is_the_same_result() {
        let folders = [(); 3].map(|()| tempfile::tempdir().unwrap());
        let (store, file) = stored(folders[0].path(), 0.5);
        let (other_store, other) = stored(folders[1].path(), -0.5);
        let (again, mut rewritten) = stored(folders[2].path(), 0.5);
        // The trial's name in the file is not one of the values.
        let mut record = Recorder::default();
        record.add(Phase::Final, 7, 0, 0, "return", 0.5);
        let bytes = metrics_file::encode(&record, "another").unwrap();
        rewritten.end.digest = contract::digest::of_bytes(&bytes);
        write_durably(&again.folder(&file.key.id()).join(METRICS), &bytes).unwrap();
        assert_ne!(rewritten.end.digest, file.end.digest);
        let known = Fingerprint::of(&file, &store);
        assert_eq!(known.differences(&Fingerprint::of(&rewritten, &again)), []);
        assert_eq!(known.differences(&Fingerprint::of(&other, &other_store)).len(), 1);
    }

    #[test]
    fn a_file_that_is_gone_has_the_hash_of_its_bytes() {
        let folder = tempfile::tempdir().unwrap();
        let (store, file) = stored(folder.path(), 0.5);
        std::fs::remove_file(store.folder(&file.key.id()).join(METRICS)).unwrap();
        assert_eq!(Fingerprint::of(&file, &store).digest, file.end.digest);
    }
}
