//! The far side: the program on a host that runs trials for a program on another machine.
//!
//! It has a store of its own, which holds a trial from its beginning until it has arrived at the other side. Other
//! programs on the host, including those of an earlier connection that broke, may work in the same store, so a trial
//! runs under its lease here too.

use super::wire::{ALIVE_EVERY, FromHost, Order, StudyFile, ToHost, broken, hear, say};
use crate::{
    limits::Limits,
    scheduler::{
        idle::IdleWorkers,
        local::Local,
        process::WorkerProcess,
        slot::{RequestOutcome, Runner},
        worker::{Reply, Request},
    },
    store::{Bundle, BundleError, Claim, Leases, Manifest, Store, read_bytes, write_durably},
    world::{clock, fs},
};
use contract::{
    Build, Error, build,
    trial_end::{EndState, is_missing},
};
use std::{
    io::{self, BufRead, Write},
    path::{Path, PathBuf},
    sync::{Arc, Mutex, PoisonError, mpsc},
    time::Duration,
};

/// Interval between two checks of the process that runs a trial.
const PERIOD: Duration = Duration::from_millis(20);

/// The far side: answers one connection, with a store of its own and one process that runs trials.
pub struct Relay {
    store: Store,
    leases: Arc<Leases>,
    lease_expiry: Duration,
    program: PathBuf,
    process: Arc<WorkerProcess>,
}

/// Output to the other side. A message and its files are written under one lock.
#[derive(Clone)]
struct Output(Arc<Mutex<Box<dyn Write + Send>>>);

impl Output {
    fn say(&self, word: &FromHost) -> io::Result<()> {
        self.say_with(word, "", None)
    }

    /// Sends the end of a trial, with the files that it left.
    fn say_with(&self, word: &FromHost, id: &str, files: Option<&Bundle>) -> io::Result<()> {
        let mut output = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        say(&mut *output, word)?;
        if let Some(files) = files {
            say(&mut *output, &FromHost::Trial(Manifest::of(id, files)))?;
            files.iter().try_for_each(|(_, bytes)| output.write_all(bytes))?;
        }
        output.flush()
    }

    /// Sends signs of life from now on. A separate thread sends them, since a blocked connection must not block other
    /// work.
    fn stay_alive(&self) {
        let output = self.clone();
        std::thread::spawn(move || {
            while output.say(&FromHost::Alive).is_ok() {
                clock::sleep(ALIVE_EVERY);
            }
        });
    }
}

/// A message with the files that follow it.
enum Delivery {
    Has(String),
    Trial(String, Vec<(String, Vec<u8>)>),
    File(StudyFile, Vec<u8>),
    Run(Box<Order>),
    Arrived(String),
}

impl Relay {
    /// Works in the folder `store`, relative to the current one.
    ///
    /// # Errors
    /// [`Error::File`] if that folder cannot be written.
    pub fn open(store: &Path, lease_expiry: Duration) -> Result<Self, Error> {
        let program = std::env::current_exe().map_err(broken)?;
        let store = Store::at(store);
        Ok(Self {
            leases: Arc::new(Leases::open(&store, lease_expiry)?),
            store,
            lease_expiry,
            program,
            process: Arc::default(),
        })
    }

    /// Answers until the input ends. If it ends while a trial runs, the other side is gone, and the process exits at
    /// once.
    ///
    /// # Errors
    /// [`Error::Worker`] if the other side is gone.
    pub fn serve(
        &self,
        build: Option<&Build>,
        input: impl BufRead + Send + 'static,
        output: impl Write + Send + 'static,
    ) -> Result<(), Error> {
        let output = Output(Arc::new(Mutex::new(Box::new(output))));
        output
            .say(&FromHost::Ready(build::version(build)))
            .map_err(broken)?;
        output.stay_alive();
        let (sender, heard) = mpsc::channel();
        let process = Arc::clone(&self.process);
        std::thread::spawn(move || {
            listen(input, &process, &sender);
            std::process::exit(0);
        });
        self.watch();
        let idle = IdleWorkers::default();
        let mut runner = Local::new(&self.program, None, &self.process, &idle);
        while let Ok(message) = heard.recv() {
            self.answer(message, &mut runner, &output)?;
        }
        Ok(())
    }

    /// Enforces the limits of the running trial, and renews the leases, as long as this process lives.
    fn watch(&self) {
        let (process, leases) = (Arc::clone(&self.process), Arc::clone(&self.leases));
        let heartbeat = self.lease_expiry / 6;
        std::thread::spawn(move || {
            let mut renewed = clock::now();
            loop {
                process.hold_limits();
                if clock::since(renewed) >= heartbeat {
                    renewed = clock::now();
                    // The next trial reports a store that cannot be written.
                    let _ = leases.beat();
                }
                clock::sleep(PERIOD);
            }
        });
    }

    fn answer(&self, message: Delivery, runner: &mut Local<'_>, output: &Output) -> Result<(), Error> {
        let done = match message {
            Delivery::Has(trial) => {
                let end = self.store.sound(&trial).ok().flatten();
                let has = end.is_some_and(|file| !is_missing(Some(&file.end)));
                return output.say(&FromHost::Has(has)).map_err(broken);
            }
            Delivery::Run(order) => return self.run(*order, runner, output),
            Delivery::Trial(trial, files) => self.take_in(&trial, &files),
            Delivery::File(file, bytes) => keep(&file, &bytes),
            Delivery::Arrived(trial) => match self.remove(&trial) {
                Ok(()) => return output.say(&FromHost::Removed).map_err(broken),
                refused => refused,
            },
        };
        match done {
            Ok(()) => Ok(()),
            Err(error) => output.say(&FromHost::Refused(error.to_string())).map_err(broken),
        }
    }

