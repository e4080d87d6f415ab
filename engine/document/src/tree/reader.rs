//! Reads the parser's events into nodes, within bounds.

use super::{DEEPEST, Entry, MOST_BYTES, MOST_MISTAKES, MOST_NODES, Node, NodeKind, scalar::scalar};
use crate::{
    diagnostic::{Diagnostic, Sources, Span, shortened},
    lookalikes::{self, Lookalike},
    plain_text::is_unprintable,
};
use saphyr_parser::{Event, Parser, ScalarStyle, StrInput, Tag};
use std::{borrow::Cow, collections::BTreeMap};

/// Reads events into nodes. Mistakes that leave the tree readable are collected; others end the reading.
pub struct TreeReader<'a> {
    parser: Parser<'a, StrInput<'a>>,
    text: &'a str,
    sources: &'a Sources,
    start: Span,
    anchors: BTreeMap<usize, (Node, Size)>,
    size: Size,
    found: Vec<Diagnostic>,
}

/// Size of the part of a document that was read, aliases expanded.
#[derive(Clone, Copy, Default)]
struct Size {
    nodes: usize,
    /// Number of bytes of keys and scalars.
    bytes: usize,
}

impl Size {
    fn since(self, before: Self) -> Self {
        Self {
            nodes: self.nodes - before.nodes,
            bytes: self.bytes - before.bytes,
        }
    }
}

type Fatal = Box<Diagnostic>;

impl<'a> TreeReader<'a> {
    /// A reader of `text`, which begins at `start`.
    pub fn new(sources: &'a Sources, start: Span, text: &'a str) -> Self {
        Self {
            parser: Parser::new_from_str(text),
            text,
            sources,
            start,
            anchors: BTreeMap::new(),
            size: Size::default(),
            found: Vec::new(),
        }
    }

    /// The document, or all mistakes in it.
    pub fn read(mut self) -> Result<Node, Vec<Diagnostic>> {
        match self.document() {
            Ok(node) if self.found.is_empty() => return Ok(node),
            Ok(_) => {}
            Err(fatal) => self.found.push(*fatal),
        }
        Err(self.found)
    }

    fn document(&mut self) -> Result<Node, Fatal> {
        let root = loop {
            let (event, span) = self.next()?;
            match event {
                Event::StreamStart | Event::DocumentStart(_) => {}
                Event::StreamEnd => return Err(Box::new(self.empty())),
                event => break self.node(event, span, 0)?,
            }
        };
        if matches!(&root.kind, NodeKind::Scalar(scalar) if scalar.value.is_null() && scalar.text.is_empty())
        {
            return Err(Box::new(self.empty()));
        }
        loop {
            match self.next()? {
                (Event::StreamEnd, _) => return Ok(root),
                (Event::DocumentStart(_), span) => {
                    let error = self.sources.error(
                        span,
                        "",
                        "a second document begins here, but a study is one document",
                    );
                    return Err(Box::new(error.help(
                        "remove the `---` line, or put the second document into a file of its own",
                    )));
                }
                _ => {}
            }
        }
    }

    fn empty(&self) -> Diagnostic {
        self.sources
            .error(self.start, "", "the file is empty")
            .help("a study begins with `study: NAME`")
    }

    fn next(&mut self) -> Result<(Event<'a>, Span), Fatal> {
        match self.parser.next_event() {
            Some(Ok((event, span))) => {
                let length = if span.start.line() == span.end.line() {
                    span.len()
                } else {
                    1
                };
                let span = self.span(span.start.line(), span.start.col() + 1, length);
                Ok((event, span))
            }
            Some(Err(error)) => Err(Box::new(self.syntax(&error))),
            None => Ok((Event::StreamEnd, self.start)),
        }
    }

    fn span(&self, line: usize, column: usize, length: usize) -> Span {
        let shift = if line == 1 { self.start.column - 1 } else { 0 };
        Span {
            source: self.start.source,
            line: line + self.start.line - 1,
            column: column + shift,
            length,
        }
    }

