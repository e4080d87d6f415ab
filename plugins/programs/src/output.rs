//! The output of a program: lines with metrics are noted while it says them, and its first and last words are kept.

use crate::lines::{Filter, Lines};
use engine::Error;
use std::{
    collections::{BTreeSet, VecDeque},
    fs::{File, OpenOptions},
    io::{BufRead, BufReader, Read, Write},
    path::{Path, PathBuf},
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicU64, Ordering},
        mpsc::{Receiver, RecvTimeoutError, Sender, channel},
    },
    thread::JoinHandle,
    time::Duration,
};

/// The streams of a program, as a study names them.
pub const STREAMS: [&str; 2] = ["stdout", "stderr"];
/// The file that a program is told of, as a study names it: what it says there needs no filter.
pub const LOG: &str = "log";
/// How much is kept of the beginning, and as much again of the end, bytes.
const KEPT: usize = 1 << 20;
/// How long the streams of a program that has ended may stay open.
const LONGEST_CLOSING: Duration = Duration::from_secs(2);
/// How much of standard error is told where a program fails, bytes.
const LAST_WORDS: usize = 2000;

/// True for what lies in [`noted`].
pub fn is_noted(from: &str) -> bool {
    from == LOG || STREAMS.contains(&from)
}

/// The file of lines with metrics: those of a stream, or of [`LOG`].
pub fn noted(notes: &Path, stream: &str) -> PathBuf {
    notes.join(format!("{stream}.jsonl"))
}

/// The ear on a program.
#[derive(Debug)]
pub struct Listening {
    threads: Vec<JoinHandle<()>>,
    closed: Receiver<()>,
    heard: Heard,
    /// How much had been heard when it was asked last.
    before: u64,
}

#[derive(Debug, Clone, Default)]
struct Heard {
    bytes: Arc<AtomicU64>,
    said: Arc<Mutex<Said>>,
}

/// The output so far.
#[derive(Debug, Default)]
struct Said {
    first: Vec<u8>,
    last: VecDeque<u8>,
    left_out: u64,
    errors: VecDeque<u8>,
    seen: BTreeSet<String>,
    problem: Option<String>,
}

impl Listening {
    /// Listens to both streams, by their filters.
    ///
    /// # Errors
    /// [`Error::File`] where what is heard cannot be noted.
    pub fn to(streams: [Box<dyn Read + Send>; 2], filters: [Filter; 2], notes: &Path) -> Result<Self, Error> {
        let (heard, (closing, closed)) = (Heard::default(), channel());
        let mut threads = Vec::new();
        for ((stream, mut filter), name) in streams.into_iter().zip(filters).zip(STREAMS) {
            let path = noted(notes, name);
            filter.counted = lines_in(&path);
            let file = OpenOptions::new().create(true).append(true).open(&path);
            let file = file.map_err(Error::file("write", &path))?;
            let ear = Ear {
                stream: name,
                filter,
                file,
                heard: heard.clone(),
            };
            let closing = closing.clone();
            threads.push(std::thread::spawn(move || ear.listen(stream, &closing)));
        }
        Ok(Self {
            threads,
            closed,
            heard,
            before: 0,
        })
    }

    /// Waits until both streams are closed, not longer than `wait`; true where they are.
    pub fn closes_within(&self, wait: Duration) -> bool {
        self.closed.recv_timeout(wait) == Err(RecvTimeoutError::Disconnected)
    }

    /// True where something was heard since this was asked last.
    pub fn has_heard(&mut self) -> bool {
        let heard = self.heard.bytes.load(Ordering::Relaxed);
        heard != std::mem::replace(&mut self.before, heard)
    }

    /// Why what was heard could not be noted.
    pub fn problem(&self) -> Option<String> {
        self.heard.lock().problem.clone()
    }

    /// The keys that lines had.
    pub fn seen(&self) -> Vec<String> {
        self.heard.lock().seen.iter().cloned().collect()
    }

    /// The last words on standard error.
    pub fn last_words(&self) -> String {
        let said = self.heard.lock();
        let words: Vec<u8> = said.errors.iter().copied().collect();
        String::from_utf8_lossy(&words).trim().to_owned()
    }

    /// The output: its beginning and its end, with how much is left out between them.
    pub fn said(&self) -> Vec<u8> {
        let said = self.heard.lock();
        let mut all = said.first.clone();
        if said.left_out > 0 {
            let left_out = format!("\n[{} bytes of output are left out here]\n", said.left_out);
            all.extend(left_out.as_bytes());
        }
        all.extend(said.last.iter());
        all
    }

