//! Values that are read as far as they have the form of their type.

use crate::Node;
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::{Deserialize, Deserializer, Serialize, de::DeserializeOwned};
use serde_json::Value;
use std::{borrow::Cow, collections::BTreeMap};

/// A value of a document, with the schema of its type; empty if it is absent or has another form. The check against the
/// schema reports such a value, which hides no mistake in others.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(transparent)]
pub struct Fitting<T>(pub Option<T>);

/// Values by name, each read alone.
pub type FittingEntries<T> = Fitting<BTreeMap<String, Fitting<T>>>;

/// Values in a list, each read alone.
pub type FittingItems<T> = Fitting<Vec<Fitting<T>>>;

impl<T: DeserializeOwned> Fitting<T> {
    /// Reads a value.
    #[must_use]
    pub fn read(value: Value) -> Self {
        Self(serde_json::from_value(value).ok())
    }
}

impl<T> FittingEntries<T> {
    /// The value of this name.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<&T> {
        self.0.as_ref()?.get(name)?.0.as_ref()
    }
}

impl<T> FittingItems<T> {
    /// The items that have the form of their type, each with its index and its node in the section.
    pub fn located<'a>(
        &'a self,
        section: Option<&'a Node>,
    ) -> impl Iterator<Item = (usize, &'a T, &'a Node)> {
        let items = self.0.as_deref().unwrap_or_default().iter();
        let nodes = section.map_or(&[][..], Node::items);
        let all = items.zip(nodes).enumerate();
        all.filter_map(|(index, (item, node))| Some((index, item.0.as_ref()?, node)))
    }
}

impl<T> Default for Fitting<T> {
    fn default() -> Self {
        Self(None)
    }
}

impl<'de, T: DeserializeOwned> Deserialize<'de> for Fitting<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        // An absent field is read as an option without a value.
        let value = Option::<Value>::deserialize(deserializer)?;
        Ok(value.map_or_else(Self::default, Self::read))
    }
}

impl<T: JsonSchema> JsonSchema for Fitting<T> {
    fn inline_schema() -> bool {
        T::inline_schema()
    }

    fn schema_name() -> Cow<'static, str> {
        T::schema_name()
    }

    fn schema_id() -> Cow<'static, str> {
        T::schema_id()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        T::json_schema(generator)
    }
}
