//! Announcements of external environments, from the last time that each was made. With them a study is read without
//! running any environment, even on a machine or in a shell that cannot make them.
//!
//! A record belongs to one identity, so a changed environment has none. It can be made again at any time: a damaged
//! record, or one of another program, is skipped.

use super::remade;
use crate::world::fs;
use contract::digest;
use serde::{Serialize, de::DeserializeOwned};
use std::path::{Path, PathBuf};

/// The folder of the records in a store.
pub(super) const FOLDER: &str = "environments";
/// Key of the announcement in a record.
const KEY: &str = "announced";
/// Version of the announcements; raised whenever an environment with the same config would announce something else.
const VERSION: u32 = 2;

/// Records of announcements in a store.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Announcements {
    store: PathBuf,
    /// Whether a record replaces the environment.
    is_believed: bool,
}

impl Announcements {
    /// The records of a store.
    #[must_use]
    pub fn of(store: &Path) -> Self {
        Self {
            store: store.into(),
            is_believed: true,
        }
    }

    /// The same records, but every environment is made in spite of them.
    #[must_use]
    pub fn doubted(self) -> Self {
        Self {
            is_believed: false,
            ..self
        }
    }

    /// The announcement of the environment with an identity; `None` if it is unknown or must not be used.
    pub fn recall<T: DeserializeOwned>(&self, id: &str) -> Option<T> {
        if !self.is_believed {
            return None;
        }
        remade::recall(&self.place(id), KEY)
    }

    /// Whether there is a store.
    pub fn has_store(&self) -> bool {
        fs::is_folder(&self.store)
    }

    /// Stores the announcement of an environment. If it cannot be stored, the environment is made again next time.
    pub fn keep(&self, id: &str, announced: &impl Serialize) {
        remade::keep(&self.place(id), KEY, announced);
    }

    fn place(&self, id: &str) -> PathBuf {
        let program = env!("CARGO_PKG_VERSION");
        let name = digest::of_bytes(format!("{id} {program} {VERSION}").as_bytes());
        self.store.join(FOLDER).join(format!("{name}.json"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_announced_is_known_until_it_is_damaged() {
        let dir = tempfile::tempdir().unwrap();
        let known = Announcements::of(dir.path());
        let recalled = |of: &Announcements, id: &str| of.recall::<Vec<String>>(id);
        assert_eq!(recalled(&known, "a"), None);
        let told = vec!["level".to_owned()];
        known.keep("a", &told);
        assert_eq!(recalled(&known, "a"), Some(told.clone()));
        assert_eq!(recalled(&known, "b"), None);
        assert_eq!(recalled(&known.clone().doubted(), "a"), None);
        let mut text = fs::read(known.place("a")).unwrap();
        text[16] ^= 1;
        fs::write(known.place("a"), &text).unwrap();
        assert_eq!(recalled(&known, "a"), None);
        known.keep("a", &told);
        assert_eq!(recalled(&known, "a"), Some(told.clone()));
        assert!(known.has_store() && !Announcements::of(&dir.path().join("absent")).has_store());
    }
}
