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
    node.map(|node| node.to_value()).map_err(|found| {
        // The message of a refusal begins with `error: ` itself.
        let text = render(&found, false);
        DraftRefusal::NoYaml(text.strip_prefix("error: ").unwrap_or(&text).to_owned())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mistake_is_told_without_a_second_word_for_it() {
        let told = read("sweep.yaml", "a: [\n").unwrap_err().to_string();
        assert!(
            !told.starts_with("error") && told.contains("sweep.yaml"),
            "{told}"
        );
    }
}
