//! The chosen profile and the options of the command line, written into the study.
//!
//! Keys of environments, agents, protocol, plays, searches, entries of `prepare` and seeds are set in these parts,
//! which a sweep respects. Keys of every other section, including the sweep, are set in the document before it is
//! checked.

use super::{
    first_texts::FirstTexts,
    json_schema::check_structure,
    known_agents::KnownAgents,
    path::{self, KeyPath},
    section,
    sections::StudyText,
    sweep,
    written::Written,
};
use analysis::search::Progress;
use document::{
    Entry, Node,
    diagnostic::{Diagnostic, Sources, Span, suggest},
};
use execution::store::Announcements;
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// Options of a command line that change a study.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Options {
    /// Name of the profile to use; `None` for the study as it is written.
    pub profile: Option<String>,
    /// `PATH=VALUE` words, applied after the profile, in order.
    pub sets: Vec<String>,
    /// Number of seeds that replaces the study's own.
    pub seeds: Option<u64>,
    /// Progress of the searches, by name; a search without an entry begins.
    pub searches: BTreeMap<String, Progress>,
    /// Announcements of environments that were tried out before; every environment is tried out if absent.
    pub announced: Option<Announcements>,
    /// Agents that are not built again.
    pub known: KnownAgents,
    /// Files that are not read again.
    pub texts: FirstTexts,
}

/// Applies the profile, then `--set` in order, then `--seeds`. All profiles are checked, used or not.
///
/// Returns the keys that were set, which no sweep varies any more, and the mistakes.
pub fn apply<'a>(
    root: &Node,
    text: &StudyText,
    written: &mut Written,
    schema: &'a Value,
    sources: &mut Sources,
    options: &Options,
) -> (Vec<KeyPath<'a>>, Vec<Diagnostic>) {
    let (mut fixed, mut found) = (Vec::new(), Vec::new());
    let profiles = root.get("profiles").map_or(&[][..], Node::entries);
    for profile in profiles {
        let chosen = options.profile.as_deref() == Some(&profile.key);
        for entry in profile.value.entries() {
            if is_of_section(entry, written, schema) {
                continue;
            }
            let at = format!("profiles.{}.{}", profile.key, entry.key);
            match value_at(entry, &at, written, schema, sources) {
                Ok(path) if chosen => fix(path, entry.value.clone(), written, &mut fixed),
                Ok(_) => {}
                Err(errors) => found.extend(errors),
            }
        }
    }
    found.extend(unknown_profile(options, text, profiles, sources));
    let of_parts = |set: &&String| section_of_option(set, written, schema).is_none();
    let sets: Vec<&String> = options.sets.iter().filter(of_parts).collect();
    for set in sets {
        match option(set, written, schema, sources) {
            Ok((path, value)) => fix(path, value, written, &mut fixed),
            Err(errors) => found.extend(errors),
        }
    }
    if let Some(seeds) = options.seeds {
        found.extend(seeds_option(seeds, written, schema, sources));
    }
    (fixed, found)
}

fn fix<'a>(path: KeyPath<'a>, value: Node, written: &mut Written, fixed: &mut Vec<KeyPath<'a>>) {
    path.set(written, &value);
    fixed.push(path);
}

fn value_at<'a>(
    entry: &Entry,
    at: &str,
    written: &Written,
    schema: &'a Value,
    sources: &Sources,
) -> Result<KeyPath<'a>, Vec<Diagnostic>> {
    let path = path::find(&entry.key, entry.key_span, at, written, schema, sources)?;
    let wrong = path.check(&entry.value, at, sources);
    if wrong.is_empty() { Ok(path) } else { Err(wrong) }
}

fn unknown_profile(
    options: &Options,
    text: &StudyText,
    profiles: &[Entry],
    sources: &mut Sources,
) -> Option<Diagnostic> {
    let wanted = options.profile.as_deref()?;
    let known = text.profiles.0.as_ref();
    if known.is_some_and(|known| known.contains_key(wanted)) {
        return None;
    }
    let source = sources.add_option(&format!("--profile {wanted}"));
    let span = Span {
        source,
        line: 1,
        column: 11,
        length: wanted.chars().count(),
    };
    let error = sources.error(span, "", format!("the study has no profile `{wanted}`"));
    Some(if profiles.is_empty() {
        error.help("it has none at all: write them under `profiles`")
    } else {
        error.help(suggest(
            wanted,
            profiles.iter().map(|profile| profile.key.as_str()),
        ))
    })
}

/// Writes the values that the profile and `--set` give to sections outside the parts of trials into the document.
/// Returns paths that name nothing; the check of the document reports values that do not fit.
pub fn lay_sections(
    root: &mut Node,
    schema: &Value,
    sources: &mut Sources,
    options: &Options,
) -> Vec<Diagnostic> {
    let written = Written::read(root);
    let mut found = lay_profiles(root, &written, schema, sources, options);
    let of_sections = |set: &&String| section_of_option(set, &written, schema).is_some();
    let sets: Vec<&String> = options.sets.iter().filter(of_sections).collect();
    let errors = sets.into_iter().map(|set| {
        let entry = entry(set, sources)?;
        set_section(root, &entry, schema, sources)
    });
    found.extend(errors.filter_map(Result::err).flatten());
    found
}

