//! Parts taken apart into leaves: the values of a config by dotted path. Equal parts and equal values become
//! equal numbers, so that many parts are compared quickly.

use contract::{complete_config::CompleteConfig, part::Part};
use serde_json::{Value, json};
use std::{
    cmp::Ordering,
    collections::HashMap,
    fmt::{self, Display, Formatter},
    sync::Arc,
};

/// Number of a part in a [`Catalogue`]: equal for equal parts only.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PartIndex(usize);

/// One leaf in which two trials differ.
#[derive(Debug, Clone, PartialEq)]
pub struct Difference {
    /// The differing key or version, as in `protocol.steps` or `agent version`.
    pub what: String,
    /// The stored value; `None` if the stored trial has no such key.
    pub stored: Option<Value>,
    /// The planned value; `None` if the planned trial has no such key.
    pub planned: Option<Value>,
}

impl Display for Difference {
    fn fmt(&self, out: &mut Formatter<'_>) -> fmt::Result {
        if let Some((part, name)) = self.file() {
            let change = match (&self.stored, &self.planned) {
                (None, _) => "is new",
                (_, None) => "is gone",
                _ => "has other content",
            };
            return write!(out, "{part}: `{name}` {change}");
        }
        // A key of a config ends in a colon, everything else reads as a sentence: `agent version 1 -> 2`.
        let colon = if self.what.contains('.') { ":" } else { "" };
        write!(
            out,
            "{}{colon} {} -> {}",
            self.what,
            short(self.stored.as_ref()),
            short(self.planned.as_ref())
        )
    }
}

impl Difference {
    /// The part and the name of a file whose content differs, if the file stands under a name.
    fn file(&self) -> Option<(&str, &str)> {
        let named = self.what.strip_suffix(".file.content")?;
        if let Some(part) = named.strip_suffix(".lock") {
            return Some((part, "lock"));
        }
        let (part, name) = [".sources.", ".inputs."]
            .iter()
            .find_map(|files| named.split_once(files))?;
        // A file in a list is identified by its index there.
        name.parse::<usize>().is_err().then_some((part, name))
    }
}

/// A value in at most 40 characters.
fn short(value: Option<&Value>) -> String {
    let text = match value {
        None => return "absent".into(),
        Some(Value::String(word)) => word.clone(),
        Some(value) => value.to_string(),
    };
    if text.chars().count() <= 40 {
        text
    } else {
        text.chars().take(37).chain("...".chars()).collect()
    }
}

/// A part with its leaves in the order of their paths.
#[derive(Debug, PartialEq, Eq, Hash, Clone)]
struct Leaves {
    plugin: String,
    version: u32,
    leaves: Vec<(usize, usize)>,
}

/// Every part that was seen, taken apart once.
#[derive(Debug, Default)]
pub struct Catalogue {
    parts: Vec<Arc<Leaves>>,
    index: HashMap<Arc<Leaves>, PartIndex>,
    /// Trials of a plan share configs, which are recognised by their address.
    shared: HashMap<usize, (CompleteConfig, PartIndex)>,
    texts: HashMap<String, usize>,
    by_number: Vec<String>,
}

impl Catalogue {
    /// The index of a part; a new part is added.
    pub fn index(&mut self, part: &Part) -> PartIndex {
        let address = part.config.address();
        let known = self.shared.get(&address).map(|(_, index)| *index);
        if let Some(index) = known.filter(|index| {
            let leaves = &self.parts[index.0];
            part.files.is_empty() && leaves.plugin == part.plugin && leaves.version == part.version
        }) {
            return index;
        }
        let mut leaves = Vec::new();
        self.flatten(&part.identity(), &mut String::new(), &mut leaves);
        leaves.sort_unstable();
        let leaves = Arc::new(Leaves {
            plugin: part.plugin.clone(),
            version: part.version,
            leaves,
        });
        let next = PartIndex(self.parts.len());
        let index = *self.index.entry(Arc::clone(&leaves)).or_insert(next);
        if index == next {
            self.parts.push(leaves);
        }
        // The config is kept, so that no other config can take its address.
        self.shared.insert(address, (part.config.clone(), index));
        index
    }

    /// Number of leaves in which two parts differ; the plugin counts with all leaves of the larger config.
    pub fn distance(&self, one: PartIndex, other: PartIndex) -> usize {
        if one == other {
            return 0;
        }
        let (one, other) = (&self.parts[one.0], &self.parts[other.0]);
        if one.plugin != other.plugin {
            return 1 + one.leaves.len().max(other.leaves.len());
        }
        let mut count = usize::from(one.version != other.version);
        merge(&one.leaves, &other.leaves, |_, _, _| count += 1);
        count
    }

