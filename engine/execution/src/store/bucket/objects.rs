//! What is asked of object storage.

use std::fmt::Debug;

/// An object and the tag of this version of it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Object {
    pub(super) bytes: Vec<u8>,
    /// Changes with the content, as `ETag` does.
    pub(super) tag: String,
}

/// When an object is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum When<'a> {
    /// Whatever is there.
    Always,
    /// Where nothing is there.
    New,
    /// Where the version with this tag is there.
    Unchanged(&'a str),
}

/// Objects by their keys below the prefix. Errors are sentences.
pub(super) trait Objects: Send + Sync + Debug {
    /// The object; `None` where there is none.
    fn get(&self, key: &str) -> Result<Option<Object>, String>;
    /// Writes an object; false where it is not to be written.
    fn put(&self, key: &str, bytes: &[u8], when: When<'_>) -> Result<bool, String>;
    /// Removes an object, where there is one.
    fn delete(&self, key: &str) -> Result<(), String>;
    /// Every key that begins so.
    fn list(&self, prefix: &str) -> Result<Vec<String>, String>;
}
