//! Requests of other processes, over a Unix socket.
//!
//! A message is a kind, the number of a member, the length of its content in bytes, and the content. A reply is 0 or 1,
//! the length of its content, and the content: the result, or the sentence of [`Lost`]. Numbers have 32 bits in the
//! machine's byte order, since both ends run on one machine.

use bytemuck::{Pod, cast_slice, cast_slice_mut};
use plan::Shape;
use plan::cuda::Kernels;
use plan::executor::{Executor, Lost, Member};
use std::collections::BTreeMap;
use std::io::{Error, ErrorKind, Read, Write};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

const ADMIT: u32 = 1;
const DISMISS: u32 = 2;
const WRITE: u32 = 3;
const READ: u32 = 4;
const LOAD: u32 = 5;
const RUN: u32 = 6;

/// Serves the processes that connect to a socket, each in a thread.
///
/// # Errors
/// [`Error`] if no process can connect any more.
pub fn serve(listener: &UnixListener, executor: &Arc<dyn Executor>) -> Result<(), Error> {
    for stream in listener.incoming() {
        let mut guest = Guest {
            stream: stream?,
            executor: Arc::clone(executor),
            members: BTreeMap::new(),
            routines: Vec::new(),
        };
        // The members of a process end with it.
        std::thread::spawn(move || while guest.answer().is_ok() {});
    }
    Ok(())
}

/// A connected process.
struct Guest {
    stream: UnixStream,
    executor: Arc<dyn Executor>,
    members: BTreeMap<u32, Arc<dyn Member>>,
    routines: Vec<Arc<Kernels>>,
}

impl Guest {
    fn answer(&mut self) -> Result<(), Error> {
        let [kind, member, length] = read_words(&mut self.stream)?;
        let content = read_bytes(&mut self.stream, length)?;
        let (code, content) = match self.result(kind, member, &content) {
            Ok(content) => (0, content),
            Err(Lost { reason }) => (1, reason.into_bytes()),
        };
        write_message(&mut self.stream, &[code, length_of(&content)?], &[&content])
    }

    fn result(&mut self, kind: u32, member: u32, content: &[u8]) -> Result<Vec<u8>, Lost> {
        let of_member = || self.members.get(&member).ok_or_else(|| unknown(member));
        match kind {
            ADMIT => {
                let tensors: Vec<(String, Shape)> = serde_json::from_slice(content).map_err(garbled)?;
                let tensors: Vec<(&str, Shape)> = tensors
                    .iter()
                    .map(|(name, shape)| (name.as_str(), *shape))
                    .collect();
                self.members.insert(member, self.executor.admit(&tensors)?);
                Ok(Vec::new())
            }
            DISMISS => {
                self.members.remove(&member);
                Ok(Vec::new())
            }
            WRITE => {
                let (name, entries) = named(content)?;
                of_member()?.write(name, &numbers::<f32>(entries))?;
                Ok(Vec::new())
            }
            READ => Ok(cast_slice(&of_member()?.read(named(content)?.0)?).to_vec()),
            LOAD => {
                self.routines
                    .push(Arc::new(serde_json::from_slice(content).map_err(garbled)?));
                Ok(Vec::new())
            }
            RUN => {
                let words: Vec<u32> = numbers(content);
                let routine = words.first().and_then(|at| self.routines.get(*at as usize));
                let routine = routine.ok_or_else(|| unknown(member))?;
                let (run, inputs) = words[1..].split_at(routine.run_size().min(words.len() - 1));
                let outputs = of_member()?.run(routine, run, cast_slice(inputs))?;
                Ok(cast_slice(&outputs).to_vec())
            }
            _ => Err(unknown(member)),
        }
    }
}

fn garbled(error: serde_json::Error) -> Lost {
    Lost {
        reason: format!("a message to the process that drives the card is garbled: {error}"),
    }
}

fn unknown(member: u32) -> Lost {
    Lost {
        reason: format!("the process that drives the card does not know member {member} or its request"),
    }
}

/// A name after its length, and the rest.
fn named(content: &[u8]) -> Result<(&str, &[u8]), Lost> {
    let split = content.split_first_chunk::<4>().and_then(|(length, rest)| {
        let (name, rest) = rest.split_at_checked(u32::from_ne_bytes(*length) as usize)?;
        Some((std::str::from_utf8(name).ok()?, rest))
    });
    split.ok_or_else(|| unknown(0))
}

/// An executor in another process.
#[derive(Debug, Clone)]
pub struct Remote {
    line: Arc<Mutex<Line>>,
}

/// The connection to the process of the executor.
#[derive(Debug)]
struct Line {
    stream: UnixStream,
    /// Routines known to the other process, by their number there.
    routines: Vec<Arc<Kernels>>,
    /// Members so far.
    n_members: u32,
}

impl Remote {
    /// Connects to a socket.
    ///
    /// # Errors
    /// [`Error`] if no process answers there.
    pub fn new(socket: &Path) -> Result<Self, Error> {
        let line = Line {
            stream: UnixStream::connect(socket)?,
            routines: Vec::new(),
            n_members: 0,
        };
        Ok(Self {
            line: Arc::new(Mutex::new(line)),
        })
    }
}

