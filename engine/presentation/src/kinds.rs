//! Kinds of tables and of figures, for listing, description, checks and construction.
//!
//! A kind is a type that can be read from a study and implements [`Table`](crate::table::Table) or
//! [`Figure`](crate::figure::Figure). The lists of the kinds in this crate have a line for each; other crates register
//! theirs by [`RegisterKinds`](crate::request::RegisterKinds).

use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::{Serialize, Serializer, de::DeserializeOwned};
use serde_json::{Map, Value, json};
use std::{any::Any, fmt, ops::Deref, path::Path, sync::Arc};

/// Facts about a kind that need no study.
#[derive(Debug, Clone, Copy)]
pub struct Kind {
    /// Key of the kind in a study.
    pub name: &'static str,
    /// Description in a sentence or two, for `describe`.
    pub about: &'static str,
    /// Schema of the value under the key.
    pub schema: fn(&mut SchemaGenerator) -> Schema,
    /// Check for options under the key that exclude each other; `None` if there are none.
    pub contradiction: fn(&Value) -> Option<Contradiction>,
    /// A use of the kind, in a study with the agents `rule`, `other` and `learner` (which learns), whose `discount` is
    /// swept, the environments `short`, `long` and `pair`, and the play `tag`; their trials record `return` and `length`.
    /// `describe` shows it, and a test checks a study with it: it names an agent, and a metric if the kind has a key for
    /// one.
    pub example: fn() -> &'static str,
}

/// A kind as a study names it: a type for the options under its key.
pub trait KindSpec: KindOptions + DeserializeOwned + JsonSchema {
    /// Key of the kind in a study.
    fn name() -> &'static str;

    /// Description in a sentence or two, for `describe`.
    fn about() -> &'static str;

    /// A use of the kind in YAML, see [`Kind::example`].
    fn example() -> &'static str;

    /// Options that exclude each other, in the value under the key; `None` if there are none.
    fn contradiction(_: &Value) -> Option<Contradiction> {
        None
    }
}

impl Kind {
    /// Facts on a kind.
    #[must_use]
    pub fn of<K: KindSpec>() -> Self {
        Self {
            name: K::name(),
            about: K::about(),
            schema: |generator| generator.subschema_for::<K>(),
            contradiction: K::contradiction,
            example: K::example,
        }
    }
}

/// A kind with its reader of options; `T` is `dyn Table` or `dyn Figure`.
pub struct Readable<T: ?Sized> {
    /// Facts on the kind.
    pub kind: Kind,
    pub(crate) read: fn(Value, &Path) -> serde_json::Result<Arc<T>>,
}

impl<T: ?Sized> Clone for Readable<T> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<T: ?Sized> Copy for Readable<T> {}

impl<T: ?Sized> Readable<T> {
    /// Reads the options under the key of the kind; paths of files are relative to `folder`.
    ///
    /// # Errors
    /// A missing option, or one of another type.
    pub fn read(&self, options: Value, folder: &Path) -> serde_json::Result<Chosen<T>> {
        Ok(Chosen {
            name: self.kind.name,
            options: (self.read)(options, folder)?,
        })
    }
}

/// Options of a kind. They can be written as in a study, and are identified by their type.
pub trait KindOptions: Any + fmt::Debug + Send + Sync {
    /// The value under the key of the kind.
    ///
    /// # Errors
    /// Options that have no form in JSON.
    fn to_value(&self) -> serde_json::Result<Value>;

    /// The options as a type that can be asked for.
    fn as_any(&self) -> &dyn Any;
}

impl<T: Any + fmt::Debug + Serialize + Send + Sync> KindOptions for T {
    fn to_value(&self) -> serde_json::Result<Value> {
        serde_json::to_value(self)
    }

    fn as_any(&self) -> &dyn Any {
        self
    }
}

/// The kind of one table or figure, with its options. In a study it is a mapping with the kind's name as its only key.
pub struct Chosen<T: ?Sized> {
    /// Key of the kind in a study.
    pub name: &'static str,
    options: Arc<T>,
}

impl<T: ?Sized> Chosen<T> {
    pub(crate) fn of<K: KindSpec>(options: Arc<T>) -> Self {
        let name = K::name();
        Self { name, options }
    }
}

impl<T: KindOptions + ?Sized> Chosen<T> {
    /// The options, if they are of this type.
    #[must_use]
    pub fn downcast<K: Any>(&self) -> Option<&K> {
        (*self.options).as_any().downcast_ref()
    }
}

impl<T: ?Sized> Deref for Chosen<T> {
    type Target = T;

    fn deref(&self) -> &T {
        &self.options
    }
}

impl<T: ?Sized> Clone for Chosen<T> {
    fn clone(&self) -> Self {
        Self {
            name: self.name,
            options: Arc::clone(&self.options),
        }
    }
}

impl<T: fmt::Debug + ?Sized> fmt::Debug for Chosen<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {:?}", self.name, &*self.options)
    }
}

impl<T: KindOptions + ?Sized> PartialEq for Chosen<T> {
    fn eq(&self, other: &Self) -> bool {
        let value = |it: &Self| (*it.options).to_value().ok();
        self.name == other.name && value(self) == value(other)
    }
}

impl<T: KindOptions + ?Sized> Serialize for Chosen<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let value = (*self.options).to_value().map_err(serde::ser::Error::custom)?;
        serializer.collect_map([(self.name, value)])
    }
}

/// An option that others exclude.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{message}")]
pub struct Contradiction {
    /// The option, as keys below that of the kind.
    pub at: Vec<&'static str>,
    /// Sentence on the contradiction.
    pub message: String,
    /// Sentence on the repair; empty if it is obvious.
    pub help: &'static str,
}

impl Contradiction {
    /// The same contradiction, with options one key deeper.
    #[must_use]
    pub fn below(mut self, key: &'static str) -> Self {
        self.at.insert(0, key);
        self
    }
}

/// Marker of a key in a schema whose own keys are described under their name instead of at its place.
pub const ELSEWHERE: &str = "x-described-by-name";

/// The keys of the kinds in the schema of an entry that gives exactly one of them. A key without a value counts as not
/// given.
#[must_use]
pub fn properties(kinds: &[Kind], generator: &mut SchemaGenerator) -> Map<String, Value> {
    let property = |kind: &Kind| {
        let value = (kind.schema)(generator);
        (
            kind.name.to_owned(),
            json!({ "description": kind.about, "anyOf": [value, { "type": "null" }], ELSEWHERE: true }),
        )
    };
    kinds.iter().map(property).collect()
}