    /// Number of plugins that two combinations of three parts have in common.
    pub fn same_plugins(&self, one: &[PartIndex; 3], other: &[PartIndex; 3]) -> usize {
        let plugin = |index: &PartIndex| &self.parts[index.0].plugin;
        one.iter()
            .zip(other)
            .filter(|(one, other)| plugin(one) == plugin(other))
            .count()
    }

    /// The leaves in which two combinations (parts, numerics version) differ.
    pub fn differences(
        &self,
        stored: &([PartIndex; 3], u32),
        planned: &([PartIndex; 3], u32),
    ) -> Vec<Difference> {
        let mut found = Vec::new();
        let mut note = |what: String, stored: Option<Value>, planned: Option<Value>| {
            if stored != planned {
                found.push(Difference {
                    what,
                    stored,
                    planned,
                });
            }
        };
        for (kind, (one, other)) in ["environment", "agent", "protocol"]
            .into_iter()
            .zip(stored.0.iter().zip(&planned.0))
        {
            self.differences_of_parts(kind, *one, *other, &mut note);
        }
        note(
            "numerics version".into(),
            Some(json!(stored.1)),
            Some(json!(planned.1)),
        );
        found
    }

    fn differences_of_parts(
        &self,
        kind: &str,
        one: PartIndex,
        other: PartIndex,
        note: &mut impl FnMut(String, Option<Value>, Option<Value>),
    ) {
        let (one, other) = (&self.parts[one.0], &self.parts[other.0]);
        note(
            format!("{kind} plugin"),
            Some(json!(one.plugin)),
            Some(json!(other.plugin)),
        );
        if one.plugin != other.plugin {
            return;
        }
        note(
            format!("{kind} version"),
            Some(json!(one.version)),
            Some(json!(other.version)),
        );
        // A study has one protocol, but usually several environments and agents.
        let subject = if kind == "protocol" {
            kind.to_owned()
        } else {
            format!("{kind} {}", one.plugin)
        };
        let value = |number: Option<usize>| {
            number.and_then(|number| serde_json::from_str(&self.by_number[number]).ok())
        };
        merge(&one.leaves, &other.leaves, |path, from, to| {
            let path = &self.by_number[path];
            note(format!("{subject}.{path}"), value(from), value(to));
        });
    }

    fn flatten(&mut self, value: &Value, path: &mut String, leaves: &mut Vec<(usize, usize)>) {
        let length = path.len();
        let mut inside = |this: &mut Self, key: &str, value: &Value| {
            if !path.is_empty() {
                path.push('.');
            }
            path.push_str(key);
            this.flatten(value, path, leaves);
            path.truncate(length);
        };
        match value {
            Value::Object(map) if !map.is_empty() => {
                map.iter().for_each(|(key, value)| inside(self, key, value));
            }
            Value::Array(items) if items.iter().any(|item| item.is_object() || item.is_array()) => {
                items
                    .iter()
                    .enumerate()
                    .for_each(|(index, value)| inside(self, &index.to_string(), value));
            }
            // A list of numbers or words is one leaf: a list that grew by an entry differs in one leaf.
            leaf => {
                let leaf = (self.number(path), self.number(&leaf.to_string()));
                leaves.push(leaf);
            }
        }
    }

    fn number(&mut self, text: &str) -> usize {
        if let Some(&number) = self.texts.get(text) {
            return number;
        }
        self.by_number.push(text.to_owned());
        self.texts.insert(text.to_owned(), self.by_number.len() - 1);
        self.by_number.len() - 1
    }
}

/// Calls `differs` with each path whose values differ between two lists sorted by path.
fn merge(
    one: &[(usize, usize)],
    other: &[(usize, usize)],
    mut differs: impl FnMut(usize, Option<usize>, Option<usize>),
) {
    let (mut left, mut right) = (one.iter().peekable(), other.iter().peekable());
    loop {
        let order = match (left.peek(), right.peek()) {
            (None, None) => return,
            (Some(_), None) => Ordering::Less,
            (None, Some(_)) => Ordering::Greater,
            (Some((one, _)), Some((other, _))) => one.cmp(other),
        };
        let first = if order == Ordering::Greater {
            None
        } else {
            left.next()
        };
        let second = if order == Ordering::Less {
            None
        } else {
            right.next()
        };
        let value = |leaf: Option<&(usize, usize)>| leaf.map(|(_, value)| *value);
        if let Some((path, _)) = first.or(second).filter(|_| value(first) != value(second)) {
            differs(*path, value(first), value(second));
        }
    }
}