    fn syntax(&self, error: &saphyr_parser::ScanError) -> Diagnostic {
        let (line, column) = (error.marker().line().max(1), error.marker().col() + 1);
        let lines: Vec<&str> = self.text.lines().collect();
        if let Some(invisible) = self.invisible_structure(&lines, line) {
            return invisible;
        }
        if let Some(tab) = tab_indentation(&lines, line) {
            let at = lines[tab - 1]
                .chars()
                .position(|letter| letter == '\t')
                .unwrap_or(0)
                + 1;
            let error = self.sources.error(
                self.span(tab, at, 1),
                "",
                "a tab indents this line; YAML allows spaces only",
            );
            return error.help("replace each tab by spaces (two per level)");
        }
        // The reader stops after the last line if something is still open: show the last line instead.
        let (line, column) = match lines.len() {
            0 => (1, 1),
            last if line > last => (last, lines[last - 1].chars().count() + 1),
            _ => (line, column),
        };
        let words = error.info().trim_end_matches('.');
        let diagnostic =
            self.sources
                .error(self.span(line, column, 1), "", format!("not valid YAML: {words}"));
        let Some((line, column, bracket)) = open_bracket(&lines) else {
            return diagnostic.help(self.advice());
        };
        let place = self.sources.place(self.span(line, column, 1));
        diagnostic
            .help(self.advice())
            .note(format!("this `{bracket}` is never closed"), place)
    }

