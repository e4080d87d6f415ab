//! Object storage, reduced to the operations that a bucket needs.

use std::fmt::Debug;

/// Content of an object, and the tag of this version of it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Object {
    pub(super) bytes: Vec<u8>,
    /// Tag that changes with the content, as `ETag` does.
    pub(super) tag: String,
}

/// Condition under which an object is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum WriteCondition<'a> {
    /// No condition.
    Always,
    /// Only where there is no object.
    New,
    /// Only over the version with this tag.
    Unchanged(&'a str),
}

/// Objects by their keys below the prefix. Errors are sentences.
pub(super) trait Objects: Send + Sync + Debug {
    /// Reads an object; `None` where there is none.
    fn get(&self, key: &str) -> Result<Option<Object>, String>;
    /// Writes an object; false where the condition does not hold.
    fn put(&self, key: &str, bytes: &[u8], when: WriteCondition<'_>) -> Result<bool, String>;
    /// Removes an object, if there is one.
    fn delete(&self, key: &str) -> Result<(), String>;
    /// Every key that begins with `prefix`.
    fn list(&self, prefix: &str) -> Result<Vec<String>, String>;
}
