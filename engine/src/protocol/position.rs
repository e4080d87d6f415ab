//! Where a protocol that learns and measures stands, so that it can continue.

use crate::{Environment, Error, Rng};
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// A place in a trial; `L` is what learning needs to go on.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Position<L> {
    /// `None` where learning is over.
    pub(super) learning: Option<L>,
    /// Set inside a measurement, between two of its blocks.
    pub(super) measuring: Option<Blocks>,
}

/// A measurement between two blocks of episodes.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Blocks {
    /// First episode of the next block.
    pub(super) first: u64,
    /// What the agent draws.
    pub(super) rng: Rng,
    /// The environments as the last block left them; empty before the first block.
    pub(super) pool: Vec<Value>,
}

/// An environment with the state that a snapshot describes.
pub(super) fn restored(
    make_environment: &dyn Fn() -> Result<Box<dyn Environment>, Error>,
    snapshot: &Value,
) -> Result<Box<dyn Environment>, Error> {
    let mut environment = make_environment()?;
    environment.restore(snapshot)?;
    Ok(environment)
}
