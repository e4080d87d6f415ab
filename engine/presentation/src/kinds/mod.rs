//! Kinds of tables and of figures: one list of each, for listing, description, checks and construction.
//!
//! A kind is a type that can be read from a study, with the trait of its list ([`crate::table::TableKind`] or
//! [`crate::figure::FigureKind`] names them). Adding one is a file with that type and a line in the list.

use schemars::{Schema, SchemaGenerator, json_schema};
use serde_json::{Map, Value, json};

/// Facts on a kind that hold without a study.
#[derive(Debug, Clone, Copy)]
pub struct Kind {
    /// Key of the kind in a study.
    pub name: &'static str,
    /// Description in a sentence or two, for `describe`.
    pub about: &'static str,
    /// Schema of the value under the key.
    pub schema: fn(&mut SchemaGenerator) -> Schema,
    /// Check for options under the key that exclude each other; `None` where there are none.
    pub contradiction: fn(&Value) -> Option<Contradiction>,
    /// A use of it, in a study with the agents `rule`, `other` and `learner` (which learns), whose `discount` is
    /// swept, the environments `short`, `long` and `pair`, and the play `tag`. `describe` shows it, and a test
    /// checks a study with it.
    pub example: fn() -> &'static str,
}

/// An option that others exclude.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{message}")]
pub struct Contradiction {
    /// The option, below the key of the kind.
    pub at: Vec<&'static str>,
    /// Sentence on the contradiction.
    pub message: String,
    /// Sentence on the repair; empty where it is plain.
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

/// Marker of a key in a schema whose own keys are described under their name and not at its place.
pub const ELSEWHERE: &str = "x-described-by-name";

/// The schema of an entry that gives exactly one of the kinds: a key for each. A key without a value counts
/// as not given.
pub(crate) fn schema(kinds: &[Kind], generator: &mut SchemaGenerator) -> Schema {
    let property = |kind: &Kind| {
        let value = (kind.schema)(generator);
        (
            kind.name.to_owned(),
            json!({ "description": kind.about, "anyOf": [value, { "type": "null" }], ELSEWHERE: true }),
        )
    };
    let properties: Map<String, Value> = kinds.iter().map(property).collect();
    json_schema!({ "type": "object", "properties": properties })
}

/// A list of kinds: an enum of their types, which is written as a mapping with the kind's name as its one
/// key.
macro_rules! kinds {
    ($(#[$doc:meta])* $Any:ident: $Trait:ident { $($name:literal => $Variant:ident($Spec:ty),
        $about:literal;)+ }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
        pub enum $Any {
            $(#[doc = $about] #[serde(rename = $name)] $Variant($Spec),)+
        }

        impl $Any {
            /// All kinds, in the order in which they are listed.
            pub const ALL: &'static [$crate::kinds::Kind] = &[$($crate::kinds::Kind {
                name: $name,
                about: $about,
                schema: |generator| generator.subschema_for::<$Spec>(),
                contradiction: <$Spec as $Trait>::contradiction,
                example: <$Spec as $Trait>::example,
            },)+];

            fn it(&self) -> &dyn $Trait {
                match self { $(Self::$Variant(it) => it,)+ }
            }
        }

        $(impl From<$Spec> for $Any {
            fn from(it: $Spec) -> Self {
                Self::$Variant(it)
            }
        })+

        impl schemars::JsonSchema for $Any {
            fn inline_schema() -> bool {
                true
            }
            fn schema_name() -> std::borrow::Cow<'static, str> {
                stringify!($Any).into()
            }
            fn json_schema(generator: &mut schemars::SchemaGenerator) -> schemars::Schema {
                $crate::kinds::schema(Self::ALL, generator)
            }
        }
    };
}
pub(crate) use kinds;
