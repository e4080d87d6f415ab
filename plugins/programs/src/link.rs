//! The socket on which a program requests measurements, and answers with actions while it is measured.
//!
//! A program opens a connection for each measurement and writes a line of JSON, `{"step": 1000}` or `{"step":
//! null}` for the last one. From then on both sides write rows of numbers: two integers of 4 bytes, the count
//! of rows and of columns, and the numbers, 8 bytes each, in little-endian order. A count of zero rows ends the
//! measurement: the count of columns is then the length of a JSON text, which follows and holds the mean of
//! each metric or `null`.

use contract::{Error, own_training::MeasurementPoint};
use serde::Deserialize;
use std::{
    collections::BTreeMap,
    io::{self, BufRead, BufReader, ErrorKind, Read, Write},
    os::unix::net::{UnixListener, UnixStream},
    path::{Path, PathBuf},
    time::Duration,
};
use tempfile::TempDir;

/// Longest wait for the line of a request.
const LONGEST_LINE: Duration = Duration::from_secs(10);
/// Longest line of a request, bytes.
const MOST_ASKED: u64 = 1000;

/// A socket for requests of measurements.
#[derive(Debug)]
pub struct Link {
    /// A temporary folder: the paths of sockets have to be short.
    folder: TempDir,
    listener: UnixListener,
    asking: Option<UnixStream>,
    patience: Option<Duration>,
}

/// The line of a request.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields, expecting = "a request")]
struct RequestLine {
    step: Option<u64>,
}

impl Link {
    /// Opens a socket; a program that does not answer within `patience` is an error.
    ///
    /// # Errors
    /// [`Error::File`] where no socket can be made.
    pub fn open(patience: Option<Duration>) -> Result<Self, Error> {
        let folder = tempfile::tempdir().map_err(Error::file("create a folder in", &std::env::temp_dir()))?;
        let path = at(&folder);
        let listener = UnixListener::bind(&path).and_then(|listener| {
            listener.set_nonblocking(true)?;
            Ok(listener)
        });
        Ok(Self {
            listener: listener.map_err(Error::file("listen at", &path))?,
            folder,
            asking: None,
            patience,
        })
    }

    /// Path of the socket.
    pub fn path(&self) -> PathBuf {
        at(&self.folder)
    }

    /// The next request; `None` without one.
    ///
    /// # Errors
    /// [`Error::Model`] for a line that is not a request.
    pub fn asked(&mut self) -> Result<Option<MeasurementPoint>, Error> {
        let stream = match self.listener.accept() {
            Ok((stream, _)) => stream,
            Err(error) if error.kind() == ErrorKind::WouldBlock => return Ok(None),
            Err(error) => return Err(lost(&error)),
        };
        let line = line_of(&stream).map_err(|error| lost(&error))?;
        if line.is_empty() {
            // The program was ended before it wrote a request.
            return Ok(None);
        }
        let asked: RequestLine = serde_json::from_str(&line)
            .map_err(|error| wrong(format!("`{}` asks for no measurement: {error}", line.trim())))?;
        self.asking = Some(stream);
        Ok(Some(
            asked.step.map_or(MeasurementPoint::Last, MeasurementPoint::At),
        ))
    }

    /// Whether the program asks for another measurement; its request is not answered.
    pub fn is_asked_again(&self) -> bool {
        self.listener.accept().is_ok()
    }

