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

pub mod claim;
pub mod cli;
pub mod compare;
pub mod cross_play;
pub mod describe;
pub mod executor;
pub mod export;
pub mod figure;
pub mod first_study;
mod footprint;
pub mod guard;
pub mod imported;
pub mod kinds;
pub mod limits;
mod pace;
pub mod patience;
pub mod plan;
pub mod published_curve;
pub mod record;
pub mod report;
pub mod results;
pub mod rollout;
pub mod scheduler;
pub mod search;
pub mod spec;
pub mod store;
pub mod table;
pub mod training_share;
pub mod verification;
pub mod watch;
mod world;
