//! A study with every default written out.

use super::{
    Study,
    cells::Sections,
    config, imported_runs,
    path::Target,
    search::Searched,
    seeds::SeedPlan,
    way::name_written_out,
    written::{Chosen, Named, PartKind, Prepared},
};
use contract::Error;
use document::{Entry, Node};
use execution::limits::Limits;
use presentation::{figure::FigureSpec, table::TableSpec, vocabulary::Play};
use serde::{Serialize, Serializer, ser::SerializeMap};
use serde_json::{Map, Value, json};
use serde_saphyr::FlowSeq;
use std::{collections::BTreeMap, path::Path};

/// The study as YAML with every default written out, to be stored in `folder`: data files are named relative
/// to it.
///
/// The chosen profile and the options of the command line are part of it; profiles and presets are not. It
/// loads to the same trials, and other readers find the same values in it.
///
/// # Errors
/// [`Error::Render`] where a value has no form in YAML.
pub fn resolved_yaml(study: &Study, folder: &Path) -> Result<String, Error> {
    let texts = [
        ("study", &study.name),
        ("title", &study.title),
        ("source", &study.source),
    ];
    let mut sections: Vec<(String, Section)> = texts
        .map(|(key, text)| (key.into(), Section::Plain(json!(text))))
        .into();
    let summary = study.summary.iter();
    let family = study.family.iter();
    sections.extend(family.map(|it| ("family".into(), Section::Plain(json!(it)))));
    sections.extend(summary.map(|it| ("summary".into(), Section::Plain(json!(it.text)))));
    if !study.answers.is_empty() {
        let lines: Vec<_> = study.answers.iter().map(|it| &it.text).collect();
        sections.push(("answers".into(), Section::Plain(json!(lines))));
    }
    sections.push(("departures".into(), Section::Plain(json!(study.departures))));
    // In the resolved configs files are named from the current folder, in sweeps and overrides from the
    // study's.
    let relocated = study.resolved.iter().map(|(key, section)| {
        if key == "imported" {
            let seen = |_: &str, entry| imported_runs::relocated(entry, &study.folder, folder);
            return (key.clone(), section.clone().map(seen));
        }
        let from = if ["sweep", "overrides", "cross_play"].contains(&key.as_str()) {
            study.folder.as_path()
        } else {
            Path::new("")
        };
        (
            key.clone(),
            section
                .clone()
                .map(|key, value| relocate(value, key, from, folder)),
        )
    });
    sections.extend(relocated);
    let tables = study
        .tables
        .iter()
        .map(|(name, spec)| (name.clone(), given(json!(table_from(spec, folder)))))
        .collect();
    let figures = study
        .figures
        .iter()
        .map(|(name, spec)| (name.clone(), given(json!(files_from(spec, folder)))))
        .collect();
    sections.extend([
        ("tables".to_string(), Section::Named(tables)),
        ("figures".to_string(), Section::Named(figures)),
    ]);
    sections.push(("claims".into(), Section::Plain(given(json!(study.claims)))));
    if !study.confirm.is_empty() {
        sections.push(("confirm".into(), Section::Plain(json!(study.confirm))));
    }
    if study.limits != Limits::default() {
        sections.push(("limits".into(), Section::Plain(json!(study.limits))));
    }
    text(&sections)
}

/// A section as a study has it, in YAML.
///
/// # Errors
/// [`Error::Render`] where a value has no form in YAML.
pub fn section_yaml(name: &str, value: Value) -> Result<String, Error> {
    text(&[(name.into(), Section::Plain(value))])
}

/// A section of a study.
#[derive(Debug, Clone, PartialEq)]
pub enum Section {
    /// A value whose keys are sorted.
    Plain(Value),
    /// A mapping whose order is the study's.
    Named(Entries),
    /// Searches in the order of the study.
    Searches(Vec<(String, WrittenSearch)>),
}