    /// The rows of `columns` numbers with which the program answers these rows.
    ///
    /// # Errors
    /// [`Error::Silent`] where the answer takes too long, [`Error::Action`] for a wrong number of rows or
    /// columns, and [`Error::Model`] where the program left.
    pub fn act(&mut self, rows: &[&[f64]], columns: usize) -> Result<Vec<Vec<f64>>, Error> {
        let patience = self.patience;
        let failed = |error: io::Error| match (error.kind(), patience) {
            (ErrorKind::WouldBlock | ErrorKind::TimedOut, Some(limit)) => Error::Silent { limit },
            _ => lost(&error),
        };
        let stream = self.stream()?;
        stream.write_all(&as_bytes(rows)).map_err(failed)?;
        let mut head = [0; 8];
        stream.read_exact(&mut head).map_err(failed)?;
        let [found_rows, found_columns] = lengths(head);
        if [found_rows, found_columns] != [rows.len(), columns] {
            let problem = format!(
                "the program was asked for {} rows of {columns} numbers, and gave {found_rows} of {found_columns}",
                rows.len()
            );
            return Err(Error::Action { problem });
        }
        let mut bytes = vec![0; 8 * found_rows * found_columns];
        stream.read_exact(&mut bytes).map_err(failed)?;
        Ok(as_rows(&bytes, columns))
    }

    /// Ends the measurement and sends the means.
    ///
    /// # Errors
    /// [`Error::Model`] where the program left.
    pub fn answer(&mut self, means: Option<&BTreeMap<String, f64>>) -> Result<(), Error> {
        let text = serde_json::to_vec(&means).map_err(|error| wrong(error.to_string()))?;
        let told = [&head(0, text.len())[..], &text].concat();
        self.stream()?.write_all(&told).map_err(|error| lost(&error))?;
        self.asking = None;
        Ok(())
    }

    fn stream(&mut self) -> Result<&mut UnixStream, Error> {
        let patience = self.patience;
        let stream = self.asking.as_mut();
        let stream = stream.ok_or_else(|| wrong("it did not ask to be measured".to_owned()))?;
        let limited = stream
            .set_read_timeout(patience)
            .and_then(|()| stream.set_write_timeout(patience));
        limited.map_err(|error| lost(&error))?;
        Ok(stream)
    }
}

fn at(folder: &TempDir) -> PathBuf {
    Path::new(folder.path()).join("trial")
}

/// Reads the line of a request; empty where the program left.
fn line_of(stream: &UnixStream) -> io::Result<String> {
    stream.set_nonblocking(false)?;
    stream.set_read_timeout(Some(LONGEST_LINE))?;
    let mut line = String::new();
    BufReader::with_capacity(1, stream.take(MOST_ASKED)).read_line(&mut line)?;
    Ok(line)
}

fn head(rows: usize, columns: usize) -> [u8; 8] {
    let four = |length: usize| u32::try_from(length).unwrap_or(u32::MAX).to_le_bytes();
    let mut head = [0; 8];
    head[..4].copy_from_slice(&four(rows));
    head[4..].copy_from_slice(&four(columns));
    head
}

fn lengths([a, b, c, d, e, f, g, h]: [u8; 8]) -> [usize; 2] {
    [[a, b, c, d], [e, f, g, h]].map(|four| u32::from_le_bytes(four) as usize)
}

fn as_bytes(rows: &[&[f64]]) -> Vec<u8> {
    let columns = rows.first().map_or(0, |row| row.len());
    let numbers = rows.iter().flat_map(|row| row.iter());
    let numbers = numbers.flat_map(|number| number.to_le_bytes());
    head(rows.len(), columns).into_iter().chain(numbers).collect()
}

fn as_rows(bytes: &[u8], columns: usize) -> Vec<Vec<f64>> {
    let number = |eight: &[u8; 8]| f64::from_le_bytes(*eight);
    let numbers: Vec<f64> = bytes.as_chunks().0.iter().map(number).collect();
    numbers.chunks(columns.max(1)).map(<[f64]>::to_vec).collect()
}

fn wrong(problem: String) -> Error {
    Error::Model {
        model: "the program",
        problem,
    }
}

