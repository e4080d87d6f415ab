//! Runs missing trials in worker processes, one single-threaded trial per process at a time.
//!
//! One thread per worker slot owns one child process, here or on a host ([`hosts`]), and takes trials from a common
//! queue. A trial begins only under its lease, so that several programs can work on one store. The child runs the
//! trial, writes it to the store and reports its end; a child that dies is replaced, and only its trial is affected.
//! At the end of a run the children of this machine wait for the next one ([`IdleWorkers`]).
//!
//! One watching thread renews the leases, enforces the limits of time and memory, and passes on the stop request. Every
//! event reaches the caller as an [`Event`] on one channel, so that a single owner decides what is shown.

#[cfg(test)]
mod fault_tests;
pub mod hosts;
mod idle;
mod local;
mod process;
mod queue;
mod readiness;
mod silence;
mod slot;
mod watch;
mod worker;

/// The verb that starts a worker process of this program.
pub const WORKER: &str = "trial-worker";

pub use idle::IdleWorkers;
pub use readiness::is_ready;
pub use worker::{Reply, Request, serve};

use crate::{
    limits::Limits,
    store::{BucketLeases, Leases, Owner, Store},
};
use contract::{
    Error,
    resources::{Capacity, Needs},
    trial::Trial,
    trial_end::TrialEnd,
};
use queue::Queue;
use std::{
    path::Path,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
        mpsc::Sender,
    },
    time::Duration,
};

/// Events of a run.
#[derive(Debug, Clone)]
pub enum Event {
    /// A trial started in a slot.
    Started {
        /// Worker slot, from 0.
        slot: usize,
        /// Index into the list of tasks.
        trial: usize,
    },
    /// Progress of the trial in a slot.
    Progress {
        /// Worker slot.
        slot: usize,
        /// Steps done.
        done: u64,
        /// Total number of steps.
        total: u64,
    },
    /// A trial ended and its end is stored.
    Ended {
        /// Worker slot.
        slot: usize,
        /// Index into the list of tasks.
        trial: usize,
        /// End of the trial.
        end: TrialEnd,
    },
    /// An attempt at a trial failed and it will be tried again.
    Retried {
        /// Worker slot.
        slot: usize,
        /// Index into the list of tasks.
        trial: usize,
        /// End of the attempt.
        end: TrialEnd,
        /// The wait before the next attempt.
        wait: Duration,
    },
    /// Another program has the trial; it is tried again later.
    Held {
        /// Index into the list of tasks.
        trial: usize,
        /// Process that has the trial.
        owner: Owner,
    },
    /// Another program has ended the trial.
    EndedElsewhere {
        /// Index into the list of tasks.
        trial: usize,
        /// End of the trial.
        end: TrialEnd,
    },
    /// A source of a trial is running in another program; the trial is tried again later.
    Awaits {
        /// Index into the list of tasks.
        trial: usize,
        /// Id of that source.
        source: String,
        /// Process that runs the source.
        owner: Owner,
    },
    /// A trial is blocked: one of its sources has not ended `ok`, or left no usable artifact. The trial stays
    /// missing.
    Unready {
        /// Index into the list of tasks.
        trial: usize,
        /// Id of the source, and the reason.
        reason: String,
    },
    /// An obstacle blocks the place of a trial; the trial stays missing, and the others continue.
    Obstructed {
        /// Index into the list of tasks.
        trial: usize,
        /// The obstacle, and the remedy.
        reason: String,
    },
    /// A trial was interrupted because the run is being stopped; it stays missing and continues from its
    /// checkpoint.
    Stopped {
        /// Worker slot.
        slot: usize,
    },
    /// A trial has reached its pause.
    Paused {
        /// Worker slot.
        slot: usize,
        /// Index into the list of tasks.
        trial: usize,
    },
    /// The place of a slot cannot be reached; its trial is given to the other slots.
    Lost {
        /// Worker slot.
        slot: usize,
        /// The place, and the reason.
        problem: String,
        /// The wait before the next attempt to reach it; `None` if it is given up.
        wait: Option<Duration>,
    },
    /// A slot has failed and takes no further trial.
    Broken {
        /// Worker slot.
        slot: usize,
        /// The reason.
        problem: String,
    },
}

/// A trial to run.
#[derive(Debug, Clone)]
pub struct Task<'a> {
    /// The trial; the plan holds it.
    pub trial: &'a Trial,
    /// Number of steps of the trial.
    pub cost: u64,
    /// Seconds per step of earlier trials of its agent in its environment; `None` if none is stored. Long paths start
    /// first.
    pub pace_s: Option<f64>,
    /// Limits of each attempt.
    pub limits: Arc<Limits>,
    /// Stored end of the trial, if it runs again in spite of it.
    pub before: Option<TrialEnd>,
    /// Ids of the trials that must have ended `ok` before it begins.
    pub after: Vec<String>,
    /// The step at which the trial pauses after the measurement there; `None` to run to its end.
    pub until: Option<u64>,
    /// Cores and cards that the trial needs.
    pub needs: Needs,
}