    fn advice(&self) -> &'static str {
        if self.start.column > 1 {
            "write a list as [1, 2] and a mapping as {a: 1}, in quotes so that the shell leaves them alone"
        } else {
            "look at this line and the one above: brackets, quotes, indentation, a space after `:`"
        }
    }

    fn node(&mut self, event: Event<'a>, span: Span, depth: usize) -> Result<Node, Fatal> {
        let bytes = match &event {
            Event::Scalar(text, ..) => text.len(),
            _ => 0,
        };
        self.count(Size { nodes: 1, bytes }, false, span)?;
        let refuse = |reader: &Self, message: String| Err(Box::new(reader.sources.error(span, "", message)));
        if depth > DEEPEST {
            return refuse(self, format!("nested more than {DEEPEST} levels deep"));
        }
        let mut before = self.size;
        (before.nodes, before.bytes) = (before.nodes - 1, before.bytes - bytes);
        let (anchor, kind) = match event {
            Event::Alias(id) => return self.alias(id, span),
            Event::Scalar(text, style, anchor, tag) => (anchor, self.scalar(text, style, tag, span)),
            Event::SequenceStart(anchor, tag) => {
                tag.inspect(|tag| self.refuse_tag(&tag.to_string(), span));
                (anchor, NodeKind::Sequence(self.items(depth)?))
            }
            Event::MappingStart(anchor, tag) => {
                tag.inspect(|tag| self.refuse_tag(&tag.to_string(), span));
                (anchor, NodeKind::Mapping(self.entries(depth)?))
            }
            _ => return refuse(self, "not valid YAML: a value is missing here".into()),
        };
        let node = Node { span, kind };
        if anchor > 0 {
            self.anchors
                .insert(anchor, (node.clone(), self.size.since(before)));
        }
        Ok(node)
    }

    /// A scalar; the tag `!!str` makes it a text, and every other tag is refused.
    fn scalar(
        &mut self,
        text: Cow<'a, str>,
        style: ScalarStyle,
        tag: Option<Cow<'a, Tag>>,
        span: Span,
    ) -> NodeKind {
        let is_text = |tag: &Cow<'_, Tag>| tag.is_yaml_core_schema() && tag.suffix == "str";
        self.refuse_control(&text, span);
        if style == ScalarStyle::Plain {
            self.refuse_invisible(&text, span, false);
        }
        let as_text = tag.as_ref().is_some_and(is_text);
        if let Some(tag) = tag.filter(|_| !as_text) {
            self.refuse_tag(&tag.to_string(), span);
        }
        let plain = style == ScalarStyle::Plain && !as_text;
        NodeKind::Scalar(scalar(text.into_owned(), plain))
    }

    /// Refuses characters that are not text, since terminals, pages and figures, which show a study, cannot show them.
    fn refuse_control(&mut self, text: &str, span: Span) {
        if let Some(letter) = text.chars().find(|letter| is_unprintable(*letter)) {
            let message = format!(
                "a control character (U+{:04X}) has no meaning in a study",
                u32::from(letter)
            );
            let error = self.sources.error(span, "", message);
            self.found
                .push(error.help("remove it, or the escape sequence in quotes that stands for it"));
        }
    }

    /// Refuses a letter that looks like a space, or is invisible, in a text without quotes: at its ends, and within a
    /// key unless a script needs it.
    fn refuse_invisible(&mut self, text: &str, span: Span, is_key: bool) {
        let last = text.chars().count().saturating_sub(1);
        let is_meant = |found: &Lookalike| {
            let is_joiner = matches!(found.letter, '\u{200c}' | '\u{200d}');
            (1..last).contains(&found.index) && (!is_key || is_joiner || found.instead == Some(' '))
        };
        let letters = text.chars().enumerate();
        let mut found = letters.filter_map(|(index, letter)| lookalikes::of(letter, index));
        if let Some(found) = found.find(|it| it.is_invisible() && !is_meant(it)) {
            let at = Span {
                column: span.column + found.index,
                length: 1,
                ..span
            };
            self.found.push(self.taken_for_a_letter(&found, at));
        }
    }

    /// The first letter up to the line after `last` that looks like a space, or is invisible, where YAML needs a space.
    fn invisible_structure(&self, lines: &[&str], last: usize) -> Option<Diagnostic> {
        let (line, found) = lines
            .iter()
            .take(last + 1)
            .enumerate()
            .find_map(|(line, text)| Some((line + 1, structural(text)?)))?;
        Some(self.taken_for_a_letter(&found, self.span(line, found.index + 1, 1)))
    }

    fn taken_for_a_letter(&self, found: &Lookalike, at: Span) -> Diagnostic {
        let message = format!("{} stands here; YAML takes it for a letter", found.named());
        let error = Diagnostic {
            // The message says the same as a note on the letter would.
            notes: Vec::new(),
            ..self.sources.error(at, "", message)
        };
        error.help(found.advice())
    }

    fn refuse_tag(&mut self, tag: &str, span: Span) {
        let error = self.sources.error(
            span,
            "",
            format!("the YAML tag `{tag}` has no meaning in a study"),
        );
        self.found.push(error.help("remove the tag"));
    }

    /// A copy of the anchored node; the copy keeps the positions of the original.
    fn alias(&mut self, id: usize, span: Span) -> Result<Node, Fatal> {
        // Counted before it is copied.
        let size = self.anchors.get(&id).map(|(_, size)| *size);
        self.count(size.unwrap_or_default(), true, span)?;
        match self.anchors.get(&id) {
            Some((node, _)) => Ok(node.clone()),
            None => Err(Box::new(self.sources.error(
                span,
                "",
                "this alias stands inside the value that it names",
            ))),
        }
    }

    /// Counts the nodes and bytes that were read or copied.
    fn count(&mut self, more: Size, is_copy: bool, span: Span) -> Result<(), Fatal> {
        self.size.nodes += more.nodes;
        self.size.bytes += more.bytes;
        if self.found.len() >= MOST_MISTAKES {
            let message = format!("after {MOST_MISTAKES} mistakes the rest is not read");
            return Err(Box::new(self.sources.error(span, "", message)));
        }
        let much = if self.size.nodes > MOST_NODES {
            format!("{MOST_NODES} values")
        } else if is_copy && self.size.bytes > MOST_BYTES {
            format!("{} MB", MOST_BYTES / 1_000_000)
        } else {
            return Ok(());
        };
        let message = format!("with its aliases written out the document has more than {much}");
        Err(Box::new(
            self.sources
                .error(span, "", message)
                .help("a study is small; write the values where they are used"),
        ))
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
            self.size.bytes += key.len();
            let (event, span) = self.next()?;
            let value = self.node(event, span, depth + 1)?;
            if let Some(first) = known.get(&key) {
                let error = self.sources.error(
                    key_span,
                    "",
                    format!("the key `{}` is given twice", shortened(&key, 200)),
                );
                self.found.push(
                    error
                        .note("it is given first here", self.sources.place(*first))
                        .help("remove one of the two"),
                );
                continue;
            }
            known.insert(key.clone(), key_span);
            entries.push(Entry { key, key_span, value });
        }
    }

    fn key(&mut self, event: Event<'a>, span: Span) -> Result<String, Fatal> {
        match event {
            Event::Scalar(text, style, ..) => {
                self.refuse_control(&text, span);
                if style == ScalarStyle::Plain {
                    self.refuse_invisible(&text, span, true);
                }
                Ok(text.into_owned())
            }
            _ => Err(Box::new(self.sources.error(span, "", "a key must be one word"))),
        }
    }
}

