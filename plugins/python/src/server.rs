//! The environments of one Python process: a block of shared memory for each, and the waiting requests.
//!
//! The engine reads and writes the file that Python maps into its memory, so this code handles no pointers.

use crate::{
    interface::{EnvironmentDescription, n_asked},
    making::MakeRequest,
    process::{Answer, Process, failed},
};
use contract::{Channel, Error, Seat};
use serde::de::DeserializeOwned;
use serde_json::Value;
use std::{
    collections::BTreeMap,
    fs::{self, File, OpenOptions},
    os::unix::fs::FileExt,
    sync::{Arc, Mutex, MutexGuard, PoisonError, Weak},
};
use tempfile::TempDir;

/// Maximum number of blocks in the shared memory, which begins with the numbers of the waiting blocks. It equals the
/// value in `server.py`.
const MOST_ENVIRONMENTS: usize = 8192;
const BYTES: usize = 8;
/// Seed of a rehearsal.
const REHEARSED: u64 = 20;

/// Request to an environment, with the codes of `server.py`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Request {
    /// Take a step.
    Step = 1,
    /// Begin another episode.
    Reset = 2,
    /// Begin an episode of an environment as it was made.
    Renew = 3,
}

/// A Python process and its environments.
#[derive(Debug)]
pub struct Server {
    process: Process,
    memory: File,
    seats: Vec<Seat>,
    state: Vec<Channel>,
    metrics: Vec<String>,
    /// Holds copies of the data files that the environments read.
    _files: TempDir,
    /// Count of numbers in a request, and in an answer.
    asked: usize,
    answered: usize,
    /// Whether each block is in use.
    taken: Vec<bool>,
    /// Blocks with requests that were not announced to Python yet.
    waiting: Vec<u64>,
    bytes: Vec<u8>,
}

/// A process that its environments share; it ends with the last of them.
pub type SharedServer = Arc<Mutex<Server>>;

/// Servers in use, by the key of the request that made them.
static SERVERS: Mutex<BTreeMap<String, Weak<Mutex<Server>>>> = Mutex::new(BTreeMap::new());

/// The server for this request: one in use, or a new one.
///
/// # Errors
/// The errors of [`Server::start`].
pub fn shared(interpreter: &str, request: &MakeRequest) -> Result<SharedServer, Error> {
    let key = request.key()?;
    let mut servers = SERVERS.lock().unwrap_or_else(PoisonError::into_inner);
    servers.retain(|_, server| server.strong_count() > 0);
    if let Some(server) = servers.get(&key).and_then(Weak::upgrade) {
        return Ok(server);
    }
    let server = Arc::new(Mutex::new(Server::start(interpreter, request)?));
    servers.insert(key, Arc::downgrade(&server));
    Ok(server)
}

