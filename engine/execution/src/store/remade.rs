//! Records that can be made again at any time; a damaged one, or one that cannot be stored, counts as absent.

use super::{read_file, seal, write_durably};
use crate::world::fs;
use serde::{Serialize, de::DeserializeOwned};
use serde_json::{Value, json};
use std::path::Path;

/// The value that a file contains under a key; `None` if there is none, or if its checksum does not match.
pub(super) fn recall<T: DeserializeOwned>(path: &Path, key: &str) -> Option<T> {
    let text = read_file(path).ok()??;
    if !seal::is_sealed(&text) {
        return None;
    }
    let mut record: Value = serde_json::from_slice(&text).ok()?;
    serde_json::from_value(record[key].take()).ok()
}

/// Stores a value under a key in a file, unless the file already has it.
pub(super) fn keep(path: &Path, key: &str, value: &impl Serialize) {
    let text = serde_json::to_vec(&json!({ key: value })).map(seal::sealed);
    if let (Ok(text), Some(folder)) = (text, path.parent())
        && read_file(path).ok().flatten().as_ref() != Some(&text)
        && fs::create_dir_all(folder).is_ok()
    {
        let _ = write_durably(path, &text);
    }
}
