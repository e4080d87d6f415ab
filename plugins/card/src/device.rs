//! The card as a device of the engine: the process that drives it, and the workers that send requests.

use crate::backend::Backend;
use crate::cuda::Card;
use crate::population::Population;
use crate::socket::{Remote, serve};
use contract::{Error, Registry};
use execution::device::{Device, DeviceKind, Opened, RegisterDevice};
use plan::executor::{Executor, Lost, with};
use std::os::unix::fs::DirBuilderExt;
use std::os::unix::net::UnixListener;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Sender, channel};

/// Registers the device of this crate.
pub fn register(registry: &mut Registry) {
    registry.device(DeviceKind {
        name: "cuda",
        about: "NVIDIA's card: the learners of many trials compute at once, each with the bits of a trial on a core",
        serve: |ready| {
            serve_population(ready, |words| {
                let card = Card::open(0)?;
                let _ = words.send(card.in_words()?);
                Ok(card)
            })
        },
        connect,
    });
}

/// Opens a backend, which describes itself, and serves the workers that connect to a new socket.
///
/// # Errors
/// A sentence that names what the machine lacks.
pub fn serve_population<B: Backend>(
    ready: &mut dyn FnMut(Opened),
    open: impl FnOnce(&Sender<String>) -> Result<B, Lost> + Send + 'static,
) -> Result<(), String> {
    let (words, said) = channel();
    let population = Population::new(move || open(&words)).map_err(|lost| lost.reason)?;
    let unheard = |error: std::io::Error| format!("no socket for workers: {error}");
    let socket = new_socket().map_err(unheard)?;
    let listener = UnixListener::bind(&socket).map_err(unheard)?;
    ready(Opened {
        socket,
        device: said.recv().unwrap_or_default(),
    });
    let executor: Arc<dyn Executor> = Arc::new(population);
    serve(&listener, &executor).map_err(unheard)
}

/// A path in a new folder that no other user can enter.
fn new_socket() -> Result<PathBuf, std::io::Error> {
    let folder = std::env::temp_dir().join(format!("regimen-card-{}", std::process::id()));
    // An earlier process with this number may have left the folder.
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::DirBuilder::new().mode(0o700).create(&folder)?;
    Ok(folder.join("socket"))
}

/// A worker's connection to the process of the device.
///
/// # Errors
/// A sentence if no process answers there.
pub fn connect(socket: &Path) -> Result<Box<dyn Device>, String> {
    let remote = Remote::new(socket);
    let remote =
        remote.map_err(|error| format!("the process that drives the card cannot be reached: {error}"))?;
    Ok(Box::new(Connected(Arc::new(remote))))
}

struct Connected(Arc<dyn Executor>);

impl Device for Connected {
    fn during(&self, trial: &mut dyn FnMut()) -> Result<(), Error> {
        let outcome = catch_unwind(AssertUnwindSafe(|| with(&self.0, trial)));
        outcome.or_else(|panic| match panic.downcast::<Lost>() {
            Ok(lost) => Err(Error::Device { problem: lost.reason }),
            Err(other) => resume_unwind(other),
        })
    }
}
