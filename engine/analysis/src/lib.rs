//! Results of the trials of a study, claims on them, and searches for settings.

pub mod claim;
pub mod cross_play;
pub mod published_curve;
pub mod results;
pub mod search;
pub mod training_share;
