//! Overlays: two mappings merged into one, for `include`, `<<` and sections of a file.
//!
//! A key without a value removes the value under it, unless the schema allows `null` there.

use document::{Entry, Node, NodeKind, schema_check::View};
use std::collections::{BTreeMap, BTreeSet};

/// The key that takes blocks.
pub const TAKE: &str = "<<";

/// Overlays `under` with `over`. Mappings are merged key by key, everything else is replaced. If the schema asks for
/// one key of several (a plugin, a sampler), another key replaces the first.
pub fn overlay(under: &mut Node, over: Node, place: Option<&View<'_>>) {
    let merges =
        |mine: &[Entry], theirs: &[Entry]| !place.is_some_and(one_of_several) || same_keys(mine, theirs);
    match (&mut under.kind, over.kind) {
        (NodeKind::Mapping(mine), NodeKind::Mapping(theirs)) if merges(mine, &theirs) => {
            overlay_entries(mine, theirs, place);
            under.span = over.span;
        }
        (_, kind) => {
            *under = Node {
                span: over.span,
                kind,
            }
        }
    }
}

/// Overlays entries with others; each is found by its key at once, since a study may have very many.
fn overlay_entries(mine: &mut Vec<Entry>, theirs: Vec<Entry>, place: Option<&View<'_>>) {
    let mut all: Vec<Option<Entry>> = std::mem::take(mine).into_iter().map(Some).collect();
    let mut places: BTreeMap<String, usize> = BTreeMap::new();
    for (place, entry) in all.iter().flatten().enumerate() {
        places.entry(entry.key.clone()).or_insert(place);
    }
    for entry in theirs {
        let Some(&at) = places.get(&entry.key) else {
            places.insert(entry.key.clone(), all.len());
            all.push(Some(entry));
            continue;
        };
        let below = place.and_then(|place| below(place, &entry.key));
        // The value that a block has under the key comes later, and is removed then.
        if !places.contains_key(TAKE) && takes_away(&entry.value, below.as_ref()) {
            places.remove(&entry.key);
            all[at] = None;
        } else if let Some(known) = &mut all[at] {
            known.key_span = entry.key_span;
            overlay(&mut known.value, entry.value, below.as_ref());
        }
    }
    *mine = all.into_iter().flatten().collect();
}

/// Removes keys without a value at places that require a value.
pub fn without_nothing(node: &mut Node, place: Option<&View<'_>>) {
    if let NodeKind::Mapping(entries) = &mut node.kind {
        entries.retain(|entry| {
            let below = place.and_then(|place| below(place, &entry.key));
            !takes_away(&entry.value, below.as_ref())
        });
    }
}

/// Whether an entry without a value removes the one below: parameters that may be `null` become `null` instead.
fn takes_away(over: &Node, place: Option<&View<'_>>) -> bool {
    let wanted: Vec<&str> = place.map_or_else(Vec::new, |place| {
        place.alternatives().iter().flat_map(View::types).collect()
    });
    let is_null = matches!(&over.kind, NodeKind::Scalar(scalar) if scalar.value.is_null());
    is_null && !wanted.is_empty() && !wanted.contains(&"null")
}

/// The schema of the values under a key; `None` if it is not known.
pub fn below<'a>(place: &View<'a>, key: &str) -> Option<View<'a>> {
    let places = place.alternatives();
    let mut mappings = places.iter().filter(|place| place.is_mapping());
    mappings.find_map(|place| place.property(key))
}

/// Whether a mapping has one key of several: a plugin, or a variant of an enum.
fn one_of_several(place: &View<'_>) -> bool {
    let places = place.alternatives();
    let one_at_most = |place: &View<'_>| place.get("maxProperties").is_some_and(|most| most == 1);
    places.iter().any(one_at_most) || places.len() > 1 && places.iter().any(|place| place.variant().is_some())
}

