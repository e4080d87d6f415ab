//! Holds a document against a JSON Schema and says what is wrong in a person's words.
//!
//! It reads what schemars writes for plain structs and enums: `type`, `properties`, `required`, `additionalProperties`,
//! `enum`, `const`, `oneOf` and `anyOf`, `$ref` into `$defs`, limits of numbers and lists. Besides these it knows `x-unit`
//! (shown with ranges), `x-kind` (what the keys or words of a place are: `agent plugin`, `preset`) and two patterns of names.

use crate::{
    diagnostic::{Diagnostic, Sources, Span, nearest, suggest},
    document::{Kind, Node, Scalar},
};
use serde_json::Value;

/// Pattern of a study's name, which becomes a folder.
pub const SLUG: &str = "^[a-z0-9][a-z0-9._-]*$";
/// Pattern of the names of environments and agents, which begin dotted paths.
pub const NAME: &str = "^[A-Za-z_][A-Za-z0-9_-]*$";

/// A schema with its references followed: the outermost layer that has a keyword wins.
#[derive(Debug, Clone)]
pub struct View<'a> {
    root: &'a Value,
    layers: Vec<&'a Value>,
}

impl<'a> View<'a> {
    /// The schema `schema`, whose references point into `root`.
    #[must_use]
    pub fn new(root: &'a Value, schema: &'a Value) -> Self {
        let mut layers = vec![schema];
        // A reference to itself ends here; no schema of ours nests references deeper.
        while let Some(next) = layers.last().and_then(|last| referenced(root, last)).filter(|_| layers.len() < 16) {
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
        self.get("properties").and_then(Value::as_object).map_or_else(Vec::new, |map| map.keys().map(String::as_str).collect())
    }

    /// The schema of the values under a key; `None` where the key is not allowed.
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
        listed.or_else(|| self.get("items")).map(|schema| View::new(self.root, schema))
    }

