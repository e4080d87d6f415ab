//! Whether programs repeat, as was found out when a trial of them was computed twice: a file for each such trial. It
//! is found out again at any time, so that a file that is damaged is passed over.

use super::{Store, read_file, seal, write_durably};
use crate::{results::Repeats, world::fs};
use std::path::PathBuf;

/// The folder of these files in a store.
pub(super) const FOLDER: &str = "repeats";

impl Store {
    /// What was found out with the trial of an id; `None` where nothing was.
    #[must_use]
    pub fn repeats(&self, id: &str) -> Option<Repeats> {
        let text = read_file(&self.repeats_file(id)).ok()??;
        let mut file: serde_json::Value = serde_json::from_slice(&text).ok()?;
        serde_json::from_value(file["repeats"].take())
            .ok()
            .filter(|_| seal::is_sealed(&text))
    }

    /// True where something was found out with any trial.
    #[must_use]
    pub fn has_repeats(&self) -> bool {
        fs::is_folder(&self.root.join(FOLDER))
    }

    /// Keeps what was found out with a trial. Where it cannot be kept it is found out again.
    pub fn keep_repeats(&self, id: &str, repeats: &Repeats) {
        let text = serde_json::to_vec(&serde_json::json!({ "repeats": repeats })).map(seal::sealed);
        if let Ok(text) = text
            && fs::create_dir_all(self.root.join(FOLDER)).is_ok()
        {
            let _ = write_durably(&self.repeats_file(id), &text);
        }
    }

    fn repeats_file(&self, id: &str) -> PathBuf {
        self.root.join(FOLDER).join(format!("{id}.json"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_found_out_is_known_until_it_is_damaged() {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::at(dir.path());
        assert_eq!(store.repeats("a"), None);
        for repeats in [
            Repeats::ToTheBit(3),
            Repeats::Within(-6),
            Repeats::Unknown("slow".into()),
        ] {
            store.keep_repeats("a", &repeats);
            assert_eq!(store.repeats("a"), Some(repeats));
        }
        let file = store.repeats_file("a");
        let mut text = fs::read(&file).unwrap();
        text[18] ^= 1;
        fs::write(&file, &text).unwrap();
        assert_eq!(store.repeats("a"), None);
    }
}