/// A letter of a line that looks like a sign of YAML: an invisible one at the beginning or beside a sign, or one that
/// looks like a colon or a bracket. Comments and quotes are skipped.
fn structural(line: &str) -> Option<Lookalike> {
    const SIGNS: &str = ":,-[]{}";
    let letters: Vec<char> = line.chars().collect();
    let (mut quote, mut begun) = (None, false);
    for (index, letter) in letters.iter().copied().enumerate() {
        let before = index
            .checked_sub(1)
            .and_then(|before| letters.get(before).copied())
            .unwrap_or(' ');
        match (quote, letter) {
            (Some(mark), _) if mark == letter => quote = None,
            (Some(_), _) => continue,
            (None, '"' | '\'') if SIGNS.contains(before) || before == ' ' => quote = Some(letter),
            (None, '#') if before == ' ' => return None,
            _ => {}
        }
        let beside =
            SIGNS.contains(before) || letters.get(index + 1).is_some_and(|next| SIGNS.contains(*next));
        if let Some(found) = lookalikes::of(letter, index) {
            let is_sign = found.instead.is_some_and(|sign| ":{}[]".contains(sign));
            if is_sign || found.is_invisible() && (!begun || beside) {
                return Some(found);
            }
        }
        begun |= letter != ' ';
    }
    None
}

/// The last bracket that opens a list or mapping and has no partner. Brackets count only where a value can begin;
/// quoted text and comments are skipped.
fn open_bracket(lines: &[&str]) -> Option<(usize, usize, char)> {
    let mut open = Vec::new();
    for (index, line) in lines.iter().enumerate() {
        let (mut quote, mut before, mut last) = (None, ' ', ':');
        for (column, letter) in line.chars().enumerate() {
            let begins = open.is_empty() && ":-".contains(last) || !open.is_empty();
            match (quote, letter) {
                (Some(mark), _) if mark == letter => quote = None,
                (Some(_), _) => {}
                (None, '"' | '\'') if ":-,[{".contains(last) => quote = Some(letter),
                (None, '#') if before == ' ' => break,
                (None, '[' | '{') if begins => open.push((index + 1, column + 1, letter)),
                (None, ']' | '}') => drop(open.pop()),
                _ => {}
            }
            before = letter;
            last = if letter.is_whitespace() { last } else { letter };
        }
    }
    open.last().copied()
}

/// The first line up to `last` (or the one after it) that is indented by a tab.
fn tab_indentation(lines: &[&str], last: usize) -> Option<usize> {
    let indented = |text: &&str| {
        let indent: &str = &text[..text.len() - text.trim_start().len()];
        indent.contains('\t') && !text.trim().is_empty() && !text.trim().starts_with('#')
    };
    lines
        .iter()
        .take(last + 1)
        .position(indented)
        .map(|index| index + 1)
}