    /// The schemas one of which a value must fit; the schema itself where there is no choice.
    #[must_use]
    pub fn alternatives(&self) -> Vec<View<'a>> {
        let choice = self.get("oneOf").or_else(|| self.get("anyOf")).and_then(Value::as_array);
        match choice {
            None => vec![self.clone()],
            Some(list) => list.iter().flat_map(|schema| View::new(self.root, schema).alternatives()).collect(),
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
            let Some(next) = places.iter().find_map(|place| place.property(key).filter(|_| place.is_mapping())) else {
                return Err((index, places.iter().flat_map(View::property_names).collect()));
            };
            here = next;
        }
        Ok(here)
    }

    /// True where a whole number is wanted and nothing else.
    #[must_use]
    pub fn is_integer(&self) -> bool {
        let places = self.alternatives();
        let types: Vec<&str> = places.iter().flat_map(View::types).filter(|name| *name != "null").collect();
        !types.is_empty() && types.iter().all(|name| *name == "integer")
    }

    /// True for a mapping with fixed keys, whose defaults are filled in key by key.
    #[must_use]
    pub fn as_struct(&self) -> Option<View<'a>> {
        let mut places: Vec<View<'a>> = self.alternatives();
        places.retain(|place| place.types() != ["null"]);
        match places.as_slice() {
            [one] if one.get("properties").is_some() && one.variant().is_none() => Some(one.clone()),
            _ => None,
        }
    }

    fn is_mapping(&self) -> bool {
        self.types().contains(&"object") || self.types().is_empty()
    }

    /// Allowed types; empty where any is.
    fn types(&self) -> Vec<&'a str> {
        match self.get("type") {
            Some(Value::String(one)) => vec![one],
            Some(Value::Array(several)) => several.iter().filter_map(Value::as_str).collect(),
            _ if self.get("properties").is_some() => vec!["object"],
            _ => self.words().first().map_or_else(Vec::new, |_| vec!["string"]),
        }
    }

    /// The words of an `enum` or `const`.
    fn words(&self) -> Vec<&'a str> {
        let listed = self.get("enum").and_then(Value::as_array).map_or_else(Vec::new, |list| list.iter().collect());
        listed.into_iter().chain(self.get("const")).filter_map(Value::as_str).collect()
    }

    /// The name of an enum's variant that is written as a mapping with one key.
    fn variant(&self) -> Option<&'a str> {
        let required = self.get("required").and_then(Value::as_array)?;
        match (required.as_slice(), self.property_names().as_slice()) {
            ([Value::String(key)], [only]) if key == only => Some(only),
            _ => None,
        }
    }

    fn accepts(&self, node: &Node) -> bool {
        let types = self.types();
        types.is_empty() || types.iter().any(|name| fits(node, name))
    }

    fn number(&self, keyword: &str) -> Option<f64> {
        self.get(keyword).and_then(Value::as_f64)
    }

    /// First sentence of the description.
    #[must_use]
    pub fn sentence(&self) -> String {
        let text = self.get("description").and_then(Value::as_str).unwrap_or_default().replace('\n', " ");
        let end = text.find(". ").map_or(text.trim_end_matches('.').len(), |index| index);
        text[..end].to_string()
    }

    /// The range of a number in words, with its unit: `from 0 to 1 s`; empty where every number is allowed.
    #[must_use]
    pub fn range(&self) -> String {
        let limit = |words: [&str; 2], keywords: [&str; 2]| {
            let found = keywords.iter().zip(words).find_map(|(keyword, word)| Some((self.number(keyword)?, word)));
            found.map(|(value, word)| format!("{word} {}", short(value)))
        };
        let low = limit(["at least", "above"], ["minimum", "exclusiveMinimum"]);
        let high = limit(["at most", "below"], ["maximum", "exclusiveMaximum"]);
        let multiple = self.number("multipleOf").map(|value| format!("a multiple of {}", short(value)));
        [low, high, multiple].into_iter().flatten().collect::<Vec<_>>().join(" and ")
    }

    /// What a value must be, in words: `an integer at least 1`, `one of ...`.
    #[must_use]
    pub fn expected(&self) -> String {
        let places = self.alternatives();
        let mut parts: Vec<String> = Vec::new();
        let words: Vec<&str> = places.iter().flat_map(View::words).collect();
        if !words.is_empty() {
            parts.push(format!("{}{}", if words.len() > 1 { "one of " } else { "" }, quoted(&words)));
        }
        let variants: Vec<&str> = places.iter().filter_map(View::variant).collect();
        if !variants.is_empty() {
            parts.push(format!("a mapping with one of the keys {}", quoted(&variants)));
        }
        for place in places.iter().filter(|place| place.words().is_empty() && place.variant().is_none()) {
            parts.extend(place.types().into_iter().filter(|name| *name != "null").map(|name| type_in_words(name).to_string()));
        }
        parts.dedup();
        parts.join(" or ")
    }

    /// What a key means: first sentence, range, unit.
    #[must_use]
    pub fn facts(&self) -> String {
        let unit = self.get("x-unit").and_then(Value::as_str).filter(|unit| !unit.is_empty());
        let places = self.alternatives();
        let range = places.iter().map(View::range).find(|range| !range.is_empty());
        let number = self.is_integer().then(|| "integer".to_string());
        let kind = [number, range, unit.map(|unit| format!("in {unit}"))].into_iter().flatten().collect::<Vec<_>>().join(", ");
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

/// Where a value stands: the span of its key and its dotted path.
#[derive(Debug, Clone)]
pub struct At {
    /// Span of the key, which errors about missing or unfit content point at.
    pub key: Span,
    /// Dotted path of the value.
    pub path: String,
}

impl At {
    fn below(&self, key: Span, name: &str) -> Self {
        Self { key, path: if self.path.is_empty() { name.into() } else { format!("{}.{name}", self.path) } }
    }

    fn name(&self) -> &str {
        self.path.rsplit('.').next().filter(|name| !name.is_empty()).unwrap_or("the study")
    }
}

/// Checks documents and collects what is wrong.
pub struct Checker<'a> {
    sources: &'a Sources,
    /// What was found so far.
    pub found: Vec<Diagnostic>,
}

impl<'a> Checker<'a> {
    /// A checker for documents of these sources.
    #[must_use]
    pub fn new(sources: &'a Sources) -> Self {
        Self { sources, found: Vec::new() }
    }

    /// Checks `node` against `schema`.
    pub fn check(&mut self, node: &Node, at: &At, schema: &View<'_>) {
        let places = schema.alternatives();
        let fitting: Vec<&View<'_>> = places.iter().filter(|place| place.accepts(node)).collect();
        match fitting.as_slice() {
            [] => self.wrong_type(node, at, schema),
            [one] => self.one(node, at, one, schema),
            several => self.choose(node, at, several, schema),
        }
    }

