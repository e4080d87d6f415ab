//! Reads YAML of other programs as plain values.

use super::error::DraftRefusal;
use document::diagnostic::{Sources, render};
use serde_json::Value;

/// Parses a text.
///
/// # Errors
/// [`DraftRefusal::NoYaml`] with the place of each mistake.
pub fn read(name: &str, text: &str) -> Result<Value, DraftRefusal> {
    let mut sources = Sources::default();
    let source = sources.add_file(name, text);
    let node = document::parse(&sources, source, text);
    node.map(|node| node.to_value())
        .map_err(|found| DraftRefusal::NoYaml(render(&found, false)))
}
