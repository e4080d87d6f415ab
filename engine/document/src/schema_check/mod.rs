//! Checks a document against a JSON Schema and reports mistakes in plain words.
//!
//! It reads the schemas that schemars writes for plain structs and enums: `type`, `properties`, `required`,
//! `additionalProperties`, `enum`, `const`, `oneOf` and `anyOf`, `$ref` into `$defs`, limits of numbers and lists. It
//! also knows `x-unit` (shown with ranges), `x-kind` (the kind of the keys or words at a place: `agent plugin`,
//! `preset`) and two patterns of names.

mod numbers;
mod view;

pub use view::View;

use crate::{
    Entry, MOST_MISTAKES, Node, NodeKind, Scalar,
    diagnostic::{Diagnostic, Sources, Span, nearest, suggest},
    plain_number,
};
use serde_json::Value;
use view::quoted;

/// Pattern of a study's name, which becomes a folder.
pub const SLUG: &str = "^[a-z0-9][a-z0-9._-]*$";
/// Pattern of the names of environments and agents, which begin dotted paths.
pub const NAME: &str = "^[A-Za-z_][A-Za-z0-9_-]*$";
/// Number of unknown keys of a mapping that are named; the message counts further ones.
const MOST_UNKNOWN: usize = 20;
/// Largest number of characters of a name, since names of files are composed of several names.
const LONGEST_NAME: usize = 100;

/// Keys of earlier studies and of other programs, with their names here.
const OTHER_NAMES: [(&str, &str); 6] = [
    ("departures", "deviations"),
    ("matters", "min_effect"),
    ("search", "tune"),
    ("by", "metric"),
    ("goal", "direction"),
    ("n_trials", "settings"),
];

/// Name of a key at this place; `None` if it has no other name.
fn renamed(key: &str, place: &View<'_>) -> Option<String> {
    let is_here = |name: &str| place.property_names().contains(&name);
    let (_, name) = OTHER_NAMES
        .iter()
        .find(|(old, name)| *old == key && is_here(name))?;
    Some(format!("it is called `{name}`"))
}

/// Location of a value: its key's span and name, and its dotted path.
#[derive(Debug, Clone)]
pub struct At {
    /// Span of the key, to which errors about missing or unfit content refer.
    pub key: Span,
    /// Name of the value in messages; empty for the whole study.
    pub name: String,
    /// Dotted path of the value.
    pub path: String,
}

impl At {
    fn below(&self, key: Span, name: &str) -> Self {
        let path = if self.path.is_empty() {
            name.into()
        } else {
            format!("{}.{name}", self.path)
        };
        Self {
            key,
            name: name.into(),
            path,
        }
    }

    fn in_words(&self) -> String {
        if self.name.is_empty() {
            "the study".into()
        } else {
            format!("`{}`", self.name)
        }
    }
}

/// Checks documents and collects mistakes.
pub struct Checker<'a> {
    sources: &'a Sources,
    /// Mistakes so far.
    pub found: Vec<Diagnostic>,
}

impl<'a> Checker<'a> {
    /// A checker for documents of these sources.
    #[must_use]
    pub fn new(sources: &'a Sources) -> Self {
        Self {
            sources,
            found: Vec::new(),
        }
    }

    /// Checks `node` against `schema`.
    pub fn check(&mut self, node: &Node, at: &At, schema: &View<'_>) {
        if self.found.len() >= MOST_MISTAKES {
            return;
        }
        let places = schema.alternatives();
        let fitting: Vec<&View<'_>> = places.iter().filter(|place| place.accepts(node)).collect();
        match fitting.as_slice() {
            [] => self.wrong_type(node, at, schema),
            [one] => self.one(node, at, one, schema),
            several => self.choose(node, at, several, schema),
        }
    }

