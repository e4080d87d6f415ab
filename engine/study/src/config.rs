//! Turns the keys that a study gives into a plugin's complete config: defaults, then the preset, then the study's own
//! keys.

use contract::{Error, data_file::hash_of, part::Part, plugin::About};
use document::{
    Node, NodeKind,
    diagnostic::{Diagnostic, Sources, Span},
    reach::{Outside, Reach},
    schema_check::{At, Checker, View},
};
use imported::{PatternError, matching_sources};
use serde_json::{Value, json};
use std::{
    collections::BTreeMap,
    io::ErrorKind,
    path::{Path, PathBuf},
};

/// Largest number of files that the patterns of one plugin may name; each file is read whenever a study is.
const MOST_FILES: usize = 5_000;
const MANY_FILES: &str = "name the folder of the sources, as `lib/**/*.py`";

/// A plugin to resolve a config for.
pub struct Plugin<'a> {
    /// Registered name.
    pub name: &'a str,
    /// Defaults, schema, presets.
    pub about: &'a About,
    /// Schema of the config, as a study writes it.
    pub schema: View<'a>,
    /// Dotted path of the config in the study.
    pub at: String,
    /// Position of the plugin's name.
    pub span: Span,
}

/// Reads data files once and remembers their hashes.
#[derive(Clone)]
pub struct Files<'a> {
    folder: &'a Path,
    reach: Reach,
    /// Path and hash of each file, or the reason why it cannot be used, by its name.
    known: BTreeMap<String, Result<(PathBuf, String), FileProblem>>,
}

/// Reason why a data file cannot be used.
#[derive(Debug, Clone)]
enum FileProblem {
    Outside(Outside),
    Absent,
    Unreadable(String),
}

impl FileProblem {
    fn of(error: &Error) -> Self {
        match error {
            Error::File { source, .. } if source.kind() == ErrorKind::NotFound => Self::Absent,
            Error::File { source, .. } => Self::Unreadable(source.to_string()),
            other => Self::Unreadable(other.to_string()),
        }
    }

    /// The message about the file that `text` names.
    fn message(&self, text: &str) -> String {
        match self {
            Self::Outside(outside) => outside.to_string(),
            Self::Absent => format!("there is no data file `{text}`"),
            Self::Unreadable(why) => format!("the data file `{text}` cannot be read: {why}"),
        }
    }

    fn help(&self, text: &str, folder: &Path) -> String {
        let path = folder.join(text);
        match self {
            Self::Outside(_) => Outside::HELP.into(),
            _ => format!(
                "files are sought from the folder of the study: `{}`",
                path.display()
            ),
        }
    }
}

impl<'a> Files<'a> {
    /// Files named relative to the folder of the study.
    #[must_use]
    pub fn new(folder: &'a Path) -> Self {
        Self {
            folder,
            reach: Reach::of(folder),
            known: BTreeMap::new(),
        }
    }

    /// The path of a file by its name in the study, and the hash of its content.
    fn find(&mut self, text: &str) -> Result<(PathBuf, String), FileProblem> {
        if let Some(known) = self.known.get(text) {
            return known.clone();
        }
        let path = self.reach.find(self.folder, text).map_err(FileProblem::Outside);
        let found = path.and_then(|path| {
            let hash = hash_of(&path).map_err(|error| FileProblem::of(&error))?;
            Ok((path, hash))
        });
        self.known.insert(text.into(), found.clone());
        found
    }
}

/// The complete config of a plugin.
///
/// # Errors
/// Values that the plugin refuses, and data files that do not exist.
pub fn resolve(
    plugin: &Plugin<'_>,
    given: &Node,
    files: &mut Files<'_>,
    sources: &Sources,
) -> Result<Part, Vec<Diagnostic>> {
    let mut found = Vec::new();
    missing_files(given, &plugin.at, files, sources, &mut found);
    if !found.is_empty() {
        return Err(found);
    }
    let mut merged = merged(plugin.about, given);
    list_files(plugin, given, &mut merged, files, sources)?;
    let mut config =
        (plugin.about.resolve)(&merged).map_err(|error| refused(plugin, given, &error, sources))?;
    let mut named = BTreeMap::new();
    if let Err((pointer, text, why)) = find_files(&config, "", files, &mut named) {
        let key = pointer.trim_start_matches('/').replace('/', ".");
        if let Some(span) = locate(given, &key) {
            let (message, help) = (why.message(&text), why.help(&text, files.folder));
            return Err(vec![in_a_word(plugin, &key, (message, help), span, sources)]);
        }
        let message = format!("the data file `{text}` that `{key}` names by default cannot be read");
        return Err(vec![
            sources
                .error(plugin.span, &plugin.at, message)
                .help(format!("give `{key}` in the study")),
        ]);
    }
    // Paths are made usable from the current folder.
    for (pointer, (path, _)) in &named {
        if let Some(text) = config.pointer_mut(pointer) {
            *text = path.display().to_string().into();
        }
    }
    Ok(Part {
        files: named
            .into_iter()
            .map(|(pointer, (_, hash))| (pointer, hash))
            .collect(),
        of_machine: plugin.about.machine_keys().map(Into::into).collect(),
        ..Part::new(plugin.name, plugin.about.version, config)
    })
}

