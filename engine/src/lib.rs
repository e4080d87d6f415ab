//! Regimen's engine: from one YAML file to trials, a store of metrics, statistics, tables, figures and a
//! report.
//!
//! Data flows one way: spec -> plan -> trials -> workers -> store -> statistics -> tables and figures ->
//! report.
//!
//! Invariants
//! 1. The engine names no environment, agent or paper.
//! 2. Nothing below [`trial`] reads a clock, an environment variable or global randomness.
//! 3. A trial's numbers depend on its [`trial::TrialKey`] only: not on workers, order, machine load or
//!    trials that it takes nothing from.
//! 4. After `check` passes, a name, metric or key cannot be wrong.
//! 5. Tables and figures read the store only.
//! 6. What is on disk says what made it, and has a version.

pub mod cli;
pub mod describe;
pub mod first_study;
pub mod rollout;
pub mod watch;
