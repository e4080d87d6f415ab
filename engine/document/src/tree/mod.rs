//! Parses YAML text into a tree of nodes that know their line and column.
//!
//! Scalars follow the core schema of YAML 1.2: `1e-4` is a number, `yes` is a word. Documents are bounded: a file of a
//! few lines cannot become millions of nodes through aliases, and no nesting exhausts the stack.

mod reader;
mod scalar;

pub use scalar::plain_number;

use crate::diagnostic::{Diagnostic, Sources, Span};
use serde_json::{Map, Value};

/// Largest number of nodes in a document, aliases expanded.
pub const MOST_NODES: usize = 200_000;
/// Largest number of bytes of keys and scalars in a document, aliases expanded; a document without aliases may have
/// more.
pub const MOST_BYTES: usize = 32_000_000;
/// Number of mistakes in one document after which its reading ends.
pub const MOST_MISTAKES: usize = 1000;
/// Deepest nesting of a document.
pub const DEEPEST: usize = 64;

/// A part of a document.
#[derive(Debug, Clone, PartialEq)]
pub struct Node {
    /// Place in the text.
    pub span: Span,
    /// Kind of the node, with its content.
    pub kind: NodeKind,
}

/// The content of a node.
#[derive(Debug, Clone, PartialEq)]
pub enum NodeKind {
    /// A word, number, truth value or nothing.
    Scalar(Scalar),
    /// A list.
    Sequence(Vec<Node>),
    /// Keys with values, in the order of the text.
    Mapping(Vec<Entry>),
}

/// A scalar as it was written, with its value.
#[derive(Debug, Clone, PartialEq)]
pub struct Scalar {
    /// The text, without quotes.
    pub text: String,
    /// Whether it was written without quotes.
    pub plain: bool,
    /// Null, a truth value, a finite number or a string.
    pub value: Value,
}

/// A key with its value.
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    /// Text of the key.
    pub key: String,
    /// Place of the key in the text.
    pub key_span: Span,
    /// Node under the key.
    pub value: Node,
}

impl Node {
    /// A mapping without keys.
    #[must_use]
    pub fn empty_mapping(span: Span) -> Self {
        Self {
            span,
            kind: NodeKind::Mapping(Vec::new()),
        }
    }

    /// A number, word or truth value that represents something written at `span`.
    #[must_use]
    pub fn scalar(span: Span, value: Value) -> Self {
        let text = value.as_str().map_or_else(|| value.to_string(), String::from);
        Self {
            span,
            kind: NodeKind::Scalar(Scalar {
                text,
                plain: !value.is_string(),
                value,
            }),
        }
    }

    /// A value that represents something written at `span`.
    #[must_use]
    pub fn from_value(span: Span, value: &Value) -> Self {
        let below = |value: &Value| Self::from_value(span, value);
        let kind = match value {
            Value::Array(items) => NodeKind::Sequence(items.iter().map(below).collect()),
            Value::Object(map) => {
                let entry = |(key, value): (&String, &Value)| Entry {
                    key: key.clone(),
                    key_span: span,
                    value: below(value),
                };
                NodeKind::Mapping(map.iter().map(entry).collect())
            }
            scalar => return Self::scalar(span, scalar.clone()),
        };
        Self { span, kind }
    }

    /// The entries of a mapping; none for anything else.
    #[must_use]
    pub fn entries(&self) -> &[Entry] {
        match &self.kind {
            NodeKind::Mapping(entries) => entries,
            _ => &[],
        }
    }

    /// The items of a list; none for anything else.
    #[must_use]
    pub fn items(&self) -> &[Node] {
        match &self.kind {
            NodeKind::Sequence(items) => items,
            _ => &[],
        }
    }

    /// The entry with this key.
    #[must_use]
    pub fn entry(&self, key: &str) -> Option<&Entry> {
        self.entries().iter().find(|entry| entry.key == key)
    }

    /// The value under this key.
    #[must_use]
    pub fn get(&self, key: &str) -> Option<&Node> {
        self.entry(key).map(|entry| &entry.value)
    }

    /// The entry with this key, created if there is none; a node of another kind becomes a mapping.
    pub fn entry_or_insert(&mut self, key: &str, key_span: Span) -> Option<&mut Entry> {
        if !matches!(self.kind, NodeKind::Mapping(_)) {
            self.kind = NodeKind::Mapping(Vec::new());
        }
        let NodeKind::Mapping(entries) = &mut self.kind else {
            return None;
        };
        let index = entries
            .iter()
            .position(|entry| entry.key == key)
            .unwrap_or_else(|| {
                entries.push(Entry {
                    key: key.into(),
                    key_span,
                    value: Node::empty_mapping(key_span),
                });
                entries.len() - 1
            });
        entries.get_mut(index)
    }

