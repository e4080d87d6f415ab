//! The near side: runs the trials of one slot on a host, over one connection.

use super::{
    Host,
    wire::{FromHost, Order, SILENT_FOR, StudyFile, ToHost, hear, say},
};
use crate::{
    limits::Limits,
    scheduler::{
        process::{Replies, WorkerProcess},
        slot::{RequestOutcome, Runner},
        worker::{Reply, Request},
    },
    store::{BundleError, Manifest, Store},
};
use contract::Error;
use document::input_file;
use std::{io, path::Path, sync::Arc};

/// Runs the trials of one slot on a host. A broken connection is opened again for the next trial.
pub(in crate::scheduler) struct Remote<'a> {
    host: &'a Host,
    store: &'a Store,
    process: &'a WorkerProcess,
    replies: Option<Replies>,
}

/// Reason why a trial did not run.
enum Failure {
    /// This side has failed: the store, or a file that the study names.
    Here(Error),
    /// The host has failed, or the connection to it.
    There(String),
}

impl From<io::Error> for Failure {
    fn from(error: io::Error) -> Self {
        Self::There(match error.kind() {
            io::ErrorKind::BrokenPipe | io::ErrorKind::UnexpectedEof => "the connection broke".into(),
            _ => error.to_string(),
        })
    }
}

impl<'a> Remote<'a> {
    /// A slot without a connection yet. Artifacts of trials are written into `store`.
    pub(in crate::scheduler) fn new(host: &'a Host, store: &'a Store, process: &'a WorkerProcess) -> Self {
        Self {
            host,
            store,
            process,
            replies: None,
        }
    }

    fn attempt(
        &mut self,
        request: Request,
        limits: &Arc<Limits>,
        progress: &mut dyn FnMut(u64, u64),
    ) -> Result<RequestOutcome, Failure> {
        let id = request.trial.id.clone();
        let mut replies = match self.replies.take() {
            Some(replies) => replies,
            None => self.connect()?,
        };
        for source in request.trial.key.sources() {
            self.bring(&source, &mut replies)?;
        }
        for (path, digest) in request.trial.key.data_files() {
            self.bring_file(path, digest)?;
        }
        let limits = Limits::clone(limits);
        let order = ToHost::Run(Box::new(Order { request, limits }));
        // The host enforces the limits; here only the connection would be measured.
        self.process.begin(&line(&order)?, &Arc::default());
        let answer = self.listen(&id, &mut replies, progress)?;
        let serves = self.process.end();
        if matches!(answer, RequestOutcome::Said(Reply::Ended { .. })) {
            // The trial is stored here, whatever happens to the connection now.
            match serves.then(|| self.clear_away(id, &mut replies)) {
                Some(Ok(())) => self.replies = Some(replies),
                _ => drop(self.process.bury()),
            }
        } else if serves {
            self.replies = Some(replies);
        } else {
            return Err(Failure::There("the connection broke".into()));
        }
        Ok(answer)
    }

    /// Waits until the host has removed the trial that has arrived: a connection that ends earlier leaves it
    /// there.
    fn clear_away(&self, id: String, replies: &mut Replies) -> Result<(), Failure> {
        self.send(&ToHost::Arrived(id))?;
        match heard(replies)? {
            Some(FromHost::Removed) => Ok(()),
            other => Err(unexpected(other)),
        }
    }

    fn connect(&self) -> Result<Replies, Failure> {
        let mut command = self.host.relay();
        let started = self.process.start(&mut command, Some(SILENT_FOR));
        let mut replies = started.map_err(|error| Failure::There(error.to_string()))?;
        match heard(&mut replies)? {
            Some(FromHost::Ready(program)) if program == self.host.program => Ok(replies),
            Some(FromHost::Ready(program)) => Err(Failure::There(format!(
                "it has the program {program}, and this is {}",
                self.host.program
            ))),
            _ => Err(Failure::There(
                "no connection, or the program does not start".into(),
            )),
        }
    }

    /// Sends the host a trial that is a source of the next one.
    fn bring(&self, source: &str, replies: &mut Replies) -> Result<(), Failure> {
        self.send(&ToHost::Has(source.to_owned()))?;
        match heard(replies)? {
            Some(FromHost::Has(true)) => return Ok(()),
            Some(FromHost::Has(false)) => {}
            other => return Err(unexpected(other)),
        }
        // If a source is absent, the host reports that the trial is not ready.
        let Some(files) = self.store.bundle(source).ok().flatten() else {
            return Ok(());
        };
        self.send(&ToHost::Trial(Manifest::of(source, &files)))?;
        for (_, bytes) in &files {
            self.process.write(bytes)?;
        }
        Ok(())
    }

