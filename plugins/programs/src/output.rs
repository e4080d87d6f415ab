//! The output of a program: lines with metrics are noted as they are written, and its beginning and end are kept.
//!
//! The program writes into files, `stdout.raw` and `stderr.raw`, so that no output is lost when a process is killed.
//! They are read as they grow, and the disk space of parts that were read is released. Each noted line holds the
//! position of its end in its file; reading continues after the last one.

use crate::lines::{AT, Filter, Lines, SeenKey};
use contract::Error;
use imported::BEGINS_AGAIN;
use serde_json::{Value, json};
use std::{
    collections::{BTreeSet, VecDeque},
    fs::{self, File, OpenOptions},
    io::{Read, Seek as _, SeekFrom, Write},
    path::{Path, PathBuf},
};

/// The streams of a program, as a study names them.
pub const STREAMS: [&str; 2] = ["stdout", "stderr"];
/// The name of the log file in a study; its lines need no filter.
pub const LOG: &str = "log";
/// Length of the beginning of the output that is kept, and of its end, bytes.
const KEPT: usize = 1 << 20;
/// Length of a file's read part before its disk space is released, bytes.
const READ: u64 = 1 << 24;
/// Length of the end of standard error in an error message, bytes.
const LAST_WORDS: usize = 2000;

/// Whether a source is a file of noted lines, see [`noted`].
pub fn is_noted(from: &str) -> bool {
    from == LOG || STREAMS.contains(&from)
}

/// The file of noted lines of a stream, or of [`LOG`].
pub fn noted(notes: &Path, stream: &str) -> PathBuf {
    notes.join(format!("{stream}.jsonl"))
}

/// The file into which a program writes a stream.
fn raw(notes: &Path, stream: &str) -> PathBuf {
    notes.join(format!("{stream}.raw"))
}

/// Opens the files for a program's output, which is appended to their content.
///
/// # Errors
/// [`Error::File`] where they cannot be created.
pub fn files(notes: &Path) -> Result<[File; 2], Error> {
    let file = |stream| {
        let path = raw(notes, stream);
        let file = OpenOptions::new().create(true).append(true).open(&path);
        file.map_err(Error::file("write", &path))
    };
    let [output, errors] = STREAMS;
    Ok([file(output)?, file(errors)?])
}

/// Reader of both output streams of a program.
#[derive(Debug)]
pub struct OutputReader {
    readers: [StreamReader; 2],
    captured: CapturedOutput,
    /// Bytes that were read since the last [`has_heard`](Self::has_heard).
    heard: u64,
}

/// Parts of the output that are kept in memory.
#[derive(Debug, Default)]
struct CapturedOutput {
    first: Vec<u8>,
    last: VecDeque<u8>,
    left_out: u64,
    errors: VecDeque<u8>,
    problem: Option<String>,
}

impl OutputReader {
    /// Reads both streams, each through its filter, starting after the lines noted before.
    ///
    /// # Errors
    /// [`Error::File`] where the notes cannot be written.
    pub fn to(notes: &Path, filters: [Filter; 2]) -> Result<Self, Error> {
        fs::create_dir_all(notes).map_err(Error::file("create", notes))?;
        let [of_output, of_errors] = filters;
        let [output, errors] = STREAMS;
        Ok(Self {
            readers: [
                StreamReader::on(notes, output, of_output)?,
                StreamReader::on(notes, errors, of_errors)?,
            ],
            captured: CapturedOutput::default(),
            heard: 0,
        })
    }

    /// Reads the output since the last call.
    pub fn look(&mut self) {
        for reader in &mut self.readers {
            let heard = reader.listen(&mut self.captured);
            if let Err(error) = heard.as_ref() {
                self.captured.problem.get_or_insert(error.to_string());
            }
            self.heard += heard.unwrap_or_default();
        }
    }

    /// Reads the rest of the output of a program that has ended.
    pub fn end(&mut self) {
        self.look();
        for reader in &mut self.readers {
            let noted = reader.end();
            if let Err(error) = noted {
                self.captured.problem.get_or_insert(error.to_string());
            }
        }
    }

    /// Marks that the program continues from a checkpoint: its output from now on replaces earlier output at
    /// the same and later steps. A line that was begun before is dropped.
    ///
    /// # Errors
    /// [`Error::File`] where the mark cannot be written.
    pub fn mark_continuation(&mut self, notes: &Path) -> Result<(), Error> {
        self.look();
        for reader in &mut self.readers {
            reader.mark_continuation(notes)?;
        }
        mark(&noted(notes, LOG), &json!({ BEGINS_AGAIN: true }))
    }