/// A search as it is written. What it draws depends on the order of the keys that it is over.
#[derive(Debug, Clone, PartialEq)]
pub struct WrittenSearch {
    /// The section `over`.
    over: Entries,
    /// Everything else.
    rest: Value,
}

impl Section {
    fn map(self, change: impl Fn(&str, Value) -> Value) -> Self {
        match self {
            Section::Plain(value) => Section::Plain(change("", value)),
            Section::Named(pairs) => Section::Named(
                pairs
                    .into_iter()
                    .map(|(name, value)| {
                        let value = change(&name, value);
                        (name, value)
                    })
                    .collect(),
            ),
            // A search names no files.
            searches @ Section::Searches(_) => searches,
        }
    }
}

/// The sections that trials are made of, in the order of a study, with all defaults.
pub fn sections(
    root: &Node,
    sections: &Sections<'_>,
    plan: &SeedPlan,
    plays: &[Play],
) -> Vec<(String, Section)> {
    let mut files = config::Files::new(sections.folder);
    let mut full = |target, named: &Named| {
        let plugin = sections.plugin(target);
        let part = plugin
            .and_then(|plugin| config::resolve(&plugin, &named.config, &mut files, sections.sources).ok());
        // A config that is complete only with a sweep or an override stays as it is written.
        json!({ named.plugin.clone(): part.map_or_else(|| named.config.to_value(),
            |part| part.config.whole().into_owned()) })
    };
    let mut parts = |list: &[Named], target: fn(usize) -> Target| {
        let pairs = list
            .iter()
            .enumerate()
            .map(|(index, named)| (named.name.clone(), full(target(index), named)));
        Section::Named(pairs.collect())
    };
    let environments = parts(&sections.written.environments, Target::Environment);
    let agents = parts(&sections.written.agents, Target::Agent);
    let protocol = full(Target::Protocol, &sections.written.protocol);
    let exclude = root.get("exclude").map_or_else(|| json!([]), Node::to_value);
    let written = vec![
        ("environments".into(), environments),
        ("agents".into(), agents),
        ("protocol".into(), Section::Plain(protocol)),
        ("seeds".into(), Section::Plain(seeds(plan))),
        ("sweep".into(), sweep(root, sections)),
        ("exclude".into(), Section::Plain(exclude)),
        ("overrides".into(), Section::Plain(overrides(root, sections))),
    ];
    let entries = sections.written.prepared.iter().enumerate();
    let prepared = entries.map(|(index, entry)| (entry.name.clone(), prepared(index, entry, &mut full)));
    let prepared = ("prepare", prepared.collect());
    let searches = sections.written.searches.iter().zip(sections.searches);
    let searches: Vec<_> = searches
        .map(|(named, it)| (named.name.clone(), search(named, it)))
        .collect();
    let searches = (!searches.is_empty()).then(|| ("search".into(), Section::Searches(searches)));
    let plain = |name: &str| Some((name.into(), Section::Plain(root.get(name)?.to_value())));
    let judged_by = ["success", "paper_budget", "floors", "relevance"];
    let named = [prepared].into_iter().chain(named_sections(root, plays));
    let named = named.filter(|(_, entries)| !entries.is_empty());
    let named = named.map(|(name, entries)| (name.into(), Section::Named(entries)));
    written
        .into_iter()
        .chain(judged_by.into_iter().filter_map(plain))
        .chain(named)
        .chain(searches)
        .collect()
}

/// Entries with their names, in the order of the study.
type Entries = Vec<(String, Value)>;

