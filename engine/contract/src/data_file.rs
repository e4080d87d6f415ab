//! Data files that a config names under the key `file`. The content of a file is part of a trial's id, and the trial
//! gets exactly this content.
//!
//! A plan hashes the content. A trial reads each file once, compares it with the hash, and gives its plugins a config
//! with the content beside the path. A plugin that is built several times therefore reads the same content, even if the
//! file changes meanwhile. Binary files may be larger than memory: a config gets their hash, and plugins read them by
//! their path.

use crate::{Error, digest, panics, parquet};
use document::input_file::{self, Use};
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::{
    borrow::Cow,
    fs::{self, File},
    io::{self, Read},
    path::{Path, PathBuf},
    string::FromUtf8Error,
    sync::Arc,
};

/// A data file in a config: its path in a study, its path and content or hash inside a trial.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(from = "DataFileConfig", into = "PathBuf")]
pub struct DataFile {
    path: PathBuf,
    content: Option<Arc<str>>,
    digest: Option<Arc<str>>,
}

/// The form of a data file in a config.
#[derive(Deserialize)]
#[serde(untagged, expecting = "the path of a data file")]
enum DataFileConfig {
    Named(PathBuf),
    Read { path: PathBuf, content: String },
    Checked { path: PathBuf, digest: String },
}

/// The format of a file, by its first bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FileFormat {
    /// Text, according to its first bytes.
    Text,
    /// Apache Parquet.
    Parquet,
    /// HDF5.
    Hdf5,
    /// Bytes that are not text, in a layout that only the plugin knows.
    Binary,
}

impl FileFormat {
    /// # Errors
    /// [`Error::File`] if the file cannot be read.
    fn of(path: &Path) -> Result<Self, Error> {
        let opened = input_file::open(path, Use::Bytes).and_then(|mut file| first_bytes(&mut file));
        opened
            .map(|first| Self::of_first(&first))
            .map_err(Error::file("read", path))
    }

    fn of_first(first: &[u8]) -> Self {
        match first[..] {
            [b'P', b'A', b'R', b'1', ..] => Self::Parquet,
            [0x89, b'H', b'D', b'F', b'\r', b'\n', 0x1a, b'\n', ..] => Self::Hdf5,
            _ if is_text(first) => Self::Text,
            _ => Self::Binary,
        }
    }
}

fn first_bytes(file: &mut impl Read) -> io::Result<Vec<u8>> {
    let mut first = Vec::new();
    file.take(4096).read_to_end(&mut first)?;
    Ok(first)
}

/// Whether the first bytes of a file are UTF-8 without control characters; they may end inside a character.
fn is_text(first: &[u8]) -> bool {
    let whole = match str::from_utf8(first) {
        Ok(text) => text,
        Err(error) if error.error_len().is_some() => return false,
        // The bytes before the reported position are valid.
        Err(error) => str::from_utf8(&first[..error.valid_up_to()]).unwrap_or_default(),
    };
    !whole.contains(|character: char| character.is_control() && !"\t\r\n\u{c}".contains(character))
}

impl DataFile {
    /// The file at a path; it is read when its text is requested.
    #[must_use]
    pub fn new(path: impl Into<PathBuf>) -> Self {
        Self {
            path: path.into(),
            content: None,
            digest: None,
        }
    }

