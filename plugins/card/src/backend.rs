//! A device that holds states and runs batches.

use plan::cuda::Batch;
use plan::executor::Lost;
use std::ops::Range;

/// Memory of states, by cohort and member, and the runs of routines on them. A backend is used by one thread.
pub trait Backend {
    /// Provides memory for `n_members` states of `state_size` entries; existing states stay.
    ///
    /// # Errors
    /// [`Lost`] if there is too little memory.
    fn reserve(&mut self, cohort: usize, state_size: usize, n_members: usize) -> Result<(), Lost>;

    /// Writes entries of a member's state, starting at entry `first`.
    ///
    /// # Errors
    /// [`Lost`] where the device fails.
    fn write(&mut self, cohort: usize, member: u32, first: usize, entries: &[f32]) -> Result<(), Lost>;

    /// Reads entries of a member's state.
    ///
    /// # Errors
    /// [`Lost`] where the device fails.
    fn read(&mut self, cohort: usize, member: u32, entries: Range<usize>) -> Result<Vec<f32>, Lost>;

    /// Begins a batch of members of a cohort. Equal `routine`s have equal kernels. Another batch may still run.
    ///
    /// # Errors
    /// [`Lost`] where the device fails or memory is short.
    fn start(&mut self, cohort: usize, routine: usize, batch: &Batch<'_>) -> Result<(), Lost>;

    /// Waits for the oldest running batch, of at most two; returns the outputs of each run.
    ///
    /// # Errors
    /// [`Lost`] where the device fails.
    fn finish(&mut self) -> Result<Vec<f32>, Lost>;
}
