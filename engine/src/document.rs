//! From YAML text to a tree of nodes that know their line and column.
//!
//! Scalars follow the core schema of YAML 1.2: `1e-4` is a number, `yes` is a word. What is read is bounded: a file of a
//! few lines cannot become millions of nodes through aliases, and no nesting exhausts the stack.

use crate::diagnostic::{Diagnostic, Sources, Span};
use saphyr_parser::{Event, Parser, ScalarStyle, StrInput};
use serde_json::{Map, Number, Value};
use std::collections::BTreeMap;

/// Largest number of nodes in a document, aliases expanded.
pub const MOST_NODES: usize = 200_000;
/// Deepest nesting of a document.
pub const DEEPEST: usize = 64;

/// A part of a document.
#[derive(Debug, Clone, PartialEq)]
pub struct Node {
    /// Where it begins.
    pub span: Span,
    /// What it is.
    pub kind: Kind,
}

/// What a node is.
#[derive(Debug, Clone, PartialEq)]
pub enum Kind {
    /// A word, number, truth value or nothing.
    Scalar(Scalar),
    /// A list.
    Sequence(Vec<Node>),
    /// Keys with values, in the order of the text.
    Mapping(Vec<Entry>),
}

/// A scalar as it was written and what it means.
#[derive(Debug, Clone, PartialEq)]
pub struct Scalar {
    /// The text, without quotes.
    pub text: String,
    /// True where it was written without quotes.
    pub plain: bool,
    /// Null, a truth value, a finite number or a string.
    pub value: Value,
}

/// A key with its value.
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    /// The key.
    pub key: String,
    /// Where the key stands.
    pub key_span: Span,
    /// The value.
    pub value: Node,
}

impl Node {
    /// A mapping without keys.
    #[must_use]
    pub fn empty_mapping(span: Span) -> Self {
        Self { span, kind: Kind::Mapping(Vec::new()) }
    }

    /// A number, word or truth value that stands for something written at `span`.
    #[must_use]
    pub fn scalar(span: Span, value: Value) -> Self {
        let text = value.as_str().map_or_else(|| value.to_string(), String::from);
        Self { span, kind: Kind::Scalar(Scalar { text, plain: !value.is_string(), value }) }
    }

    /// The entries of a mapping; none for anything else.
    #[must_use]
    pub fn entries(&self) -> &[Entry] {
        match &self.kind {
            Kind::Mapping(entries) => entries,
            _ => &[],
        }
    }