/// Settings of a run: machines, stops and intervals.
#[derive(Debug, Clone)]
pub struct Workers {
    /// The cores of this machine, each with a worker process, and its cards; unused if there are hosts.
    pub capacity: Capacity,
    /// Hosts that run the trials instead of this machine, if any.
    pub hosts: hosts::Hosts,
    /// The devices of the worker processes here, which are assigned in turn, each in the form of
    /// [`device::VARIABLE`](crate::device::VARIABLE); empty if learners compute in these processes.
    pub devices: Vec<String>,
    /// Worker processes of earlier runs of this program, which the trials of this run take over.
    pub idle: Arc<IdleWorkers>,
    /// Set from outside to stop: no new trial starts, and running ones save a checkpoint and exit.
    pub stop: Arc<AtomicBool>,
    /// Whether to stop at the first trial that does not end `ok`.
    pub fail_fast: bool,
    /// Whether to wait for trials that other programs run; otherwise these are left to the other programs.
    pub wait_for_others: bool,
    /// Interval between two checkpoints of a trial.
    pub checkpoint_every: Duration,
    /// Interval between two renewals of the leases.
    pub heartbeat: Duration,
    /// Time without renewal after which leases of programs on other machines count as dead.
    pub lease_expiry: Duration,
}

/// Runs `tasks` and stores their ends; returns when all have ended or the run was stopped.
///
/// The order in which trials run does not affect results.
///
/// # Errors
/// [`Error::Worker`] if no worker process can be started; [`Error::File`] if the store cannot be written, and
/// [`Error::Bucket`] if its shared bucket cannot. The remaining tasks stay missing.
pub fn run(
    tasks: &[Task<'_>],
    store: &Store,
    workers: &Workers,
    events: &Sender<Event>,
) -> Result<(), Error> {
    let program = std::env::current_exe().map_err(|source| Error::Worker {
        problem: format!("cannot find this program: {source}"),
    })?;
    let leases = Leases::open(store, workers.lease_expiry)?;
    let bucket = store.bucket();
    let shared_leases = bucket.map(|bucket| BucketLeases::open(bucket, workers.lease_expiry));
    let shared_leases = shared_leases.transpose()?;
    let (halt, watching) = (AtomicBool::new(false), AtomicBool::new(true));
    let queue = Queue::new(tasks, machines(workers));
    let places = places(workers);
    let count = places.len().min(tasks.len());
    let children: Vec<process::WorkerProcess> =
        (0..count).map(|_| process::WorkerProcess::default()).collect();
    std::thread::scope(|scope| {
        let slots: Vec<_> = (0..count)
            .map(|number| {
                let shared = slot::SlotContext {
                    tasks,
                    store,
                    leases: &leases,
                    shared_leases: shared_leases.as_ref(),
                    workers,
                    queue: &queue,
                    halt: &halt,
                };
                let machine = places[number];
                let runner = runner((number, machine), &program, &shared, &children[number]);
                let mut slot = slot::Slot::new((number, machine), shared, runner, events);
                scope.spawn(move || slot.work())
            })
            .collect();
        let watch = watch::Watch {
            children: &children,
            leases: &leases,
            stop: &workers.stop,
            halt: &halt,
            on: &watching,
        };
        let watcher = scope.spawn(move || watch.run(workers.heartbeat));
        if let Some(leases) = &shared_leases {
            scope.spawn(|| watch::renew(leases, &watching, workers.heartbeat));
        }
        let outcome = slots.into_iter().map(|slot| {
            slot.join()
                .unwrap_or_else(|panic| std::panic::resume_unwind(panic))
        });
        let outcome = outcome.fold(Ok(()), Result::and);
        watching.store(false, Ordering::SeqCst);
        watcher.thread().unpark();
        outcome
    })
}

/// The runner of a slot, by the numbers of the slot and of its machine.
fn runner<'a>(
    (number, machine): (usize, usize),
    program: &'a Path,
    shared: &slot::SlotContext<'a>,
    process: &'a process::WorkerProcess,
) -> Box<dyn slot::Runner + Send + 'a> {
    let workers = shared.workers;
    match workers.hosts.all.get(machine) {
        None => Box::new(local::Local::new(
            program,
            device_of(workers, number),
            process,
            &workers.idle,
        )),
        Some(host) => Box::new(hosts::Remote::new(host, shared.store, process)),
    }
}

/// The device of a slot. Devices are assigned in turn.
fn device_of(workers: &Workers, slot: usize) -> Option<&str> {
    let devices = workers.devices.iter().map(String::as_str);
    devices.cycle().nth(slot % workers.devices.len().max(1))
}

/// The capacity of each machine: of the hosts, or of this one.
fn machines(workers: &Workers) -> Vec<Capacity> {
    match &workers.hosts.all[..] {
        [] => vec![workers.capacity.clone()],
        hosts => hosts.iter().map(|host| host.capacity().clone()).collect(),
    }
}

/// The machine of each slot. Hosts are assigned in turn, so that few trials spread over all of them.
fn places(workers: &Workers) -> Vec<usize> {
    let cores: Vec<usize> = machines(workers).iter().map(|it| it.cores).collect();
    let most = cores.iter().copied().max().unwrap_or(0);
    let cores = &cores;
    let round = |turn: usize| (0..cores.len()).filter(move |machine| cores[*machine] > turn);
    (0..most).flat_map(round).collect()
}