    /// Path of the file, for messages.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Text of the file: inside a trial the text with the hash in the trial's id, elsewhere the current one.
    ///
    /// # Errors
    /// [`Error::File`] if it cannot be read or is no UTF-8.
    pub fn text(&self) -> Result<Cow<'_, str>, Error> {
        match &self.content {
            Some(content) => Ok(Cow::Borrowed(content)),
            None => input_file::read(&self.path, Use::Text)
                .and_then(as_text)
                .map(Cow::Owned)
                .map_err(Error::file("read", &self.path)),
        }
    }

    /// Copies the file into a folder, under its own name, so that no other program changes the copy while it is read.
    ///
    /// # Errors
    /// [`Error::DataFileChanged`] if the hash of the content is not the one in the trial's id, and [`Error::File`].
    pub fn copy_into(&self, folder: &Path) -> Result<PathBuf, Error> {
        let copy = folder.join(self.path.file_name().unwrap_or_default());
        self.copy_to(&copy)?;
        Ok(copy)
    }

    /// Copies the file to a path.
    ///
    /// # Errors
    /// The errors of [`copy_into`](Self::copy_into).
    pub fn copy_to(&self, copy: &Path) -> Result<(), Error> {
        let written = match &self.content {
            Some(content) => fs::write(copy, content.as_bytes()),
            None => input_file::open(&self.path, Use::Bytes)
                .and_then(|mut file| io::copy(&mut file, &mut File::create(copy)?).map(drop)),
        };
        written.map_err(Error::file("copy", &self.path))?;
        self.held_against(|| digest_of(copy))
    }

    /// Compares the file with the trial's id again, after a plugin read it by its path.
    ///
    /// # Errors
    /// [`Error::DataFileChanged`] if the content has changed, and [`Error::File`].
    pub fn unchanged(&self) -> Result<(), Error> {
        self.held_against(|| digest_of(&self.path))
    }

    fn held_against(&self, found: impl FnOnce() -> Result<String, Error>) -> Result<(), Error> {
        match &self.digest {
            Some(digest) if found()? != **digest => Err(Error::DataFileChanged {
                path: self.path.clone(),
            }),
            _ => Ok(()),
        }
    }

    /// The format of the file.
    ///
    /// # Errors
    /// [`Error::File`] if it cannot be read.
    pub fn format(&self) -> Result<FileFormat, Error> {
        match self.content {
            Some(_) => Ok(FileFormat::Text),
            None => FileFormat::of(&self.path),
        }
    }

    /// Hash of the content: inside a trial the one in the trial's id.
    ///
    /// # Errors
    /// [`Error::File`] if it cannot be read.
    pub fn digest(&self) -> Result<Cow<'_, str>, Error> {
        match (&self.digest, &self.content) {
            (Some(digest), _) => Ok(Cow::Borrowed(digest)),
            (None, Some(content)) => Ok(Cow::Owned(digest::of_bytes(content.as_bytes()))),
            (None, None) => digest_of(&self.path).map(Cow::Owned),
        }
    }

    /// The bytes of a binary file: inside a trial those with the hash in the trial's id.
    ///
    /// # Errors
    /// [`Error::File`] if it cannot be read, [`Error::DataFileChanged`] if its content has changed.
    pub fn bytes(&self) -> Result<Vec<u8>, Error> {
        let bytes = input_file::read(&self.path, Use::Bytes).map_err(Error::file("read", &self.path))?;
        self.held_against(|| Ok(digest::of_bytes(&bytes)))?;
        Ok(bytes)
    }

    /// Columns of a Parquet file as numbers, in the order of `names`.
    ///
    /// # Errors
    /// [`Error::File`] if it cannot be read, [`Error::Damaged`] if it is no such file, and [`Error::Input`] with the
    /// column that is missing or has another type, or with the row of an empty cell.
    pub fn parquet_columns(&self, names: &[&str]) -> Result<Vec<Vec<f64>>, Error> {
        let bytes = self.bytes()?;
        panics::or_damaged(&self.path, || {
            let table = parquet::ParquetTable::decode(bytes, &self.path)?;
            names.iter().map(|name| table.numbers(name)).collect()
        })
    }
}

