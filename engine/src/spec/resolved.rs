//! A study with every default written out.

use super::{Study, cells::Sections, config, written::Named};
use crate::document::{Entry, Node};
use serde_json::{Value, json};
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
    let mut sections: Vec<(String, Value)> = vec![("study".into(), json!(study.name))];
    sections.extend([("title", &study.title), ("source", &study.source)].map(|(key, text)| (key.into(), json!(text))));
    sections.push(("departures".into(), json!(study.departures)));
    // In the resolved configs files are named from the current folder, in sweeps and overrides from the study's.
    let relocated = study.resolved.iter().map(|(key, value)| {
        let from = if ["sweep", "overrides"].contains(&key.as_str()) { study.folder.as_path() } else { Path::new("") };
        (key.clone(), relocate(value.clone(), key, from, folder))
    });
    sections.extend(relocated);
    let named = |section: Vec<(String, Value)>| json!({ "": section });
    let tables = study.tables.iter().map(|(name, spec)| (name.clone(), given(json!(spec)))).collect();
    let figures = study.figures.iter().map(|(name, spec)| (name.clone(), given(json!(spec)))).collect();
    sections.extend([("tables".to_string(), named(tables)), ("figures".to_string(), named(figures))]);
    sections.push(("claims".into(), given(json!(study.claims))));
    let mut out = String::new();
    for (key, value) in &sections {
        entry(&mut out, 0, key, value);
    }
    out
}

/// The sections that trials are made of, in the order of a study, with all defaults.
///
/// A mapping whose order matters is a list of pairs under the empty key.
pub fn sections(root: &Node, sections: &Sections<'_>, seeds: &[u64]) -> Vec<(String, Value)> {
    let mut files = config::Files::new(sections.folder);
    let mut full = |target, named: &Named| {
        let plugin = sections.plugin(target);
        let part = plugin.and_then(|plugin| config::resolve(&plugin, &named.config, &mut files, sections.sources).ok());
        // A config that is complete only with a sweep or an override stays as it is written.
        json!({ named.plugin.clone(): part.map_or_else(|| named.config.to_value(), |part| part.config) })
    };
    let mut parts = |list: &[Named], target: fn(usize) -> super::path::Target| {
        let pairs = list.iter().enumerate().map(|(index, named)| json!([named.name, full(target(index), named)]));
        json!({ "": pairs.collect::<Vec<_>>() })
    };
    let environments = parts(&sections.written.environments, super::path::Target::Environment);
    let agents = parts(&sections.written.agents, super::path::Target::Agent);
    let protocol = full(super::path::Target::Protocol, &sections.written.protocol);
    let counted = seeds.iter().enumerate().all(|(index, seed)| index as u64 == *seed);
    let seeds = if counted { json!(seeds.len()) } else { json!(seeds) };
    let list = |key: &str| root.get(key).map_or_else(|| json!([]), Node::to_value);
    vec![
        ("environments".into(), environments),
        ("agents".into(), agents),
        ("protocol".into(), protocol),
        ("seeds".into(), seeds),
        ("sweep".into(), sweep(root, sections)),
        ("exclude".into(), list("exclude")),
        ("overrides".into(), list("overrides")),
    ]
}

/// The sweep without keys that a profile or an option fixed.
fn sweep(root: &Node, sections: &Sections<'_>) -> Value {
    let kept = |entry: &&Entry| {
        let mut keys = sections.dimensions.iter().flat_map(|dimension| &dimension.keys);
        keys.any(|key| key.text == entry.key)
    };
    let entries = root.get("sweep").map_or(&[][..], Node::entries).iter().filter(kept);
    json!({ "": entries.map(|entry| json!([entry.key, entry.value.to_value()])).collect::<Vec<_>>() })
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

/// Names data files relative to `folder`, whichever folder they are named from now.
fn relocate(value: Value, key: &str, from: &Path, folder: &Path) -> Value {
    let is_file = key == "file" || key.ends_with(".file");
    match value {
        Value::String(text) if is_file && !text.is_empty() => json!(way(folder, &from.join(text)).display().to_string()),
        Value::Array(items) => match items.as_slice() {
            // A pair of an ordered mapping.
            [Value::String(name), value] if !is_file => json!([name, relocate(value.clone(), name, from, folder)]),
            _ => Value::Array(items.into_iter().map(|item| relocate(item, key, from, folder)).collect()),
        },
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
    match pairs(value) {
        Some(pairs) if pairs.is_empty() => out.push_str(" {}\n"),
        Some(pairs) => {
            out.push('\n');
            pairs.iter().for_each(|(key, value)| entry(out, indent + 2, key, value));
        }
        None => match value.as_array().filter(|items| items.iter().any(|item| item.is_object() || item.is_array())) {
            Some(items) => {
                out.push('\n');
                for item in items {
                    let _ = writeln!(out, "{:width$}- {}", "", flow(item), width = indent + 2);
                }
            }
            None => {
                let _ = writeln!(out, " {}", flow(value));
            }
        },
    }
}

/// The pairs of a mapping: in order where it is a list under the empty key, else sorted.
fn pairs(value: &Value) -> Option<Vec<(&str, &Value)>> {
    let map = value.as_object()?;
    if let Some(Value::Array(list)) = map.get("") {
        return Some(list.iter().filter_map(|pair| Some((pair.get(0)?.as_str()?, pair.get(1)?))).collect());
    }
    let mut pairs: Vec<(&str, &Value)> = map.iter().map(|(key, value)| (key.as_str(), value)).collect();
    pairs.sort_by_key(|(key, _)| *key);
    Some(pairs)
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
