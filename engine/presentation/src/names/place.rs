//! Places of a study at which names are checked.

use document::{Entry, Node, NodeKind, diagnostic::Span};

/// The part of the study from which a table or figure takes its values.
pub struct Picked {
    /// Indices of agents in the vocabulary.
    pub agents: Vec<usize>,
    /// Indices of environments in the vocabulary.
    pub environments: Vec<usize>,
}

impl Picked {
    /// The same for one environment: the named one, or the first.
    pub fn of_one_environment(mut self) -> Self {
        self.environments.truncate(1);
        self
    }
}

/// A mapping of the study with its place.
#[derive(Clone)]
pub struct Place<'a> {
    /// The mapping in the study file.
    pub node: &'a Node,
    /// Position of its key in the file.
    pub key: Span,
    /// Dotted path of the mapping, for messages.
    pub at: String,
}

impl<'a> Place<'a> {
    /// The value of an entry whose dotted path is known.
    #[must_use]
    pub fn of(entry: &'a Entry, at: String) -> Self {
        Self {
            node: &entry.value,
            key: entry.key_span,
            at,
        }
    }

    /// The mapping under a key; `None` if it is not given.
    #[must_use]
    pub fn below(&self, key: &str) -> Option<Place<'a>> {
        self.node
            .entry(key)
            .map(|entry| Place::of(entry, format!("{}.{key}", self.at)))
    }

    /// The items of a list.
    pub fn items(&self) -> impl Iterator<Item = Place<'a>> {
        let item = |(index, node): (usize, &'a Node)| Place {
            node,
            key: node.span,
            at: format!("{}[{index}]", self.at),
        };
        self.node.items().iter().enumerate().map(item)
    }

    /// Position of the value under a key, or that of the mapping's own key if the key is absent.
    pub fn value(&self, key: &str) -> (Span, String) {
        let at = format!("{}.{key}", self.at);
        match self.node.entry(key) {
            Some(entry) if matches!(entry.value.kind, NodeKind::Scalar(_)) => (entry.value.span, at),
            Some(entry) => (entry.key_span, at),
            None => (self.key, at),
        }
    }
}
