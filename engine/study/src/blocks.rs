//! `blocks` and `<<`: keys that are written once and used in several places.

use super::{
    overlay::{TAKE, below, overlay, without_nothing},
    sections::StudyText,
};
use document::{
    DEEPEST, Entry, FittingEntries, MOST_NODES, Node, NodeKind,
    diagnostic::{Diagnostic, Sources, Span, suggest},
    schema_check::View,
};
use serde_json::{Map, Value};

/// Inserts blocks at the keys `<<` that name them. Keys beside `<<` take precedence over those of the block.
///
/// # Errors
/// Unknown names of blocks, values that are no names, blocks that contain themselves, and two blocks that give one key
/// different values.
pub fn expand(root: &mut Node, schema: &Value, sources: &Sources) -> Result<(), Vec<Diagnostic>> {
    let named = root
        .get("blocks")
        .map_or_else(Vec::new, |node| node.entries().to_vec());
    let mut blocks = Blocks {
        text: StudyText::read(root).blocks,
        named: &named,
        sources,
        open: Vec::new(),
        left: MOST_NODES,
        found: Vec::new(),
    };
    if let NodeKind::Mapping(entries) = &mut root.kind {
        let study = View::new(schema, schema);
        for entry in entries.iter_mut().filter(|entry| entry.key != "blocks") {
            let place = study.property(&entry.key);
            blocks.fill(&mut entry.value, &entry.key, place.as_ref());
        }
    }
    if blocks.found.is_empty() {
        Ok(())
    } else {
        Err(blocks.found)
    }
}

struct Blocks<'a> {
    text: FittingEntries<Map<String, Value>>,
    /// The blocks with their positions, in the order of the study.
    named: &'a [Entry],
    sources: &'a Sources,
    /// Names of the blocks that are being expanded; none of them may be named inside.
    open: Vec<&'a str>,
    /// Number of values that blocks may still add.
    left: usize,
    found: Vec<Diagnostic>,
}

impl Blocks<'_> {
    /// Inserts blocks into everything below `node`, which stands at the dotted path `at`.
    fn fill(&mut self, node: &mut Node, at: &str, place: Option<&View<'_>>) {
        match &mut node.kind {
            NodeKind::Scalar(_) => {}
            NodeKind::Sequence(items) => {
                for (index, item) in items.iter_mut().enumerate() {
                    let places = place.map_or_else(Vec::new, View::alternatives);
                    let below = places.iter().find_map(|place| place.item(index));
                    self.fill(item, &format!("{at}[{index}]"), below.as_ref());
                }
            }
            NodeKind::Mapping(entries) => {
                for entry in entries.iter_mut() {
                    let below = match (entry.key.as_str(), place) {
                        (TAKE, place) => place.cloned(),
                        (key, place) => place.and_then(|place| below(place, key)),
                    };
                    self.fill(&mut entry.value, &format!("{at}.{}", entry.key), below.as_ref());
                }
                if let Some(index) = entries.iter().position(|entry| entry.key == TAKE) {
                    let taken = entries.remove(index);
                    let own = std::mem::replace(node, Node::empty_mapping(node.span));
                    *node = self.under(&taken.value, &own, at, place);
                    overlay(node, own, place);
                    without_nothing(node, place);
                }
            }
        }
    }

    /// The values that `<<` takes, as one mapping; `own` are the keys beside it.
    fn under(&mut self, taken: &Node, own: &Node, at: &str, place: Option<&View<'_>>) -> Node {
        let mut whole = Node::empty_mapping(taken.span);
        let wanted = match &taken.kind {
            NodeKind::Sequence(items) => items.iter().collect(),
            _ => vec![taken],
        };
        for one in wanted {
            let Some(block) = self.block(one, at, place) else {
                continue;
            };
            if let Some((key, first, second)) = differs(&whole, &block, own, "") {
                let message = format!("two blocks give `{key}` different values");
                let error = self.sources.error(second, &format!("{at}.{TAKE}"), message);
                let first = self.sources.place(first);
                let help = format!("write `{key}` beside `{TAKE}`: what stands there wins");
                self.found
                    .push(error.note("the other value is here", first).help(help));
            }
            overlay(&mut whole, block, place);
        }
        whole
    }

    /// A mapping that an alias put here, or the block of this name.
    fn block(&mut self, wanted: &Node, at: &str, place: Option<&View<'_>>) -> Option<Node> {
        let name = match &wanted.kind {
            NodeKind::Mapping(_) => return Some(wanted.clone()),
            _ => wanted.as_str(),
        };
        let Some(name) = name else {
            let message =
                format!("`{TAKE}` takes the name of a block or an alias of a mapping, or a list of them");
            return self.refuse(wanted.span, at, message, "blocks stand under `blocks`, by name");
        };
        let named = self.named;
        let Some(entry) = named.iter().find(|entry| entry.key == name) else {
            let help = suggest(name, named.iter().map(|entry| entry.key.as_str()));
            return self.refuse(wanted.span, at, format!("no block is named `{name}`"), &help);
        };
        // The check of `blocks` reports a block in another form at its own position.
        self.text.get(name)?;
        if self.open.contains(&entry.key.as_str()) || self.open.len() >= DEEPEST {
            let message = format!("the block `{name}` contains itself");
            return self.refuse(wanted.span, at, message, "take it in one of the two places");
        }
        let mut block = entry.value.clone();
        self.left = self.left.saturating_sub(size(&block));
        if self.left == 0 {
            let message = format!("blocks add more than {MOST_NODES} values to this study");
            return self.refuse(
                wanted.span,
                at,
                message,
                "write smaller blocks, or use them less often",
            );
        }
        self.open.push(&entry.key);
        self.fill(&mut block, at, place);
        self.open.pop();
        Some(block)
    }

    fn refuse(&mut self, span: Span, at: &str, message: String, help: &str) -> Option<Node> {
        let error = self.sources.error(span, &format!("{at}.{TAKE}"), message);
        // Once too many values were added, every later block would cause the same error.
        if self.left > 0 || self.found.is_empty() {
            self.found.push(error.help(help));
        }
        None
    }
}

/// The first key to which both blocks give different values of their own, and that no key beside `<<` decides.
fn differs(one: &Node, other: &Node, own: &Node, at: &str) -> Option<(String, Span, Span)> {
    other.entries().iter().find_map(|entry| {
        let known = one.get(&entry.key)?;
        let key = if at.is_empty() {
            entry.key.clone()
        } else {
            format!("{at}.{}", entry.key)
        };
        let mappings = [known, &entry.value].map(|node| matches!(node.kind, NodeKind::Mapping(_)));
        match (mappings, own.get(&entry.key)) {
            ([true, true], beside) => {
                let nothing = Node::empty_mapping(own.span);
                differs(known, &entry.value, beside.unwrap_or(&nothing), &key)
            }
            (_, Some(_)) => None,
            _ => (known.to_value() != entry.value.to_value()).then_some((key, known.span, entry.value.span)),
        }
    })
}

/// Number of values of a node.
fn size(node: &Node) -> usize {
    let below: usize = match &node.kind {
        NodeKind::Scalar(_) => 0,
        NodeKind::Sequence(items) => items.iter().map(size).sum(),
        NodeKind::Mapping(entries) => entries.iter().map(|entry| size(&entry.value)).sum(),
    };
    below + 1
}
