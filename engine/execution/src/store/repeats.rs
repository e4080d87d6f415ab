//! Repeatability of programs: a file for each trial that was computed twice, with the result.

use super::{Store, names, remade};
use contract::repeats::Repeats;
use std::{collections::BTreeMap, path::PathBuf};

/// Folder of these files in a store.
pub(super) const FOLDER: &str = "repeats";
/// Key of the answer in a file.
const KEY: &str = "repeats";

impl Store {
    /// The known answers, by the ids of the trials that were computed twice.
    #[must_use]
    pub fn repeats(&self) -> BTreeMap<String, Repeats> {
        let names = names(&self.root.join(FOLDER)).unwrap_or_default();
        let ids = names.iter().filter_map(|name| name.strip_suffix(".json"));
        ids.filter_map(|id| Some((id.to_owned(), remade::recall(&self.repeats_file(id), KEY)?)))
            .collect()
    }

    /// Stores an answer. An answer that cannot be stored is determined again.
    pub fn keep_repeats(&self, id: &str, repeats: &Repeats) {
        remade::keep(&self.repeats_file(id), KEY, repeats);
    }

    /// Copies the answers of another store for trials that this one has too.
    pub(super) fn take_repeats(&self, source: &Self) {
        let known = self.repeats();
        let other = source.repeats().into_iter();
        for (id, repeats) in other.filter(|(id, _)| !known.contains_key(id)) {
            if self.file(&id).is_ok_and(|file| file.is_some()) {
                self.keep_repeats(&id, &repeats);
            }
        }
    }

    fn repeats_file(&self, id: &str) -> PathBuf {
        self.root.join(FOLDER).join(format!("{id}.json"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::{Leases, Merge, stub};
    use contract::{Phase, Recorder};
    use std::{fs, time::Duration};

    #[test]
    fn merging_takes_the_answers_on_trials_that_both_hold() {
        let dir = tempfile::tempdir().unwrap();
        let [source, into] = ["source", "into"].map(|name| Store::at(dir.path().join(name)));
        let (trial, mut record) = (stub::trial(4, 0), Recorder::default());
        record.add(Phase::Final, 10, 0, 0, "return", 1.0);
        source.finish(&trial, &record, 1.0).unwrap();
        let held = trial.id;
        for id in [held.as_str(), "another"] {
            source.keep_repeats(id, &Repeats::ToTheBit(3));
        }
        let mut imagined = Merge::new(&into, None).unwrap();
        imagined.take(&source, &mut |_| {}).unwrap();
        assert!(into.repeats().is_empty());
        let leases = Leases::open(&into, Duration::from_secs(30)).unwrap();
        Merge::new(&into, Some(&leases))
            .unwrap()
            .take(&source, &mut |_| {})
            .unwrap();
        assert_eq!(into.repeats(), [(held, Repeats::ToTheBit(3))].into());
    }

    #[test]
    fn an_answer_is_known_until_it_is_damaged() {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::at(dir.path());
        assert!(store.repeats().is_empty());
        for repeats in [
            Repeats::ToTheBit(3),
            Repeats::Within(-6),
            Repeats::Unknown("slow".into()),
        ] {
            store.keep_repeats("a", &repeats);
            assert_eq!(store.repeats(), [("a".to_owned(), repeats)].into());
        }
        let file = store.repeats_file("a");
        let mut text = fs::read(&file).unwrap();
        text[18] ^= 1;
        fs::write(&file, &text).unwrap();
        assert!(store.repeats().is_empty());
    }
}
