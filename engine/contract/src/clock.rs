//! The monotonic clock. It times computations and affects no result.

#![expect(
    clippy::disallowed_methods,
    reason = "here the clock is read; no result depends on it"
)]

use std::{
    sync::OnceLock,
    time::{Duration, Instant},
};

static SIMULATED: OnceLock<fn() -> Option<Instant>> = OnceLock::new();

/// The present moment.
#[must_use]
pub fn now() -> Instant {
    let simulated = SIMULATED.get().and_then(|clock| clock());
    simulated.unwrap_or_else(Instant::now)
}

/// The time since a moment.
#[must_use]
pub fn since(moment: Instant) -> Duration {
    now().saturating_duration_since(moment)
}

/// Lets a simulated machine provide the time, on the threads for which it gives one; only the first call has an effect.
pub fn simulate(clock: fn() -> Option<Instant>) {
    SIMULATED.get_or_init(|| clock);
}
