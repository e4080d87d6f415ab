//! Clocks. Their times decide when a step is done, and are shown to users; they affect no result.

#![expect(
    clippy::disallowed_methods,
    reason = "here the clocks are read; no result depends on them"
)]

pub use contract::clock::{now, since};

use std::{
    sync::{Condvar, MutexGuard},
    time::{Duration, SystemTime},
};

/// The date and time of this machine, which may be wrong and may jump.
pub fn date() -> SystemTime {
    #[cfg(test)]
    if let Some(date) = super::simulated::date() {
        return date;
    }
    SystemTime::now()
}

/// Suspends this thread for a duration.
pub fn sleep(wait: Duration) {
    #[cfg(test)]
    if super::simulated::sleep(wait) {
        return;
    }
    std::thread::sleep(wait);
}

/// Unlocks the mutex and suspends this thread until `changed` is notified, for `longest` at most. A simulated process
/// always waits for `longest`.
pub fn wait_for<T>(changed: &Condvar, guard: MutexGuard<'_, T>, longest: Duration) {
    #[cfg(test)]
    if super::simulated::process_id().is_some() {
        drop(guard);
        return sleep(longest);
    }
    drop(changed.wait_timeout(guard, longest));
}
