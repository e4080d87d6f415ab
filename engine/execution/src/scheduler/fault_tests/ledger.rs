//! The ledger of promises, each of which must hold whatever happens.

use crate::{store::Store, world::simulated::quietly};
use contract::{
    trial::Trial,
    trial_end::{EndState, TrialEnd},
};
use std::{
    cell::RefCell,
    collections::{BTreeMap, BTreeSet},
    sync::{Arc, Mutex, MutexGuard},
    time::Duration,
};

thread_local! {
    /// The trial that this process runs.
    static TRIAL: RefCell<Option<(Arc<Ledger>, String)>> = const { RefCell::new(None) };
}

#[derive(Default)]
pub struct Ledger {
    promises: Mutex<Promises>,
}

#[derive(Default)]
struct Promises {
    /// End of each trial, by its id.
    ended: BTreeMap<String, TrialEnd>,
    /// Steps up to which paused trials were measured, by their ids.
    paused: BTreeMap<String, u64>,
    /// Number of saved steps of each trial.
    saved: BTreeMap<String, u64>,
    /// Trials that two processes may have run at the same time: each of them may return to a state before the other's
    /// checkpoint.
    shared: BTreeSet<String>,
    /// Processes that run a trial: the place and id of each, and the time of its last renewal.
    runs: BTreeMap<String, Vec<Runner>>,
    /// Trials whose run has just begun.
    begun: BTreeSet<String>,
    broken: Option<String>,
}

struct Runner {
    place: usize,
    pid: u32,
    host: usize,
    heard: Duration,
}

/// State of the process that calls the ledger.
#[derive(Clone, Copy)]
pub struct ProcessStatus {
    pub place: usize,
    pub pid: u32,
    pub host: usize,
    /// The date by the clock of the disk.
    pub now: Duration,
    /// Time of the last renewal of its leases, by that clock.
    pub renewed: Duration,
    /// Whether it holds the lease of its trial now.
    pub has_lease: bool,
}

impl Ledger {
    fn lock(&self) -> MutexGuard<'_, Promises> {
        self.promises
            .lock()
            .unwrap_or_else(std::sync::PoisonError::into_inner)
    }

    /// Records that a process begins to run a trial. `lives` tells whether a process runs.
    pub fn begins(
        self: &Arc<Self>,
        trial: &str,
        who: ProcessStatus,
        expiry: Duration,
        lives: impl Fn(u32) -> bool,
    ) {
        let mut promises = self.lock();
        // A process that was halted after it took the lease may have lost the lease and all its state.
        assert!(
            !who.has_lease || !promises.ended.contains_key(trial),
            "{trial} has ended and runs again"
        );
        let runs = promises.runs.entry(trial.into()).or_default();
        runs.retain(|other| lives(other.pid));
        for other in &*runs {
            let silence = who.now.saturating_sub(other.heard);
            assert!(
                other.host != who.host && silence + Duration::from_secs(1) >= expiry,
                "{trial} was taken from process {} at place {}, which lives and was silent for {silence:?}",
                other.pid,
                other.place
            );
        }
        let shared = !runs.is_empty() || !who.has_lease;
        runs.push(Runner {
            place: who.place,
            pid: who.pid,
            host: who.host,
            heard: who.renewed,
        });
        if shared {
            promises.shared.insert(trial.into());
        }
        promises.begun.insert(trial.into());
        drop(promises);
        TRIAL.with(|this| *this.borrow_mut() = Some((Arc::clone(self), trial.into())));
    }

    /// Records that a process has renewed its leases. A process that lost its lease while it was halted does not renew
    /// any with it.
    pub fn hears(&self, who: ProcessStatus) {
        if !who.has_lease {
            return;
        }
        let mut promises = self.lock();
        let runners = promises.runs.values_mut().flatten();
        runners
            .filter(|other| other.pid == who.pid)
            .for_each(|other| other.heard = who.now);
    }

    /// Records that a process no longer runs a trial.
    pub fn leaves(&self, trial: &str, pid: u32) {
        if let Some(runs) = self.lock().runs.get_mut(trial) {
            runs.retain(|other| other.pid != pid);
        }
    }

    /// A promise that was broken inside a trial, where a panic would count as the trial's own.
    pub fn broken(&self) -> Option<String> {
        self.lock().broken.clone()
    }

    /// Records that the end of a trial was reported to a process.
    pub fn ends(&self, trial: &str, end: &TrialEnd) {
        let mut promises = self.lock();
        let known = promises.ended.entry(trial.into()).or_insert_with(|| end.clone());
        assert_eq!(
            (known.state, &known.digest),
            (end.state, &end.digest),
            "{trial} ended in two ways"
        );
    }

    /// Records that the pause of a trial was reported to a process.
    pub fn pauses(&self, trial: &str, step: u64) {
        let mut promises = self.lock();
        let known = promises.paused.entry(trial.into()).or_default();
        *known = step.max(*known);
    }

    /// Records that a trial must run from its beginning again.
    pub fn begins_anew(&self, trial: &str) {
        self.lock().saved.remove(trial);
    }

    /// Asserts that a trial continues from a saved step.
    pub fn goes_on(&self, trial: &str, steps: u64) {
        let mut promises = self.lock();
        let saved = promises.saved.get(trial).copied().unwrap_or(0);
        if promises.begun.remove(trial) && !promises.shared.contains(trial) && steps < saved {
            let broken = format!("{trial} goes on after {steps} steps, and {saved} were saved");
            promises.broken.get_or_insert(broken);
        }
        let saved = promises.saved.entry(trial.into()).or_default();
        *saved = steps.max(*saved);
    }

    pub fn of_this_trial(act: impl FnOnce(&Self, &str)) {
        TRIAL.with(|this| {
            if let Some((ledger, trial)) = &*this.borrow() {
                act(ledger, trial);
            }
        });
    }

    /// Asserts that every promised trial is completely stored.
    pub fn holds(&self, store: &Store, trials: &[Trial]) {
        let ended = self.lock().ended.clone();
        for (id, end) in ended {
            let trial = trials.iter().find(|trial| trial.id == id).unwrap();
            let result = quietly(|| store.load(&Arc::new(trial.clone())));
            let found = result
                .unwrap_or_else(|error| panic!("{id} had ended: {error}"))
                .end;
            let found = found.unwrap_or_else(|| panic!("{id} had ended and is missing"));
            assert_eq!((found.state, &found.digest), (end.state, &end.digest), "{id}");
            assert!(
                !quietly(|| store.has_damaged_artifact(&id)),
                "{id} left an artifact that is damaged"
            );
        }
        let paused = self.lock().paused.clone();
        for (id, step) in paused {
            let has_ended =
                quietly(|| store.end(&id)).is_ok_and(|end| end.is_some_and(|end| end.state == EndState::Ok));
            let measured = quietly(|| store.measured_until(&id));
            assert!(
                has_ended || measured.is_some_and(|known| known >= step),
                "{id} had paused at step {step}, and {measured:?} is stored"
            );
        }
    }
}