/// Writes the values of the chosen profile into sections. Values of other profiles are written into a copy, so that
/// they are checked too.
fn lay_profiles(
    root: &mut Node,
    written: &Written,
    schema: &Value,
    sources: &Sources,
    options: &Options,
) -> Vec<Diagnostic> {
    let mut found = Vec::new();
    let profiles = root.get("profiles").map_or(&[][..], Node::entries).to_vec();
    for profile in profiles {
        let entries = profile.value.entries().iter();
        let entries: Vec<&Entry> = entries
            .filter(|entry| is_of_section(entry, written, schema))
            .collect();
        if options.profile.as_deref() == Some(&profile.key) {
            found.extend(lay_entries(root, &entries, schema, sources));
        } else if !entries.is_empty() {
            let mut copy = root.clone();
            found.extend(lay_entries(&mut copy, &entries, schema, sources));
            let before = problems(root, written, schema, sources);
            let after = problems(&copy, written, schema, sources);
            found.extend(after.into_iter().filter(|problem| !before.contains(problem)));
        }
    }
    found
}

/// Whether an entry of a profile sets a key of a section. Profiles do not change profiles.
fn is_of_section(entry: &Entry, written: &Written, schema: &Value) -> bool {
    section_of(&entry.key, written, schema).is_some_and(|section| section != "profiles")
}

fn lay_entries(root: &mut Node, entries: &[&Entry], schema: &Value, sources: &Sources) -> Vec<Diagnostic> {
    let errors = entries
        .iter()
        .filter_map(|entry| set_section(root, entry, schema, sources).err());
    errors.flatten().collect()
}

/// Sets a key of a section. Rounds of `confirm` belong to the study as it is written; with a profile or an option it is
/// another study, which confirms nothing.
fn set_section(
    root: &mut Node,
    entry: &Entry,
    schema: &Value,
    sources: &Sources,
) -> Result<(), Vec<Diagnostic>> {
    if entry.key.split('.').next() == Some("confirm") {
        let message = "rounds of `confirm` are fixed in the file, and no profile or option changes them";
        let error = sources.error(entry.key_span, &entry.key, message);
        return Err(vec![error.help("write the round into the study itself")]);
    }
    section::set(root, entry, schema, sources)
}

/// Mistakes in a document and its sweep.
fn problems(root: &Node, written: &Written, schema: &Value, sources: &Sources) -> Vec<Diagnostic> {
    let mut found = check_structure(root, schema, sources);
    found.extend(
        sweep::read(root, &StudyText::read(root).sweep, written, schema, sources, &[])
            .err()
            .into_iter()
            .flatten(),
    );
    found
}

/// Like [`section_of`], for an option; `None` if it has no value.
fn section_of_option<'a>(set: &'a str, written: &Written, schema: &Value) -> Option<&'a str> {
    let (path, _) = set.split_once(['.', '='])?;
    section_of(path, written, schema)
}

/// The section that a path leads into; `None` for the parts of trials and for unknown paths.
fn section_of<'a>(path: &'a str, written: &Written, schema: &Value) -> Option<&'a str> {
    const PARTS: [&str; 7] = [
        "environments",
        "agents",
        "protocol",
        "prepare",
        "cross_play",
        "tune",
        "seeds",
    ];
    const TEXT: [&str; 2] = ["include", "blocks"];
    let first = path.split('.').next()?.trim();
    let is_part = PARTS.contains(&first) || written.names().contains(&first);
    (!is_part && !TEXT.contains(&first) && schema["properties"].get(first).is_some()).then_some(first)
}

fn option<'a>(
    set: &str,
    written: &Written,
    schema: &'a Value,
    sources: &mut Sources,
) -> Result<(KeyPath<'a>, Node), Vec<Diagnostic>> {
    let entry = entry(set, sources)?;
    let path = value_at(&entry, &entry.key, written, schema, sources)?;
    Ok((path, entry.value))
}

/// The path and the value of an option, with their places on the command line.
fn entry(set: &str, sources: &mut Sources) -> Result<Entry, Vec<Diagnostic>> {
    let source = sources.add_option(&format!("--set {set}"));
    let word = |column: usize, text: &str| Span {
        source,
        line: 1,
        column,
        length: text.chars().count().max(1),
    };
    let (key, text) = match set.split_once('=') {
        Some((key, text)) if !text.trim().is_empty() => (key.trim(), text),
        _ => {
            let error = sources.error(word(7, set), "", "`--set` takes a path and a value");
            return Err(vec![error.help(
                "write `--set PATH=VALUE`, for example `--set protocol.steps=1000`",
            )]);
        }
    };
    let before = 7 + set.split('=').next().map_or(0, |key| key.chars().count()) + 1;
    let value = document::parse_from(sources, word(before, text), text)?;
    Ok(Entry {
        key: key.into(),
        key_span: word(7, key),
        value,
    })
}

fn seeds_option(seeds: u64, written: &mut Written, schema: &Value, sources: &mut Sources) -> Vec<Diagnostic> {
    let text = seeds.to_string();
    let source = sources.add_option(&format!("--seeds {text}"));
    let span = Span {
        source,
        line: 1,
        column: 9,
        length: text.len(),
    };
    let value = Node::scalar(span, json!(seeds));
    match path::find("seeds", span, "seeds", written, schema, sources) {
        Ok(path) => {
            let wrong = path.check(&value, "seeds", sources);
            if wrong.is_empty() {
                path.set(written, &value);
            }
            wrong
        }
        Err(errors) => errors,
    }
}
