//! Executors that replace the processor of this thread, such as a card that trains many members at once.
//!
//! While an executor is in use, every routine that has kernels runs on it, with the bits that the processor would give.
//! The state of a learner becomes a member of the executor with its first run: its tensors are stored there, and are
//! copied back when they are read. Other routines run on the processor.

use crate::cuda::Kernels;
use crate::graph::Shape;
use std::cell::RefCell;
use std::fmt::Debug;
use std::sync::Arc;

/// A computer that runs routines of the states that it holds.
pub trait Executor: Debug + Send + Sync {
    /// Takes over a state with the names and shapes of its tensors.
    ///
    /// # Errors
    /// [`Lost`] if it cannot store the state.
    fn admit(&self, tensors: &[(&str, Shape)]) -> Result<Arc<dyn Member>, Lost>;
}

/// A state that an executor holds until this value is dropped.
pub trait Member: Debug + Send + Sync {
    /// Writes a tensor.
    ///
    /// # Errors
    /// [`Lost`] if the executor is gone.
    fn write(&self, tensor: &str, entries: &[f32]) -> Result<(), Lost>;

    /// Reads a tensor.
    ///
    /// # Errors
    /// [`Lost`] if the executor is gone.
    fn read(&self, tensor: &str) -> Result<Vec<f32>, Lost>;

    /// Runs a routine with the words of [`Kernels::prepare`] and all inputs; returns all outputs.
    ///
    /// # Errors
    /// [`Lost`] if the executor is gone or has no memory left.
    fn run(&self, kernels: &Arc<Kernels>, words: &[u32], inputs: &[f32]) -> Result<Vec<f32>, Lost>;
}

/// The error of an executor that cannot continue.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Lost {
    /// The reason, as a sentence without its full stop.
    pub reason: String,
}

impl std::fmt::Display for Lost {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        write!(f, "{}", self.reason)
    }
}

impl std::error::Error for Lost {}

/// The result, or a panic with [`Lost`] as its payload, which ends the trial: its state is lost with the executor, and
/// only a checkpoint has an earlier one.
pub(crate) fn or_panic<T>(result: Result<T, Lost>) -> T {
    result.unwrap_or_else(|lost| std::panic::panic_any(lost))
}

thread_local! {
    static CURRENT: RefCell<Option<Arc<dyn Executor>>> = const { RefCell::new(None) };
}

/// Calls a function while an executor is in use in this thread.
pub fn with<R>(executor: &Arc<dyn Executor>, call: impl FnOnce() -> R) -> R {
    /// Restores the former executor, even after a panic.
    struct Restore(Option<Arc<dyn Executor>>);
    impl Drop for Restore {
        fn drop(&mut self) {
            CURRENT.with(|current| *current.borrow_mut() = self.0.take());
        }
    }
    let _restore = Restore(CURRENT.with(|current| current.borrow_mut().replace(Arc::clone(executor))));
    call()
}

/// The executor that is in use in this thread.
pub(crate) fn current() -> Option<Arc<dyn Executor>> {
    CURRENT.with(|current| current.borrow().clone())
}
