//! Observers, which receive the events of a session.

use crate::Failure;
use execution::scheduler::{Event, Task};
use std::sync::{Arc, atomic::AtomicBool};

/// Receives messages of a session, and may stop its runs.
pub trait Observer {
    /// Receives a warning, or a message about a run.
    fn notice(&self, text: &str);

    /// Follows a run of these trials on `workers` worker processes.
    fn follow<'t>(&self, tasks: &'t [Task<'t>], workers: usize) -> Box<dyn Follower + 't>;

    /// The flag that stops a run when it is set: running trials save a checkpoint and end.
    ///
    /// # Errors
    /// Fails if nothing can set the flag.
    fn stop(&self) -> Result<Arc<AtomicBool>, Failure>;
}

/// Follows one run, and is dropped at its end.
pub trait Follower {
    /// Receives an event of a trial.
    fn hear(&mut self, event: &Event);

    /// Receives a message about the run.
    fn line(&mut self, text: &str);
}

/// Ignores all messages and stops nothing.
#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl Observer for Silent {
    fn notice(&self, _: &str) {}

    fn follow<'t>(&self, _: &'t [Task<'t>], _: usize) -> Box<dyn Follower + 't> {
        Box::new(Self)
    }

    fn stop(&self) -> Result<Arc<AtomicBool>, Failure> {
        Ok(Arc::default())
    }
}

impl Follower for Silent {
    fn hear(&mut self, _: &Event) {}

    fn line(&mut self, _: &str) {}
}
