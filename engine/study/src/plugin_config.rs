//! One plugin's config in a file of its own, as `rollout` takes it.

use super::{config, json_schema::with_presets};
use contract::{part::Part, plugin::About};
use document::{
    diagnostic::{Diagnostic, Sources, Span, in_order},
    input_file,
    schema_check::{At, Checker, View},
};
use std::path::Path;

/// Reads, checks and completes the config of the plugin `name` in a YAML file; returns the defaults without a file.
///
/// # Errors
/// Everything that is wrong with it, sorted by position.
pub fn load_config(name: &str, about: &About, path: Option<&Path>) -> Result<Part, Vec<Diagnostic>> {
    let (title, text) = match path {
        Some(path) => (path.display().to_string(), read(path)?),
        None => (format!("the defaults of `{name}`"), "{}".into()),
    };
    let folder = path.and_then(Path::parent).unwrap_or(Path::new(""));
    read_config(name, about, &title, &text, folder)
}

/// Like [`load_config`], but from a text: `title` is its name in messages, and data files are found relative to
/// `folder`.
///
/// # Errors
/// The errors of [`load_config`].
pub fn read_config(
    name: &str,
    about: &About,
    title: &str,
    text: &str,
    folder: &Path,
) -> Result<Part, Vec<Diagnostic>> {
    let mut sources = Sources::default();
    let source = sources.add_file(title, text);
    let root = document::parse(&sources, source, text).map_err(in_order)?;
    let schema = with_presets(about);
    let mut checker = Checker::new(&sources);
    let start = Span {
        length: 1,
        ..root.span
    };
    checker.check(
        &root,
        &At {
            key: start,
            name: name.into(),
            path: String::new(),
        },
        &View::new(&schema, &schema),
    );
    if !checker.found.is_empty() {
        return Err(in_order(checker.found));
    }
    let plugin = config::Plugin {
        name,
        about,
        schema: View::new(&schema, &schema),
        at: String::new(),
        span: start,
    };
    config::resolve(&plugin, &root, &mut config::Files::new(folder), &sources)
}

fn read(path: &Path) -> Result<String, Vec<Diagnostic>> {
    let name = path.display().to_string();
    let bytes = input_file::read(path, input_file::Use::Study).map_err(|error| {
        let mut sources = Sources::default();
        let source = sources.add_file(&name, "");
        vec![sources.error(
            Span {
                source,
                ..Span::default()
            },
            "",
            format!("cannot read the config: {error}"),
        )]
    })?;
    document::decode(&name, &bytes)
}
