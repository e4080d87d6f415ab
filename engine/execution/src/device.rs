//! Devices that compute the learners of trials instead of a core, such as a card that trains many at once.
//!
//! A run starts one process that drives the device. Worker processes are the same as in a run without a device, but get
//! the socket of that process. Devices do not affect numbers: a trial has the same bits on all of them.

use crate::world::process::{Child, ChildStdin, Command, Stdio};
use contract::{Error, Registry};
use serde::{Deserialize, Serialize};
use std::{
    io::{BufRead, BufReader, Read, Write},
    path::{Path, PathBuf},
    sync::Arc,
};

/// The verb that starts the process of a device, before the name of the device.
pub const SERVER: &str = "device-server";

/// The variable that gives a worker process its device, as `NAME=SOCKET`.
pub const VARIABLE: &str = "REGIMEN_DEVICE";

/// Name that means no device: learners compute where their trials run.
pub const PROCESSOR: &str = "processor";

/// One entry of the list of devices.
pub struct DeviceKind {
    /// Name as written after `--device`.
    pub name: &'static str,
    /// One line about the device.
    pub about: &'static str,
    /// Opens the device and calls `ready`, then answers workers until this process ends; the error names what the
    /// machine lacks.
    pub serve: fn(ready: &mut dyn FnMut(Opened)) -> Result<(), String>,
    /// Connects a worker to the process of the device.
    pub connect: fn(socket: &Path) -> Result<Box<dyn Device>, String>,
}

/// A device that is open.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Opened {
    /// Socket for requests to the device.
    pub socket: PathBuf,
    /// The device as text, such as a card's name and memory.
    pub device: String,
}

/// A device as a worker sees it.
pub trait Device {
    /// Runs a trial whose learners compute on the device.
    ///
    /// # Errors
    /// [`Error::Device`] if the device is lost while the trial runs.
    fn during(&self, trial: &mut dyn FnMut()) -> Result<(), Error>;
}

/// Registration of devices.
pub trait RegisterDevice {
    /// Registers a device.
    fn device(&mut self, kind: DeviceKind);
}

impl RegisterDevice for Registry {
    fn device(&mut self, kind: DeviceKind) {
        self.extend(kind);
    }
}

/// The device of a name.
///
/// # Errors
/// [`Error::Device`] with the names that are known.
pub fn find<'r>(registry: &'r Registry, name: &str) -> Result<&'r DeviceKind, Error> {
    let found = registry.extensions::<DeviceKind>().find(|kind| kind.name == name);
    found.ok_or_else(|| {
        let known = registry.extensions::<DeviceKind>().map(|kind| kind.name);
        let known: Vec<&str> = std::iter::once(PROCESSOR).chain(known).collect();
        let problem = format!("there is no device `{name}`; known: {}", known.join(", "));
        Error::Device { problem }
    })
}

/// A process that drives a device. It ends when this value is dropped.
#[derive(Debug)]
pub struct Server {
    child: Child,
    /// Pipe whose end tells the process to exit.
    input: Option<ChildStdin>,
    /// Name of the device.
    pub name: &'static str,
    /// The device that it has opened.
    pub opened: Opened,
}

/// Reply of the process of a device.
type OpenReply = Result<Opened, String>;

impl Server {
    /// Starts the process of a device, which sees one card of the machine or all of them, and waits until it answers.
    ///
    /// # Errors
    /// [`Error::Device`] with the missing requirement of the machine.
    pub fn start(kind: &DeviceKind, card: Option<&str>) -> Result<Self, Error> {
        let failed = |problem: String| Error::Device { problem };
        let unstarted = |source: std::io::Error| failed(format!("its process cannot be started: {source}"));
        let program = std::env::current_exe().map_err(unstarted)?;
        let mut command = Command::new(program);
        command.envs(card.map(|card| ("CUDA_VISIBLE_DEVICES", card)));
        let piped = command
            .args([SERVER, kind.name])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped());
        let mut child = piped.spawn().map_err(unstarted)?;
        let (input, output) = (child.stdin.take(), child.stdout.take());
        let mut line = String::new();
        let read = output.map(|output| BufReader::new(output).read_line(&mut line));
        let answer: Result<OpenReply, _> = serde_json::from_str(&line);
        match (read, answer) {
            (Some(Ok(_)), Ok(Ok(opened))) => Ok(Self {
                child,
                input,
                name: kind.name,
                opened,
            }),
            (_, answer) => {
                drop(input);
                let ended = child.wait();
                Err(failed(match (answer, ended) {
                    (Ok(Err(problem)), _) => problem,
                    (_, Ok(status)) => format!("the process that drives `{}` ended with {status}", kind.name),
                    (_, Err(source)) => source.to_string(),
                }))
            }
        }
    }

    /// The value of [`VARIABLE`] for workers.
    #[must_use]
    pub fn address(&self) -> String {
        format!("{}={}", self.name, self.opened.socket.display())
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        drop(self.input.take());
        // A process that was ended from outside is already gone.
        let _ = self.child.wait();
    }
}

/// Drives a device until the input of this process ends.
///
/// # Errors
/// [`Error::Device`] if there is no such device; a missing requirement of the machine is reported to the run that
/// started this process.
pub fn serve(registry: &Registry, name: &str, mut input: impl Read + Send + 'static) -> Result<(), Error> {
    let kind = find(registry, name)?;
    outlive_signals()?;
    let mut leaves = Some(move |socket: PathBuf| {
        std::thread::spawn(move || {
            let _ = input.read_to_end(&mut Vec::new());
            let _ = crate::world::fs::remove_file(&socket);
            std::process::exit(0);
        });
    });
    let served = (kind.serve)(&mut |opened: Opened| {
        let socket = opened.socket.clone();
        tell(&Ok(opened));
        if let Some(leaves) = leaves.take() {
            leaves(socket);
        }
    });
    if let Err(problem) = served {
        tell(&Err(problem));
    }
    Ok(())
}

/// Keeps this process alive at a signal to its group, because trials still have to save the state that the device
/// holds; the end of the input shows that they have.
fn outlive_signals() -> Result<(), Error> {
    use signal_hook::consts::{SIGINT, SIGTERM, SIGUSR1};
    for signal in [SIGINT, SIGTERM, SIGUSR1] {
        let noted = signal_hook::flag::register(signal, Arc::default());
        noted.map_err(|source| Error::Device {
            problem: format!("cannot listen for signals: {source}"),
        })?;
    }
    Ok(())
}

/// Sends the answer to the run that started this process; if that run is gone, the input ends.
fn tell(answer: &OpenReply) {
    let line = serde_json::to_string(answer).unwrap_or_default();
    let mut output = std::io::stdout();
    let _ = writeln!(output, "{line}").and_then(|()| output.flush());
}

/// A worker's connection to the device of its run.
pub struct Connection {
    /// Name of the device.
    pub name: &'static str,
    /// The device.
    pub device: Box<dyn Device>,
}

/// The device that the value of [`VARIABLE`] names.
///
/// # Errors
/// [`Error::Device`] if it is unknown or its process cannot be reached.
pub fn connect(registry: &Registry, address: &str) -> Result<Connection, Error> {
    let (name, socket) = address.split_once('=').unwrap_or((address, ""));
    let kind = find(registry, name)?;
    let connected = (kind.connect)(Path::new(socket)).map_err(|problem| Error::Device { problem });
    connected.map(|device| Connection {
        name: kind.name,
        device,
    })
}