    /// Waits for the threads, once the program has ended. A process that it left in another session, under a
    /// guard that was killed, may hold the streams open, and is not waited for.
    pub fn end(&mut self) {
        if !self.threads.is_empty() && !self.closes_within(LONGEST_CLOSING) {
            self.threads.clear();
        }
        for thread in self.threads.drain(..) {
            // A panic of one was printed.
            let _ = thread.join();
        }
    }
}

impl Heard {
    fn lock(&self) -> MutexGuard<'_, Said> {
        // Words are added one after the other: those that are there are whole.
        self.said.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Listens to one stream.
struct Ear {
    stream: &'static str,
    filter: Filter,
    file: File,
    heard: Heard,
}

impl Ear {
    /// Until the stream is closed. The receiver learns of it when `_closing` is dropped by all.
    fn listen(mut self, mut stream: impl Read, _closing: &Sender<()>) {
        let (mut lines, mut piece) = (Lines::default(), vec![0; 1 << 16]);
        while let Ok(read @ 1..) = stream.read(&mut piece) {
            let piece = &piece[..read];
            self.heard.lock().add(self.stream, piece);
            self.note(|line| lines.take(piece, line));
            self.heard.bytes.fetch_add(read as u64, Ordering::Relaxed);
        }
        self.note(|line| lines.end(line));
    }

    fn note(&mut self, lines: impl FnOnce(&mut dyn FnMut(&str))) {
        let mut noted = String::new();
        lines(&mut |line| {
            if let Some(line) = self.filter.noted(line) {
                noted.push_str(&line);
                noted.push('\n');
            }
        });
        // Whole lines at once, so that a reader finds no half of one.
        let written = self.file.write_all(noted.as_bytes());
        let mut said = self.heard.lock();
        if let Err(error) = written {
            said.problem.get_or_insert(error.to_string());
        }
        if said.seen.len() < self.filter.seen.len() {
            said.seen.extend(self.filter.seen.iter().cloned());
        }
    }
}

impl Said {
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

fn lines_in(path: &Path) -> u64 {
    File::open(path).map_or(0, |file| BufReader::new(file).lines().count() as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn heard(stdout: &'static [u8], stderr: &'static [u8]) -> (Listening, tempfile::TempDir) {
        let folder = tempfile::tempdir().unwrap();
        let filter = || Filter {
            keys: ["x".to_owned()].into(),
            numbers: true,
            ..Filter::default()
        };
        let streams: [Box<dyn Read + Send>; 2] = [Box::new(stdout), Box::new(stderr)];
        let mut listening = Listening::to(streams, [filter(), filter()], folder.path()).unwrap();
        assert!(listening.closes_within(Duration::from_secs(60)));
        listening.end();
        (listening, folder)
    }

    #[test]
    fn lines_with_metrics_are_noted_by_stream_and_last_words_are_those_of_errors() {
        let (mut listening, folder) = heard(b"x=1\nhello\nx=2", b"y=1\nx=3\nit broke\n");
        let noted = |stream| std::fs::read_to_string(noted(folder.path(), stream)).unwrap();
        assert_eq!(
            noted("stdout"),
            "{\"step\":1,\"x\":\"1\"}\n{\"step\":2,\"x\":\"2\"}\n"
        );
        assert_eq!(noted("stderr"), "{\"step\":1,\"x\":\"3\"}\n");
        assert_eq!(listening.last_words(), "y=1\nx=3\nit broke");
        assert!(listening.has_heard() && !listening.has_heard());
        assert_eq!(listening.seen(), ["x", "y"]);
        assert_eq!(lines_in(&folder.path().join("stdout.jsonl")), 2);
    }

    #[test]
    fn of_much_output_the_beginning_and_the_end_are_kept() {
        let mut said = Said::default();
        for _ in 0..5 {
            said.add("stdout", &vec![b'a'; KEPT / 2]);
        }
        said.add("stderr", b"the end");
        assert_eq!((said.first.len(), said.last.len()), (KEPT, KEPT));
        assert_eq!(said.left_out, (KEPT / 2 + 7) as u64);
        assert!(
            said.last
                .iter()
                .copied()
                .collect::<Vec<u8>>()
                .ends_with(b"the end")
        );
    }
}