/// The sections of named entries besides environments and agents; without entries where a study has none.
fn named_sections(root: &Node, plays: &[Play]) -> [(&'static str, Entries); 2] {
    let imported = root.get("imported").map_or(&[][..], Node::entries).iter();
    let imported = imported.map(|entry| (entry.key.clone(), entry.value.to_value()));
    let plays = plays.iter().map(|it| (it.name.clone(), play(it)));
    [("imported", imported.collect()), ("cross_play", plays.collect())]
}

fn seeds(plan: &SeedPlan) -> Value {
    let first = plan.seeds.first().copied().unwrap_or_default();
    let in_order = (first..).zip(&plan.seeds).all(|(next, seed)| next == *seed);
    match (&plan.design, plan.seeds.as_slice()) {
        (Some(design), _) => {
            let looks = design.looks();
            let mut written = json!({ "min": looks[0], "max": design.most(), "looks": looks });
            if first > 0 {
                written["first"] = json!(first);
            }
            written
        }
        (None, seeds) if in_order && first == 0 => json!(seeds.len()),
        (None, [first, _, .., last]) if in_order => json!(format!("{first}-{last}")),
        (None, seeds) => json!(seeds),
    }
}

/// An entry of `prepare`; what it takes from the study stays a name.
fn prepared(index: usize, entry: &Prepared, full: &mut impl FnMut(Target, &Named) -> Value) -> Value {
    let mut value = Map::new();
    for kind in PartKind::ALL {
        let chosen = match (kind, &entry.environment, &entry.agent) {
            (PartKind::Environment, Chosen::OfStudy(name, _), _)
            | (PartKind::Agent, _, Chosen::OfStudy(name, _)) => json!(name),
            _ => match entry.own(kind) {
                Some(named) => full(Target::Prepared(index, kind), named),
                None => continue,
            },
        };
        value.insert(kind.name().into(), chosen);
    }
    Value::Object(value)
}

/// A search without keys that a profile or an option fixed.
fn search(named: &Named, searched: &Searched<'_>) -> WrittenSearch {
    let over = named.config.get("over").map_or(&[][..], Node::entries).iter();
    let is_searched = |entry: &&Entry| searched.search.keys.iter().any(|(key, _)| *key == entry.key);
    let mut rest = named.config.to_value();
    rest.as_object_mut().and_then(|rest| rest.remove("over"));
    WrittenSearch {
        over: over
            .filter(is_searched)
            .map(|entry| (entry.key.clone(), entry.value.to_value()))
            .collect(),
        rest,
    }
}

fn play(play: &Play) -> Value {
    let roles: Map<String, Value> = play
        .roles
        .iter()
        .map(|(role, seats)| (role.clone(), json!(seats)))
        .collect();
    let agents: Vec<&str> = play.players.iter().map(|player| player.name.as_str()).collect();
    json!({
        "environment": play.environment, "roles": roles, "agents": agents, "episodes": play.episodes,
        "pairs": play.pairs,
        "environment_config": play.environment_config.to_value(),
    })
}

/// The sweep without keys that a profile or an option fixed.
fn sweep(root: &Node, sections: &Sections<'_>) -> Section {
    let kept = |entry: &&Entry| {
        let mut keys = sections.dimensions.iter().flat_map(|dimension| &dimension.keys);
        keys.any(|key| key.text == entry.key)
    };
    let entries = root
        .get("sweep")
        .map_or(&[][..], Node::entries)
        .iter()
        .filter(kept);
    Section::Named(
        entries
            .map(|entry| (entry.key.clone(), entry.value.to_value()))
            .collect(),
    )
}

/// The overrides without keys that a profile or an option fixed.
fn overrides(root: &Node, sections: &Sections<'_>) -> Value {
    let items = root
        .get("overrides")
        .map_or(&[][..], Node::items)
        .iter()
        .zip(sections.overrides);
    let written = items.map(|(item, kept)| {
        let mut value = item.to_value();
        value["set"] = kept
            .set
            .iter()
            .map(|(text, _, node)| (text.clone(), node.to_value()))
            .collect();
        value
    });
    written.collect()
}

/// Leaves out what is not given: exactly one kind of a table or figure is, and the others would be noise.
fn given(value: Value) -> Value {
    match value {
        Value::Object(map) => {
            let kept = map.into_iter().filter(|(_, value)| !value.is_null());
            Value::Object(kept.map(|(key, value)| (key, given(value))).collect())
        }
        Value::Array(items) => Value::Array(items.into_iter().map(given).collect()),
        other => other,
    }
}

/// The same table with the files of its published curves named relative to `folder`.
fn table_from(spec: &TableSpec, folder: &Path) -> TableSpec {
    let mut spec = spec.clone();
    spec.published_curves
        .iter_mut()
        .for_each(|curve| curve.file = name_written_out(folder, &curve.file));
    spec
}

/// The same figure with the files of its published curves named relative to `folder`.
fn files_from(spec: &FigureSpec, folder: &Path) -> FigureSpec {
    let mut spec = spec.clone();
    spec.published_curves_mut()
        .iter_mut()
        .for_each(|curve| curve.file = name_written_out(folder, &curve.file));
    spec
}

/// Names data files relative to `folder`, whichever folder they are named from now.
fn relocate(value: Value, key: &str, from: &Path, folder: &Path) -> Value {
    let is_file = key == "file" || key.ends_with(".file");
    match value {
        Value::String(text) if is_file && !text.is_empty() => {
            json!(name_written_out(folder, &from.join(text)).display().to_string())
        }
        Value::Array(items) => Value::Array(
            items
                .into_iter()
                .map(|item| relocate(item, key, from, folder))
                .collect(),
        ),
        Value::Object(map) => {
            // The generators of a sweep stand between the key and its values.
            let name = |inner: &str| {
                if is_file {
                    key.to_string()
                } else {
                    inner.to_string()
                }
            };
            Value::Object(
                map.into_iter()
                    .map(|(inner, value)| (inner.clone(), relocate(value, &name(&inner), from, folder)))
                    .collect(),
            )
        }
        other => other,
    }
}

/// The text of a document with these sections.
fn text(sections: &[(String, Section)]) -> Result<String, Error> {
    let options = serde_saphyr::ser_options! { compact_list_indent: false, prefer_block_scalars: false };
    let refused = |source: serde_saphyr::ser_error::Error| Error::Render {
        what: "resolved study".into(),
        problem: source.to_string(),
    };
    serde_saphyr::to_string_with_options(&Document(sections), options).map_err(refused)
}

/// Sections in their order.
struct Document<'a>(&'a [(String, Section)]);

