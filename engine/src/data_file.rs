//! Data files that a config names under the key `file`: what one holds is part of a trial's id, and the trial
//! gets just that.
//!
//! A plan hashes the content. A trial reads each file once, holds it against the hash, and hands its plugins
//! a config with the content beside the path: however often a plugin is built, and whatever becomes of the
//! file meanwhile, it reads the same.

use crate::{Error, store};
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::{
    borrow::Cow,
    fs, io,
    path::{Path, PathBuf},
    sync::Arc,
};

/// A file of text in a config: its path in a study, its path and content inside a trial.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(from = "Form", into = "PathBuf")]
pub struct DataFile {
    path: PathBuf,
    content: Option<Arc<str>>,
}

/// What stands in a config.
#[derive(Deserialize)]
#[serde(untagged, expecting = "the path of a data file")]
enum Form {
    Named(PathBuf),
    Read { path: PathBuf, content: String },
}

impl DataFile {
    /// The file at a path, read when its text is asked for.
    #[must_use]
    pub fn new(path: impl Into<PathBuf>) -> Self {
        Self {
            path: path.into(),
            content: None,
        }
    }

    /// Where the file lies, for messages.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What the file holds: inside a trial what the trial's id names, elsewhere what lies there now.
    ///
    /// # Errors
    /// [`Error::File`] where it cannot be read or is no UTF-8.
    pub fn text(&self) -> Result<Cow<'_, str>, Error> {
        match &self.content {
            Some(content) => Ok(Cow::Borrowed(content)),
            None => fs::read_to_string(&self.path)
                .map(Cow::Owned)
                .map_err(Error::file("read", &self.path)),
        }
    }
}

impl From<Form> for DataFile {
    fn from(form: Form) -> Self {
        match form {
            Form::Named(path) => Self::new(path),
            Form::Read { path, content } => Self {
                path,
                content: Some(content.into()),
            },
        }
    }
}

impl From<DataFile> for PathBuf {
    fn from(file: DataFile) -> Self {
        file.path
    }
}

impl JsonSchema for DataFile {
    fn inline_schema() -> bool {
        true
    }

    fn schema_name() -> Cow<'static, str> {
        "DataFile".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        String::json_schema(generator)
    }
}

/// Hash of what the file at `path` holds, as it enters ids; `None` where it cannot be read.
#[must_use]
pub fn hash_of(path: &Path) -> Option<String> {
    fs::read(path).ok().map(|bytes| store::digest(&bytes))
}

/// The config's value of the [`DataFile`] at the path `named`, with its content.
///
/// # Errors
/// [`Error::DataFileChanged`] where its hash is not `expected`, and [`Error::File`] where it cannot be read
/// or is no UTF-8.
pub(crate) fn read(named: &str, expected: &str) -> Result<Value, Error> {
    let path = Path::new(named);
    let bytes = fs::read(path).map_err(Error::file("read", path))?;
    if store::digest(&bytes) != expected {
        return Err(Error::DataFileChanged { path: path.into() });
    }
    let text = String::from_utf8(bytes).map_err(|source| io::Error::new(io::ErrorKind::InvalidData, source));
    Ok(json!({ "path": named, "content": text.map_err(Error::file("read", path))? }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_its_path_in_a_config_and_keeps_what_it_was_given() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("load.csv");
        fs::write(&path, "first").unwrap();
        let read = read(path.to_str().unwrap(), &hash_of(&path).unwrap()).unwrap();
        let [named, given]: [DataFile; 2] =
            [json!(path), read].map(|value| serde_json::from_value(value).unwrap());
        fs::write(&path, "second").unwrap();
        assert_eq!(
            (named.text().unwrap(), given.text().unwrap()),
            ("second".into(), "first".into())
        );
        assert_eq!([json!(named), json!(given)], [json!(path), json!(path)]);
    }

    #[test]
    fn a_changed_missing_or_odd_file_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("load.csv");
        let named = path.to_str().unwrap();
        assert_eq!(hash_of(&path), None);
        assert!(matches!(read(named, ""), Err(Error::File { .. })));
        fs::write(&path, b"\xff").unwrap();
        let message = read(named, &hash_of(&path).unwrap()).unwrap_err().to_string();
        assert!(
            message.contains("load.csv") && message.contains("utf-8"),
            "{message}"
        );
        let message = read(named, "another hash").unwrap_err().to_string();
        assert!(
            message.contains("load.csv` does not hold what this trial's id names; restore it"),
            "{message}"
        );
    }
}