fn lost(error: &io::Error) -> Error {
    let why = match error.kind() {
        ErrorKind::UnexpectedEof => "an error in `act` may not be caught around `trial.measure`".into(),
        _ => error.to_string(),
    };
    wrong(format!("it left a measurement before its end: {why}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Runs a program's part of the protocol in another thread, beside the link.
    fn with(
        asks: impl FnOnce(UnixStream) + Send + 'static,
        patience: Option<Duration>,
    ) -> (Link, Result<Option<MeasurementPoint>, Error>) {
        let mut link = Link::open(patience).unwrap();
        assert!(link.asked().unwrap().is_none(), "nobody asks yet");
        let stream = UnixStream::connect(link.path()).unwrap();
        std::thread::spawn(move || asks(stream));
        let asked = link.asked();
        (link, asked)
    }

    #[test]
    fn numbers_come_back_to_the_bit_and_means_are_told() {
        let (said, heard) = std::sync::mpsc::channel();
        let asks = move |mut stream: UnixStream| {
            stream.write_all(b"{\"step\": 40}\n").unwrap();
            let mut told = vec![0; 8 + 4 * 8];
            stream.read_exact(&mut told).unwrap();
            let two = as_rows(&told[8..], 2);
            let rows: Vec<&[f64]> = two.iter().map(|row| &row[..1]).collect();
            stream.write_all(&as_bytes(&rows)).unwrap();
            let mut end = Vec::new();
            stream.read_to_end(&mut end).unwrap();
            said.send(end).unwrap();
        };
        let (mut link, asked) = with(asks, None);
        assert_eq!(asked.unwrap(), Some(MeasurementPoint::At(40)));
        let rows = [[f64::MIN_POSITIVE, 1.0], [0.1, -0.0]];
        let actions = link.act(&rows.each_ref().map(|row| &row[..]), 1).unwrap();
        assert_eq!(actions, [[f64::MIN_POSITIVE], [0.1]]);
        link.answer(Some(&[("return".to_owned(), 2.5)].into())).unwrap();
        let end = heard.recv().unwrap();
        assert_eq!(
            (lengths(end[..8].try_into().unwrap()), &end[8..]),
            ([0, 14], &b"{\"return\":2.5}"[..])
        );
    }

    #[test]
    fn invalid_requests_and_answers_and_early_exits_are_errors() {
        let (_, asked) = with(|mut stream| stream.write_all(b"{\"stop\": 1}\n").unwrap(), None);
        assert!(asked.unwrap_err().to_string().contains("asks for no measurement"));
        let (_, asked) = with(drop, None);
        assert_eq!(asked.unwrap(), None);
        let last = |mut stream: UnixStream| {
            stream.write_all(b"{\"step\": null}\n").unwrap();
            stream
        };
        let (mut link, asked) = with(move |stream| drop(last(stream)), None);
        assert_eq!(asked.unwrap(), Some(MeasurementPoint::Last));
        let left = link.act(&[&[1.0]], 1).unwrap_err().to_string();
        assert!(left.contains("left a measurement before its end"), "{left}");
        assert!(!link.is_asked_again());
        let _again = UnixStream::connect(link.path()).unwrap();
        assert!(link.is_asked_again());
        let short = move |stream| {
            let mut stream = last(stream);
            stream.write_all(&as_bytes(&[&[1.0]])).unwrap();
            std::thread::sleep(Duration::from_secs(5));
        };
        let (mut link, _) = with(short, None);
        let other = link.act(&[&[1.0], &[2.0]], 1).unwrap_err().to_string();
        assert!(
            other.contains("asked for 2 rows of 1 numbers, and gave 1 of 1"),
            "{other}"
        );
    }

    #[test]
    fn a_program_that_does_not_answer_is_not_waited_for_without_end() {
        let silent = |mut stream: UnixStream| {
            stream.write_all(b"{\"step\": null}\n").unwrap();
            std::thread::sleep(Duration::from_secs(5));
        };
        let (mut link, _) = with(silent, Some(Duration::from_millis(20)));
        assert!(matches!(link.act(&[&[1.0]], 1), Err(Error::Silent { .. })));
    }
}
