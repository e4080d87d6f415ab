//! Computes the missing trials of studies on this machine, and says what happens.

use super::{
    Failure, INCOMPLETE, LimitOptions, OK, TRIALS_FAILED, complain, progress::Progress, settings::Settings, study, study::Planned,
};
use crate::{
    Registry, cross_play,
    limits::Limits,
    results::EndState,
    scheduler::{self, Task, Workers},
    store::{Store, is_missing},
};
use std::{
    collections::BTreeSet,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
        mpsc,
    },
};

/// How to compute.
pub(super) struct Compute<'a> {
    /// What this program is made of.
    pub(super) registry: &'a Registry,
    /// What holds on this machine.
    pub(super) settings: &'a Settings,
    /// What the command line says of limits.
    pub(super) limits: &'a LimitOptions,
    /// Worker processes.
    pub(super) workers: usize,
    /// Whether trials that ended otherwise than `ok` run again.
    pub(super) retry_failed: bool,
    /// Whether to wait for trials that other programs run.
    pub(super) wait_for_others: bool,
}

impl Compute<'_> {
    /// Runs the trials that are missing (of those that `mine` picks by position); 106 where some still are, 100 where some
    /// of them failed.
    pub(super) fn run(&self, planned: &[Planned], mine: impl Fn(usize) -> bool) -> Result<u8, Failure> {
        let store = Store::at(&self.settings.store).by(self.registry.build.clone());
        let tasks = self.tasks(planned, &store, mine);
        if tasks.is_empty() {
            complain("every trial is in the store already; nothing runs");
            return Ok(OK);
        }
        complain(&format!("running {} trials on {} worker processes", tasks.len(), self.workers.min(tasks.len())));
        let stop = Arc::new(AtomicBool::new(false));
        listen_for_signals(&stop)?;
        let (events, received) = mpsc::channel();
        let mut progress = Progress::new(&tasks, self.workers);
        let ran = std::thread::scope(|scope| {
            let (workers, tasks, store) = (self.workers(&stop), &tasks, &store);
            let running = scope.spawn(move || scheduler::run(tasks, store, &workers, &events));
            received.iter().for_each(|event| progress.show(&event));
            running.join()
        });
        let failed = progress.failed();
        drop(progress);
        match ran {
            Ok(outcome) => outcome?,
            Err(panic) => std::panic::resume_unwind(panic),
        }
        Ok(self.code(&tasks, &store, failed, stop.load(Ordering::SeqCst)))
    }

    fn code(&self, tasks: &[Task<'_>], store: &Store, failed: usize, stopped: bool) -> u8 {
        let left: Vec<&Task<'_>> =
            tasks.iter().filter(|task| is_missing(store.end(&task.trial.id).unwrap_or(None).as_ref())).collect();
        let elsewhere = left.iter().filter(|task| store.running(&task.trial.id).is_some()).count();
        let unready = left.iter().filter(|task| !scheduler::is_ready(&task.after, store)).count();
        let (ours, failed) = (left.len().saturating_sub(elsewhere + unready), failed > 0);
        if unready > 0 {
            complain(&format!("{unready} trials of cross-play are missing, because they play policies that are not there"));
        }
        if elsewhere > 0 {
            complain(&format!("{elsewhere} trials are with other programs"));
        }
        if ours > 0 {
            complain(&format!("{ours} trials are still missing; the same command goes on"));
        }
        // A worker leaves to others what plays the policies that others train.
        match (ours > 0 || unready > 0 && self.wait_for_others, failed) {
            (true, true) if self.limits.fail_fast && !stopped => TRIALS_FAILED,
            (true, _) => INCOMPLETE,
            (false, true) => TRIALS_FAILED,
            (false, false) => OK,
        }
    }

    fn workers(&self, stop: &Arc<AtomicBool>) -> Workers {
        let lease_expiry = self.settings.lease_expiry;
        Workers {
            count: self.workers,
            stop: Arc::clone(stop),
            fail_fast: self.limits.fail_fast,
            wait_for_others: self.wait_for_others,
            checkpoint_every: self.settings.checkpoint_every,
            // Several renewals may be late or lost before a lease looks dead.
            heartbeat: lease_expiry / 6,
            lease_expiry,
        }
    }

    /// The trials to run, each once though several studies share it.
    pub(super) fn tasks<'p>(&self, planned: &'p [Planned], store: &Store, mine: impl Fn(usize) -> bool) -> Vec<Task<'p>> {
        let (mut seen, mut tasks) = (BTreeSet::new(), Vec::new());
        for one in planned {
            let limits = Arc::new(self.limits_of(&one.study.limits));
            let ends = study::ends(store, &one.plan.trials);
            for (position, ((trial, cost), end)) in one.plan.trials.iter().zip(&one.costs).zip(ends).enumerate() {
                let retry = self.retry_failed && end.as_ref().is_some_and(|end| end.state != EndState::Ok);
                let after = cross_play::sources(&trial.key);
                // A part of the trials may lack the policies that the other parts train: whoever finds them runs what plays them.
                let mine = mine(position) || !after.is_empty();
                if mine && (retry || is_missing(end.as_ref())) && seen.insert(trial.id.as_str()) {
                    tasks.push(Task { trial, cost: *cost, limits: Arc::clone(&limits), before: end, after });
                }
            }
        }
        tasks
    }

    /// The study's limits, tightened by the machine's, and what the command line says in their place.
    fn limits_of(&self, study: &Limits) -> Limits {
        let (held, said) = (study.on(&self.settings.limits), self.limits);
        Limits {
            wall_time_s: said.wall_time_s.or(held.wall_time_s),
            memory_mb: said.memory_mb.or(held.memory_mb),
            retries: said.retries.or(held.retries),
            retry_on: if said.retry_on.is_empty() { held.retry_on } else { Some(said.retry_on.clone()) },
            retry_delay_s: said.retry_delay_s.or(held.retry_delay_s),
        }
    }
}

/// The first Ctrl-C (or SIGTERM) stops the run in order, the second one at once. SIGUSR1, the early warning of a batch system,
/// stops in order too.
pub(super) fn listen_for_signals(stop: &Arc<AtomicBool>) -> Result<(), Failure> {
    use signal_hook::{
        consts::{SIGINT, SIGTERM, SIGUSR1},
        flag,
    };
    let asked = Arc::new(AtomicBool::new(false));
    let listen = || -> std::io::Result<()> {
        for signal in [SIGINT, SIGTERM] {
            flag::register_conditional_shutdown(signal, 128 + signal, Arc::clone(&asked))?;
            flag::register(signal, Arc::clone(&asked))?;
        }
        for signal in [SIGINT, SIGTERM, SIGUSR1] {
            flag::register(signal, Arc::clone(stop))?;
        }
        Ok(())
    };
    listen().map_err(|error| Failure { code: INCOMPLETE, text: format!("error: cannot listen for signals: {error}") })
}