impl From<DataFileConfig> for DataFile {
    fn from(form: DataFileConfig) -> Self {
        match form {
            DataFileConfig::Named(path) => Self::new(path),
            DataFileConfig::Read { path, content } => Self {
                path,
                content: Some(content.into()),
                digest: None,
            },
            DataFileConfig::Checked { path, digest } => Self {
                path,
                content: None,
                digest: Some(digest.into()),
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

/// Hash of the content of the file at `path`, as used in ids.
///
/// # Errors
/// [`Error::File`] if it cannot be read.
pub fn hash_of(path: &Path) -> Result<String, Error> {
    digest_of(path)
}

fn digest_of(path: &Path) -> Result<String, Error> {
    let read = || digest::of_file(input_file::open(path, Use::Bytes)?);
    read().map_err(Error::file("read", path))
}

fn as_text(bytes: Vec<u8>) -> io::Result<String> {
    let no_text = |source: FromUtf8Error| {
        let message = format!("it is no UTF-8 text: {}", source.utf8_error());
        io::Error::new(io::ErrorKind::InvalidData, message)
    };
    String::from_utf8(bytes).map_err(no_text)
}

/// The config's value of the [`DataFile`] at the path `named`, with its content, or with its hash if it is binary.
///
/// # Errors
/// [`Error::DataFileChanged`] if its hash is not `expected`, and [`Error::File`] if it cannot be read or is no UTF-8.
pub fn read(named: &str, expected: &str) -> Result<Value, Error> {
    let path = Path::new(named);
    let content = content(path, expected)?;
    Ok(match content {
        Some(text) => json!({ "path": named, "content": text }),
        None => json!({ "path": named, "digest": expected }),
    })
}

/// The text of a file, `None` if it is binary. The file is opened once, so that the text is the one whose hash was
/// compared.
fn content(path: &Path, expected: &str) -> Result<Option<String>, Error> {
    let of_file = || Error::file("read", path);
    let unchanged = |digest: String| {
        let path = path.into();
        (digest == expected)
            .then_some(())
            .ok_or(Error::DataFileChanged { path })
    };
    let mut file = input_file::open(path, Use::Bytes).map_err(of_file())?;
    let first = first_bytes(&mut file).map_err(of_file())?;
    if FileFormat::of_first(&first) == FileFormat::Text {
        let bytes = input_file::rest(file, first, Use::Text).map_err(of_file())?;
        unchanged(digest::of_bytes(&bytes))?;
        return as_text(bytes).map(Some).map_err(of_file());
    }
    // The hash is that of the same opened file.
    let digest = digest::of_file(first.chain(file));
    unchanged(digest.map_err(of_file())?)?;
    Ok(None)
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
        assert!(hash_of(&path).is_err());
        assert!(matches!(read(named, ""), Err(Error::File { .. })));
        // A file that begins as text but does not end as text.
        fs::write(&path, [vec![b'1'; 5000], vec![0xff]].concat()).unwrap();
        let message = read(named, &hash_of(&path).unwrap()).unwrap_err().to_string();
        assert!(
            message.contains("load.csv") && message.contains("utf-8"),
            "{message}"
        );
        fs::write(&path, b"\xff").unwrap();
        let file = read(named, &hash_of(&path).unwrap()).unwrap();
        let file: DataFile = serde_json::from_value(file).unwrap();
        assert_eq!(file.format().unwrap(), FileFormat::Binary);
        let message = file.text().unwrap_err().to_string();
        assert!(
            message.contains("load.csv") && message.contains("UTF-8"),
            "{message}"
        );
        let message = read(named, "another hash").unwrap_err().to_string();
        assert!(
            message.contains("load.csv` does not hold what this trial's id names; restore it"),
            "{message}"
        );
    }

    #[test]
    fn of_a_binary_file_a_trial_has_the_hash() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("flights.h5");
        fs::write(&path, b"\x89HDF\r\n\x1a\n and more").unwrap();
        let hash = hash_of(&path).unwrap();
        assert_eq!(hash, digest::of_bytes(b"\x89HDF\r\n\x1a\n and more"));
        let value = read(path.to_str().unwrap(), &hash).unwrap();
        let file: DataFile = serde_json::from_value(value).unwrap();
        assert_eq!(
            (file.format().unwrap(), file.digest().unwrap()),
            (FileFormat::Hdf5, hash.as_str().into())
        );
        fs::write(&path, b"PAR1 another").unwrap();
        assert_eq!(DataFile::new(&path).format().unwrap(), FileFormat::Parquet);
        assert!(matches!(
            read(path.to_str().unwrap(), &hash),
            Err(Error::DataFileChanged { .. })
        ));
    }

    #[test]
    fn a_copy_holds_what_the_id_names_whatever_becomes_of_the_file() {
        let dir = tempfile::tempdir().unwrap();
        let own = tempfile::tempdir().unwrap();
        for (name, bytes) in [("load.csv", &b"1,2"[..]), ("load.bin", b"\xff\x00")] {
            let path = dir.path().join(name);
            fs::write(&path, bytes).unwrap();
            let value = read(path.to_str().unwrap(), &hash_of(&path).unwrap()).unwrap();
            let file: DataFile = serde_json::from_value(value).unwrap();
            let copy = file.copy_into(own.path()).unwrap();
            assert_eq!(
                (copy.file_name().unwrap(), fs::read(&copy).unwrap()),
                (name.as_ref(), bytes.to_vec())
            );
            file.unchanged().unwrap();
            fs::write(&path, b"\xff another").unwrap();
            assert_eq!(fs::read(&copy).unwrap(), bytes);
            // The text was read with the id; the next copy of the other file would have other content.
            let again = file.copy_into(own.path());
            assert_eq!(again.is_ok(), name == "load.csv", "{again:?}");
            assert_eq!(file.unchanged().is_ok(), name == "load.csv");
        }
    }

    #[test]
    fn text_is_told_from_other_bytes() {
        let cut = "time,überhang".as_bytes();
        assert!(is_text(b"") && is_text(b"a,b\r\n1\t2\n") && is_text(&cut[..6]));
        assert!(!is_text(&[3, 200, 201]) && !is_text(&[9, 10, 1]) && !is_text(b"a\0b"));
    }

    #[test]
    fn columns_of_a_parquet_file_are_numbers_or_named() {
        use crate::parquet::Values;
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("flights.parquet");
        let columns = vec![
            ("unit", Values::U32(vec![1, 2])),
            ("alt", Values::F64(vec![3.5, 4.5])),
            ("class", Values::Text(vec!["a", "b"])),
        ];
        fs::write(&path, parquet::encode(&path, columns, &[]).unwrap()).unwrap();
        let file = DataFile::new(&path);
        assert_eq!(
            file.parquet_columns(&["alt", "unit"]).unwrap(),
            [[3.5, 4.5], [1.0, 2.0]]
        );
        for (name, expected) in [
            ("mach", "column `mach`: is missing; there are unit, alt, class"),
            ("class", "column `class`: holds no numbers"),
        ] {
            let message = file.parquet_columns(&[name]).unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
        }
    }
}
