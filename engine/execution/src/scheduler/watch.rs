//! The watching thread: leases, limits, stop requests.

use super::process::WorkerProcess;
use crate::{
    store::{BucketLeases, Leases},
    world::clock,
};
use std::{
    sync::atomic::{AtomicBool, Ordering},
    time::Duration,
};

/// Interval between two checks of the processes; a process that takes memory as fast as it can gets about 50 MB in it.
const PERIOD: Duration = Duration::from_millis(20);

/// Delay of a check that shows that this program was suspended, with its children.
const SUSPENDED: Duration = Duration::from_secs(1);

/// Processes, leases and flags of the watching thread.
pub(super) struct Watch<'a> {
    pub(super) children: &'a [WorkerProcess],
    pub(super) leases: &'a Leases,
    /// The stop request from outside, and the internal one.
    pub(super) stop: &'a AtomicBool,
    pub(super) halt: &'a AtomicBool,
    /// Whether the slots still work.
    pub(super) on: &'a AtomicBool,
}

impl Watch<'_> {
    /// Watches until the slots are done.
    pub(super) fn run(&self, heartbeat: Duration) {
        let mut renewed = clock::now();
        while self.on.load(Ordering::SeqCst) {
            let stopping = self.stop.load(Ordering::SeqCst) || self.halt.load(Ordering::SeqCst);
            for child in self.children {
                if stopping {
                    child.ask_to_stop();
                }
                child.hold_limits();
            }
            if clock::since(renewed) >= heartbeat {
                renewed = clock::now();
                // A store that cannot be written now is noticed at the next trial; until then the leases only look
                // older.
                let _ = self.leases.beat();
            }
            let parked = clock::now();
            std::thread::park_timeout(PERIOD);
            let away = clock::since(parked);
            if away > SUSPENDED {
                self.children.iter().for_each(|child| child.was_suspended(away));
            }
        }
    }
}

/// Renews the leases in a bucket until the slots are done. A separate thread does it, since a service that does not
/// answer must not block limits and stop requests.
pub(super) fn renew(leases: &BucketLeases, on: &AtomicBool, heartbeat: Duration) {
    let mut renewed = clock::now();
    while on.load(Ordering::SeqCst) {
        if clock::since(renewed) >= heartbeat {
            renewed = clock::now();
            // As above: until the service answers again, the leases only look older.
            let _ = leases.beat();
        }
        std::thread::park_timeout(PERIOD);
    }
}
