//! The chosen profile and the options of the command line, written into the study.
//!
//! Keys of environments, agents, protocol, plays, searches, entries of `prepare` and seeds are set in these
//! parts, where a sweep heeds them. Keys of every other section are set in the document, before it is checked.

use super::{
    Options,
    path::{self, KeyPath},
    section,
    written::Written,
};
use crate::{
    diagnostic::{Diagnostic, Sources, Span, suggest},
    document::{self, Entry, Node},
};
use serde_json::{Value, json};

/// Applies the profile, then `--set` in order, then `--seeds`. All profiles are checked, used or not.
///
/// Returns the keys that were set, which no sweep varies any more, and what is wrong.
pub fn apply<'a>(
    root: &Node,
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
            let at = format!("profiles.{}.{}", profile.key, entry.key);
            match value_at(entry, &at, written, schema, sources) {
                Ok(path) if chosen => fix(path, entry.value.clone(), written, &mut fixed),
                Ok(_) => {}
                Err(errors) => found.extend(errors),
            }
        }
    }
    found.extend(unknown_profile(options, profiles, sources));
    let of_parts = |set: &&String| section_of(set, written, schema).is_none();
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
    written.set(&path, value);
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

fn unknown_profile(options: &Options, profiles: &[Entry], sources: &mut Sources) -> Option<Diagnostic> {
    let wanted = options.profile.as_deref()?;
    if profiles.iter().any(|profile| profile.key == wanted) {
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

/// Writes what `--set` says of sections that are no parts of trials into the document. Returns what names
/// nothing; whether values fit is seen when the document is checked.
pub fn lay_sections(
    root: &mut Node,
    schema: &Value,
    sources: &mut Sources,
    options: &Options,
) -> Vec<Diagnostic> {
    let written = Written::read(root);
    let of_sections = |set: &&String| section_of(set, &written, schema).is_some();
    let sets: Vec<&String> = options.sets.iter().filter(of_sections).collect();
    let errors = sets.into_iter().map(|set| {
        let entry = entry(set, sources)?;
        section::set(root, &entry, schema, sources)
    });
    errors.filter_map(Result::err).flatten().collect()
}

/// The section that an option sets a key of; `None` for the parts of trials, and for what is unknown.
fn section_of<'a>(set: &'a str, written: &Written, schema: &Value) -> Option<&'a str> {
    const PARTS: [&str; 7] = [
        "environments",
        "agents",
        "protocol",
        "prepare",
        "cross_play",
        "search",
        "seeds",
    ];
    const TEXT: [&str; 2] = ["include", "blocks"];
    let (first, _) = set.split_once(['.', '='])?;
    let first = first.trim();
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
                written.set(&path, value);
            }
            wrong
        }
        Err(errors) => errors,
    }
}
