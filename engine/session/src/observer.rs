//! Who is told what a session does.

use crate::Failure;
use execution::scheduler::{Event, Task};
use std::sync::{Arc, atomic::AtomicBool};

/// Hears of a session, and may stop its runs.
pub trait Observer {
    /// Hears a warning, or a sentence on what runs.
    fn notice(&self, text: &str);

    /// Follows a run of these trials on so many worker processes.
    fn follow<'t>(&self, tasks: &'t [Task<'t>], workers: usize) -> Box<dyn Follower + 't>;

    /// The flag that stops a run when it is raised: running trials save a checkpoint.
    ///
    /// # Errors
    /// Where nothing could raise it.
    fn stop(&self) -> Result<Arc<AtomicBool>, Failure>;
}

/// Follows one run; dropped at its end.
pub trait Follower {
    /// Hears what happens to a trial.
    fn hear(&mut self, event: &Event);

    /// Hears a sentence on the run.
    fn line(&mut self, text: &str);
}

/// Hears nothing and stops nothing.
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
