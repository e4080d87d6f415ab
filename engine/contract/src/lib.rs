//! The contract between plugins and the engine: environments, agents, protocols, trials and their records.
//!
//! A plugin implements [`Environment`], [`Agent`] or [`Protocol`] and is added to a [`Registry`]. The engine describes
//! a [trial](trial::TrialKey) by the plugins' names and configs, and runs it from them. This crate does not know
//! studies, stores, tables or machines.
//!
//! Nothing below [`trial`] reads an environment variable or global randomness, and no number depends on a clock: a
//! trial's numbers depend only on its [`trial::TrialKey`].

pub mod agent;
pub mod artifact;
pub mod build;
pub mod cast;
pub mod checkpoint;
pub mod choice;
pub mod clock;
pub mod complete_config;
pub mod data_file;
pub mod dataset;
pub mod design;
pub mod digest;
pub mod draft;
pub mod drawing;
pub mod ending;
pub mod environment;
pub mod episode_metrics;
pub mod error;
pub mod exact;
pub mod feed;
pub mod form_version;
pub mod metrics_file;
pub mod own_training;
pub mod panics;
pub mod parquet;
pub mod part;
pub mod plugin;
pub mod policy_form;
pub mod protocol;
pub mod random;
pub mod recorder;
pub mod registry;
pub mod repeats;
pub mod resources;
pub mod standard_metrics;
pub mod sweep_point;
pub mod trial;
pub mod trial_end;
pub mod trial_result;
mod trial_run;

pub use agent::{Agent, Mode, Transition, Updates};
pub use artifact::{Artifact, ArtifactKind, Checkpoint};
pub use build::Build;
pub use checkpoint::{Keeper, NoKeeper};
pub use choice::{Choice, first_largest};
pub use data_file::{DataFile, FileFormat};
pub use dataset::Dataset;
pub use design::{Design, Designs};
pub use environment::{
    Action, Better, Channel, End, Environment, Interface, Metric, Observation, PerEpisode, Seat, Space,
    StaticTrace, Step,
};
pub use error::Error;
pub use feed::Feed;
pub use own_training::OwnTraining;
pub use plugin::{Config, Preset};
pub use protocol::Protocol;
pub use random::Rng;
pub use recorder::{Phase, Recorder};
pub use registry::{AgentTraits, Registry};