/// Replaces lists of patterns by the files that they name, if a plugin asks for files by patterns. Each file has its
/// name as seen from the study's folder.
fn list_files(
    plugin: &Plugin<'_>,
    given: &Node,
    config: &mut Value,
    files: &Files<'_>,
    sources: &Sources,
) -> Result<(), Vec<Diagnostic>> {
    for key in plugin.about.pattern_keys() {
        let Some(Value::Array(patterns)) = config.get(key) else {
            continue;
        };
        let at = format!("{}.{key}", plugin.at);
        let mut listed = serde_json::Map::new();
        for (index, pattern) in patterns.iter().enumerate() {
            let span = locate(given, &format!("{key}.{index}")).unwrap_or(plugin.span);
            let refused = |message: String, help: String| vec![sources.error(span, &at, message).help(help)];
            let Some(pattern) = pattern.as_str() else {
                return Err(refused(
                    "no name of a file, and no pattern of such".into(),
                    MANY_FILES.into(),
                ));
            };
            let found = matching_sources(&files.reach, files.folder, pattern);
            let found = found.map_err(|error| match error {
                PatternError::Outside(_) => refused(error.to_string(), elsewhere(key, pattern)),
                _ => refused(error.to_string(), MANY_FILES.into()),
            })?;
            if found.is_empty() {
                let message = format!("no file is named by `{pattern}`");
                return Err(refused(message, files_in(files.folder, pattern)));
            }
            for path in found {
                let name = path.strip_prefix(files.folder).unwrap_or(&path);
                let name = name.strip_prefix(".").unwrap_or(name).display().to_string();
                listed.insert(name.clone(), json!({ "file": name }));
            }
            if listed.len() > MOST_FILES {
                return Err(refused(
                    format!("more than {MOST_FILES} files"),
                    MANY_FILES.into(),
                ));
            }
        }
        config[key] = Value::Object(listed);
    }
    Ok(())
}

/// Advice for a name in a list that leads out of the study's folder: the list gives each file its own name, so a file
/// from elsewhere is given one.
fn elsewhere(key: &str, pattern: &str) -> String {
    let name = Path::new(pattern)
        .file_name()
        .unwrap_or_default()
        .to_string_lossy();
    let name = if name.contains('*') { "NAME".into() } else { name };
    format!(
        "move the file into that folder, or write its absolute path with a name, as `{key}: {{ {name}: {{ file: \
         /PATH/{name} }} }}`"
    )
}

/// Advice for a pattern that names no file: how the files in a folder are written, or where files are sought.
fn files_in(folder: &Path, pattern: &str) -> String {
    let named = pattern.trim_end_matches(['/', '*']).trim_end_matches('/');
    let is_plain = pattern.trim_end_matches('/') == named || pattern.ends_with("**");
    // The current folder has the empty path, which is no folder's.
    if is_plain && !named.contains('*') && Path::new(".").join(folder).join(named).is_dir() {
        let all = Path::new(named).join("**/*");
        return format!("`{}` names all files in that folder and below", all.display());
    }
    if folder.as_os_str().is_empty() {
        return "files are sought from the folder of the study, which is the current one".into();
    }
    format!(
        "files are sought from the folder of the study: `{}`",
        folder.display()
    )
}

/// A file that is part of a word, as in `tank.py:make`, instead of the value of a key `file`.
fn in_a_word(
    plugin: &Plugin<'_>,
    key: &str,
    (problem, help): (String, String),
    span: Span,
    sources: &Sources,
) -> Diagnostic {
    let key = key.trim_end_matches(".file");
    let message = format!("`{key}` names a file that cannot be read: {problem}");
    let at = format!("{}.{key}", plugin.at);
    sources.error(span, &at, message).help(help)
}

