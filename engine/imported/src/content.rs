//! Content of files: unpacked, recognised by their first bytes, and counted once if one is a copy of another.

use super::event_file::begins_record;
use contract::Error;
use document::input_file;
use flate2::read::MultiGzDecoder;
use sha2::{Digest, Sha256};
use std::path::{Path, PathBuf};

/// A file that was read.
pub(super) struct Content {
    pub(super) path: PathBuf,
    /// The SHA-256 of the file as it is on disk.
    pub(super) sha256: String,
    /// The bytes, unpacked where the file is packed.
    pub(super) bytes: Vec<u8>,
}

/// Formats of the files that are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum LogFormat {
    /// TensorBoard's event files.
    Events,
    /// Tables in Parquet.
    Parquet,
    /// Arrays of NumPy in an archive.
    Arrays,
    /// Offline runs of W&B.
    Wandb,
    /// JSON: a document, or a line for every record.
    Json,
    /// Text with a separator between columns.
    Separated,
}

/// The first bytes of arrays of NumPy in an archive.
const ARRAYS: &[u8] = b"PK\x03\x04";
/// The first bytes of an offline run of W&B.
const WANDB: &[u8] = b":W&B";

/// First bytes of files that are not read, with their names and a way to convert each.
const FOREIGN: [(&[u8], &str, &str); 15] = [
    (
        b"\x89HDF\r\n",
        "an HDF5 file",
        "pandas.read_hdf(FILE).to_csv(\"log.csv\")",
    ),
    (
        b"\x93NUMPY",
        "an array of NumPy",
        "pandas.DataFrame(numpy.load(FILE)).to_csv(\"log.csv\")",
    ),
    (
        b"SQLite format 3",
        "a database of SQLite",
        "sqlite3 -csv -header FILE \"SELECT ...\" > log.csv",
    ),
    (
        b"ARROW1",
        "an Arrow (Feather) file",
        "pandas.read_feather(FILE).to_csv(\"log.csv\")",
    ),
    (
        b"FEA1",
        "a Feather file",
        "pandas.read_feather(FILE).to_csv(\"log.csv\")",
    ),
    (
        b"\x28\xb5\x2f\xfd",
        "packed by Zstandard",
        "unpack it with `zstd -d`",
    ),
    (b"BZh", "packed by bzip2", "unpack it with `bunzip2`"),
    (b"\xfd7zXZ", "packed by xz", "unpack it with `unxz`"),
    (
        b"\x80\x02",
        "a pickle of Python",
        "pandas.DataFrame(pandas.read_pickle(FILE)).to_csv(\"log.csv\")",
    ),
    (
        b"\x80\x03",
        "a pickle of Python",
        "pandas.DataFrame(pandas.read_pickle(FILE)).to_csv(\"log.csv\")",
    ),
    (
        b"\x80\x04",
        "a pickle of Python",
        "pandas.DataFrame(pandas.read_pickle(FILE)).to_csv(\"log.csv\")",
    ),
    (
        b"\x80\x05",
        "a pickle of Python",
        "pandas.DataFrame(pandas.read_pickle(FILE)).to_csv(\"log.csv\")",
    ),
    (b"\xff\xfe", "text in UTF-16", "save the file as UTF-8"),
    (b"\xfe\xff", "text in UTF-16", "save the file as UTF-8"),
    (b"%PDF", "a PDF file", "name the table that it was made of"),
];

impl Content {
    pub(super) fn read(path: &Path) -> Result<Self, Error> {
        let packed = input_file::read(path, input_file::Use::Bytes).map_err(Error::file("read", path))?;
        let sha256 = sha256(&packed);
        let bytes = if packed.starts_with(b"\x1f\x8b") {
            let unpacked = MultiGzDecoder::new(packed.as_slice());
            input_file::rest(unpacked, Vec::new(), input_file::Use::Text)
                .map_err(|error| input(path, None, None, format!("it is packed by gzip, and {error}")))?
        } else {
            packed
        };
        let path = path.to_owned();
        Ok(Self { path, sha256, bytes })
    }