    /// Whether any output was read since the last call.
    pub fn has_heard(&mut self) -> bool {
        std::mem::take(&mut self.heard) > 0
    }

    /// The problem that prevented a note, if any.
    pub fn problem(&self) -> Option<&str> {
        self.captured.problem.as_deref()
    }

    /// The keys in the lines.
    pub fn seen(&self) -> Vec<String> {
        let seen: BTreeSet<&String> = self
            .readers
            .iter()
            .flat_map(|reader| &reader.filter.seen)
            .collect();
        seen.into_iter().cloned().collect()
    }

    /// The keys in the lines, each with a value that is no number, if it has one.
    pub fn seen_keys(&self) -> Vec<SeenKey> {
        let filters = || self.readers.iter().map(|reader| &reader.filter);
        let key = |name: String| SeenKey {
            no_number: filters().find_map(|filter| filter.no_numbers.get(&name)).cloned(),
            name,
        };
        self.seen().into_iter().map(key).collect()
    }

    /// The end of standard error.
    pub fn last_words(&self) -> String {
        let words: Vec<u8> = self.captured.errors.iter().copied().collect();
        String::from_utf8_lossy(&words).trim().to_owned()
    }

    /// The beginning and the end of the output, with the length of the gap between them.
    pub fn captured(&self) -> Vec<u8> {
        let mut all = self.captured.first.clone();
        if self.captured.left_out > 0 {
            let left_out = format!(
                "\n[{} bytes of output are left out here]\n",
                self.captured.left_out
            );
            all.extend(left_out.as_bytes());
        }
        all.extend(self.captured.last.iter());
        all
    }
}

/// Reader of one stream.
#[derive(Debug)]
struct StreamReader {
    stream: &'static str,
    filter: Filter,
    raw: File,
    lines: Lines,
    /// Length of the file's part whose disk space was released.
    given_back: u64,
    noted: File,
}

impl StreamReader {
    fn on(notes: &Path, stream: &'static str, mut filter: Filter) -> Result<Self, Error> {
        let path = noted(notes, stream);
        let before = whole_lines(&path)?;
        filter.counted = before
            .iter()
            .filter(|line| line.get(BEGINS_AGAIN).is_none())
            .count() as u64;
        let at = before.last().and_then(|line| line[AT].as_u64()).unwrap_or(0);
        let file = OpenOptions::new().create(true).append(true).open(&path);
        let noted = file.map_err(Error::file("write", &path))?;
        let path = raw(notes, stream);
        let mut options = OpenOptions::new();
        let raw = options
            .create(true)
            .truncate(false)
            .read(true)
            .write(true)
            .open(&path);
        let mut raw = raw.map_err(Error::file("read", &path))?;
        let there = first_data(&raw, at);
        raw.seek(SeekFrom::Start(there))
            .map_err(Error::file("read", &path))?;
        Ok(Self {
            stream,
            filter,
            raw,
            lines: Lines::from(there, there == at),
            given_back: there,
            noted,
        })
    }

    /// Reads the new output and returns its length.
    fn listen(&mut self, captured: &mut CapturedOutput) -> std::io::Result<u64> {
        let (mut piece, mut heard) = (vec![0; 1 << 16], 0);
        loop {
            let read = self.raw.read(&mut piece)?;
            if read == 0 {
                break;
            }
            captured.add(self.stream, &piece[..read]);
            self.note(|lines, line| lines.take(&piece[..read], line))?;
            heard += read as u64;
        }
        if self.lines.at() - self.given_back > READ {
            give_back(&self.raw, self.lines.at());
            self.given_back = self.lines.at();
        }
        Ok(heard)
    }

    fn end(&mut self) -> std::io::Result<()> {
        self.note(|lines, line| lines.end(line))
    }

    fn mark_continuation(&mut self, notes: &Path) -> Result<(), Error> {
        let at = self.lines.at();
        self.lines = Lines::from(at, true);
        mark(&noted(notes, self.stream), &json!({ BEGINS_AGAIN: true, AT: at }))
    }

