//! Positions from which a protocol that learns and measures can continue.
//!
//! A protocol gives a [`Position`] to [`Run::checkpoint`](super::Run::checkpoint) wherever it can continue, and gets
//! the last one back from [`Run::resume`](super::Run::resume) in another process. [`measure`](super::measure) gives its
//! own between two blocks of episodes.

use crate::{Environment, Error, Rng};
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// A place in a trial; `L` is the state that learning needs to continue.
#[derive(Debug, Serialize, Deserialize)]
pub struct Position<L> {
    /// `None` once learning is over.
    pub learning: Option<L>,
    /// Set inside a measurement, between two of its blocks; it must be passed to [`measure`](super::measure).
    pub measuring: Option<Blocks>,
}

/// A measurement between two blocks of episodes, whose content only [`measure`](super::measure) uses.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Blocks {
    /// First episode of the next block.
    pub(super) first: u64,
    /// The agent's random stream.
    pub(super) rng: Rng,
    /// The environments after the last block; empty before the first block.
    pub(super) pool: Vec<Value>,
}

/// An environment with the state that a [snapshot](Environment::snapshot) describes.
///
/// # Errors
/// [`Error::Checkpoint`] if the snapshot does not fit.
pub fn restored(
    make_environment: &dyn Fn() -> Result<Box<dyn Environment>, Error>,
    snapshot: &Value,
) -> Result<Box<dyn Environment>, Error> {
    let mut environment = make_environment()?;
    environment.restore(snapshot)?;
    Ok(environment)
}
