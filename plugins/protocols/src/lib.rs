//! Protocols that fit any environment: how a trial trains, measures, fits, searches and gathers.
//!
//! They implement [`contract::Protocol`] and are registered like every other plugin.

mod attribution;
mod estimator_tracking;
mod gather;
#[cfg(test)]
mod numbered_episodes;
mod offline_fit;
#[cfg(test)]
mod offline_tests;
mod own_measuring;
mod own_training;
mod search;
mod supervised_fit;
#[cfg(test)]
mod tests;
mod track;
mod train_evaluate;

pub use attribution::Attribution;
pub use estimator_tracking::EstimatorTracking;
pub use gather::{EpisodeGathering, GatherMode};
pub use offline_fit::OfflineFit;
pub use search::{Choose, Search};
pub use supervised_fit::SupervisedFit;
pub use track::EpisodeTracking;
pub use train_evaluate::TrainEvaluate;

use contract::Registry;

/// Registers all protocols of this crate.
pub fn register(registry: &mut Registry) {
    train_evaluate::register(registry);
    attribution::register(registry);
    supervised_fit::register(registry);
    estimator_tracking::register(registry);
    gather::register(registry);
    offline_fit::register(registry);
    search::register(registry);
    track::register(registry);
}

/// For serde: a key that is written only if it is true.
#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
fn is_false(value: &bool) -> bool {
    !value
}

/// For serde: a key that is written only if it is false.
#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
fn is_true(value: &bool) -> bool {
    *value
}
