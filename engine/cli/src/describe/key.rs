//! The keys of a JSON Schema as data, including nested structs, lists, mappings and the forms of a choice.

use document::schema_check::View;
use presentation::kinds::ELSEWHERE;
use serde::Serialize;
use serde_json::{Value, json};

/// Maximum depth of keys, which ends a schema that refers to itself.
const DEEPEST: usize = 8;

/// A key that a study may write.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Key {
    /// The key; empty for the entries of a list, and for those of a mapping whose keys are free.
    pub name: String,
    /// Condition on its value, in words.
    #[serde(rename = "type")]
    pub expected: String,
    /// The range of a number in words; empty where every number is allowed.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub range: String,
    /// The unit; empty where there is none.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub unit: String,
    /// Whether a study has to write it.
    pub required: bool,
    /// Value that applies if the key is absent; null if there is none, and absent if the schema does not state one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub default: Option<Value>,
    /// Meaning of the key.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub about: String,
    /// Source of its default.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub source: String,
    /// The keys of a mapping whose keys are fixed.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub keys: Vec<Key>,
    /// The ways to write it, where there are several.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub forms: Vec<Notation>,
    /// Each entry of a list, or of a mapping whose keys are free.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub entries: Option<Box<Key>>,
}

/// One way to write something.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Notation {
    /// Its notation: a word, a mapping with one key, or a description.
    pub written: String,
    /// Meaning of the value.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub about: String,
    /// An example; empty if its keys say enough.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub example: String,
    /// Its keys.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub keys: Vec<Key>,
    /// Each entry of a list, or of a mapping whose keys are free.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub entries: Option<Box<Key>>,
}

impl Key {
    /// This key and all below it, each with its dotted path.
    #[must_use]
    pub fn paths(&self) -> Vec<String> {
        let of_forms = self
            .forms
            .iter()
            .flat_map(|form| form.keys.iter().chain(form.entries.as_deref()));
        let below = self.keys.iter().chain(of_forms).chain(self.entries.as_deref());
        let mut all = vec![self.name.clone()];
        for path in below.flat_map(Key::paths) {
            all.push(if path.is_empty() {
                self.name.clone()
            } else {
                format!("{}.{path}", self.name)
            });
        }
        all
    }
}

/// The keys of a mapping; `defaults` holds the values of absent keys, if they are known.
pub(super) fn keys(schema: &View<'_>, defaults: &Value) -> Vec<Key> {
    keys_at(schema, defaults, 0)
}

/// Condition that a schema sets on the value of a key, in words.
pub(super) fn key(name: &str, schema: &View<'_>) -> Key {
    key_at(name, schema, schema.get("default"), false, 0)
}

fn keys_at(schema: &View<'_>, defaults: &Value, depth: usize) -> Vec<Key> {
    let required = schema.get("required").and_then(Value::as_array);
    let mut all = Vec::new();
    for name in schema.property_names() {
        let Some(property) = schema.property(name) else {
            continue;
        };
        let required = required.is_some_and(|keys| keys.contains(&json!(name)));
        let default = defaults.get(name).or_else(|| property.get("default"));
        all.push(key_at(name, &property, default, required, depth));
    }
    all
}

fn key_at(name: &str, schema: &View<'_>, default: Option<&Value>, required: bool, depth: usize) -> Key {
    let text = |keyword: &str| schema.get(keyword).and_then(Value::as_str).unwrap_or_default();
    let Inside { keys, forms, entries } = inside(schema, default, depth);
    let ranges = schema.alternatives().iter().map(View::range).collect::<Vec<_>>();
    let range = ranges
        .into_iter()
        .find(|range| !range.is_empty() && forms.is_empty());
    Key {
        name: name.into(),
        expected: expected(schema),
        range: range.unwrap_or_default(),
        unit: text("x-unit").into(),
        required,
        default: default.cloned(),
        about: text("description").into(),
        source: text("x-source").into(),
        keys,
        forms,
        entries,
    }
}

