//! A study with every default written out.

use super::{
    checked_study::Study,
    imported_runs,
    relative_path::name_written_out,
    resolved::{Entries, Section, WrittenSearch},
};
use contract::Error;
use execution::limits::Limits;
use presentation::{figure::FigureSpec, table::TableSpec};
use serde::{Serialize, Serializer, ser::SerializeMap};
use serde_json::{Value, json};
use serde_saphyr::FlowSeq;
use std::{collections::BTreeMap, path::Path};

/// The study as YAML with every default written out, to be stored in `folder`; data files are named relative to that
/// folder.
///
/// The chosen profile and the options of the command line are part of it; profiles and presets are not. It
/// loads to the same trials, and other readers find the same values in it.
///
/// # Errors
/// [`Error::Render`] if a value has no form in YAML.
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
    sections.push(("deviations".into(), Section::Plain(json!(study.deviations))));
    // Resolved configs name files relative to the current folder; sweeps and overrides name them relative to the
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
        .map(|(name, spec)| (name.clone(), given(figure_from(spec, folder))))
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
/// [`Error::Render`] if a value has no form in YAML.
pub fn section_yaml(name: &str, value: Value) -> Result<String, Error> {
    text(&[(name.into(), Section::Plain(value))])
}

/// Leaves out absent values: a table or figure has exactly one kind, and the empty others would be noise.
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
fn figure_from(spec: &FigureSpec, folder: &Path) -> Value {
    let mut value = json!(spec);
    if let Some(published) = value[spec.kind.name].get_mut("published") {
        *published = relocate(published.take(), "", Path::new(""), folder);
    }
    value
}

/// Names data files relative to `folder`; they are named relative to `from` before.
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
            Section::Plain(value) => SortedValue(value).serialize(serializer),
            Section::Named(pairs) => {
                serializer.collect_map(pairs.iter().map(|(name, value)| (name, SortedValue(value))))
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
        map.serialize_entry("over", &OrderedEntries(&self.over))?;
        for (key, value) in self.rest.as_object().into_iter().flatten() {
            map.serialize_entry(key, &SortedValue(value))?;
        }
        map.end()
    }
}

/// Entries in their order.
struct OrderedEntries<'a>(&'a Entries);

impl Serialize for OrderedEntries<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.0.iter().map(|(key, value)| (key, SortedValue(value))))
    }
}

/// A value whose mappings are in the order of their keys. Lists of numbers and words stand on one line.
struct SortedValue<'a>(&'a Value);

impl Serialize for SortedValue<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self.0 {
            Value::Object(map) => {
                let pairs: BTreeMap<&String, SortedValue<'_>> =
                    map.iter().map(|(key, value)| (key, SortedValue(value))).collect();
                serializer.collect_map(pairs)
            }
            Value::Array(items) if items.iter().all(is_word) => FlowSeq(items).serialize(serializer),
            Value::Array(items) => serializer.collect_seq(items.iter().map(SortedValue)),
            scalar => scalar.serialize(serializer),
        }
    }
}

/// Whether a value is a number or a single word, which may share a line with others.
fn is_word(value: &Value) -> bool {
    match value {
        Value::Array(_) | Value::Object(_) => false,
        Value::String(text) => !text.contains(char::is_whitespace),
        _ => true,
    }
}