/// The fault in a config: a value that does not fit the schema, or else the error of the plugin's reader.
fn refused(
    plugin: &Plugin<'_>,
    config: &Node,
    error: &serde_json::Error,
    sources: &Sources,
) -> Vec<Diagnostic> {
    let mut checker = Checker::new(sources);
    checker.check(
        config,
        &At {
            key: plugin.span,
            name: plugin.name.into(),
            path: plugin.at.clone(),
        },
        &plugin.schema,
    );
    if checker.found.is_empty() {
        let message = format!("`{}` does not take this config: {error}", plugin.name);
        checker
            .found
            .push(sources.error(plugin.span, &plugin.at, message));
    }
    checker.found
}

fn merged(about: &About, config: &Node) -> Value {
    let schema = about.schema.as_value();
    let view = View::new(schema, schema);
    let mut value = Value::clone(&about.defaults);
    let preset = config.get("preset").and_then(Node::as_str);
    if let Some(preset) = about.presets.iter().find(|it| Some(it.name) == preset) {
        merge(&mut value, preset.values.clone(), Some(&view));
    }
    let mut own = config.to_value();
    if let Some(map) = own.as_object_mut().filter(|_| !about.presets.is_empty()) {
        map.remove("preset");
    }
    merge(&mut value, own, Some(&view));
    value
}

/// Merges `over` into `value`. Mappings with fixed keys are merged key by key; everything else (an enum's variant, a
/// list, a map with free names) is replaced as a whole.
fn merge(value: &mut Value, over: Value, schema: Option<&View<'_>>) {
    let fields = if value.is_object() && over.is_object() {
        schema.and_then(View::as_struct)
    } else {
        None
    };
    match (value, over, fields) {
        (Value::Object(base), Value::Object(over), Some(fields)) => {
            for (key, item) in over {
                merge(
                    base.entry(key.clone()).or_insert(Value::Null),
                    item,
                    fields.property(&key).as_ref(),
                );
            }
        }
        (value, over, _) => *value = over,
    }
}

/// Strings under the key `file` that name no file.
fn missing_files(
    config: &Node,
    at: &str,
    files: &mut Files<'_>,
    sources: &Sources,
    found: &mut Vec<Diagnostic>,
) {
    match &config.kind {
        NodeKind::Sequence(items) => items
            .iter()
            .for_each(|item| missing_files(item, at, files, sources, found)),
        NodeKind::Mapping(entries) => {
            for entry in entries {
                let below = format!("{at}.{}", entry.key);
                match entry
                    .value
                    .as_str()
                    .filter(|text| entry.key == "file" && !text.is_empty())
                {
                    Some(text) => {
                        if let Err(why) = files.find(text) {
                            let (message, help) = (why.message(text), why.help(text, files.folder));
                            found.push(sources.error(entry.value.span, &below, message).help(help));
                        }
                    }
                    None => missing_files(&entry.value, &below, files, sources, found),
                }
            }
        }
        NodeKind::Scalar(_) => {}
    }
}

/// Notes path and hash of each file that is named under `file`, by JSON pointer.
///
/// # Errors
/// The first file that cannot be used, with its pointer, its name and the reason.
fn find_files(
    value: &Value,
    at: &str,
    files: &mut Files<'_>,
    named: &mut BTreeMap<String, (PathBuf, String)>,
) -> Result<(), (String, String, FileProblem)> {
    let below = |key: &str| format!("{at}/{}", key.replace('~', "~0").replace('/', "~1"));
    match value {
        Value::Object(map) => map.iter().try_for_each(|(key, item)| match item {
            Value::String(text) if key == "file" && !text.is_empty() => {
                let found = files.find(text).map_err(|why| (below(key), text.clone(), why))?;
                named.insert(below(key), found);
                Ok(())
            }
            Value::Object(_) | Value::Array(_) => find_files(item, &below(key), files, named),
            _ => Ok(()),
        }),
        Value::Array(items) => items
            .iter()
            .enumerate()
            .try_for_each(|(index, item)| find_files(item, &below(&index.to_string()), files, named)),
        _ => Ok(()),
    }
}

/// Span of the value at a dotted key, or of the deepest part of it that is written; `None` if no part is.
#[must_use]
pub fn locate(config: &Node, key: &str) -> Option<Span> {
    let (mut here, mut span) = (config, None);
    for word in key.split('.') {
        if let Some(item) = word.parse().ok().and_then(|index: usize| here.items().get(index)) {
            (span, here) = (Some(item.span), item);
            continue;
        }
        let Some(entry) = here.entry(word) else { break };
        span = Some(if matches!(entry.value.kind, NodeKind::Scalar(_)) {
            entry.value.span
        } else {
            entry.key_span
        });
        here = &entry.value;
    }
    span
}