    fn note(&mut self, lines: impl FnOnce(&mut Lines, &mut dyn FnMut(&str, u64))) -> std::io::Result<()> {
        let mut noted = String::new();
        let filter = &mut self.filter;
        lines(&mut self.lines, &mut |line, at| {
            if let Some(line) = filter.noted(line, at) {
                noted.push_str(&line);
                noted.push('\n');
            }
        });
        // Whole lines at once, so that a reader never finds half a line.
        self.noted.write_all(noted.as_bytes())
    }
}

/// The lines of a file of JSON; an incomplete line at its end is cut off.
///
/// # Errors
/// [`Error::File`] where the file cannot be read or shortened.
pub fn whole_lines(path: &Path) -> Result<Vec<Value>, Error> {
    let text = match fs::read(path) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        read => read.map_err(Error::file("read", path))?,
    };
    let whole = text
        .iter()
        .rposition(|byte| *byte == b'\n')
        .map_or(0, |end| end + 1);
    if whole < text.len() {
        let file = OpenOptions::new().write(true).open(path);
        let cut = file.and_then(|file| file.set_len(whole as u64));
        cut.map_err(Error::file("write", path))?;
    }
    let lines = text[..whole].split(|byte| *byte == b'\n');
    Ok(lines
        .filter_map(|line| serde_json::from_slice(line).ok())
        .collect())
}

/// Writes a mark into a file of lines where a program continues. A file that does not exist needs no mark.
fn mark(path: &Path, line: &Value) -> Result<(), Error> {
    if !path.exists() {
        return Ok(());
    }
    whole_lines(path)?;
    let file = OpenOptions::new().append(true).open(path);
    let marked = file.and_then(|mut file| writeln!(file, "{line}"));
    marked.map_err(Error::file("write", path))
}

/// Whether lines of an earlier attempt had no step and were numbered; a program that writes them again would
/// get other numbers.
pub fn is_numbered(notes: &Path) -> bool {
    let is_numbered = |line: &Value| line["step"].is_u64();
    STREAMS
        .iter()
        .any(|stream| whole_lines(&noted(notes, stream)).is_ok_and(|lines| lines.iter().any(is_numbered)))
}

/// The first position from `at` on whose disk space was not released.
fn first_data(file: &File, at: u64) -> u64 {
    #[cfg(target_os = "linux")]
    if let Ok(data) = rustix::fs::seek(file, rustix::fs::SeekFrom::Data(at)) {
        return data;
    }
    let _ = file;
    at
}

/// Releases the disk space of a file before a position, if the file system supports it.
fn give_back(file: &File, until: u64) {
    #[cfg(target_os = "linux")]
    {
        use rustix::fs::FallocateFlags;
        let flags = FallocateFlags::PUNCH_HOLE | FallocateFlags::KEEP_SIZE;
        let _ = rustix::fs::fallocate(file, flags, 0, until);
    }
    #[cfg(not(target_os = "linux"))]
    let _ = (file, until);
}