    /// The items of a list; none for anything else.
    #[must_use]
    pub fn items(&self) -> &[Node] {
        match &self.kind {
            Kind::Sequence(items) => items,
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

    /// The text of a scalar that is a string.
    #[must_use]
    pub fn as_str(&self) -> Option<&str> {
        match &self.kind {
            Kind::Scalar(Scalar { value: Value::String(text), .. }) => Some(text),
            _ => None,
        }
    }

    /// Writes `value` at `keys` below this node; what is no mapping on the way becomes one.
    pub fn set(&mut self, keys: &[String], key_span: Span, value: Node) {
        let Some((first, rest)) = keys.split_first() else {
            *self = value;
            return;
        };
        if !matches!(self.kind, Kind::Mapping(_)) {
            self.kind = Kind::Mapping(Vec::new());
        }
        let Kind::Mapping(entries) = &mut self.kind else { return };
        let index = entries.iter().position(|entry| entry.key == *first).unwrap_or_else(|| {
            entries.push(Entry { key: first.clone(), key_span, value: Node::empty_mapping(key_span) });
            entries.len() - 1
        });
        if rest.is_empty() {
            entries[index].key_span = key_span;
        }
        entries[index].value.set(rest, key_span, value);
    }

    /// The same content as JSON, positions forgotten.
    #[must_use]
    pub fn to_value(&self) -> Value {
        match &self.kind {
            Kind::Scalar(scalar) => scalar.value.clone(),
            Kind::Sequence(items) => Value::Array(items.iter().map(Node::to_value).collect()),
            Kind::Mapping(entries) => {
                Value::Object(entries.iter().map(|entry| (entry.key.clone(), entry.value.to_value())).collect::<Map<_, _>>())
            }
        }
    }
}

/// Turns bytes into text.
///
/// # Errors
/// Where the bytes are no UTF-8: offset, line and column of the first that is wrong.
pub fn decode(name: &str, bytes: &[u8]) -> Result<String, Diagnostic> {
    std::str::from_utf8(bytes).map(|text| text.trim_start_matches('\u{feff}').to_string()).map_err(|error| {
        let offset = error.valid_up_to();
        let before = String::from_utf8_lossy(&bytes[..offset]).into_owned();
        let mut sources = Sources::default();
        let source = sources.add_file(name, &String::from_utf8_lossy(bytes));
        let column = before.rsplit('\n').next().unwrap_or_default().chars().count() + 1;
        let span = Span { source, line: before.matches('\n').count() + 1, column, length: 1 };
        let message = format!("not UTF-8: byte 0x{:02x} at offset {offset} begins no character", bytes[offset]);
        sources.error(span, "", message).help("save the file as UTF-8")
    })
}

/// Parses a whole file, the source with index `source`.
///
/// # Errors
/// Everything that is wrong with the text as YAML.
pub fn parse(sources: &Sources, source: usize, text: &str) -> Result<Node, Vec<Diagnostic>> {
    parse_from(sources, Span { source, line: 1, column: 1, length: 1 }, text)
}

/// Parses text that begins at `start` of its source, such as the value of an option.
///
/// # Errors
/// Everything that is wrong with the text as YAML.
pub fn parse_from(sources: &Sources, start: Span, text: &str) -> Result<Node, Vec<Diagnostic>> {
    let mut reader = Reader {
        parser: Parser::new_from_str(text),
        lines: text.lines().collect(),
        sources,
        start,
        anchors: BTreeMap::new(),
        nodes: 0,
        found: Vec::new(),
    };
    match reader.document() {
        Ok(node) if reader.found.is_empty() => Ok(node),
        Ok(_) => Err(reader.found),
        Err(fatal) => {
            reader.found.push(*fatal);
            Err(reader.found)
        }
    }
}

/// Reads events into nodes. Mistakes that leave the tree readable are collected, others end the reading.
struct Reader<'a> {
    parser: Parser<'a, StrInput<'a>>,
    lines: Vec<&'a str>,
    sources: &'a Sources,
    start: Span,
    anchors: BTreeMap<usize, (Node, usize)>,
    nodes: usize,
    found: Vec<Diagnostic>,
}

type Fatal = Box<Diagnostic>;

impl<'a> Reader<'a> {
    fn document(&mut self) -> Result<Node, Fatal> {
        let root = loop {
            let (event, span) = self.next()?;
            match event {
                Event::StreamStart | Event::DocumentStart(_) => {}
                Event::StreamEnd => return Err(Box::new(self.empty())),
                event => break self.node(event, span, 0)?,
            }
        };
        if matches!(&root.kind, Kind::Scalar(scalar) if scalar.value.is_null() && scalar.text.is_empty()) {
            return Err(Box::new(self.empty()));
        }
        loop {
            match self.next()? {
                (Event::StreamEnd, _) => return Ok(root),
                (Event::DocumentStart(_), span) => {
                    let error = self.sources.error(span, "", "a second document begins here, but a study is one document");
                    return Err(Box::new(error.help("remove the `---` line, or put the second document into a file of its own")));
                }
                _ => {}
            }
        }
    }

    fn empty(&self) -> Diagnostic {
        self.sources.error(self.start, "", "there is nothing in here").help("a study begins with `study: NAME`")
    }

    fn next(&mut self) -> Result<(Event<'a>, Span), Fatal> {
        match self.parser.next_event() {
            Some(Ok((event, span))) => {
                let length = if span.start.line() == span.end.line() { span.len() } else { 1 };
                let span = self.span(span.start.line(), span.start.col() + 1, length);
                Ok((event, span))
            }
            Some(Err(error)) => Err(Box::new(self.syntax(&error))),
            None => Ok((Event::StreamEnd, self.start)),
        }
    }

    fn span(&self, line: usize, column: usize, length: usize) -> Span {
        let shift = if line == 1 { self.start.column - 1 } else { 0 };
        Span { source: self.start.source, line: line + self.start.line - 1, column: column + shift, length }
    }

    fn syntax(&self, error: &saphyr_parser::ScanError) -> Diagnostic {
        let (line, column) = (error.marker().line().max(1), error.marker().col() + 1);
        if let Some(tab) = self.tab_indentation(line) {
            let at = self.lines[tab - 1].chars().position(|letter| letter == '\t').unwrap_or(0) + 1;
            let error = self.sources.error(self.span(tab, at, 1), "", "a tab indents this line; YAML allows spaces only");
            return error.help("replace each tab by spaces (two per level)");
        }
        // The reader stops behind the last line where something is still open: show the last line instead.
        let (line, column) = match self.lines.len() {
            0 => (1, 1),
            last if line > last => (last, self.lines[last - 1].chars().count() + 1),
            _ => (line, column),
        };
        let words = error.info().trim_end_matches('.');
        let diagnostic = self.sources.error(self.span(line, column, 1), "", format!("not valid YAML: {words}"));
        diagnostic.help("look at this line and the one above: brackets, quotes, indentation, a space after `:`")
    }

