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

pub mod agent;
pub mod build;
pub mod cast;
pub mod checkpoint;
pub mod choice;
pub mod cli;
pub mod compare;
pub mod complete_config;
mod count;
pub mod cross_play;
pub mod data_file;
pub mod dataset;
pub mod describe;
pub mod design;
pub mod diagnostic;
pub mod document;
pub mod drawing;
pub mod environment;
pub mod error;
pub mod executor;
pub mod export;
pub mod figure;
pub mod first_study;
mod footprint;
pub mod guard;
pub mod imported;
pub mod input_file;
pub mod kinds;
pub mod limits;
pub mod lookalikes;
pub mod own_training;
mod pace;
pub mod panics;
mod parquet;
pub mod patience;
pub mod plain_text;
pub mod plan;
pub mod product;
pub mod protocol;
pub mod published_curve;
pub mod random;
pub mod reach;
pub mod record;
pub mod recorder;
pub mod registry;
pub mod report;
pub mod resources;
pub mod results;
pub mod rollout;
pub mod scheduler;
pub mod schema_check;
pub mod search;
pub mod setting;
pub mod spec;
pub mod statistics;
pub mod store;
pub mod table;
pub mod training_share;
pub mod trial;
pub mod verification;
pub mod watch;
mod world;

pub use agent::{Agent, Mode, Transition, Updates};
pub use build::Build;
pub use checkpoint::{Keeper, NoKeeper};
pub use choice::{Choice, first_largest};
pub use data_file::{DataFile, FileFormat};
pub use dataset::Dataset;
pub use design::{Design, Designs};
pub use environment::{
    Action, Better, Channel, End, Environment, Interface, Metric, Observation, PerEpisode, RewardSurface,
    Seat, Space, Step,
};
pub use error::Error;
pub use own_training::OwnTraining;
pub use product::{Checkpoint, Product, ProductKind};
pub use protocol::Protocol;
pub use random::Rng;
pub use recorder::{Phase, Recorder};
pub use registry::{AgentTraits, Config, Preset, Registry, UseOfDatasets};