    /// The kind of the file.
    ///
    /// # Errors
    /// [`Error::Input`] with the kind of the file, where that kind is not read.
    pub(super) fn form(&self) -> Result<LogFormat, Error> {
        let is = |magic: &[u8]| self.bytes.starts_with(magic);
        if is_event_file(&self.path) || begins_record(&self.bytes) {
            return Ok(LogFormat::Events);
        }
        if is(b"PAR1") {
            return Ok(LogFormat::Parquet);
        }
        if is(ARRAYS) {
            return Ok(LogFormat::Arrays);
        }
        if is(WANDB) {
            return Ok(LogFormat::Wandb);
        }
        if let Some((_, kind, way)) = FOREIGN.iter().find(|(magic, ..)| is(magic)) {
            let read = "CSV, JSON, JSON lines, Parquet, arrays of NumPy (.npz), TensorBoard's event files and offline runs of W&B \
                 are read, also packed by gzip";
            return Err(self.wrong(None, format!("it is {kind}, which is not read: {way} ({read})")));
        }
        let text = self.bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&self.bytes);
        Ok(match text.trim_ascii_start().first() {
            Some(b'{' | b'[') => LogFormat::Json,
            _ => LogFormat::Separated,
        })
    }

    /// The text of the file, without a byte order mark.
    ///
    /// # Errors
    /// [`Error::Input`] with the line where it is not UTF-8.
    pub(super) fn text(&self) -> Result<&str, Error> {
        let wrong = |line: usize, problem: &str| self.wrong(Some(line as u64), problem.into());
        let text = std::str::from_utf8(&self.bytes).map_err(|error| {
            let before = &self.bytes[..error.valid_up_to()];
            wrong(
                lines_in(before) + 1,
                "a letter is not UTF-8: save the file as UTF-8",
            )
        })?;
        if let Some(place) = text.find('\0') {
            let line = lines_in(&self.bytes[..place]) + 1;
            return Err(wrong(
                line,
                "a byte of 0 stands here: the file is no text, or damaged",
            ));
        }
        Ok(text.strip_prefix('\u{feff}').unwrap_or(text))
    }

    pub(super) fn wrong(&self, line: Option<u64>, problem: String) -> Error {
        input(&self.path, line, None, problem)
    }

    /// Name of the file, without its folder.
    pub(super) fn name(&self) -> String {
        self.path
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned()
    }

    /// Whether it has values; only then another file with the same content is a copy.
    fn has_values(&self) -> bool {
        self.bytes.trim_ascii_end().contains(&b'\n') || self.is_binary()
    }

    /// Whether it has enough values that a file beginning with all of them must be a later state of it.
    fn has_many_values(&self) -> bool {
        const LINES: usize = 4;
        lines_in(&self.bytes) > LINES || begins_record(&self.bytes)
    }

    fn is_binary(&self) -> bool {
        let begins = |magic| self.bytes.starts_with(magic);
        begins(b"PAR1") || begins(ARRAYS) || begins(WANDB) || begins_record(&self.bytes)
    }
}

/// The error about a file of another program.
pub(super) fn input(path: &Path, line: Option<u64>, column: Option<&str>, problem: String) -> Error {
    Error::Input {
        path: path.into(),
        line,
        column: column.map(Into::into),
        problem,
    }
}

/// The SHA-256 of some bytes, in hexadecimal digits.
pub(super) fn sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes)
        .iter()
        .map(|byte| format!("{byte:02x}"))
        .collect()
}

fn lines_in(bytes: &[u8]) -> usize {
    bytes.iter().filter(|byte| **byte == b'\n').count()
}

fn is_event_file(path: &Path) -> bool {
    path.file_name()
        .is_some_and(|name| name.to_string_lossy().contains("tfevents"))
}

/// The files without copies of others, with a sentence on the copies. A file whose whole content is the beginning of
/// another file is an earlier copy of it.
pub(super) fn without_copies(files: Vec<Content>) -> (Vec<Content>, Option<String>) {
    let copies: Vec<Option<String>> = (0..files.len()).map(|place| copy(place, &files)).collect();
    let mut counted = Vec::new();
    for (file, copy) in files.into_iter().zip(&copies) {
        if copy.is_none() {
            counted.push(file);
        }
    }
    let copies: Vec<String> = copies.into_iter().flatten().collect();
    let all = listed(&copies);
    let sentence = match copies.len() {
        0 => None,
        1 => Some(format!("1 file is a copy and not counted again ({all})")),
        n => Some(format!("{n} files are copies and not counted again ({all})")),
    };
    (counted, sentence)
}

