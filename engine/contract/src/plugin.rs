//! Plugins as the engine sees them: their configs, presets and schemas.

use crate::complete_config::CompleteConfig;
use schemars::{JsonSchema, Schema};
use serde::{Serialize, de::DeserializeOwned};
use serde_json::Value;

/// The config of a plugin.
///
/// A file that a config names stands under a key `file` and is a [`DataFile`](crate::DataFile): a trial then reads the
/// content whose hash is in its id, even if the file changes.
///
/// Derive `Clone`, `Serialize`, `Deserialize` (with `#[serde(deny_unknown_fields, default)]`) and `JsonSchema`. Doc
/// comments become the descriptions that `describe` prints. `#[schemars(range(min = .., max = ..))]` gives the limits
/// that `check` enforces, `#[schemars(extend("x-unit" = "s"))]` the unit and `#[schemars(extend("x-source" = "table
/// 3.1"))]` the source of a default.
pub trait Config:
    Clone + DeserializeOwned + Serialize + Default + JsonSchema + Send + Sync + 'static
{
    /// Named settings that differ from the default.
    fn presets() -> Vec<Preset> {
        Vec::new()
    }
}

/// A named setting of a plugin: keys that replace the defaults.
#[derive(Debug, Clone, Serialize)]
pub struct Preset {
    /// Name of the preset, as in `preset: thesis`.
    pub name: &'static str,
    /// Source of the values.
    pub about: &'static str,
    /// A JSON object with the keys that differ.
    pub values: Value,
}

/// Facts about a plugin, the same for every kind.
pub struct About {
    /// Description in one line.
    pub about: &'static str,
    /// Raised whenever a change of code changes the numbers of a trial.
    pub version: u32,
    /// The config with every default.
    pub defaults: CompleteConfig,
    /// JSON Schema of the config.
    pub schema: Schema,
    /// Named settings.
    pub presets: Vec<Preset>,
    /// Fills in the defaults of a config and refuses one that does not fit.
    pub resolve: Resolve,
}

impl About {
    /// Keys of the config that only concern the observation of the plugin, and no event in it: those that the schema
    /// marks with `x-looks`. They are part of a trial's identity but not of its random streams.
    pub fn looking_keys(&self) -> impl Iterator<Item = &str> {
        self.marked("x-looks", true)
    }

    /// Keys of the config that only decide where it is computed: those that the schema marks with `x-identity: false`.
    /// They are part of neither a trial's identity nor its random streams.
    pub fn machine_keys(&self) -> impl Iterator<Item = &str> {
        self.marked("x-identity", false)
    }

    /// Keys of the config that name files by a list of patterns: those that the schema marks with `x-patterns`.
    /// The list is replaced by a mapping of names to files before the config is read.
    pub fn pattern_keys(&self) -> impl Iterator<Item = &str> {
        self.marked("x-patterns", true)
    }

    fn marked(&self, mark: &'static str, value: bool) -> impl Iterator<Item = &str> {
        let properties = self.schema.get("properties").and_then(Value::as_object);
        let is_marked =
            move |(_, property): &(&String, &Value)| property.get(mark) == Some(&Value::Bool(value));
        properties
            .into_iter()
            .flatten()
            .filter(is_marked)
            .map(|(key, _)| key.as_str())
    }
}

/// Makes a complete config from the given one, or refuses it.
pub type Resolve<Given = Value> =
    Box<dyn Fn(&Given) -> Result<CompleteConfig, serde_json::Error> + Send + Sync>;
