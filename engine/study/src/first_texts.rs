//! Files of a study as they were read first.

use document::input_file::{self, Use};
use std::{
    collections::BTreeMap,
    io,
    path::{Path, PathBuf},
    sync::{Arc, Mutex, PoisonError},
};

/// The bytes of a study's files. Loads with the same options read each file once, so that a search goes on with the
/// study with which it began, even if somebody saves another version meanwhile.
#[derive(Debug, Clone, Default)]
pub struct FirstTexts {
    bytes: Arc<Mutex<BTreeMap<PathBuf, Vec<u8>>>>,
}

/// All are equal, since they change no study.
impl PartialEq for FirstTexts {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl Eq for FirstTexts {}

impl FirstTexts {
    /// The bytes of a file at its first read.
    ///
    /// # Errors
    /// Those of [`input_file::read`]; such a file is read again.
    pub(crate) fn read(&self, path: &Path) -> io::Result<Vec<u8>> {
        let mut known = self.bytes.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(bytes) = known.get(path) {
            return Ok(bytes.clone());
        }
        let bytes = input_file::read(path, Use::Study)?;
        known.insert(path.to_owned(), bytes.clone());
        Ok(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_was_read_stays_as_it_was() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("study.yaml");
        let texts = FirstTexts::default();
        assert!(texts.read(&path).is_err());
        std::fs::write(&path, "settings: 10").unwrap();
        assert_eq!(texts.read(&path).unwrap(), b"settings: 10");
        std::fs::write(&path, "settings: 5").unwrap();
        assert_eq!(texts.clone().read(&path).unwrap(), b"settings: 10");
        assert_eq!(FirstTexts::default().read(&path).unwrap(), b"settings: 5");
    }
}
