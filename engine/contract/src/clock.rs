//! The clock that is never set. It times what is computed and reaches no result.

#![expect(
    clippy::disallowed_methods,
    reason = "here the clock is read; no result depends on it"
)]

use std::time::{Duration, Instant};

/// This moment.
#[must_use]
pub fn now() -> Instant {
    Instant::now()
}

/// The time since a moment.
#[must_use]
pub fn since(moment: Instant) -> Duration {
    now().saturating_duration_since(moment)
}