/// A phrase that names the file and the file that it is a copy of; `None` if it is no copy.
fn copy(place: usize, files: &[Content]) -> Option<String> {
    let file = &files[place];
    let length = file.bytes.len();
    let mut others = files
        .iter()
        .zip(0..)
        .filter(|(other, at)| match other.bytes.len() {
            same if same == length => *at < place && file.has_values(),
            longer => longer > length && file.has_many_values(),
        });
    let (whole, _) = others.find(|(other, _)| other.bytes.starts_with(&file.bytes))?;
    let kind = if whole.bytes.len() == length {
        "of"
    } else {
        "of the beginning of"
    };
    Some(format!(
        "`{}` {kind} `{}`",
        file.path.display(),
        whole.path.display()
    ))
}

/// The first of some texts, and the number of the others.
pub(super) fn listed(texts: &[String]) -> String {
    const MOST: usize = 5;
    let first = texts
        .iter()
        .take(MOST)
        .map(String::as_str)
        .collect::<Vec<_>>()
        .join(", ");
    match texts.len().saturating_sub(MOST) {
        0 => first,
        more => format!("{first} and {more} more"),
    }
}

#[cfg(test)]
pub(super) fn content(path: &str, bytes: impl AsRef<[u8]>) -> Content {
    let bytes = bytes.as_ref().to_vec();
    let sha256 = sha256(&bytes);
    Content {
        path: path.into(),
        sha256,
        bytes,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write as _;

    #[test]
    fn a_copy_and_an_earlier_copy_are_not_counted_again() {
        let files = vec![
            content("a.csv", "step,x\n0,1\n1,1\n2,1\n3,1\n"),
            content("b.csv", "step,x\n0,1\n1,1\n2,1\n3,1\n4,2\n"),
            content("c.csv", "step,x\n0,1\n1,1\n2,1\n3,1\n4,2\n"),
            content("d.csv", "step,x\n0,1\n"),
            content("e.csv", "step,x\n"),
            content("f.csv", "step,x\n"),
        ];
        let (counted, note) = without_copies(files);
        let left: Vec<String> = counted.iter().map(Content::name).collect();
        assert_eq!(
            left,
            ["b.csv", "d.csv", "e.csv", "f.csv"],
            "what has few lines or none may be the same by chance"
        );
        let told = "2 files are copies and not counted again (`a.csv` of the beginning of `b.csv`, `c.csv` of `b.csv`)";
        assert_eq!(note.as_deref(), Some(told));
        let many: Vec<String> = (0..7).map(|it| it.to_string()).collect();
        assert_eq!(listed(&many), "0, 1, 2, 3, 4 and 2 more");
    }

    #[test]
    fn a_packed_file_is_unpacked_and_a_torn_one_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.csv.gz");
        let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        packed.write_all(b"step,x\n0,1\n").unwrap();
        let packed = packed.finish().unwrap();
        std::fs::write(&path, &packed).unwrap();
        let read = Content::read(&path).unwrap();
        assert_eq!(read.bytes, b"step,x\n0,1\n");
        assert_eq!(read.sha256, sha256(&packed));
        std::fs::write(&path, &packed[..packed.len() - 9]).unwrap();
        let told = Content::read(&path).err().unwrap().to_string();
        assert!(told.contains("it is packed by gzip, and "), "{told}");
    }

    #[test]
    fn a_file_is_told_by_its_first_bytes() {
        for (bytes, form) in [
            (&b"PAR1x"[..], LogFormat::Parquet),
            (b"PK\x03\x04", LogFormat::Arrays),
            (b":W&B\xe1\xbe", LogFormat::Wandb),
            (b" {\"a\": 1}", LogFormat::Json),
            (b"\xef\xbb\xbf[1]", LogFormat::Json),
            (b"step,x\n", LogFormat::Separated),
            (b"", LogFormat::Separated),
        ] {
            assert_eq!(content("log", bytes).form().unwrap(), form);
        }
        for (magic, kind, way) in FOREIGN {
            let told = content("log", magic).form().unwrap_err().to_string();
            assert!(
                told.contains(kind) && told.contains(way) && told.contains("Parquet"),
                "{told}"
            );
        }
    }

    #[test]
    fn letters_that_are_not_utf_8_are_told_with_their_line() {
        let told = content("a.csv", b"step,x\n0,1\n1,\xfc\n")
            .text()
            .unwrap_err()
            .to_string();
        assert!(
            told.contains("line 3") && told.contains("save the file as UTF-8"),
            "{told}"
        );
        assert!(
            content("a.csv", b"a\nb\0")
                .text()
                .unwrap_err()
                .to_string()
                .contains("line 2")
        );
    }
}
