//! A JSON Schema as a reader understands it: references followed, alternatives listed, types and ranges as text.

use crate::{Node, NodeKind};
use serde_json::Value;

/// A schema with its references followed; the outermost layer that has a keyword takes precedence.
#[derive(Debug, Clone)]
pub struct View<'a> {
    root: &'a Value,
    layers: Vec<&'a Value>,
}

impl<'a> View<'a> {
    /// The schema `schema`, whose references refer to parts of `root`.
    #[must_use]
    pub fn new(root: &'a Value, schema: &'a Value) -> Self {
        let mut layers = vec![schema];
        // A reference to itself ends here; no schema of this program nests references deeper.
        while let Some(next) = layers
            .last()
            .and_then(|last| referenced(root, last))
            .filter(|_| layers.len() < 16)
        {
            layers.push(next);
        }
        Self { root, layers }
    }

    /// The value of a keyword.
    #[must_use]
    pub fn get(&self, keyword: &str) -> Option<&'a Value> {
        self.layers.iter().find_map(|layer| layer.get(keyword))
    }

    /// Names of the properties.
    #[must_use]
    pub fn property_names(&self) -> Vec<&'a str> {
        self.get("properties")
            .and_then(Value::as_object)
            .map_or_else(Vec::new, |map| map.keys().map(String::as_str).collect())
    }

    /// The schema of the values under a key; `None` if the key is not allowed.
    #[must_use]
    pub fn property(&self, key: &str) -> Option<View<'a>> {
        if let Some(found) = self.get("properties").and_then(|properties| properties.get(key)) {
            return Some(View::new(self.root, found));
        }
        match self.get("additionalProperties") {
            Some(Value::Bool(false)) => None,
            Some(schema) => Some(View::new(self.root, schema)),
            None if self.get("properties").is_some() => None,
            None => Some(View::new(self.root, &Value::Null)),
        }
    }

    /// The schema of a list's items.
    #[must_use]
    pub fn item(&self, index: usize) -> Option<View<'a>> {
        let listed = self.get("prefixItems").and_then(|items| items.get(index));
        listed
            .or_else(|| self.get("items"))
            .map(|schema| View::new(self.root, schema))
    }

    /// The alternative schemas for a value; the schema itself if there is no choice.
    #[must_use]
    pub fn alternatives(&self) -> Vec<View<'a>> {
        let choice = self
            .get("oneOf")
            .or_else(|| self.get("anyOf"))
            .and_then(Value::as_array);
        match choice {
            None => vec![self.clone()],
            Some(list) => list
                .iter()
                .flat_map(|schema| View::new(self.root, schema).alternatives())
                .collect(),
        }
    }

    /// The schema below a dotted path.
    ///
    /// # Errors
    /// The index of the first key that does not exist, and the names known there.
    pub fn descend(&self, keys: &[String]) -> Result<View<'a>, (usize, Vec<&'a str>)> {
        let mut here = self.clone();
        for (index, key) in keys.iter().enumerate() {
            let places = here.alternatives();
            let Some(next) = places
                .iter()
                .find_map(|place| place.property(key).filter(|_| place.is_mapping()))
            else {
                return Err((index, places.iter().flat_map(View::property_names).collect()));
            };
            here = next;
        }
        Ok(here)
    }

    /// Whether only whole numbers are allowed.
    #[must_use]
    pub fn is_integer(&self) -> bool {
        let places = self.alternatives();
        let types: Vec<&str> = places
            .iter()
            .flat_map(View::types)
            .filter(|name| *name != "null")
            .collect();
        !types.is_empty() && types.iter().all(|name| *name == "integer")
    }

    /// The schema of a mapping with fixed keys, whose defaults are filled in key by key.
    #[must_use]
    pub fn as_struct(&self) -> Option<View<'a>> {
        let mut places: Vec<View<'a>> = self.alternatives();
        places.retain(|place| place.types() != ["null"]);
        match places.as_slice() {
            [one] if one.get("properties").is_some() && one.variant().is_none() => Some(one.clone()),
            _ => None,
        }
    }

    /// Whether a mapping is allowed.
    #[must_use]
    pub fn is_mapping(&self) -> bool {
        self.types().contains(&"object") || self.types().is_empty()
    }

    /// Allowed types; empty if any is allowed.
    #[must_use]
    pub fn types(&self) -> Vec<&'a str> {
        match self.get("type") {
            Some(Value::String(one)) => vec![one],
            Some(Value::Array(several)) => several.iter().filter_map(Value::as_str).collect(),
            _ if self.get("properties").is_some() => vec!["object"],
            _ => self.words().first().map_or_else(Vec::new, |_| vec!["string"]),
        }
    }

    /// The words of an `enum` or `const`.
    #[must_use]
    pub fn words(&self) -> Vec<&'a str> {
        let listed = self
            .get("enum")
            .and_then(Value::as_array)
            .map_or_else(Vec::new, |list| list.iter().collect());
        listed
            .into_iter()
            .chain(self.get("const"))
            .filter_map(Value::as_str)
            .collect()
    }

    /// The name of an enum's variant that is written as a mapping with one key.
    #[must_use]
    pub fn variant(&self) -> Option<&'a str> {
        let required = self.get("required").and_then(Value::as_array)?;
        match (required.as_slice(), self.property_names().as_slice()) {
            ([Value::String(key)], [only]) if key == only => Some(only),
            _ => None,
        }
    }

    pub(super) fn accepts(&self, node: &Node) -> bool {
        let types = self.types();
        types.is_empty() || types.iter().any(|name| fits(node, name))
    }

    pub(super) fn number(&self, keyword: &str) -> Option<f64> {
        self.get(keyword).and_then(Value::as_f64)
    }

    /// First sentence of the description.
    #[must_use]
    pub fn sentence(&self) -> String {
        let text = self
            .get("description")
            .and_then(Value::as_str)
            .unwrap_or_default()
            .replace('\n', " ");
        let end = text
            .find(". ")
            .map_or(text.trim_end_matches('.').len(), |index| index);
        text[..end].to_string()
    }

    /// The range of a number as text, such as `from 0 to 1`; empty if every number is allowed.
    #[must_use]
    pub fn range(&self) -> String {
        let limit = |keyword: &str, word: &str| {
            self.number(keyword)
                .map(|value| format!("{word} {}", short(value)))
        };
        if let (Some(low), Some(high)) = (self.number("minimum"), self.number("maximum")) {
            return format!("from {} to {}", short(low), short(high));
        }
        let low = limit("minimum", "at least").or_else(|| limit("exclusiveMinimum", "above"));
        let high = limit("maximum", "at most").or_else(|| limit("exclusiveMaximum", "below"));
        let multiple = limit("multipleOf", "a multiple of");
        [low, high, multiple]
            .into_iter()
            .flatten()
            .collect::<Vec<_>>()
            .join(" and ")
    }

    /// The expected value, as text: `an integer at least 1`, `one of ...`.
    #[must_use]
    pub fn expected(&self) -> String {
        let places = self.alternatives();
        let mut parts: Vec<String> = Vec::new();
        let words: Vec<&str> = places.iter().flat_map(View::words).collect();
        if !words.is_empty() {
            parts.push(format!(
                "{}{}",
                if words.len() > 1 { "one of " } else { "" },
                quoted(&words)
            ));
        }
        let variants: Vec<&str> = places.iter().filter_map(View::variant).collect();
        if !variants.is_empty() {
            parts.push(format!("a mapping with one of the keys {}", quoted(&variants)));
        }
        for place in places
            .iter()
            .filter(|place| place.words().is_empty() && place.variant().is_none())
        {
            let types = place.types().into_iter().filter(|name| *name != "null");
            parts.extend(types.map(|name| {
                if name == "array" {
                    place.list_in_words()
                } else {
                    type_in_words(name).to_string()
                }
            }));
        }
        parts.dedup();
        parts.join(" or ")
    }

    fn list_in_words(&self) -> String {
        let types = self
            .get("items")
            .map(|items| View::new(self.root, items).types())
            .unwrap_or_default();
        let plural = |name| match name {
            "integer" => "a list of integers",
            "number" => "a list of numbers",
            "string" => "a list of texts",
            _ => "a list",
        };
        types.first().map_or("a list", |name| plural(name)).into()
    }

    /// Meaning of a key: first sentence, range, unit.
    #[must_use]
    pub fn facts(&self) -> String {
        let unit = self
            .get("x-unit")
            .and_then(Value::as_str)
            .filter(|unit| !unit.is_empty());
        let places = self.alternatives();
        let range = places.iter().map(View::range).find(|range| !range.is_empty());
        let number = self.is_integer().then(|| "integer".to_string());
        let kind = [number, range, unit.map(|unit| format!("in {unit}"))]
            .into_iter()
            .flatten()
            .collect::<Vec<_>>()
            .join(", ");
        match (self.sentence(), kind) {
            (sentence, kind) if kind.is_empty() => sentence,
            (sentence, kind) if sentence.is_empty() => kind,
            (sentence, kind) => format!("{sentence} ({kind})"),
        }
    }
}

