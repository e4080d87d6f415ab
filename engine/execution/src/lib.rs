//! Computation and storage of trials: on this machine, on others, and in the store.
//!
//! Only [`world`] uses files, clocks and processes; tests of crashes and power losses replace it by a simulated
//! machine.

pub mod device;
pub mod executor;
pub mod footprint;
pub mod guard;
pub mod limits;
pub mod pace;
pub mod patience;
pub mod scheduler;
pub mod store;
pub mod verification;
pub mod world;
