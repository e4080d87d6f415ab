//! A key of a section that does not affect trials, set by a profile or from the command line: `--set
//! tables.t.caption=...`, `--set claims.0.exploratory=...`, `--set sweep.learner.discount='{ grid: [0.9] }'`.

use super::{overlay::below, path::assign};
use document::{
    Entry, Node, NodeKind,
    diagnostic::{Diagnostic, Sources, Span, suggest},
    schema_check::View,
};
use serde_json::Value;

/// Writes the value of `entry`, whose key is a dotted path, into the document.
///
/// # Errors
/// The unknown word of the path, with the nearest known one.
pub fn set(root: &mut Node, entry: &Entry, schema: &Value, sources: &Sources) -> Result<(), Vec<Diagnostic>> {
    let words: Vec<&str> = entry.key.split('.').collect();
    let way = PathAssignment {
        words: &words,
        span: entry.key_span,
        value: &entry.value,
    };
    let study = View::new(schema, schema);
    way.put(root, &study, 0).map_err(|unknown| {
        let word = words[unknown.index];
        let before: usize = words[..unknown.index]
            .iter()
            .map(|word| word.chars().count() + 1)
            .sum();
        let span = Span {
            column: entry.key_span.column + before,
            length: word.chars().count().max(1),
            ..entry.key_span
        };
        let owner = words[..unknown.index].join(".");
        let message = format!("`{owner}` has nothing named `{word}`");
        let error = sources.error(span, &entry.key, message);
        vec![error.help(suggest(word, unknown.known.iter().map(String::as_str)))]
    })
}

/// A dotted path with the value to be set there.
struct PathAssignment<'a> {
    words: &'a [&'a str],
    span: Span,
    value: &'a Node,
}

/// A word of a path that names nothing, and the words that are known at its place.
struct UnknownWord {
    index: usize,
    known: Vec<String>,
}

impl PathAssignment<'_> {
    /// Writes the value below `node`, to which the words before `first` lead.
    fn put(&self, node: &mut Node, place: &View<'_>, first: usize) -> Result<(), UnknownWord> {
        match &mut node.kind {
            NodeKind::Sequence(items) => self.put_into_list(items, place, first),
            NodeKind::Mapping(entries) => {
                let Some((count, below)) = self.known(entries, place, first) else {
                    return self.put_here(node, place, first);
                };
                let next = first + count;
                let name = self.words[first..next].join(".");
                if next == self.words.len() {
                    assign(node, place, &[name], self.span, self.value);
                    return Ok(());
                }
                // `known` has found the entry.
                let entry = entries.iter_mut().find(|entry| entry.key == name);
                entry.map_or(Ok(()), |entry| self.put(&mut entry.value, &below, next))
            }
            NodeKind::Scalar(_) => self.put_here(node, place, first),
        }
    }

    fn put_into_list(&self, items: &mut [Node], place: &View<'_>, first: usize) -> Result<(), UnknownWord> {
        let count = items.len();
        let known = || (0..count).map(|index| index.to_string()).collect();
        let index = self.words[first].parse().ok().filter(|index| *index < count);
        let Some(index) = index else {
            return Err(UnknownWord {
                index: first,
                known: known(),
            });
        };
        let places = place.alternatives();
        let below = places.iter().find_map(|place| place.item(index));
        match below {
            Some(below) if first + 1 < self.words.len() => self.put(&mut items[index], &below, first + 1),
            _ => {
                items[index] = self.value.clone();
                Ok(())
            }
        }
    }

    /// The number of words that name the next entry, whose name may contain dots, and the schema below it.
    fn known<'b>(&self, entries: &[Entry], place: &View<'b>, first: usize) -> Option<(usize, View<'b>)> {
        let longest = (1..=self.words.len() - first).rev();
        let places = place.alternatives();
        longest.into_iter().find_map(|count| {
            let name = self.words[first..first + count].join(".");
            entries.iter().find(|entry| entry.key == name)?;
            let below = places.iter().find_map(|place| place.property(&name))?;
            Some((count, below))
        })
    }

    /// Writes a value that the study does not have yet, or has as a whole.
    fn put_here(&self, node: &mut Node, place: &View<'_>, first: usize) -> Result<(), UnknownWord> {
        let rest: Vec<String> = self.words[first..].iter().map(ToString::to_string).collect();
        let whole = [rest.join(".")];
        let (index, known) = match place.descend(&rest) {
            // An absent entry with a free name must be set as a whole.
            Ok(_) if rest.len() > 1 && !place.property_names().contains(&&*rest[0]) => (0, Vec::new()),
            Ok(_) => {
                assign(node, place, &rest, self.span, self.value);
                return Ok(());
            }
            Err(_) if rest.len() > 1 && place.property_names().contains(&&*rest[0]) => {
                return self.put_into_new(node, place, first);
            }
            Err(unknown) => unknown,
        };
        // Sections with free names: a new entry is given as a whole, and its name may contain dots.
        if place.descend(&whole).is_ok() && matches!(self.value.kind, NodeKind::Mapping(_)) {
            assign(node, place, &whole, self.span, self.value);
            return Ok(());
        }
        let mut known: Vec<String> = known.into_iter().map(String::from).collect();
        if known.is_empty() {
            known = node.entries().iter().map(|entry| entry.key.clone()).collect();
        }
        Err(UnknownWord {
            index: first + index,
            known,
        })
    }

    /// Writes below a section that the study does not have yet.
    fn put_into_new(&self, node: &mut Node, place: &View<'_>, first: usize) -> Result<(), UnknownWord> {
        let name = self.words[first];
        let below = below(place, name).unwrap_or_else(|| place.clone());
        let entry = node.entry_or_insert(name, self.span);
        entry.map_or(Ok(()), |entry| self.put(&mut entry.value, &below, first + 1))
    }
}