    /// The first line up to `last` (or the one after it) that is indented by a tab.
    fn tab_indentation(&self, last: usize) -> Option<usize> {
        let indented = |text: &&str| {
            let indent: &str = &text[..text.len() - text.trim_start().len()];
            indent.contains('\t') && !text.trim().is_empty() && !text.trim().starts_with('#')
        };
        self.lines.iter().take(last + 1).position(indented).map(|index| index + 1)
    }

    fn node(&mut self, event: Event<'a>, span: Span, depth: usize) -> Result<Node, Fatal> {
        self.count(1, span)?;
        if depth > DEEPEST {
            return Err(Box::new(self.sources.error(span, "", format!("nested more than {DEEPEST} levels deep"))));
        }
        let before = self.nodes;
        let (anchor, node) = match event {
            Event::Alias(id) => return self.alias(id, span),
            Event::Scalar(text, style, anchor, tag) => {
                let as_text = tag.as_ref().is_some_and(|tag| tag.is_yaml_core_schema() && tag.suffix == "str");
                if let Some(tag) = tag.filter(|_| !as_text) {
                    self.refuse_tag(&tag.to_string(), span);
                }
                let plain = style == ScalarStyle::Plain && !as_text;
                (anchor, Node { span, kind: Kind::Scalar(scalar(text.into_owned(), plain)) })
            }
            Event::SequenceStart(anchor, tag) => {
                tag.inspect(|tag| self.refuse_tag(&tag.to_string(), span));
                (anchor, Node { span, kind: Kind::Sequence(self.items(depth)?) })
            }
            Event::MappingStart(anchor, tag) => {
                tag.inspect(|tag| self.refuse_tag(&tag.to_string(), span));
                (anchor, Node { span, kind: Kind::Mapping(self.entries(depth)?) })
            }
            _ => return Err(Box::new(self.sources.error(span, "", "not valid YAML: a value is missing here"))),
        };
        if anchor > 0 {
            self.anchors.insert(anchor, (node.clone(), self.nodes - before + 1));
        }
        Ok(node)
    }

    fn refuse_tag(&mut self, tag: &str, span: Span) {
        let error = self.sources.error(span, "", format!("the YAML tag `{tag}` has no meaning in a study"));
        self.found.push(error.help("remove the tag"));
    }

    /// A copy of the anchored node; the copy keeps the positions of the original.
    fn alias(&mut self, id: usize, span: Span) -> Result<Node, Fatal> {
        match self.anchors.get(&id).cloned() {
            Some((node, size)) => {
                self.count(size, span)?;
                Ok(node)
            }
            None => Err(Box::new(self.sources.error(span, "", "this alias stands inside the value that it names"))),
        }
    }

    fn count(&mut self, more: usize, span: Span) -> Result<(), Fatal> {
        self.nodes += more;
        if self.nodes <= MOST_NODES {
            return Ok(());
        }
        let message = format!("with its aliases written out the document has more than {MOST_NODES} values");
        Err(Box::new(self.sources.error(span, "", message).help("a study is small; write the values where they are used")))
    }

    fn items(&mut self, depth: usize) -> Result<Vec<Node>, Fatal> {
        let mut items = Vec::new();
        loop {
            match self.next()? {
                (Event::SequenceEnd, _) => return Ok(items),
                (event, span) => items.push(self.node(event, span, depth + 1)?),
            }
        }
    }

    fn entries(&mut self, depth: usize) -> Result<Vec<Entry>, Fatal> {
        let mut entries: Vec<Entry> = Vec::new();
        let mut known: BTreeMap<String, Span> = BTreeMap::new();
        loop {
            let (event, key_span) = self.next()?;
            if event == Event::MappingEnd {
                return Ok(entries);
            }
            let key = self.key(event, key_span)?;
            let (event, span) = self.next()?;
            let value = self.node(event, span, depth + 1)?;
            if let Some(first) = known.get(&key) {
                let error = self.sources.error(key_span, "", format!("the key `{key}` is given twice"));
                self.found.push(error.note("it is given first here", self.sources.place(*first)).help("remove one of the two"));
                continue;
            }
            known.insert(key.clone(), key_span);
            entries.push(Entry { key, key_span, value });
        }
    }