    /// Takes in a trial. Another connection may send the same trial at the same time.
    fn take_in(&self, trial: &str, files: &[(String, Vec<u8>)]) -> Result<(), Error> {
        let Claim::Mine = self.leases.claim(trial)? else {
            return Ok(());
        };
        let outcome = self.store.take_in(trial, files);
        self.leases.release(trial)?;
        outcome.map(drop).map_err(|error| match error {
            BundleError::Here(error) => error,
            damaged => broken(damaged),
        })
    }

    /// Removes a trial that is no longer needed here. Checkpoints and rows of other trials are kept.
    fn remove(&self, trial: &str) -> Result<(), Error> {
        let folder = self.store.folder(trial);
        if let Claim::Held(_) = self.leases.claim(trial)? {
            return Ok(());
        }
        // The lease is removed with the folder.
        let outcome = fs::remove_dir_all(&folder).map_err(Error::file("remove", &folder));
        self.leases.release(trial)?;
        outcome
    }

    fn run(&self, order: Order, runner: &mut Local<'_>, output: &Output) -> Result<(), Error> {
        let id = order.request.trial.id.clone();
        match self.leases.claim(&id) {
            Ok(Claim::Mine) => {}
            Ok(Claim::Held(owner)) => {
                let who = format!("process {} on {}", owner.pid, owner.host);
                return output.say(&FromHost::Held(who)).map_err(broken);
            }
            Err(error) => return output.say(&FromHost::Refused(error.to_string())).map_err(broken),
        }
        let answer = self.under_lease(order, runner, output);
        let told = self.tell(&id, answer, output);
        self.leases.release(&id)?;
        told
    }

    fn under_lease(
        &self,
        order: Order,
        runner: &mut Local<'_>,
        output: &Output,
    ) -> Result<RequestOutcome, Error> {
        // The connection may have broken before the end was sent. A failure is tried again, as requested.
        let stored = self.store.sound(&order.request.trial.id).ok().flatten();
        if let Some(file) = stored.filter(|file| file.end.state == EndState::Ok) {
            return Ok(RequestOutcome::Said(Reply::Ended { end: file.end }));
        }
        let request = Request {
            store: self.store.root().to_path_buf(),
            ..order.request
        };
        let mut progress = |done, total| {
            // The other side may be gone; the end of the input then shows it.
            let _ = output.say(&FromHost::Said(Reply::Progress { done, total }));
        };
        runner.run(request, &Arc::<Limits>::new(order.limits), &mut progress)
    }

    fn tell(&self, id: &str, answer: Result<RequestOutcome, Error>, output: &Output) -> Result<(), Error> {
        let has_ended = matches!(&answer, Ok(RequestOutcome::Said(Reply::Ended { .. })));
        let line = match answer {
            Ok(RequestOutcome::Said(Reply::StoreRefused { problem } | Reply::DeviceLost { problem })) => {
                FromHost::Refused(problem)
            }
            Ok(RequestOutcome::Said(reply)) => FromHost::Said(reply),
            Ok(RequestOutcome::Died {
                state,
                reason,
                by_limit,
            }) => FromHost::Died {
                state,
                reason,
                by_limit,
            },
            Ok(RequestOutcome::Lost(problem)) => FromHost::Refused(problem),
            Err(error) => FromHost::Refused(error.to_string()),
        };
        let files = if has_ended {
            self.store.bundle(id)
        } else {
            Ok(None)
        };
        match files {
            Ok(files) => output.say_with(&line, id, files.as_ref()).map_err(broken),
            Err(error) => output.say(&FromHost::Refused(error.to_string())).map_err(broken),
        }
    }
}

/// Reads messages until the input ends; a stop request goes to the running process at once.
fn listen(mut input: impl BufRead, process: &WorkerProcess, sender: &mpsc::Sender<Delivery>) {
    while let Ok(Some(message)) = hear::<ToHost>(&mut input) {
        let heard = match message {
            ToHost::Stop => {
                process.ask_to_stop();
                continue;
            }
            ToHost::Has(trial) => Ok(Delivery::Has(trial)),
            ToHost::Run(order) => Ok(Delivery::Run(order)),
            ToHost::Arrived(trial) => Ok(Delivery::Arrived(trial)),
            ToHost::Trial(manifest) => manifest
                .read(&mut input)
                .map(|files| Delivery::Trial(manifest.trial, files)),
            ToHost::File(file) => {
                read_bytes(&mut input, file.length).map(|bytes| Delivery::File(file, bytes))
            }
        };
        let Ok(heard) = heard else { return };
        if sender.send(heard).is_err() {
            return;
        }
    }
}

/// Writes a file of the study at the path that the study gives, relative to the current folder.
fn keep(file: &StudyFile, bytes: &[u8]) -> Result<(), Error> {
    let path = Path::new(&file.path);
    if !fs::is_inside(path) {
        return Err(broken(format!("`{}` leads out of the folder", file.path)));
    }
    if contract::digest::of_bytes(bytes) != file.digest {
        return Err(broken(format!("`{}` did not arrive as it was sent", file.path)));
    }
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder).map_err(Error::file("create", folder))?;
    }
    write_durably(path, bytes)
}