    /// Checks a value that several alternatives allow by type: words and variants are combined, so that the message
    /// names all of them.
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
            let message = format!(
                "{} takes exactly one of {}, found {}",
                at.in_words(),
                quoted(&names),
                quoted(&found)
            );
            return self.found.push(self.sources.error(at.key, &at.path, message));
        };
        match places.iter().find(|place| place.variant() == Some(&entry.key)) {
            Some(place) => self.mapping(node, at, place),
            None => {
                let message = format!("unknown key `{}`", entry.key);
                let error = self.sources.error(
                    entry.key_span,
                    &at.below(entry.key_span, &entry.key).path,
                    message,
                );
                self.found.push(error.help(suggest(&entry.key, names)));
            }
        }
    }

    fn one(&mut self, node: &Node, at: &At, place: &View<'_>, outer: &View<'_>) {
        match &node.kind {
            NodeKind::Mapping(_) => self.mapping(node, at, place),
            NodeKind::Sequence(items) => self.list(items, at, place),
            NodeKind::Scalar(Scalar {
                value: Value::Number(_),
                text,
                ..
            }) => self.number(node, text, at, place, outer),
            NodeKind::Scalar(Scalar {
                value: Value::String(text),
                ..
            }) => {
                if !place.words().is_empty() {
                    self.word(node, at, &place.words(), outer);
                } else if let Some(problem) = place
                    .get("pattern")
                    .and_then(Value::as_str)
                    .and_then(|it| mismatch(it, text))
                {
                    let error = self.sources.error(
                        node.span,
                        &at.path,
                        format!("`{text}` cannot be a name: {problem}"),
                    );
                    self.found.push(error.about(outer.facts()));
                }
            }
            NodeKind::Scalar(_) => {}
        }
    }

    fn mapping(&mut self, node: &Node, at: &At, place: &View<'_>) {
        let kind = place.get("x-kind").and_then(Value::as_str).unwrap_or("key");
        let mut unknown: Vec<&Entry> = Vec::new();
        for entry in node.entries() {
            let below = at.below(entry.key_span, &entry.key);
            match place.property(&entry.key) {
                Some(schema) => self.check(&entry.value, &below, &schema),
                None if unknown.len() >= MOST_UNKNOWN => {
                    unknown.push(entry);
                    continue;
                }
                None => {
                    unknown.push(entry);
                    let error = self.sources.error(
                        entry.key_span,
                        &below.path,
                        format!("unknown {kind} `{}`", entry.key),
                    );
                    let help = renamed(&entry.key, place)
                        .unwrap_or_else(|| suggest(&entry.key, place.property_names()));
                    self.found.push(error.help(help));
                }
            }
            self.key_name(&entry.key, &below, place);
        }
        if let Some(next) = unknown.get(MOST_UNKNOWN) {
            let message = format!(
                "{} has {} more unknown {kind}s from here on",
                at.in_words(),
                unknown.len() - MOST_UNKNOWN
            );
            self.found
                .push(self.sources.error(next.key_span, &at.path, message));
        }
        unknown.truncate(MOST_UNKNOWN);
        self.size(node, at, place, kind);
        self.required(node, at, place, &unknown);
    }

    /// Reports missing required keys; one that was mistyped, or has another name here, is among the unknown ones.
    fn required(&mut self, node: &Node, at: &At, place: &View<'_>, unknown: &[&Entry]) {
        let required = place
            .get("required")
            .and_then(Value::as_array)
            .map_or_else(Vec::new, Clone::clone);
        for key in required
            .iter()
            .filter_map(Value::as_str)
            .filter(|key| node.get(key).is_none())
        {
            let missing = place.property(key);
            let error = self.sources.error(
                at.key,
                &at.path,
                format!("`{key}` is missing in {}", at.in_words()),
            );
            let error =
                error.about(missing.map_or_else(String::new, |schema| format!("{key}: {}", schema.facts())));
            let is_meant = |entry: &&Entry| {
                nearest(&entry.key, &[key]).is_some() || OTHER_NAMES.contains(&(&entry.key, key))
            };
            let mistyped = unknown.iter().any(is_meant);
            if !mistyped {
                self.found.push(error);
            }
        }
    }

    fn key_name(&mut self, key: &str, at: &At, place: &View<'_>) {
        let pattern = place
            .get("propertyNames")
            .and_then(|names| names.get("pattern"))
            .and_then(Value::as_str);
        if let Some(problem) = pattern.and_then(|pattern| mismatch(pattern, key)) {
            self.found.push(self.sources.error(
                at.key,
                &at.path,
                format!("`{key}` cannot be a name: {problem}"),
            ));
        }
    }

    fn size(&mut self, node: &Node, at: &At, place: &View<'_>, kind: &str) {
        let keys: Vec<&str> = node.entries().iter().map(|entry| entry.key.as_str()).collect();
        let limit = |keyword| place.get(keyword).and_then(Value::as_u64);
        let (least, most) = (
            limit("minProperties").unwrap_or(0),
            limit("maxProperties").unwrap_or(u64::MAX),
        );
        if (keys.len() as u64) < least {
            let known = place.property_names();
            self.found.push(if known.is_empty() {
                self.sources
                    .error(at.key, &at.path, format!("{} is empty", at.in_words()))
                    .help("write `NAME: { PLUGIN: { ... } }`")
            } else {
                let error =
                    self.sources
                        .error(at.key, &at.path, format!("{} names no {kind}", at.in_words()));
                error.help(format!("known: {}", quoted(&known)))
            });
        } else if keys.len() as u64 > most {
            let second = node.entries()[usize::try_from(most).unwrap_or(0)].key_span;
            let message = format!(
                "{} names {} {kind}s, {}; exactly one is wanted",
                at.in_words(),
                keys.len(),
                quoted(&keys)
            );
            let error = self.sources.error(second, &at.path, message);
            self.found.push(error.help("give each a name of its own"));
        }
    }

    fn list(&mut self, items: &[Node], at: &At, place: &View<'_>) {
        let limit = |keyword| place.get(keyword).and_then(Value::as_u64);
        let count = items.len() as u64;
        if let Some(least) = limit("minItems").filter(|least| count < *least) {
            let message = match (count, least) {
                (0, 1) => format!("{} is an empty list", at.in_words()),
                _ => format!("{} has {count} items, but needs at least {least}", at.in_words()),
            };
            self.found
                .push(self.sources.error(at.key, &at.path, message).about(place.facts()));
        }
        if let Some(most) = limit("maxItems").filter(|most| count > *most) {
            let message = format!("{} has {count} items, but takes at most {most}", at.in_words());
            self.found
                .push(self.sources.error(at.key, &at.path, message).about(place.facts()));
        }
        for (index, item) in items.iter().enumerate() {
            if let Some(schema) = place.item(index) {
                self.check(
                    item,
                    &At {
                        key: item.span,
                        name: format!("{}[{index}]", at.name),
                        path: format!("{}[{index}]", at.path),
                    },
                    &schema,
                );
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
                let error =
                    self.sources
                        .error(item.span, &at.path, format!("{} has {text} twice", at.in_words()));
                self.found
                    .push(error.note("it is given first here", self.sources.place(first)));
            }
        }
    }

    fn number(&mut self, node: &Node, text: &str, at: &At, place: &View<'_>, outer: &View<'_>) {
        let NodeKind::Scalar(Scalar {
            value: Value::Number(number),
            ..
        }) = &node.kind
        else {
            return;
        };
        let value = number.as_f64().unwrap_or(f64::NAN);
        let broken = [
            place.number("minimum").is_some_and(|limit| value < limit),
            place
                .number("exclusiveMinimum")
                .is_some_and(|limit| value <= limit),
            place.number("maximum").is_some_and(|limit| value > limit),
            place
                .number("exclusiveMaximum")
                .is_some_and(|limit| value >= limit),
            place
                .number("multipleOf")
                .is_some_and(|step| (value / step - (value / step).round()).abs() > 1e-9),
        ];
        if broken.contains(&true) {
            let unit = outer.get("x-unit").and_then(Value::as_str).unwrap_or_default();
            let range = format!("{} {unit}", place.range());
            let message = format!("{} is {text}, but must be {}", at.in_words(), range.trim_end());
            self.found.push(
                self.sources
                    .error(node.span, &at.path, message)
                    .about(outer.facts()),
            );
        }
    }

    fn word(&mut self, node: &Node, at: &At, words: &[&str], outer: &View<'_>) {
        let text = node.as_str().unwrap_or_default();
        if words.contains(&text) {
            return;
        }
        if let Some(variant) = outer
            .alternatives()
            .into_iter()
            .find(|place| place.variant() == Some(text))
        {
            let inner = variant
                .property(text)
                .map_or_else(Vec::new, |inner| inner.property_names());
            let keys = inner
                .iter()
                .map(|key| format!("{key}: ..."))
                .collect::<Vec<_>>()
                .join(", ");
            let error = self.sources.error(
                node.span,
                &at.path,
                format!("{} cannot be `{text}` alone", at.in_words()),
            );
            return self.found.push(
                error
                    .about(outer.sentence())
                    .help(format!("write `{text}: {{ {keys} }}`")),
            );
        }
        let message = match outer.get("x-kind").and_then(Value::as_str) {
            Some(kind) => format!("unknown {kind} `{text}`"),
            None => format!("{} cannot be `{text}`", at.in_words()),
        };
        let error = self
            .sources
            .error(node.span, &at.path, message)
            .about(outer.sentence());
        let known = suggest(text, words.iter().copied());
        let is_file = outer
            .alternatives()
            .iter()
            .any(|place| place.variant() == Some("file"));
        self.found.push(error.help(if is_file {
            format!("a file is written as `{}: {{ file: {text} }}`; {known}", at.name)
        } else {
            known
        }));
    }

    fn wrong_type(&mut self, node: &Node, at: &At, schema: &View<'_>) {
        let scalar = match &node.kind {
            NodeKind::Scalar(scalar) => Some(scalar),
            _ => None,
        };
        let nothing = scalar.is_some_and(|scalar| scalar.value.is_null());
        let span = if scalar.is_none() || nothing {
            at.key
        } else {
            node.span
        };
        let expected = schema.expected();
        let message = if nothing {
            format!("{} has no value; expected {expected}", at.in_words())
        } else {
            format!("{} must be {expected}, found {}", at.in_words(), in_words(node))
        };
        let error = self.sources.error(span, &at.path, message).about(schema.facts());
        let variants: Vec<&str> = schema.alternatives().iter().filter_map(View::variant).collect();
        let advice = match (scalar, variants.first()) {
            (Some(scalar), _) => {
                let option = error.place.is_option().then_some(at.path.as_str());
                advice(scalar, schema, option)
            }
            (None, Some(variant)) => Some(format!("for example `{{ {variant}: ... }}`")),
            (None, None) => None,
        };
        self.found.push(match advice {
            Some(advice) => error.help(advice),
            None => error,
        });
    }
}