    /// Sends a file that the study names. A file that cannot be read or has changed makes the trial fail there, as it
    /// would here.
    fn bring_file(&self, path: &Path, digest: &str) -> Result<(), Failure> {
        let read = input_file::read(path, input_file::Use::Bytes).ok();
        let Some(bytes) = read.filter(|bytes| contract::digest::of_bytes(bytes) == digest) else {
            return Ok(());
        };
        self.send(&ToHost::File(StudyFile {
            path: path.to_string_lossy().into_owned(),
            digest: digest.to_owned(),
            length: bytes.len() as u64,
        }))?;
        Ok(self.process.write(&bytes)?)
    }

    /// Reads messages about the trial until its last one, and stores the trial if it has ended.
    fn listen(
        &self,
        id: &str,
        replies: &mut Replies,
        progress: &mut dyn FnMut(u64, u64),
    ) -> Result<RequestOutcome, Failure> {
        loop {
            match heard(replies)? {
                Some(FromHost::Said(Reply::Progress { done, total })) => progress(done, total),
                Some(FromHost::Said(Reply::Ended { end })) => {
                    let manifest = match heard(replies)? {
                        Some(FromHost::Trial(manifest)) if manifest.trial == id => manifest,
                        other => return Err(unexpected(other)),
                    };
                    let files = manifest.read(replies)?;
                    self.take_in(id, &files)?;
                    return Ok(RequestOutcome::Said(Reply::Ended { end }));
                }
                Some(FromHost::Said(reply)) => return Ok(RequestOutcome::Said(reply)),
                Some(FromHost::Died {
                    state,
                    reason,
                    by_limit,
                }) => {
                    return Ok(RequestOutcome::Died {
                        state,
                        reason,
                        by_limit,
                    });
                }
                other => return Err(unexpected(other)),
            }
        }
    }

    /// Data that arrives damaged is the fault of the connection; a failed write is the fault of this side.
    fn take_in(&self, id: &str, files: &[(String, Vec<u8>)]) -> Result<(), Failure> {
        let taken = self.store.take_in(id, files).map(drop);
        taken.map_err(|error| match error {
            BundleError::Damaged(problem) => {
                Failure::There(format!("what arrived is not what was acknowledged: {problem}"))
            }
            BundleError::Here(error) => Failure::Here(error),
        })
    }

    fn send(&self, message: &ToHost) -> io::Result<()> {
        let mut text = Vec::new();
        say(&mut text, message)?;
        self.process.write(&text)
    }
}

impl Runner for Remote<'_> {
    fn run(
        &mut self,
        request: Request,
        limits: &Arc<Limits>,
        progress: &mut dyn FnMut(u64, u64),
    ) -> Result<RequestOutcome, Error> {
        match self.attempt(request, limits, progress) {
            Ok(answer) => Ok(answer),
            Err(trouble) => {
                self.replies = None;
                let fell_silent = self.process.fell_silent();
                self.process.bury();
                match trouble {
                    Failure::Here(error) => Err(error),
                    Failure::There(_) if fell_silent => Ok(RequestOutcome::Lost(format!(
                        "{}: nothing was heard from it for {} s",
                        self.host.name,
                        SILENT_FOR.as_secs()
                    ))),
                    Failure::There(problem) => {
                        Ok(RequestOutcome::Lost(format!("{}: {problem}", self.host.name)))
                    }
                }
            }
        }
    }

    fn dismiss(&mut self) {
        self.replies = None;
        self.process.dismiss();
    }
}

/// The next message other than a sign of life.
fn heard(replies: &mut Replies) -> io::Result<Option<FromHost>> {
    loop {
        match hear(replies)? {
            Some(FromHost::Alive) => {}
            word => return Ok(word),
        }
    }
}

fn line(message: &ToHost) -> io::Result<String> {
    Ok(serde_json::to_string(message)?)
}

fn unexpected(heard: Option<FromHost>) -> Failure {
    Failure::There(match heard {
        None => "the connection broke".into(),
        Some(FromHost::Refused(problem)) => problem,
        Some(FromHost::Held(owner)) => format!("the trial is with {owner} there"),
        Some(_) => "it said something else than was asked".into(),
    })
}
