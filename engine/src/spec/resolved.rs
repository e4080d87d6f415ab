//! A study with every default written out.

use super::{Study, cells::Sections, config, cross_play::Play, path::Target, seeds::SeedPlan, written::Named};
use crate::{
    document::{Entry, Node},
    figure::FigureSpec,
    limits::Limits,
    table::TableSpec,
};
use serde_json::{Map, Value, json};
use std::{
    fmt::Write,
    path::{Component, Path, PathBuf},
};

/// The study as YAML with every default written out, to be stored in `folder`: data files are named relative to it.
///
/// The chosen profile and the options of the command line are part of it; profiles and presets are not. It loads to the
/// same trials.
#[must_use]
pub fn resolved_yaml(study: &Study, folder: &Path) -> String {
    let texts = [("study", &study.name), ("title", &study.title), ("source", &study.source)];
    let mut sections: Vec<(String, Section)> = texts.map(|(key, text)| (key.into(), Section::Plain(json!(text)))).into();
    sections.push(("departures".into(), Section::Plain(json!(study.departures))));
    // In the resolved configs files are named from the current folder, in sweeps and overrides from the study's.
    let relocated = study.resolved.iter().map(|(key, section)| {
        let from =
            if ["sweep", "overrides", "cross_play"].contains(&key.as_str()) { study.folder.as_path() } else { Path::new("") };
        (key.clone(), section.clone().map(|key, value| relocate(value, key, from, folder)))
    });
    sections.extend(relocated);
    let tables = study.tables.iter().map(|(name, spec)| (name.clone(), given(json!(table_from(spec, folder))))).collect();
    let figures = study.figures.iter().map(|(name, spec)| (name.clone(), given(json!(files_from(spec, folder))))).collect();
    sections.extend([("tables".to_string(), Section::Named(tables)), ("figures".to_string(), Section::Named(figures))]);
    sections.push(("claims".into(), Section::Plain(given(json!(study.claims)))));
    if study.limits != Limits::default() {
        sections.push(("limits".into(), Section::Plain(json!(study.limits))));
    }
    let mut out = String::new();
    for (key, section) in &sections {
        match section {
            Section::Plain(value) => entry(&mut out, 0, key, value),
            Section::Named(pairs) => {
                let _ = write!(out, "{key}:");
                mapping(&mut out, 0, pairs.iter().map(|(name, value)| (name.as_str(), value)).collect());
            }
        }
    }
    out
}

/// A section of a study.
#[derive(Debug, Clone, PartialEq)]
pub enum Section {
    /// A value whose keys are sorted.
    Plain(Value),
    /// A mapping whose order is the study's.
    Named(Vec<(String, Value)>),
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
        }
    }
}

/// The sections that trials are made of, in the order of a study, with all defaults.
pub fn sections(root: &Node, sections: &Sections<'_>, plan: &SeedPlan, plays: &[Play]) -> Vec<(String, Section)> {
    let mut files = config::Files::new(sections.folder);
    let mut full = |target, named: &Named| {
        let plugin = sections.plugin(target);
        let part = plugin.and_then(|plugin| config::resolve(&plugin, &named.config, &mut files, sections.sources).ok());
        // A config that is complete only with a sweep or an override stays as it is written.
        json!({ named.plugin.clone(): part.map_or_else(|| named.config.to_value(), |part| (*part.config).clone()) })
    };
    let mut parts = |list: &[Named], target: fn(usize) -> Target| {
        let pairs = list.iter().enumerate().map(|(index, named)| (named.name.clone(), full(target(index), named)));
        Section::Named(pairs.collect())
    };
    let environments = parts(&sections.written.environments, Target::Environment);
    let agents = parts(&sections.written.agents, Target::Agent);
    let protocol = full(Target::Protocol, &sections.written.protocol);
    let counted = plan.seeds.iter().enumerate().all(|(index, seed)| index as u64 == *seed);
    let seeds = match &plan.design {
        Some(design) => json!({ "min": design.looks()[0], "max": design.most(), "looks": design.looks() }),
        None if counted => json!(plan.seeds.len()),
        None => json!(plan.seeds),
    };
    let exclude = root.get("exclude").map_or_else(|| json!([]), Node::to_value);
    let mut all = vec![
        ("environments".into(), environments),
        ("agents".into(), agents),
        ("protocol".into(), Section::Plain(protocol)),
        ("seeds".into(), Section::Plain(seeds)),
        ("sweep".into(), sweep(root, sections)),
        ("exclude".into(), Section::Plain(exclude)),
        ("overrides".into(), Section::Plain(overrides(root, sections))),
    ];
    if let Some(success) = root.get("success") {
        all.push(("success".into(), Section::Plain(success.to_value())));
    }
    if !plays.is_empty() {
        all.push(("cross_play".into(), Section::Named(plays.iter().map(|it| (it.name.clone(), play(it))).collect())));
    }
    all
}

fn play(play: &Play) -> Value {
    let roles: Map<String, Value> = play.roles.iter().map(|(role, seats)| (role.clone(), json!(seats))).collect();
    let agents: Vec<&str> = play.players.iter().map(|player| player.name.as_str()).collect();
    json!({
        "environment": play.environment, "roles": roles, "agents": agents, "episodes": play.protocol.episodes,
        "environment_config": play.environment_config.to_value(),
    })
}

