//! Object storage, reduced to the operations that a bucket needs.

use contract::Registry;
use std::{fmt::Debug, sync::Arc};

/// A kind of object storage that a program can reach.
pub struct ObjectStorage {
    /// Opens the storage at an address; the second argument reads environment variables, which contain keys. Makes no
    /// request. The error is a sentence.
    pub open: fn(&str, &dyn Fn(&str) -> Option<String>) -> Result<Arc<dyn Objects>, String>,
}

/// Registration of object storage.
pub trait RegisterObjectStorage {
    /// Registers object storage; the first one registered is used.
    fn object_storage(&mut self, storage: ObjectStorage);
}

impl RegisterObjectStorage for Registry {
    fn object_storage(&mut self, storage: ObjectStorage) {
        self.extend(storage);
    }
}

/// Content of an object, and the tag of this version of it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Object {
    /// The content.
    pub bytes: Vec<u8>,
    /// Tag that changes with the content, like an `ETag`.
    pub tag: String,
}

/// Condition under which an object is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WriteCondition<'a> {
    /// No condition.
    Always,
    /// Only if there is no object.
    New,
    /// Only over the version with this tag.
    Unchanged(&'a str),
}

/// Objects by their keys below the prefix. Errors are sentences.
pub trait Objects: Send + Sync + Debug {
    /// Reads an object; `None` if there is none.
    fn get(&self, key: &str) -> Result<Option<Object>, String>;
    /// Writes an object; false if the condition does not hold.
    fn put(&self, key: &str, bytes: &[u8], when: WriteCondition<'_>) -> Result<bool, String>;
    /// Removes an object, if there is one.
    fn delete(&self, key: &str) -> Result<(), String>;
    /// Every key that begins with `prefix`.
    fn list(&self, prefix: &str) -> Result<Vec<String>, String>;
}
