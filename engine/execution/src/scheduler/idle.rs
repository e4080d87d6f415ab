//! Worker processes between two runs of the scheduler. A search runs it once in each generation, and a process takes
//! longer to start than a short trial.

use super::process::{Process, Replies};
use std::sync::{Mutex, PoisonError};

/// Idle worker processes; they exit when this is dropped.
#[derive(Default)]
pub struct IdleWorkers {
    all: Mutex<Vec<IdleWorker>>,
}

impl std::fmt::Debug for IdleWorkers {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("IdleWorkers").finish_non_exhaustive()
    }
}

/// A worker process without a trial.
pub(super) struct IdleWorker {
    /// Address of the device with which it was started.
    pub(super) device: Option<String>,
    pub(super) process: Process,
    pub(super) replies: Replies,
}

impl IdleWorkers {
    /// A living process with this device.
    pub(super) fn take(&self, device: Option<&str>) -> Option<IdleWorker> {
        let mut all = self.all.lock().unwrap_or_else(PoisonError::into_inner);
        loop {
            let place = all.iter().position(|it| it.device.as_deref() == device)?;
            let mut worker = all.swap_remove(place);
            if worker.process.is_alive() {
                return Some(worker);
            }
        }
    }

    /// Keeps a process for a later run.
    pub(super) fn keep(&self, worker: IdleWorker) {
        let mut all = self.all.lock().unwrap_or_else(PoisonError::into_inner);
        all.push(worker);
    }
}

impl Drop for IdleWorkers {
    fn drop(&mut self) {
        let all = self.all.get_mut().unwrap_or_else(PoisonError::into_inner);
        std::thread::scope(|scope| {
            all.drain(..)
                .for_each(|it| drop(scope.spawn(|| it.process.dismiss())));
        });
    }
}