/// The sweep without keys that a profile or an option fixed.
fn sweep(root: &Node, sections: &Sections<'_>) -> Section {
    let kept = |entry: &&Entry| {
        let mut keys = sections.dimensions.iter().flat_map(|dimension| &dimension.keys);
        keys.any(|key| key.text == entry.key)
    };
    let entries = root.get("sweep").map_or(&[][..], Node::entries).iter().filter(kept);
    Section::Named(entries.map(|entry| (entry.key.clone(), entry.value.to_value())).collect())
}

/// The overrides without keys that a profile or an option fixed.
fn overrides(root: &Node, sections: &Sections<'_>) -> Value {
    let items = root.get("overrides").map_or(&[][..], Node::items).iter().zip(sections.overrides);
    let written = items.map(|(item, kept)| {
        let mut value = item.to_value();
        value["set"] = kept.set.iter().map(|(text, _, node)| (text.clone(), node.to_value())).collect();
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
    spec.published_curves.iter_mut().for_each(|curve| curve.file = way(folder, &curve.file));
    spec
}

/// The same figure with the files of its published curves named relative to `folder`.
fn files_from(spec: &FigureSpec, folder: &Path) -> FigureSpec {
    let mut spec = spec.clone();
    spec.published_curves_mut().for_each(|curve| curve.file = way(folder, &curve.file));
    spec
}

/// Names data files relative to `folder`, whichever folder they are named from now.
fn relocate(value: Value, key: &str, from: &Path, folder: &Path) -> Value {
    let is_file = key == "file" || key.ends_with(".file");
    match value {
        Value::String(text) if is_file && !text.is_empty() => json!(way(folder, &from.join(text)).display().to_string()),
        Value::Array(items) => Value::Array(items.into_iter().map(|item| relocate(item, key, from, folder)).collect()),
        Value::Object(map) => {
            // The generators of a sweep stand between the key and its values.
            let name = |inner: &str| if is_file { key.to_string() } else { inner.to_string() };
            Value::Object(
                map.into_iter().map(|(inner, value)| (inner.clone(), relocate(value, &name(&inner), from, folder))).collect(),
            )
        }
        other => other,
    }
}

/// The way from one folder to a file, both seen from the current folder.
fn way(from: &Path, to: &Path) -> PathBuf {
    let absolute = |path: &Path| std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf());
    let plain = |path: PathBuf| {
        path.components().fold(Vec::new(), |mut parts: Vec<std::ffi::OsString>, part| {
            match part {
                Component::ParentDir => drop(parts.pop()),
                Component::CurDir => {}
                other => parts.push(other.as_os_str().to_os_string()),
            }
            parts
        })
    };
    let (from, to) = (plain(absolute(from)), plain(absolute(to)));
    let shared = from.iter().zip(&to).take_while(|(one, two)| one == two).count();
    let up = std::iter::repeat_n("..".into(), from.len() - shared);
    up.chain(to[shared..].iter().cloned()).collect()
}

fn entry(out: &mut String, indent: usize, key: &str, value: &Value) {
    let _ = write!(out, "{:indent$}{}:", "", scalar(&json!(key)));
    below(out, indent, value);
}

/// What stands behind a key: on the same line where it is short by nature, else indented below.
fn below(out: &mut String, indent: usize, value: &Value) {
    match value {
        Value::Object(map) => {
            let mut pairs: Vec<(&str, &Value)> = map.iter().map(|(key, value)| (key.as_str(), value)).collect();
            pairs.sort_by_key(|(key, _)| *key);
            mapping(out, indent, pairs);
        }
        Value::Array(items) if items.iter().any(|item| item.is_object() || item.is_array()) => {
            out.push('\n');
            for item in items {
                let _ = writeln!(out, "{:width$}- {}", "", flow(item), width = indent + 2);
            }
        }
        other => {
            let _ = writeln!(out, " {}", flow(other));
        }
    }
}

fn mapping(out: &mut String, indent: usize, pairs: Vec<(&str, &Value)>) {
    out.push_str(if pairs.is_empty() { " {}\n" } else { "\n" });
    pairs.into_iter().for_each(|(key, value)| entry(out, indent + 2, key, value));
}

fn flow(value: &Value) -> String {
    match value {
        Value::Array(items) => format!("[{}]", items.iter().map(flow).collect::<Vec<_>>().join(", ")),
        Value::Object(map) => {
            let mut parts: Vec<String> =
                map.iter().map(|(key, value)| format!("{}: {}", scalar(&json!(key)), flow(value))).collect();
            parts.sort();
            format!("{{{}}}", parts.join(", "))
        }
        other => scalar(other),
    }
}

/// A scalar; words that could be read as something else are quoted. JSON strings and numbers are YAML.
fn scalar(value: &Value) -> String {
    let Some(text) = value.as_str() else { return value.to_string() };
    let plain = text.starts_with(|first: char| first.is_ascii_alphabetic() || first == '_')
        && text.chars().all(|letter| letter.is_ascii_alphanumeric() || "_-./".contains(letter))
        && !["null", "true", "false", "yes", "no", "on", "off", "y", "n"].contains(&text.to_lowercase().as_str());
    if plain { text.into() } else { value.to_string() }
}
