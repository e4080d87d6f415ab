//! Placeholders for values of a study: `{protocol.steps}` in a title, caption, note, deviation, answer or the summary
//! becomes the number that the trials have, also under a profile.
//!
//! | placeholder | value |
//! |---|---|
//! | `{protocol.steps}` | a key of the protocol |
//! | `{learner.discount}`, `{cells.load}` | a key of an agent or an environment |
//! | `{prepare.teacher.protocol.steps}` | a key of an entry of `prepare` |
//! | `{paper_budget.steps}` | a key of another section |
//!
//! Values of overrides belong to some combinations and are not used. A key that a sweep, a search or an override of all
//! combinations sets has no one value to print, so that its placeholder is refused.

use super::{checked_sections::Sections, path::KeyPath, resolved::Section, written::Target};
use document::{
    Node, NodeKind,
    diagnostic::{Diagnostic, Sources},
};
use serde_json::Value;

/// The sections whose texts are filled.
const TEXTS: [&str; 7] = [
    "title",
    "summary",
    "answers",
    "deviations",
    "tables",
    "figures",
    "claims",
];

/// The document with the values of the study in its texts.
///
/// # Errors
/// Placeholders that name no value, or one that varies between trials.
pub(super) fn fill(
    root: &Node,
    resolved: &[(String, Section)],
    sections: &Sections<'_>,
) -> Result<Node, Vec<Diagnostic>> {
    let mut filler = Filler {
        root,
        resolved,
        varied: varied(sections),
        sources: sections.sources,
        found: Vec::new(),
    };
    let mut filled = root.clone();
    if let NodeKind::Mapping(entries) = &mut filled.kind {
        let texts = entries
            .iter_mut()
            .filter(|entry| TEXTS.contains(&entry.key.as_str()));
        texts.for_each(|entry| filler.node(&mut entry.value, &entry.key));
    }
    if filler.found.is_empty() {
        Ok(filled)
    } else {
        Err(filler.found)
    }
}

/// Keys without one value for all trials, as the words of their dotted paths.
fn varied(sections: &Sections<'_>) -> Vec<Vec<String>> {
    let swept = sections
        .dimensions
        .iter()
        .flat_map(|it| &it.keys)
        .map(|key| &key.path);
    let searched = sections.searches.iter().flat_map(|it| &it.paths);
    let of_all = sections.overrides.iter().filter(|it| it.selection.is_of_all());
    let overridden = of_all.flat_map(|it| &it.set).map(|(_, path, _)| path);
    let words = |path: &KeyPath<'_>| {
        let name = match path.target {
            Target::Protocol => "protocol",
            target => &sections.written.part(target)?.name,
        };
        Some(
            std::iter::once(name.to_owned())
                .chain(path.keys.iter().cloned())
                .collect(),
        )
    };
    swept
        .chain(searched)
        .chain(overridden)
        .filter_map(words)
        .collect()
}

struct Filler<'a> {
    root: &'a Node,
    resolved: &'a [(String, Section)],
    varied: Vec<Vec<String>>,
    sources: &'a Sources,
    found: Vec<Diagnostic>,
}