    /// The text of a scalar that is a string.
    #[must_use]
    pub fn as_str(&self) -> Option<&str> {
        match &self.kind {
            NodeKind::Scalar(Scalar {
                value: Value::String(text),
                ..
            }) => Some(text),
            _ => None,
        }
    }

    /// The same content as JSON, without positions.
    #[must_use]
    pub fn to_value(&self) -> Value {
        match &self.kind {
            NodeKind::Scalar(scalar) => scalar.value.clone(),
            NodeKind::Sequence(items) => Value::Array(items.iter().map(Node::to_value).collect()),
            NodeKind::Mapping(entries) => Value::Object(
                entries
                    .iter()
                    .map(|entry| (entry.key.clone(), entry.value.to_value()))
                    .collect::<Map<_, _>>(),
            ),
        }
    }
}

/// Turns bytes into text.
///
/// # Errors
/// The bytes are no UTF-8; the error gives offset, line and column of the first wrong one.
pub fn decode(name: &str, bytes: &[u8]) -> Result<String, Vec<Diagnostic>> {
    std::str::from_utf8(bytes)
        .map(|text| text.trim_start_matches('\u{feff}').to_string())
        .map_err(|error| {
            let offset = error.valid_up_to();
            let before = String::from_utf8_lossy(&bytes[..offset]).into_owned();
            let mut sources = Sources::default();
            let source = sources.add_file(name, &String::from_utf8_lossy(bytes));
            let column = before.rsplit('\n').next().unwrap_or_default().chars().count() + 1;
            let span = Span {
                source,
                line: before.matches('\n').count() + 1,
                column,
                length: 1,
            };
            let message = format!(
                "not UTF-8: byte 0x{:02x} at offset {offset} begins no character",
                bytes[offset]
            );
            vec![sources.error(span, "", message).help("save the file as UTF-8")]
        })
}

/// Parses a whole file, the source with index `source`.
///
/// # Errors
/// All mistakes in the text as YAML.
pub fn parse(sources: &Sources, source: usize, text: &str) -> Result<Node, Vec<Diagnostic>> {
    parse_from(
        sources,
        Span {
            source,
            line: 1,
            column: 1,
            length: 1,
        },
        text,
    )
}

/// Parses text that begins at `start` of its source, such as the value of an option.
///
/// # Errors
/// All mistakes in the text as YAML.
pub fn parse_from(sources: &Sources, start: Span, text: &str) -> Result<Node, Vec<Diagnostic>> {
    reader::TreeReader::new(sources, start, text).read()
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn read(text: &str) -> Result<Node, Vec<Diagnostic>> {
        let mut sources = Sources::default();
        let source = sources.add_file("a.yaml", text);
        parse(&sources, source, text)
    }

    #[test]
    fn scalars_follow_the_core_schema() {
        let text = "[1e-4, .5, 0x10, 0o17, -3, +4, 12., 1E3, 007, yes, ~, true, 3_000, '5', .inf, 1e400, \
                    1-2, 18446744073709551615]";
        let expected = json!([
            1e-4,
            0.5,
            16,
            15,
            -3,
            4,
            12.0,
            1000.0,
            7,
            "yes",
            null,
            true,
            "3_000",
            "5",
            ".inf",
            "1e400",
            "1-2",
            18_446_744_073_709_551_615_u64
        ]);
        assert_eq!(read(text).unwrap().to_value(), expected);
    }

    #[test]
    fn keys_and_values_know_where_they_stand() {
        let root = read("a:\n  größe: 17 # x\n  c: [1, zwei]\n").unwrap();
        let entry = root.get("a").unwrap().entry("größe").unwrap();
        assert_eq!(
            (entry.key_span.line, entry.key_span.column, entry.key_span.length),
            (2, 3, 5)
        );
        assert_eq!(
            (
                entry.value.span.line,
                entry.value.span.column,
                entry.value.span.length
            ),
            (2, 10, 2)
        );
        let word = &root.get("a").unwrap().get("c").unwrap().items()[1];
        assert_eq!((word.span.line, word.span.column, word.span.length), (3, 10, 4));
    }

    #[test]
    fn aliases_copy_values() {
        assert_eq!(
            read("a: &x {b: 1}\nc: *x").unwrap().to_value(),
            json!({"a": {"b": 1}, "c": {"b": 1}})
        );
    }

    #[test]
    fn deep_nesting_ends_in_a_message() {
        let error = read(&"[".repeat(100)).unwrap_err();
        assert!(
            error[0].message.contains("nested more than 64 levels"),
            "{}",
            error[0].message
        );
    }

    #[test]
    fn both_mistakes_of_a_file_are_reported() {
        assert_eq!(read("a: 1\na: 2\nb: 1\nb: 2").unwrap_err().len(), 2);
    }

    proptest::proptest! {
        #[test]
        fn no_text_makes_the_reader_panic(text in "[a-c:{}\\[\\],&*!|>'\"\\-\\n\\t ?#%@`0-9.e_]{0,60}") {
            let _ = read(&text);
        }
    }
}