/// Locks a server.
pub fn lock(server: &SharedServer) -> MutexGuard<'_, Server> {
    // A panic elsewhere ends the trial, and the process with it.
    server.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Server {
    /// Starts Python and makes a first environment.
    ///
    /// # Errors
    /// [`Error::Unavailable`] without an interpreter, a package or a version of the lock file, and
    /// [`Error::Config`] where Python cannot be started, where nothing can be made there, and for an
    /// environment with unsupported spaces.
    pub fn start(interpreter: &str, request: &MakeRequest) -> Result<Self, Error> {
        let (files, json) = with_own_files(request)?;
        let text = json.to_string();
        let (process, answer) = Process::start(interpreter, files.path(), "environment", text.as_bytes())?;
        let face: EnvironmentDescription = face_in(answer)?;
        let memory = OpenOptions::new().read(true).write(true).open(&face.memory);
        let memory = memory.map_err(Error::file("open", &face.memory))?;
        if face.remove {
            fs::remove_file(&face.memory).map_err(Error::file("remove", &face.memory))?;
        }
        let (seats, state) = (face.seats(), face.state());
        let seen: usize = seats.iter().map(|seat| seat.observation.len()).sum();
        Ok(Self {
            asked: 2 + seats.iter().map(n_asked).sum::<usize>(),
            answered: 1 + seats.len() + seen + state.len() + face.metrics.len(),
            process,
            memory,
            seats,
            state,
            metrics: face.metrics,
            _files: files,
            taken: Vec::new(),
            waiting: Vec::new(),
            bytes: Vec::new(),
        })
    }

    /// The seats of its environments.
    pub fn seats(&self) -> &[Seat] {
        &self.seats
    }

    /// Channels of the full state.
    pub fn state(&self) -> &[Channel] {
        &self.state
    }

    /// Names of the metrics in an answer.
    pub fn metrics(&self) -> &[String] {
        &self.metrics
    }

    /// Takes a free block.
    ///
    /// # Errors
    /// [`Error::Model`] where none is free.
    pub fn open(&mut self) -> Result<usize, Error> {
        let free = self.taken.iter().position(|taken| !taken);
        let slot = free.unwrap_or(self.taken.len());
        if slot == MOST_ENVIRONMENTS {
            return Err(failed(format!(
                "more than {MOST_ENVIRONMENTS} environments at a time"
            )));
        }
        if slot == self.taken.len() {
            self.taken.push(false);
        }
        self.taken[slot] = true;
        Ok(slot)
    }

    /// Frees a block.
    pub fn close(&mut self, slot: usize) {
        self.taken[slot] = false;
        self.waiting.retain(|waiting| *waiting != slot as u64);
    }

    /// Writes a request, which the next [`answer`](Self::answer) announces to Python.
    ///
    /// # Errors
    /// [`Error::Model`] where the shared memory cannot be written.
    pub fn request(&mut self, slot: usize, what: Request, seed: u32, actions: &[f64]) -> Result<(), Error> {
        let head = [f64::from(what as u8), f64::from(seed)];
        self.bytes.clear();
        self.bytes.extend(bytemuck::cast_slice(&head));
        self.bytes.extend(bytemuck::cast_slice(actions));
        self.memory
            .write_all_at(&self.bytes, self.place(slot))
            .map_err(|source| of_memory(&source))?;
        self.waiting.push(slot as u64);
        Ok(())
    }

    /// The answer in a block: state of the episode, rewards, observations. All waiting requests are carried out
    /// first.
    ///
    /// # Errors
    /// [`Error::Model`] for an error in Python.
    pub fn answer(&mut self, slot: usize, numbers: &mut Vec<f64>) -> Result<(), Error> {
        if !self.waiting.is_empty() {
            self.ring()?;
        }
        numbers.resize(self.answered, 0.0);
        let place = self.place(slot) + (BYTES * self.asked) as u64;
        let read = self
            .memory
            .read_exact_at(bytemuck::cast_slice_mut(numbers), place);
        read.map_err(|source| of_memory(&source))
    }

    fn ring(&mut self) -> Result<(), Error> {
        let mut list = vec![self.waiting.len() as u64];
        list.append(&mut self.waiting);
        let written = self.memory.write_all_at(bytemuck::cast_slice(&list), 0);
        written.map_err(|source| of_memory(&source))?;
        self.process.ring()
    }

    /// Offset of a block in the file.
    fn place(&self, slot: usize) -> u64 {
        let block = self.asked + self.answered;
        (BYTES * (1 + MOST_ENVIRONMENTS + slot * block)) as u64
    }

    /// The environment of a block as bytes, or the reason why it could not continue identically from them.
    ///
    /// # Errors
    /// [`Error::Model`] where Python ended.
    pub fn snapshot(&mut self, slot: usize) -> Result<Answer, Error> {
        self.process.ask(Some(b'p'), &(slot as u64).to_le_bytes())
    }

    /// Puts an environment into a block that continues from a snapshot.
    ///
    /// # Errors
    /// [`Error::Model`] where Python ended.
    pub fn restore(&mut self, slot: usize, state: &[u8]) -> Result<Answer, Error> {
        let text = [&(slot as u64).to_le_bytes(), state].concat();
        self.process.ask(Some(b'r'), &text)
    }

    /// Answers of a new environment to a reset and ten steps.
    ///
    /// # Errors
    /// [`Error::Config`] for an error in Python and for a number that is not finite; [`Error::Unavailable`] for
    /// a missing package.
    pub fn rehearse(&mut self) -> Result<Rehearsal, Error> {
        let rows = self.tried(b't')?;
        let rehearsal = Rehearsal {
            rows: rows.chunks(BYTES * self.answered).map(<[u8]>::to_vec).collect(),
        };
        for (row, numbers) in rehearsal.numbers().enumerate() {
            if let Some(entry) = numbers.iter().position(|number| !number.is_finite()) {
                let (name, value, when) = (self.name_of(entry), numbers[entry], when(row));
                return Err(Error::config(
                    "make",
                    format!("`{name}` is {value} {when}, which is no finite number"),
                ));
            }
        }
        Ok(rehearsal)
    }

    /// Usable results of an environment that differ from its declaration.
    ///
    /// # Errors
    /// The errors of [`rehearse`](Self::rehearse).
    pub fn doubts(&mut self) -> Result<Vec<String>, Error> {
        let lines = self.tried(b'd')?;
        Ok(String::from_utf8_lossy(&lines)
            .lines()
            .map(str::to_owned)
            .collect())
    }

    fn tried(&mut self, what: u8) -> Result<Vec<u8>, Error> {
        let seed = REHEARSED.to_le_bytes();
        match self
            .process
            .ask_within("make", "the rehearsal", Some(what), &seed)?
        {
            Answer::Done(bytes) => Ok(bytes),
            Answer::Cannot(refusal) => Err(refused(&refusal)),
            Answer::Failed(problem) => Err(Error::config("make", problem)),
        }
    }

    /// Describes an entry of an answer.
    pub fn name_of(&self, entry: usize) -> String {
        if entry == 0 {
            return "the end of the episode".into();
        }
        let rewards = self.seats.iter().map(|seat| prefixed(seat, "reward"));
        let seen = self
            .seats
            .iter()
            .flat_map(|seat| seat.observation.names().into_iter().map(|it| prefixed(seat, &it)));
        let state = self.state.iter().map(|channel| channel.name.clone());
        let metrics = self.metrics.iter().cloned();
        rewards
            .chain(seen)
            .chain(state)
            .chain(metrics)
            .nth(entry - 1)
            .unwrap_or_default()
    }

    /// Describes the difference between two rehearsals; `None` where they are equal.
    pub fn difference(&self, first: &Rehearsal, second: &Rehearsal) -> Option<String> {
        let row = first
            .rows
            .iter()
            .zip(&second.rows)
            .position(|(one, other)| one != other)?;
        let (one, other) = (first.numbers().nth(row)?, second.numbers().nth(row)?);
        let entry = one
            .iter()
            .zip(&other)
            .position(|(one, other)| one.to_bits() != other.to_bits())?;
        let (when, name) = (when(row), self.name_of(entry));
        let (one, other) = (one[entry], other[entry]);
        Some(format!("{when}, `{name}` is {one} and then {other}"))
    }
}