    fn key(&mut self, event: Event<'a>, span: Span) -> Result<String, Fatal> {
        match event {
            Event::Scalar(text, ..) if text == "<<" => {
                let error = self.sources.error(span, "", "merge keys (`<<`) belong to YAML 1.1 and are not read");
                self.found.push(error.help("write the keys out"));
                Ok(text.into_owned())
            }
            Event::Scalar(text, ..) => Ok(text.into_owned()),
            _ => Err(Box::new(self.sources.error(span, "", "a key must be one word"))),
        }
    }
}

fn scalar(text: String, plain: bool) -> Scalar {
    let value = if plain { core_schema(&text) } else { Value::String(text.clone()) };
    Scalar { text, plain, value }
}

/// What a plain scalar means by the core schema of YAML 1.2.2, section 10.3.2. Numbers that are not finite stay text, since
/// no key of a study takes one.
fn core_schema(text: &str) -> Value {
    match text {
        "" | "~" | "null" | "Null" | "NULL" => Value::Null,
        "true" | "True" | "TRUE" => Value::Bool(true),
        "false" | "False" | "FALSE" => Value::Bool(false),
        _ => plain_number(text).map_or_else(|| Value::String(text.into()), Value::Number),
    }
}

/// The number that a text would be if it stood without quotes.
#[must_use]
pub fn plain_number(text: &str) -> Option<Number> {
    if let Some(digits) = text.strip_prefix("0x") {
        return u64::from_str_radix(digits, 16).ok().filter(|_| !digits.starts_with('+')).map(Number::from);
    }
    if let Some(digits) = text.strip_prefix("0o") {
        return u64::from_str_radix(digits, 8).ok().filter(|_| !digits.starts_with('+')).map(Number::from);
    }
    let unsigned = text.strip_prefix(['+', '-']).unwrap_or(text);
    let mantissa = unsigned.split(['e', 'E']).next().unwrap_or_default();
    let digits = |part: &str| part.bytes().all(|byte| byte.is_ascii_digit());
    let (whole, fraction) = mantissa.split_once('.').unwrap_or((mantissa, ""));
    if !digits(whole) || !digits(fraction) || whole.is_empty() && fraction.is_empty() {
        return None;
    }
    if digits(unsigned) {
        let signed = text.strip_prefix('+').unwrap_or(text);
        let whole = signed.parse::<u64>().map(Number::from).or_else(|_| signed.parse::<i64>().map(Number::from));
        return whole.ok().or_else(|| signed.parse::<f64>().ok().and_then(Number::from_f64));
    }
    text.parse::<f64>().ok().and_then(Number::from_f64)
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
        let text =
            "[1e-4, .5, 0x10, 0o17, -3, +4, 12., 1E3, 007, yes, ~, true, 3_000, '5', .inf, 1e400, 1-2, 18446744073709551615]";
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
        assert_eq!((entry.key_span.line, entry.key_span.column, entry.key_span.length), (2, 3, 5));
        assert_eq!((entry.value.span.line, entry.value.span.column, entry.value.span.length), (2, 10, 2));
        let word = &root.get("a").unwrap().get("c").unwrap().items()[1];
        assert_eq!((word.span.line, word.span.column, word.span.length), (3, 10, 4));
    }

    #[test]
    fn aliases_copy_values() {
        assert_eq!(read("a: &x {b: 1}\nc: *x").unwrap().to_value(), json!({"a": {"b": 1}, "c": {"b": 1}}));
    }

    #[test]
    fn deep_nesting_ends_in_a_message() {
        let error = read(&"[".repeat(100)).unwrap_err();
        assert!(error[0].message.contains("nested more than 64 levels"), "{}", error[0].message);
    }

    #[test]
    fn both_mistakes_of_a_file_are_reported() {
        assert_eq!(read("a: 1\na: 2\nb: 1\nb: 2").unwrap_err().len(), 2);
    }

    #[test]
    fn set_writes_below_what_is_there() {
        let mut root = read("a: {b: 1}").unwrap();
        let keys = ["a", "c", "d"].map(String::from);
        root.set(&keys, Span::default(), Node::scalar(Span::default(), json!(2)));
        assert_eq!(root.to_value(), json!({"a": {"b": 1, "c": {"d": 2}}}));
    }

    proptest::proptest! {
        #[test]
        fn no_text_makes_the_reader_panic(text in "[a-c:{}\\[\\],&*!|>'\"\\-\\n\\t ?#%@`0-9.e_]{0,60}") {
            let _ = read(&text);
        }
    }
}