impl Serialize for Document<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.0.iter().map(|(key, section)| (key, section)))
    }
}

impl Serialize for Section {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Section::Plain(value) => Sorted(value).serialize(serializer),
            Section::Named(pairs) => {
                serializer.collect_map(pairs.iter().map(|(name, value)| (name, Sorted(value))))
            }
            Section::Searches(pairs) => {
                serializer.collect_map(pairs.iter().map(|(name, search)| (name, search)))
            }
        }
    }
}

impl Serialize for WrittenSearch {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        map.serialize_entry("over", &InOrder(&self.over))?;
        for (key, value) in self.rest.as_object().into_iter().flatten() {
            map.serialize_entry(key, &Sorted(value))?;
        }
        map.end()
    }
}

/// Entries in their order.
struct InOrder<'a>(&'a Entries);

impl Serialize for InOrder<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.0.iter().map(|(key, value)| (key, Sorted(value))))
    }
}

/// A value whose mappings are in the order of their keys. Lists of numbers and words stand on one line.
struct Sorted<'a>(&'a Value);

impl Serialize for Sorted<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self.0 {
            Value::Object(map) => {
                let pairs: BTreeMap<&String, Sorted<'_>> =
                    map.iter().map(|(key, value)| (key, Sorted(value))).collect();
                serializer.collect_map(pairs)
            }
            Value::Array(items) if items.iter().all(is_word) => FlowSeq(items).serialize(serializer),
            Value::Array(items) => serializer.collect_seq(items.iter().map(Sorted)),
            scalar => scalar.serialize(serializer),
        }
    }
}

/// True for what is read at a glance: numbers and single words.
fn is_word(value: &Value) -> bool {
    match value {
        Value::Array(_) | Value::Object(_) => false,
        Value::String(text) => !text.contains(char::is_whitespace),
        _ => true,
    }
}
