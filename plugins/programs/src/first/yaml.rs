//! YAML of other programs as plain values.

use super::error::NoStudy;
use document::diagnostic::{Sources, render};
use serde_json::Value;

/// The values of a text.
///
/// # Errors
/// [`NoStudy::NoYaml`] with the place of each mistake.
pub fn read(name: &str, text: &str) -> Result<Value, NoStudy> {
    let mut sources = Sources::default();
    let source = sources.add_file(name, text);
    let node = document::parse(&sources, source, text);
    node.map(|node| node.to_value())
        .map_err(|found| NoStudy::NoYaml(render(&found, false)))
}