/// Answers to a reset and some steps.
#[derive(Debug, PartialEq, Eq)]
pub struct Rehearsal {
    rows: Vec<Vec<u8>>,
}

impl Rehearsal {
    fn numbers(&self) -> impl Iterator<Item = Vec<f64>> {
        self.rows
            .iter()
            .map(|row| bytemuck::pod_collect_to_vec::<u8, f64>(row))
    }
}

/// Describes the step of a row of a rehearsal; after the end of an episode, the reset that followed is counted too.
fn when(row: usize) -> String {
    match row {
        0 => "after `reset`".into(),
        row => format!("after step {row}"),
    }
}

/// The first answer of Python once it has made the environment or the agent.
///
/// # Errors
/// A refusal, at the config key that it names.
pub fn face_in<T: DeserializeOwned>(answer: Answer) -> Result<T, Error> {
    match answer {
        Answer::Done(text) => serde_json::from_slice(&text).map_err(|source| failed(source.to_string())),
        Answer::Cannot(refusal) | Answer::Failed(refusal) => Err(refused(&refusal)),
    }
}

/// The request with its data files replaced by the paths of private copies, and the folder of these.
///
/// # Errors
/// [`Error::File`] where a file cannot be copied.
pub fn with_own_files(request: &MakeRequest) -> Result<(TempDir, Value), Error> {
    let folder = tempfile::Builder::new().prefix("regimen-python-").tempdir();
    let folder = folder.map_err(Error::file("create", &std::env::temp_dir()))?;
    let mut json = request.json.clone();
    for (at, (place, file)) in request.files.iter().enumerate() {
        let own = folder.path().join(at.to_string());
        fs::create_dir(&own).map_err(Error::file("create", &own))?;
        if let Some(path) = json.pointer_mut(place) {
            *path = serde_json::json!(file.copy_into(&own)?);
        }
    }
    Ok((folder, json))
}

/// The name of a seat's quantity, with the seat before it where seats have names.
pub fn prefixed(seat: &Seat, name: &str) -> String {
    if seat.name.is_empty() {
        name.to_owned()
    } else {
        format!("{}_{name}", seat.name)
    }
}

fn of_memory(source: &std::io::Error) -> Error {
    failed(format!(
        "the memory that is shared with Python cannot be used: {source}"
    ))
}

/// The error of a refusal by Python, at the config key that it names.
fn refused(refusal: &str) -> Error {
    let value: Value = serde_json::from_str(refusal).unwrap_or_default();
    let word = |key: &str| value[key].as_str().map(str::to_owned);
    let problem = word("problem").unwrap_or_else(|| refusal.to_owned());
    let key = word("key").unwrap_or_else(|| "make".into());
    if value["lacks"] == true {
        return Error::Unavailable { key, problem };
    }
    Error::config(key, problem)
}