fn same_keys(mine: &[Entry], theirs: &[Entry]) -> bool {
    let keys = |entries: &[Entry]| -> BTreeSet<String> { entries.iter().map(|it| it.key.clone()).collect() };
    mine.len() == theirs.len() && keys(mine) == keys(theirs)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::json_schema;
    use document::{diagnostic::Sources, parse};
    use serde_json::json;
    use testing::toys::toys;

    fn laid(under: &str, over: &str) -> Node {
        let mut sources = Sources::default();
        let mut read = |text: &str| {
            let source = sources.add_file("a.yaml", text);
            parse(&sources, source, text).unwrap()
        };
        let (mut under, over) = (read(under), read(over));
        let schema = json_schema(&toys());
        overlay(&mut under, over, Some(&View::new(&schema, &schema)));
        under
    }

    #[test]
    fn mappings_are_merged_and_lists_and_values_replaced() {
        let node = laid(
            "{title: a, deviations: [b, c], tables: {t: {caption: d}}}",
            "{title: e, deviations: [f], tables: {t: {labels: {g: h}}, u: {}}}",
        );
        let whole = json!({"title": "e", "deviations": ["f"], "tables": {"t": {"caption": "d", "labels": {"g": "h"}}, "u": {}}});
        assert_eq!(node.to_value(), whole);
    }

    #[test]
    fn another_plugin_takes_the_place_of_the_first() {
        let node = laid(
            "{agents: {a: {walker: {direction: left}}}}",
            "{agents: {a: {q_learning: {discount: 0.5}}}}",
        );
        assert_eq!(
            node.to_value(),
            json!({"agents": {"a": {"q_learning": {"discount": 0.5}}}})
        );
        let node = laid(
            "{agents: {a: {walker: {direction: left}}}}",
            "{agents: {a: {walker: {}}}}",
        );
        assert_eq!(
            node.to_value(),
            json!({"agents": {"a": {"walker": {"direction": "left"}}}})
        );
    }

    #[test]
    fn another_sampler_takes_the_place_of_the_first() {
        let node = laid("{sweep: {a.b: {grid: [1]}}}", "{sweep: {a.b: {zip: [2]}}}");
        assert_eq!(node.to_value(), json!({"sweep": {"a.b": {"zip": [2]}}}));
    }

    #[test]
    fn a_key_without_a_value_takes_away_what_stands_under_it() {
        let node = laid(
            "{title: a, tables: {t: {caption: b}, u: {}}, agents: {c: {walker: {direction: left}}}}",
            "{title: ~, tables: {t: ~, v: null}, agents: {c: {walker: {direction: ~}}}}",
        );
        // An absent value cannot be removed: the check reports the missing key.
        let whole = json!({"tables": {"u": {}, "v": null}, "agents": {"c": {"walker": {}}}});
        assert_eq!(node.to_value(), whole);
    }

    #[test]
    fn a_published_value_of_one_cell_is_taken_away() {
        let node = laid(
            "{tables: {t: {published: {a: {x: 1, y: 2}, b: {x: {value: 3}}}}}}",
            "{tables: {t: {published: {a: {y: ~}, b: {x: ~}}}}}",
        );
        let published = json!({"a": {"x": 1}, "b": {}});
        assert_eq!(node.to_value()["tables"]["t"]["published"], published);
    }

    #[test]
    fn what_a_block_has_is_taken_away_when_it_is_there() {
        let node = laid(
            "{agents: {c: {walker: {<<: b, direction: left}}}}",
            "{agents: {c: {walker: {direction: ~}}}}",
        );
        let whole = json!({"agents": {"c": {"walker": {"<<": "b", "direction": null}}}});
        assert_eq!(node.to_value(), whole);
    }

    #[test]
    fn a_value_that_may_be_nothing_becomes_nothing() {
        let node = laid(
            "{profiles: {p: {a.b: 1}}, claims: [{claim: a}]}",
            "{profiles: {p: {a.b: ~}}}",
        );
        assert_eq!(
            node.to_value(),
            json!({"profiles": {"p": {"a.b": null}}, "claims": [{"claim": "a"}]})
        );
    }

    #[test]
    fn what_is_laid_over_keeps_its_position() {
        let node = laid("\n\na: {b: 1, c: 2}", "a: {b: 3}");
        let entry = |key: &str| node.get("a").unwrap().entry(key).unwrap();
        assert_eq!((entry("b").key_span.line, entry("c").key_span.line), (1, 3));
        assert_eq!(
            (entry("b").value.span.source, entry("c").value.span.source),
            (1, 0)
        );
    }
}