fn open(line: &Mutex<Line>) -> MutexGuard<'_, Line> {
    line.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Line {
    fn ask(&mut self, kind: u32, member: u32, contents: &[&[u8]]) -> Result<Vec<u8>, Lost> {
        let gone = |error: Error| Lost {
            reason: match error.kind() {
                ErrorKind::UnexpectedEof | ErrorKind::BrokenPipe | ErrorKind::ConnectionReset => {
                    "the process that drives the card has ended".into()
                }
                _ => format!("the process that drives the card cannot be asked: {error}"),
            },
        };
        let length = contents.iter().map(|content| content.len()).sum::<usize>();
        let length = u32::try_from(length).map_err(|_| gone(ErrorKind::FileTooLarge.into()))?;
        write_message(&mut self.stream, &[kind, member, length], contents).map_err(gone)?;
        let [code, length] = read_words(&mut self.stream).map_err(gone)?;
        let content = read_bytes(&mut self.stream, length).map_err(gone)?;
        if code == 0 {
            return Ok(content);
        }
        Err(Lost {
            reason: String::from_utf8_lossy(&content).into_owned(),
        })
    }

    /// Number of a routine in the other process.
    fn routine(&mut self, kernels: &Arc<Kernels>) -> Result<u32, Lost> {
        let found = self.routines.iter().position(|it| Arc::ptr_eq(it, kernels));
        let at = match found {
            Some(at) => at,
            None => {
                let content = serde_json::to_vec(&**kernels).map_err(garbled)?;
                self.ask(LOAD, 0, &[&content])?;
                self.routines.push(Arc::clone(kernels));
                self.routines.len() - 1
            }
        };
        u32::try_from(at).map_err(|_| unknown(0))
    }
}

impl Executor for Remote {
    fn admit(&self, tensors: &[(&str, Shape)]) -> Result<Arc<dyn Member>, Lost> {
        let mut line = open(&self.line);
        line.n_members += 1;
        let member = line.n_members;
        let content = serde_json::to_vec(tensors).map_err(garbled)?;
        line.ask(ADMIT, member, &[&content])?;
        Ok(Arc::new(RemoteMember {
            line: Arc::clone(&self.line),
            member,
        }))
    }
}

#[derive(Debug)]
struct RemoteMember {
    line: Arc<Mutex<Line>>,
    member: u32,
}

impl Drop for RemoteMember {
    fn drop(&mut self) {
        // If the process has ended, it holds no member.
        let _ = open(&self.line).ask(DISMISS, self.member, &[]);
    }
}

impl Member for RemoteMember {
    fn write(&self, tensor: &str, entries: &[f32]) -> Result<(), Lost> {
        let length = name_length(tensor);
        let contents: [&[u8]; 3] = [&length, tensor.as_bytes(), cast_slice(entries)];
        open(&self.line).ask(WRITE, self.member, &contents).map(drop)
    }

    fn read(&self, tensor: &str) -> Result<Vec<f32>, Lost> {
        let contents: [&[u8]; 2] = [&name_length(tensor), tensor.as_bytes()];
        let bytes = open(&self.line).ask(READ, self.member, &contents)?;
        Ok(numbers(&bytes))
    }

    fn run(&self, kernels: &Arc<Kernels>, words: &[u32], inputs: &[f32]) -> Result<Vec<f32>, Lost> {
        let mut line = open(&self.line);
        let routine = line.routine(kernels)?.to_ne_bytes();
        let contents: [&[u8]; 3] = [&routine, cast_slice(words), cast_slice(inputs)];
        let bytes = line.ask(RUN, self.member, &contents)?;
        Ok(numbers(&bytes))
    }
}

/// Numbers of 4 bytes; an incomplete last one is left out.
fn numbers<T: Pod>(bytes: &[u8]) -> Vec<T> {
    let mut numbers = vec![T::zeroed(); bytes.len() / size_of::<T>()];
    let whole = size_of_val(&*numbers);
    cast_slice_mut(&mut numbers).copy_from_slice(&bytes[..whole]);
    numbers
}

fn name_length(name: &str) -> [u8; 4] {
    u32::try_from(name.len()).unwrap_or(u32::MAX).to_ne_bytes()
}

fn length_of(content: &[u8]) -> Result<u32, Error> {
    u32::try_from(content.len()).map_err(|_| ErrorKind::FileTooLarge.into())
}

fn read_words<const N: usize>(stream: &mut UnixStream) -> Result<[u32; N], Error> {
    let mut words = [0; N];
    stream.read_exact(bytemuck::cast_slice_mut(&mut words))?;
    Ok(words)
}

fn read_bytes(stream: &mut UnixStream, length: u32) -> Result<Vec<u8>, Error> {
    let mut bytes = vec![0; length as usize];
    stream.read_exact(&mut bytes)?;
    Ok(bytes)
}

/// Writes a message in one call, since pieces would wake the other side several times.
fn write_message(stream: &mut UnixStream, words: &[u32], contents: &[&[u8]]) -> Result<(), Error> {
    let message = [&[cast_slice(words)], contents].concat().concat();
    stream.write_all(&message)
}