impl CapturedOutput {
    fn add(&mut self, stream: &str, piece: &[u8]) {
        let room = KEPT.saturating_sub(self.first.len()).min(piece.len());
        self.first.extend(&piece[..room]);
        self.last.extend(&piece[room..]);
        let surplus = self.last.len().saturating_sub(KEPT);
        self.last.drain(..surplus);
        self.left_out += surplus as u64;
        if stream == STREAMS[1] {
            self.errors.extend(piece);
            let surplus = self.errors.len().saturating_sub(LAST_WORDS);
            self.errors.drain(..surplus);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn filters() -> [Filter; 2] {
        [(), ()].map(|()| Filter {
            keys: ["x".to_owned()].into(),
            numbers: true,
            ..Filter::default()
        })
    }

    /// Writes the output of a program.
    fn say(notes: &Path, stdout: &[u8], stderr: &[u8]) {
        let [mut output, mut errors] = files(notes).unwrap();
        output.write_all(stdout).unwrap();
        errors.write_all(stderr).unwrap();
    }

    fn listen(notes: &Path) -> OutputReader {
        OutputReader::to(notes, filters()).unwrap()
    }

    fn lines(notes: &Path, stream: &str) -> Vec<String> {
        let lines = whole_lines(&noted(notes, stream)).unwrap();
        let text = |line: &Value| match line.get(BEGINS_AGAIN) {
            Some(_) => "again".to_owned(),
            None => format!(
                "{}: {}",
                line["step"].to_string().replace('"', ""),
                line["x"].as_str().unwrap()
            ),
        };
        lines.iter().map(text).collect()
    }

    #[test]
    fn lines_with_metrics_are_noted_by_stream_and_last_words_are_those_of_errors() {
        let folder = tempfile::tempdir().unwrap();
        let mut listening = listen(folder.path());
        say(folder.path(), b"x=1\nhello\nx=2", b"y=1\nx=3\nit broke\n");
        listening.look();
        assert_eq!(lines(folder.path(), "stdout"), ["1: 1"]);
        listening.end();
        assert_eq!(lines(folder.path(), "stdout"), ["1: 1", "2: 2"]);
        assert_eq!(lines(folder.path(), "stderr"), ["1: 3"]);
        assert_eq!(listening.last_words(), "y=1\nx=3\nit broke");
        assert!(listening.has_heard() && !listening.has_heard());
        assert_eq!(listening.seen(), ["x", "y"]);
        assert!(is_numbered(folder.path()));
    }

    /// A worker is killed after any part of the output, and while it notes a line: the next reader loses no
    /// line and takes none twice.
    #[test]
    fn a_new_reader_loses_no_line_and_takes_none_twice() {
        let all = b"step=1 x=1\nhello\nstep=2 x=2\nstep=3 x=3\n";
        let expected = ["1: 1", "2: 2", "3: 3"];
        for first in 0..=all.len() {
            let folder = tempfile::tempdir().unwrap();
            let notes = folder.path();
            fs::create_dir_all(notes).unwrap();
            say(notes, &all[..first], b"");
            listen(notes).look();
            let path = noted(notes, "stdout");
            let mut torn = OpenOptions::new().append(true).open(&path).unwrap();
            torn.write_all(b"{\"step\": \"2\", \"x").unwrap();
            say(notes, &all[first..], b"");
            listen(notes).end();
            assert_eq!(lines(notes, "stdout"), expected, "{first}");
        }
    }

    #[test]
    fn a_program_that_goes_on_is_marked_and_a_line_that_it_had_begun_is_none() {
        let folder = tempfile::tempdir().unwrap();
        let notes = folder.path();
        fs::write(noted(notes, LOG), "{\"step\": 1}\n{\"st").unwrap();
        say(notes, b"step=1 x=1\nstep=2 x=0.", b"");
        listen(notes).mark_continuation(notes).unwrap();
        // The program is killed again before it writes anything.
        listen(notes).mark_continuation(notes).unwrap();
        say(notes, b"step=2 x=5\n", b"");
        listen(notes).end();
        assert_eq!(lines(notes, "stdout"), ["1: 1", "again", "again", "2: 5"]);
        let log = fs::read_to_string(noted(notes, LOG)).unwrap();
        let mark = "{\"regimen_begins_again\":true}\n";
        assert_eq!(log, format!("{{\"step\": 1}}\n{mark}{mark}"));
        assert!(!is_numbered(notes));
    }

    #[test]
    fn output_that_was_read_is_given_back_to_the_disk() {
        use std::os::unix::fs::MetadataExt as _;
        let folder = tempfile::tempdir().unwrap();
        let notes = folder.path();
        let mut listening = listen(notes);
        let chatter = "so it goes\n".repeat(1 << 20);
        for step in 1..=3 {
            say(notes, format!("step={step} x={step}\n{chatter}").as_bytes(), b"");
            listening.look();
        }
        let file = raw(notes, "stdout").metadata().unwrap();
        assert!(
            file.blocks() * 512 < file.len() / 2,
            "{} of {}",
            file.blocks() * 512,
            file.len()
        );
        say(notes, b"step=4 x=4\n", b"");
        drop(listening);
        listen(notes).end();
        assert_eq!(lines(notes, "stdout"), ["1: 1", "2: 2", "3: 3", "4: 4"]);
    }

    #[test]
    fn of_much_output_the_beginning_and_the_end_are_kept() {
        let mut captured = CapturedOutput::default();
        for _ in 0..5 {
            captured.add("stdout", &vec![b'a'; KEPT / 2]);
        }
        captured.add("stderr", b"the end");
        assert_eq!((captured.first.len(), captured.last.len()), (KEPT, KEPT));
        assert_eq!(captured.left_out, (KEPT / 2 + 7) as u64);
        assert!(
            captured
                .last
                .iter()
                .copied()
                .collect::<Vec<u8>>()
                .ends_with(b"the end")
        );
    }
}