/// The advice for a scalar of the wrong type; `option` is the path of a key that was given on the command line.
fn advice(scalar: &Scalar, schema: &View<'_>, option: Option<&str>) -> Option<String> {
    let places = schema.alternatives();
    let wants = |name: &str| places.iter().any(|place| place.types().contains(&name));
    let lower = scalar.text.to_lowercase();
    match &scalar.value {
        Value::Null if wants("object") => Some("write `{}` for a mapping without keys".into()),
        Value::String(_) if wants("boolean") && ["yes", "on", "y"].contains(&lower.as_str()) => {
            Some("write `true`".into())
        }
        Value::String(_) if wants("boolean") && ["no", "off", "n"].contains(&lower.as_str()) => {
            Some("write `false`".into())
        }
        Value::String(text) if wants("number") || wants("integer") => {
            if !scalar.plain && plain_number(text).is_some() {
                Some(format!("write {text} without quotes"))
            } else {
                numbers::advice(text, schema, option)
            }
        }
        Value::Number(_) if wants("integer") => numbers::whole(&scalar.text),
        Value::Number(_) | Value::Bool(_) if wants("string") => {
            Some(format!("write '{}' with quotes", scalar.text))
        }
        _ if schema
            .as_struct()
            .is_some_and(|fields| !fields.property_names().is_empty()) =>
        {
            let names = schema
                .as_struct()
                .map(|fields| fields.property_names())
                .unwrap_or_default();
            Some(format!(
                "for example `{{ {}: ... }}`; keys: {}",
                names[0],
                quoted(&names)
            ))
        }
        _ if wants("array") && !wants("object") => Some(format!("write [{}]", scalar.text)),
        _ => None,
    }
}

/// The misfit of a text with one of the patterns of names; `None` if it fits.
pub fn mismatch(pattern: &str, text: &str) -> Option<&'static str> {
    if text.len() > LONGEST_NAME && [SLUG, NAME].contains(&pattern) {
        return Some("use at most 100 characters: names are parts of names of files");
    }
    let legal = |extra: &str, letter: char| letter.is_ascii_alphanumeric() || extra.contains(letter);
    match pattern {
        SLUG => {
            let fits = text.starts_with(|first: char| first.is_ascii_alphanumeric())
                && text
                    .chars()
                    .all(|letter| legal("._-", letter) && !letter.is_ascii_uppercase());
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

fn in_words(node: &Node) -> String {
    match &node.kind {
        NodeKind::Mapping(_) => "a mapping".into(),
        NodeKind::Sequence(_) => "a list".into(),
        NodeKind::Scalar(scalar) => match &scalar.value {
            Value::Null => "nothing".into(),
            Value::String(text) => format!("the text `{text}`"),
            Value::Number(_) => format!("the number {}", scalar.text),
            _ => format!("`{}`", scalar.text),
        },
    }
}
