//! Silence of the other side of a connection: time without receiving a byte from it, or without it accepting one.

use crate::world::clock;
use std::{
    io::{self, Read},
    sync::{Arc, Mutex, PoisonError},
    time::{Duration, Instant},
};

/// Beginning of the current wait; `None` while there is none. The waiting and the watching thread share it.
#[derive(Debug, Clone, Default)]
pub(super) struct Silence(Arc<Mutex<Option<Instant>>>);

impl Silence {
    /// Length of the silence so far.
    pub(super) fn lasts(&self) -> Option<Duration> {
        let since = *self.0.lock().unwrap_or_else(PoisonError::into_inner);
        since.map(clock::since)
    }

    /// Runs `act`, which may have to wait for the other side.
    pub(super) fn during<T>(&self, act: impl FnOnce() -> T) -> T {
        self.set(Some(clock::now()));
        let outcome = act();
        self.set(None);
        outcome
    }

    fn set(&self, since: Option<Instant>) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = since;
    }
}

/// A pipe whose reader can be watched while it waits.
pub(super) struct WatchedReader<R> {
    pub(super) pipe: R,
    pub(super) silence: Silence,
}

impl<R: Read> Read for WatchedReader<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.silence.during(|| self.pipe.read(buffer))
    }
}