fn expected(schema: &View<'_>) -> String {
    match schema.expected() {
        words if words.is_empty() => "anything".into(),
        words => words,
    }
}

/// Type of a value, in words.
#[derive(Default)]
struct Inside {
    keys: Vec<Key>,
    forms: Vec<Notation>,
    entries: Option<Box<Key>>,
}

fn inside(schema: &View<'_>, default: Option<&Value>, depth: usize) -> Inside {
    if depth == DEEPEST || is_described_elsewhere(schema) {
        return Inside::default();
    }
    let nothing = Value::Null;
    if let Some(fields) = schema.as_struct() {
        return Inside {
            keys: keys_at(&fields, default.unwrap_or(&nothing), depth + 1),
            ..Inside::default()
        };
    }
    let mut places = schema.alternatives();
    places.retain(|place| place.types() != ["null"]);
    match places.as_slice() {
        // With no choice between forms the keys are those of the value itself.
        [one] if one.get("properties").is_some() => Inside {
            keys: keys_at(one, default.unwrap_or(&nothing), depth + 1),
            ..Inside::default()
        },
        [one] if one.words().len() < 2 => Inside {
            entries: entries(one, depth),
            ..Inside::default()
        },
        several => Inside {
            forms: said(several.iter().flat_map(|place| form(place, depth)).collect()),
            ..Inside::default()
        },
    }
}

/// The forms, without a list of plain words, which the type already names.
fn said(forms: Vec<Notation>) -> Vec<Notation> {
    let is_word_alone =
        |form: &Notation| form.about.is_empty() && form.keys.is_empty() && form.entries.is_none();
    if forms.iter().all(is_word_alone) {
        Vec::new()
    } else {
        forms
    }
}

/// Whether the choice is among plugins or kinds, which are described under their own names.
fn is_described_elsewhere(schema: &View<'_>) -> bool {
    let is_plugin = |place: &View<'_>| {
        let kind = place.get("x-kind").and_then(Value::as_str);
        kind.is_some_and(|kind| kind.ends_with(" plugin"))
    };
    schema.get(ELSEWHERE).is_some() || schema.alternatives().iter().any(is_plugin)
}

/// The notation of one of several alternatives; several forms if it lists words.
pub(super) fn form(place: &View<'_>, depth: usize) -> Vec<Notation> {
    let about = place
        .get("description")
        .and_then(Value::as_str)
        .unwrap_or_default();
    let words = place.words();
    if !words.is_empty() {
        let about = if words.len() == 1 { about } else { "" };
        let form = |word: &str| Notation {
            written: format!("`{word}`"),
            about: about.into(),
            ..Notation::default()
        };
        return words.into_iter().map(form).collect();
    }
    let written = place.variant().map(|key| format!("`{{ {key}: ... }}`"));
    let range = place.range();
    let in_words = [expected(place), range].join(" ").trim_end().to_owned();
    let fixed = place.get("properties").is_some();
    vec![Notation {
        written: written.unwrap_or(in_words),
        about: about.into(),
        example: String::new(),
        keys: if fixed {
            keys_at(place, &Value::Null, depth + 1)
        } else {
            Vec::new()
        },
        entries: if fixed { None } else { entries(place, depth) },
    }]
}

/// Each entry of a list or of a mapping with free keys, if there is more to describe than its type.
fn entries(place: &View<'_>, depth: usize) -> Option<Box<Key>> {
    let entry = if place.types().contains(&"array") {
        place.item(0)
    } else if place.types().contains(&"object") {
        place
            .property("")
            .filter(|_| place.get("additionalProperties").is_some())
    } else {
        None
    }?;
    let key = key_at("", &entry, None, false, depth + 1);
    let is_told = !key.keys.is_empty()
        || !key.forms.is_empty()
        || key.entries.is_some()
        || !key.range.is_empty()
        || !key.about.is_empty();
    is_told.then(|| Box::new(key))
}