impl Filler<'_> {
    fn node(&mut self, node: &mut Node, at: &str) {
        let span = node.span;
        match &mut node.kind {
            NodeKind::Scalar(scalar) => {
                let Some(text) = scalar.value.as_str().filter(|text| text.contains('{')) else {
                    return;
                };
                match self.text(text) {
                    Ok(text) => {
                        scalar.value = Value::String(text.clone());
                        scalar.text = text;
                    }
                    Err(placeholder) => {
                        let (problem, help) = match self.varies(&placeholder) {
                            true => (
                                "varies between trials",
                                "write the values, or leave them to the table",
                            ),
                            false => (
                                "names no value of this study",
                                "write the dotted path of a value, as in `{protocol.steps}` or `{learner.discount}`",
                            ),
                        };
                        let message = format!("`{{{placeholder}}}` {problem}");
                        self.found.push(self.sources.error(span, at, message).help(help));
                    }
                }
            }
            NodeKind::Sequence(items) => items.iter_mut().for_each(|item| self.node(item, at)),
            NodeKind::Mapping(entries) => entries
                .iter_mut()
                .for_each(|entry| self.node(&mut entry.value, at)),
        }
    }

    /// A text with its values; the error is the first placeholder without a value.
    fn text(&self, text: &str) -> Result<String, String> {
        let mut filled = String::with_capacity(text.len());
        let mut rest = text;
        while let Some(start) = rest.find('{') {
            let (before, from) = rest.split_at(start);
            filled.push_str(before);
            let inner = from[1..].find('}').map(|end| &from[1..=end]);
            match inner.filter(|inner| is_path(inner)) {
                Some(path) => {
                    let value = self.value(path).ok_or_else(|| path.to_owned())?;
                    filled.push_str(&value);
                    rest = &from[path.len() + 2..];
                }
                None => {
                    filled.push('{');
                    rest = &from[1..];
                }
            }
        }
        Ok(filled + rest)
    }

    fn varies(&self, path: &str) -> bool {
        let overlaps = |varied: &Vec<String>| {
            varied
                .iter()
                .zip(path.split('.'))
                .all(|(one, other)| one == other)
        };
        self.varied.iter().any(overlaps)
    }

    /// The value at a dotted path, as text; `None` if there is none or it varies.
    fn value(&self, path: &str) -> Option<String> {
        if self.varies(path) {
            return None;
        }
        let (first, rest) = path.split_once('.')?;
        let section = |name: &str| self.resolved.iter().find(|(known, _)| known == name);
        let of_part = |value: &Value, rest: &str| in_words(descend(inside(value)?, rest)?);
        let named = |name: &str, key: &str| match section(name) {
            Some((_, Section::Named(entries))) => {
                let entry = entries.iter().find(|(known, _)| known == key);
                entry.map(|(_, value)| value)
            }
            _ => None,
        };
        match (first, section(first)) {
            ("protocol", Some((_, Section::Plain(value)))) => of_part(value, rest),
            ("prepare", _) => {
                let (name, rest) = rest.split_once('.')?;
                let (kind, rest) = rest.split_once('.')?;
                of_part(named("prepare", name)?.get(kind)?, rest)
            }
            (_, Some((_, Section::Plain(value)))) => in_words(descend(value, rest)?),
            _ => match named("agents", first).or_else(|| named("environments", first)) {
                Some(value) => of_part(value, rest),
                None => in_words(descend(&self.root.get(first)?.to_value(), rest)?),
            },
        }
    }
}

/// Whether the text consists of names with dots between them.
fn is_path(text: &str) -> bool {
    let is_name = |name: &str| {
        let mut letters = name.bytes();
        letters.next().is_some_and(|first| first.is_ascii_alphabetic())
            && letters.all(|letter| letter.is_ascii_alphanumeric() || letter == b'_')
    };
    text.contains('.') && text.split('.').all(is_name)
}

/// The config of a plugin, under the plugin's name.
fn inside(value: &Value) -> Option<&Value> {
    value.as_object()?.values().next()
}

fn descend<'v>(value: &'v Value, path: &str) -> Option<&'v Value> {
    path.split('.').try_fold(value, |value, key| value.get(key))
}

/// A number, with its thousands separated from 10 000 on, or a word.
fn in_words(value: &Value) -> Option<String> {
    match value {
        Value::Number(number) => Some(number.as_u64().map_or_else(|| number.to_string(), apart)),
        Value::String(text) => Some(text.clone()),
        Value::Bool(is) => Some(is.to_string()),
        Value::Null | Value::Array(_) | Value::Object(_) => None,
    }
}

fn apart(number: u64) -> String {
    let digits = number.to_string();
    if digits.len() < 5 {
        return digits;
    }
    let first = digits.len() % 3;
    let groups = digits.as_bytes()[first..].chunks(3).map(String::from_utf8_lossy);
    let groups = std::iter::once(digits[..first].into()).chain(groups);
    let groups: Vec<_> = groups.filter(|group| !group.is_empty()).collect();
    groups.join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn numbers_are_written_as_in_a_text() {
        let words = |value: Value| in_words(&value).unwrap();
        assert_eq!(words(json!(640)), "640");
        assert_eq!(words(json!(5000)), "5000");
        assert_eq!(words(json!(20_000)), "20 000");
        assert_eq!(words(json!(300_000)), "300 000");
        assert_eq!(words(json!(5_000_000)), "5 000 000");
        assert_eq!(words(json!(0.99)), "0.99");
        assert_eq!(words(json!("surrogate")), "surrogate");
        assert_eq!(in_words(&json!([1])), None);
    }

    #[test]
    fn only_dotted_names_are_paths() {
        assert!(["protocol.steps", "a.b_1.c"].iter().all(|path| is_path(path)));
        let others = [
            "",
            "steps",
            "claim 1",
            "table-3.3: rule",
            "a..b",
            "1.5",
            "a.{b",
            "{",
        ];
        assert!(others.iter().all(|path| !is_path(path)));
    }
}
