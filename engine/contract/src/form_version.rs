//! Versions of the forms of stored files.

use serde::Deserialize;

/// The version of a stored file's form, which stands under `schema` in every version.
///
/// # Errors
/// Where the text is no JSON object with such a number.
pub fn form_version(text: &[u8]) -> serde_json::Result<u32> {
    #[derive(Deserialize)]
    struct Form {
        schema: u32,
    }
    serde_json::from_slice(text).map(|form: Form| form.schema)
}