fn referenced<'a>(root: &'a Value, schema: &Value) -> Option<&'a Value> {
    let target = schema.get("$ref")?.as_str()?.strip_prefix("#")?;
    root.pointer(target)
}

fn fits(node: &Node, name: &str) -> bool {
    match (&node.kind, name) {
        (NodeKind::Mapping(_), "object") | (NodeKind::Sequence(_), "array") => true,
        (NodeKind::Scalar(scalar), _) => match &scalar.value {
            Value::Null => name == "null",
            Value::Bool(_) => name == "boolean",
            Value::String(_) => name == "string",
            Value::Number(number) => name == "number" || name == "integer" && !number.is_f64(),
            _ => false,
        },
        _ => false,
    }
}

fn type_in_words(name: &str) -> &str {
    match name {
        "object" => "a mapping",
        "array" => "a list",
        "string" => "a text",
        "integer" => "an integer",
        "number" => "a number",
        "boolean" => "`true` or `false`",
        other => other,
    }
}

/// Names in backquotes, joined by commas.
pub fn quoted(names: &[&str]) -> String {
    names
        .iter()
        .map(|name| format!("`{name}`"))
        .collect::<Vec<_>>()
        .join(", ")
}

fn short(value: f64) -> String {
    if value.abs() >= 1e-4 && value.abs() < 1e15 || value == 0.0 {
        format!("{value}")
    } else {
        format!("{value:e}")
    }
}