    /// Several alternatives have the type of the value: words and variants are taken together, so that the message names all.
    fn choose(&mut self, node: &Node, at: &At, places: &[&View<'_>], outer: &View<'_>) {
        if node.as_str().is_some() && places.iter().all(|place| !place.words().is_empty()) {
            let words: Vec<&str> = places.iter().flat_map(|place| place.words()).collect();
            return self.word(node, at, &words, outer);
        }
        if !node.entries().is_empty() && places.iter().all(|place| place.variant().is_some()) {
            return self.variant(node, at, places);
        }
        let mut best: Option<Vec<Diagnostic>> = None;
        for place in places {
            let mut attempt = Checker::new(self.sources);
            attempt.one(node, at, place, outer);
            if best.as_ref().is_none_or(|best| attempt.found.len() < best.len()) {
                best = Some(attempt.found);
            }
        }
        self.found.extend(best.unwrap_or_default());
    }

    fn variant(&mut self, node: &Node, at: &At, places: &[&View<'_>]) {
        let names: Vec<&str> = places.iter().filter_map(|place| place.variant()).collect();
        let [entry] = node.entries() else {
            let found: Vec<&str> = node.entries().iter().map(|entry| entry.key.as_str()).collect();
            let message = format!("`{}` takes exactly one of {}, found {}", at.name(), quoted(&names), quoted(&found));
            return self.found.push(self.sources.error(at.key, &at.path, message));
        };
        match places.iter().find(|place| place.variant() == Some(&entry.key)) {
            Some(place) => self.mapping(node, at, place),
            None => {
                let message = format!("unknown key `{}`", entry.key);
                let error = self.sources.error(entry.key_span, &at.below(entry.key_span, &entry.key).path, message);
                self.found.push(error.help(suggest(&entry.key, names)));
            }
        }
    }

    fn one(&mut self, node: &Node, at: &At, place: &View<'_>, outer: &View<'_>) {
        match &node.kind {
            Kind::Mapping(_) => self.mapping(node, at, place),
            Kind::Sequence(items) => self.list(items, at, place),
            Kind::Scalar(Scalar { value: Value::Number(_), text, .. }) => self.number(node, text, at, place, outer),
            Kind::Scalar(Scalar { value: Value::String(text), .. }) => {
                if !place.words().is_empty() {
                    self.word(node, at, &place.words(), outer);
                } else if let Some(problem) = place.get("pattern").and_then(Value::as_str).and_then(|it| mismatch(it, text)) {
                    let error = self.sources.error(node.span, &at.path, format!("`{text}` cannot be the name here: {problem}"));
                    self.found.push(error.about(outer.facts()));
                }
            }
            Kind::Scalar(_) => {}
        }
    }

    fn mapping(&mut self, node: &Node, at: &At, place: &View<'_>) {
        let kind = place.get("x-kind").and_then(Value::as_str).unwrap_or("key");
        for entry in node.entries() {
            let below = at.below(entry.key_span, &entry.key);
            match place.property(&entry.key) {
                Some(schema) => self.check(&entry.value, &below, &schema),
                None => {
                    let error = self.sources.error(entry.key_span, &below.path, format!("unknown {kind} `{}`", entry.key));
                    self.found.push(error.help(suggest(&entry.key, place.property_names())));
                }
            }
            self.key_name(&entry.key, &below, place);
        }
        self.size(node, at, place, kind);
        let required = place.get("required").and_then(Value::as_array).map_or_else(Vec::new, Clone::clone);
        for key in required.iter().filter_map(Value::as_str).filter(|key| node.get(key).is_none()) {
            let missing = place.property(key);
            let written = node.entries().iter().map(|entry| entry.key.as_str()).collect::<Vec<_>>();
            let error = self.sources.error(at.key, &at.path, format!("`{key}` is missing in {}", place_in_words(at)));
            let error = error.about(missing.map_or_else(String::new, |schema| format!("{key}: {}", schema.facts())));
            // A required key that was mistyped is reported as unknown already.
            let mistyped = written.iter().any(|name| place.property(name).is_none() && nearest(name, &[key]).is_some());
            if !mistyped {
                self.found.push(error);
            }
        }
    }

    fn key_name(&mut self, key: &str, at: &At, place: &View<'_>) {
        let pattern = place.get("propertyNames").and_then(|names| names.get("pattern")).and_then(Value::as_str);
        if let Some(problem) = pattern.and_then(|pattern| mismatch(pattern, key)) {
            self.found.push(self.sources.error(at.key, &at.path, format!("`{key}` cannot be a name: {problem}")));
        }
    }

    fn size(&mut self, node: &Node, at: &At, place: &View<'_>, kind: &str) {
        let keys: Vec<&str> = node.entries().iter().map(|entry| entry.key.as_str()).collect();
        let limit = |keyword| place.get(keyword).and_then(Value::as_u64);
        let (least, most) = (limit("minProperties").unwrap_or(0), limit("maxProperties").unwrap_or(u64::MAX));
        if (keys.len() as u64) < least {
            let error = self.sources.error(at.key, &at.path, format!("`{}` names no {kind}", at.name()));
            self.found.push(error.help(format!("known: {}", quoted(&place.property_names()))));
        } else if keys.len() as u64 > most {
            let second = node.entries()[usize::try_from(most).unwrap_or(0)].key_span;
            let message = format!("`{}` names {} {kind}s, {}; exactly one is wanted", at.name(), keys.len(), quoted(&keys));
            let error = self.sources.error(second, &at.path, message);
            self.found.push(error.help("give each a name of its own"));
        }
    }

    fn list(&mut self, items: &[Node], at: &At, place: &View<'_>) {
        let limit = |keyword| place.get(keyword).and_then(Value::as_u64);
        let count = items.len() as u64;
        if let Some(least) = limit("minItems").filter(|least| count < *least) {
            let message = match (count, least) {
                (0, 1) => format!("`{}` is an empty list", at.name()),
                _ => format!("`{}` has {count} items, but needs at least {least}", at.name()),
            };
            self.found.push(self.sources.error(at.key, &at.path, message).about(place.facts()));
        }
        if let Some(most) = limit("maxItems").filter(|most| count > *most) {
            let message = format!("`{}` has {count} items, but takes at most {most}", at.name());
            self.found.push(self.sources.error(at.key, &at.path, message).about(place.facts()));
        }
        for (index, item) in items.iter().enumerate() {
            if let Some(schema) = place.item(index) {
                self.check(item, &At { key: item.span, path: format!("{}[{index}]", at.path) }, &schema);
            }
        }
        if place.get("uniqueItems") == Some(&Value::Bool(true)) {
            self.unique(items, at);
        }
    }

    fn unique(&mut self, items: &[Node], at: &At) {
        let mut seen: std::collections::BTreeMap<String, Span> = std::collections::BTreeMap::new();
        for item in items {
            let text = item.to_value().to_string();
            if let Some(first) = seen.insert(text.clone(), item.span) {
                let error = self.sources.error(item.span, &at.path, format!("`{}` has {text} twice", at.name()));
                self.found.push(error.note("it is given first here", self.sources.place(first)));
            }
        }
    }

    fn number(&mut self, node: &Node, text: &str, at: &At, place: &View<'_>, outer: &View<'_>) {
        let Kind::Scalar(Scalar { value: Value::Number(number), .. }) = &node.kind else { return };
        let value = number.as_f64().unwrap_or(f64::NAN);
        let broken = [
            place.number("minimum").is_some_and(|limit| value < limit),
            place.number("exclusiveMinimum").is_some_and(|limit| value <= limit),
            place.number("maximum").is_some_and(|limit| value > limit),
            place.number("exclusiveMaximum").is_some_and(|limit| value >= limit),
            place.number("multipleOf").is_some_and(|step| (value / step - (value / step).round()).abs() > 1e-9),
        ];
        if broken.contains(&true) {
            let unit = outer.get("x-unit").and_then(Value::as_str).unwrap_or_default();
            let range = format!("{} {unit}", place.range());
            let message = format!("`{}` is {text}, but must be {}", at.name(), range.trim_end());
            self.found.push(self.sources.error(node.span, &at.path, message).about(outer.facts()));
        }
    }

    fn word(&mut self, node: &Node, at: &At, words: &[&str], outer: &View<'_>) {
        let text = node.as_str().unwrap_or_default();
        if words.contains(&text) {
            return;
        }
        let kind = outer.get("x-kind").and_then(Value::as_str);
        let message = match kind {
            Some(kind) => format!("unknown {kind} `{text}`"),
            None => format!("`{}` cannot be `{text}`", at.name()),
        };
        let error = self.sources.error(node.span, &at.path, message).about(outer.sentence());
        let variants: Vec<View<'_>> = outer.alternatives();
        self.found.push(if variants.iter().any(|place| place.variant() == Some(text)) {
            error.help(format!("`{text}` needs settings: write `{text}: {{...}}`"))
        } else {
            error.help(suggest(text, words.iter().copied()))
        });
    }

    fn wrong_type(&mut self, node: &Node, at: &At, schema: &View<'_>) {
        let scalar = match &node.kind {
            Kind::Scalar(scalar) => Some(scalar),
            _ => None,
        };
        let nothing = scalar.is_some_and(|scalar| scalar.value.is_null());
        let span = if scalar.is_none() || nothing { at.key } else { node.span };
        let expected = schema.expected();
        let message = if nothing {
            format!("`{}` has no value; expected {expected}", at.name())
        } else {
            format!("`{}` must be {expected}, found {}", at.name(), in_words(node))
        };
        let error = self.sources.error(span, &at.path, message).about(schema.facts());
        let advice = match scalar {
            Some(scalar) => advice(scalar, schema),
            None => None,
        };
        self.found.push(match advice {
            Some(advice) => error.help(advice),
            None => error,
        });
    }
}

/// What to write instead of a scalar of the wrong type.
fn advice(scalar: &Scalar, schema: &View<'_>) -> Option<String> {
    let places = schema.alternatives();
    let wants = |name: &str| places.iter().any(|place| place.types().contains(&name));
    let lower = scalar.text.to_lowercase();
    let number = || crate::document::plain_number(&scalar.text.replace(['_', ',', ' '], ""));
    match &scalar.value {
        Value::Null if wants("object") => Some("write `{}` for a mapping without keys".into()),
        Value::String(_) if wants("boolean") && ["yes", "on", "y"].contains(&lower.as_str()) => Some("write `true`".into()),
        Value::String(_) if wants("boolean") && ["no", "off", "n"].contains(&lower.as_str()) => Some("write `false`".into()),
        Value::String(_) if (wants("number") || wants("integer")) && lower.trim_start_matches(['+', '-']).starts_with(".inf") => {
            Some("the number must be finite".into())
        }
        Value::String(text) if wants("number") || wants("integer") => match number() {
            Some(_) if !scalar.plain => Some(format!("write {text} without quotes")),
            Some(value) => Some(format!("write {value}")),
            None => None,
        },
        Value::Number(value) if wants("integer") => {
            let whole = value.as_f64().filter(|value| value.fract() == 0.0 && value.abs() < 9.0e15);
            whole.map(|value| format!("write {value:.0}"))
        }
        Value::Number(_) | Value::Bool(_) if wants("string") => Some(format!("write '{}' with quotes", scalar.text)),
        _ if wants("array") && !wants("object") => Some(format!("write [{}]", scalar.text)),
        _ => None,
    }
}

fn place_in_words(at: &At) -> String {
    if at.path.is_empty() { "the study".into() } else { format!("`{}`", at.name()) }
}

fn mismatch(pattern: &str, text: &str) -> Option<&'static str> {
    let legal = |extra: &str, letter: char| letter.is_ascii_alphanumeric() || extra.contains(letter);
    match pattern {
        SLUG => {
            let fits = text.starts_with(|first: char| first.is_ascii_alphanumeric())
                && text.chars().all(|letter| legal("._-", letter) && !letter.is_ascii_uppercase());
            (!fits).then_some("use small letters, digits, `-`, `_` and `.`, and begin with a letter or digit")
        }
        NAME => {
            let fits = text.starts_with(|first: char| first.is_ascii_alphabetic() || first == '_')
                && text.chars().all(|letter| legal("_-", letter));
            (!fits).then_some("use letters, digits, `_` and `-`, and begin with a letter")
        }
        _ => None,
    }
}

fn fits(node: &Node, name: &str) -> bool {
    match (&node.kind, name) {
        (Kind::Mapping(_), "object") | (Kind::Sequence(_), "array") => true,
        (Kind::Scalar(scalar), _) => match &scalar.value {
            Value::Null => name == "null",
            Value::Bool(_) => name == "boolean",
            Value::String(_) => name == "string",
            Value::Number(number) => name == "number" || name == "integer" && !number.is_f64(),
            _ => false,
        },
        _ => false,
    }
}

fn in_words(node: &Node) -> String {
    match &node.kind {
        Kind::Mapping(_) => "a mapping".into(),
        Kind::Sequence(_) => "a list".into(),
        Kind::Scalar(scalar) => match &scalar.value {
            Value::Null => "nothing".into(),
            Value::String(text) => format!("the text `{text}`"),
            Value::Number(_) => format!("the number {}", scalar.text),
            _ => format!("`{}`", scalar.text),
        },
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

fn quoted(names: &[&str]) -> String {
    names.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ")
}

fn short(value: f64) -> String {
    if value.abs() >= 1e-4 && value.abs() < 1e15 || value == 0.0 { format!("{value}") } else { format!("{value:e}") }
}
