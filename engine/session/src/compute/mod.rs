//! Computes the missing trials of studies on this machine and reports events to the observer.

mod prepare;
mod stopping;

pub(crate) use prepare::Ends;
pub use prepare::failed_in_words;

use crate::{Exit, Failure, Observer, Planned, Session, Silent, device, fitting::Machines, loading};
use contract::{
    resources::{Capacity, Needs},
    trial::Trial,
    trial_end::{EndState, TrialEnd, is_missing},
};
use document::count::{count, either};
use execution::{
    device::{DeviceKind, Server},
    limits::Limits,
    pace::Paces,
    scheduler::{self, Event, IdleWorkers, Task, Workers, hosts::Hosts},
    store::Store,
};
use std::{
    cell::{OnceCell, RefCell},
    collections::{BTreeMap, BTreeSet},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
        mpsc,
    },
};
use stopping::Stopping;

/// Settings of a computation.
pub(crate) struct Compute<'a> {
    /// The studies and the machine.
    pub(crate) session: &'a Session<'a>,
    /// Limits that replace those of study and machine.
    pub(crate) limits: Limits,
    /// Whether the first trial that fails stops the others.
    pub(crate) fail_fast: bool,
    /// Worker processes, on this machine or on all hosts.
    pub(crate) workers: usize,
    /// The hosts that run trials instead of this machine; empty where there are none.
    pub(crate) hosts: Hosts,
    /// The device of learners; none where they compute in the worker processes.
    pub(crate) device: Option<&'a DeviceKind>,
    /// Worker processes between two generations of a search, or two looks. They exit before the device does.
    pub(crate) idle: Arc<IdleWorkers>,
    /// The processes of the device; empty until the first trial is about to run.
    pub(crate) servers: OnceCell<Vec<Server>>,
    /// Whether trials that ended in another state than `ok` run again.
    pub(crate) retry_failed: bool,
    /// Whether this is the whole command, which checks stored trials first and waits for trials of other programs.
    pub(crate) whole: bool,
    /// Trials that ended `ok` and whose metrics this command has found whole.
    pub(crate) sound: RefCell<BTreeSet<String>>,
}

/// Facts on a run that its store does not hold.
#[derive(Default)]
pub(crate) struct Ran {
    /// Whether a trial of the run ended in another state than `ok`.
    failed: bool,
    /// Whether the run was asked to stop.
    pub(crate) stopped: bool,
    /// Trials that could not begin because an artifact that they take was missing, by their places in the list of
    /// tasks.
    blocked: BTreeSet<usize>,
}

impl Ran {
    fn hear(&mut self, event: &Event) {
        match event {
            Event::Ended { end, .. } | Event::EndedElsewhere { end, .. } => {
                self.failed |= end.state != EndState::Ok;
            }
            Event::Unready { trial, .. } => drop(self.blocked.insert(*trial)),
            _ => {}
        }
    }
}

impl<'a> Compute<'a> {
    /// The whole command, on `workers` worker processes of this machine.
    pub(crate) fn of(session: &'a Session<'a>, workers: usize) -> Self {
        Self {
            session,
            limits: Limits::default(),
            fail_fast: false,
            workers,
            hosts: Hosts::default(),
            device: None,
            servers: OnceCell::new(),
            idle: Arc::default(),
            retry_failed: false,
            whole: true,
            sound: RefCell::default(),
        }
    }
}

impl Compute<'_> {
    /// Runs the missing trials that `mine` picks by position. Exit code 106 if trials are still missing, 100 if a trial
    /// failed.
    pub(crate) fn run(&self, planned: &[Planned], mine: impl Fn(usize) -> bool) -> Result<Exit, Failure> {
        let store = self
            .session
            .store()?
            .clone()
            .by(self.session.registry.build.clone());
        let ends = self.prepare(planned, &store)?;
        // Damaged trials have been set aside at this point.
        self.bring(planned, &store)?;
        let mut tasks = self.tasks(planned, &ends, mine);
        tasks.extend(self.unsealed(planned, &store));
        if tasks.is_empty() {
            self.session.notice(&self.nothing_runs(planned, &ends));
            return Ok(Exit::Ok);
        }
        self.refuse_unfit(&tasks)?;
        let missing: BTreeSet<&str> = tasks.iter().map(|task| task.trial.id.as_str()).collect();
        let runs = |one: &&Planned| one.plan.trials.iter().any(|it| missing.contains(it.id.as_str()));
        for one in planned.iter().filter(runs) {
            loading::try_out(self.session.registry, one)?;
        }
        self.open_device()?;
        self.session.notice(&format!(
            "running {}{} on {}; the store is `{}`",
            count(tasks.len(), "trial"),
            of_how_many(planned, tasks.len()),
            self.processes(tasks.len()),
            self.session.settings.store.display()
        ));
        let ran = self.work(&tasks, &store)?;
        let now: Vec<Option<TrialEnd>> = tasks
            .iter()
            .map(|task| store.end(&task.trial.id).unwrap_or(None))
            .collect();
        let ends_now = of_all(planned, &ends).chain(tasks.iter().map(|task| task.trial).zip(&now));
        if let Some(words) = self.failed(ends_now) {
            self.session.notice(&words);
        }
        let left = tasks.iter().zip(&now).enumerate();
        let left = left.filter(|(_, (task, end))| is_missing(end.as_ref()) && !has_paused(task, &store));
        let left: Vec<_> = left
            .map(|(place, (task, _))| (task, ran.blocked.contains(&place)))
            .collect();
        Ok(self.exit(&left, &store, &ran))
    }

    /// Copies trials that ended here and are not shared yet into the bucket, if there is one.
    fn bring(&self, planned: &[Planned], store: &Store) -> Result<(), Failure> {
        let trials = planned
            .iter()
            .flat_map(|one| one.paused.iter().chain(&one.plan.trials));
        let brought = store.bring(trials.map(|trial| trial.id.as_str()))?;
        if let (Some(address), 1..) = (&self.session.settings.bucket, brought) {
            self.session
                .notice(&format!("brought {} into `{address}`", count(brought, "trial")));
        }
        Ok(())
    }

    /// The number of processes that run `tasks` tasks, in words.
    pub(crate) fn processes(&self, tasks: usize) -> String {
        let processes = self.workers.min(tasks);
        let of_hosts = match self.hosts.all.len() {
            0 => String::new(),
            hosts => format!(" of {}", count(hosts, "host")),
        };
        let servers = self.servers.get().into_iter().flatten();
        let with_devices: String = servers.map(|it| format!(" and {}", it.opened.device)).collect();
        format!(
            "{processes} worker {}{of_hosts}{with_devices}",
            either(&processes, "process", "processes")
        )
    }

    /// Runs the tasks; the observer receives the events.
    pub(crate) fn work(&self, tasks: &[Task<'_>], store: &Store) -> Result<Ran, Failure> {
        self.followed_by(self.session.observer, tasks, store)
    }

    /// Runs the tasks without reporting to the observer.
    pub(crate) fn work_quietly(&self, tasks: &[Task<'_>], store: &Store) -> Result<Ran, Failure> {
        self.followed_by(&Silent, tasks, store)
    }

    fn followed_by(
        &self,
        observer: &dyn Observer,
        tasks: &[Task<'_>],
        store: &Store,
    ) -> Result<Ran, Failure> {
        self.open_device()?;
        let stop = self.session.observer.stop()?;
        let (events, received) = mpsc::channel();
        let mut ran = Ran::default();
        let mut follower = observer.follow(tasks, self.workers);
        let mut stopping = Stopping::of(self.session.registry, tasks);
        let ended = std::thread::scope(|scope| {
            let workers = self.workers(&stop);
            let running = scope.spawn(move || scheduler::run(tasks, store, &workers, &events));
            received.iter().for_each(|event| {
                ran.hear(&event);
                if let Some(text) = stopping.hear(&event) {
                    follower.line(&text);
                }
                follower.hear(&event);
            });
            running.join()
        });
        drop(follower);
        match ended {
            Ok(outcome) => outcome?,
            Err(panic) => std::panic::resume_unwind(panic),
        }
        ran.stopped = stop.load(Ordering::SeqCst);
        Ok(ran)
    }

    /// The message if no trial is missing.
    pub(crate) fn nothing_runs(&self, planned: &[Planned], ends: &Ends) -> String {
        let failed = self.failed(of_all(planned, ends));
        failed.map_or_else(
            || "every trial is in the store already; nothing runs".into(),
            |failed| format!("no trial is missing, so nothing runs; {failed}"),
        )
    }

    fn failed<'e>(&self, ends: impl Iterator<Item = (&'e Trial, &'e Option<TrialEnd>)>) -> Option<String> {
        let ends = ends.map(|(trial, end)| (trial.id.as_str(), end.as_ref()));
        failed_in_words(ends, &self.session.again())
    }

    /// The exit, from the trials that are left. The flag beside a trial says whether an artifact that it takes was
    /// missing.
    fn exit(&self, left: &[(&Task<'_>, bool)], store: &Store, ran: &Ran) -> Exit {
        let elsewhere = left
            .iter()
            .filter(|(task, _)| store.running(&task.trial.id).is_some())
            .count();
        let unready = left
            .iter()
            .filter(|(task, unready)| *unready || !scheduler::is_ready(&task.after, store))
            .count();
        let ours = left.len().saturating_sub(elsewhere + unready);
        if unready > 0 {
            self.session.notice(&format!(
                "{} {} blocked, because what {} from others is not there",
                count(unready, "trial"),
                either(&unready, "is", "are"),
                either(&unready, "it takes", "they take")
            ));
        }
        if elsewhere > 0 {
            let with = either(&elsewhere, "is with another program", "are with other programs");
            self.session
                .notice(&format!("{} {with}", count(elsewhere, "trial")));
        }
        if ours > 0 {
            self.session.notice(&format!(
                "{} {} still missing; the same command goes on",
                count(ours, "trial"),
                either(&ours, "is", "are")
            ));
        }
        // A worker leaves blocked trials to other workers.
        match (ours > 0 || unready > 0 && self.whole, ran.failed) {
            (true, true) if self.fail_fast && !ran.stopped => Exit::TrialsFailed,
            (true, _) => Exit::Incomplete,
            (false, true) => Exit::TrialsFailed,
            (false, false) => Exit::Ok,
        }
    }

    /// Opens the device of learners if one is needed and none is open.
    fn open_device(&self) -> Result<(), Failure> {
        if let (Some(kind), None) = (self.device, self.servers.get()) {
            let servers = device::open(kind, &self.session.settings.gpus)?;
            self.servers.get_or_init(|| servers);
        }
        Ok(())
    }

    fn workers(&self, stop: &Arc<AtomicBool>) -> Workers {
        let lease_expiry = self.session.settings.lease_expiry;
        Workers {
            capacity: Capacity {
                cores: self.workers,
                gpus: self.session.settings.gpus.clone(),
            },
            hosts: self.hosts.clone(),
            devices: self
                .servers
                .get()
                .into_iter()
                .flatten()
                .map(Server::address)
                .collect(),
            idle: Arc::clone(&self.idle),
            stop: Arc::clone(stop),
            fail_fast: self.fail_fast,
            wait_for_others: self.whole,
            checkpoint_every: self.session.settings.checkpoint_every,
            // Several renewals may be late or lost before a lease looks dead.
            heartbeat: lease_expiry / 6,
            lease_expiry,
        }
    }

    /// The trials to run. A trial that several studies share is listed once.
    pub(crate) fn tasks<'p>(
        &self,
        planned: &'p [Planned],
        ends: &Ends,
        mine: impl Fn(usize) -> bool,
    ) -> Vec<Task<'p>> {
        let (mut seen, mut tasks) = (BTreeMap::<&str, usize>::new(), Vec::<Task<'p>>::new());
        let paces = paces(planned, ends);
        for (one, ends) in planned.iter().zip(ends) {
            let limits = Arc::new(self.limits_of(&one.study.limits));
            for (position, ((trial, cost), end)) in
                one.plan.trials.iter().zip(&one.costs).zip(ends).enumerate()
            {
                let after = trial.key.sources();
                // A part of the trials may lack artifacts that other parts leave, so every part lists the trials that
                // take artifacts; the part that finds the artifacts runs them.
                let mine = mine(position) || !after.is_empty();
                if !mine || !is_missing(end.as_ref()) {
                    continue;
                }
                let until = one.pauses.get(&trial.id).copied();
                if let Some(place) = seen.get(trial.id.as_str()) {
                    // If one study needs the trial to its end, it runs to its end.
                    let task = &mut tasks[*place];
                    task.until = task.until.zip(until).map(|(one, other)| one.max(other));
                } else {
                    seen.insert(trial.id.as_str(), tasks.len());
                    let pace_s = paces.of(&trial.cell);
                    tasks.push(Task {
                        trial,
                        cost: *cost,
                        pace_s,
                        limits: Arc::clone(&limits),
                        before: end.clone(),
                        after,
                        until,
                        needs: self.needs(trial),
                    });
                }
            }
        }
        tasks
    }

    /// The trials whose measurement at their pause exists only in their logs, because an earlier program left it there
    /// or this one was killed. They resume from their checkpoints briefly, and the measurement is stored.
    fn unsealed<'p>(&self, planned: &'p [Planned], store: &Store) -> Vec<Task<'p>> {
        let of_study = |one: &'p Planned| {
            let limits = Arc::new(self.limits_of(&one.study.limits));
            let task = move |trial: &'p Arc<Trial>| Task {
                trial,
                cost: 0,
                pace_s: None,
                limits: Arc::clone(&limits),
                before: None,
                after: trial.key.sources(),
                until: one.pauses.get(&trial.id).copied(),
                needs: self.needs(trial),
            };
            one.paused.iter().map(task)
        };
        let tasks = planned.iter().flat_map(of_study);
        let mut seen = BTreeSet::new();
        tasks
            .filter(|task| !has_paused(task, store) && seen.insert(task.trial.id.as_str()))
            .collect()
    }

    /// Refuses trials whose needs no machine meets.
    pub(crate) fn refuse_unfit(&self, tasks: &[Task<'_>]) -> Result<(), Failure> {
        let machines = match &self.hosts.all[..] {
            [] => Machines::here(&self.session.settings, self.workers),
            hosts => Machines::hosts(hosts),
        };
        let agents = tasks.iter().filter_map(|task| task.trial.key.agent.agent());
        machines.refuse_unfit(self.session.registry, agents)
    }

    fn needs(&self, trial: &Trial) -> Needs {
        self.session.registry.needs(trial.key.agent.agent())
    }

    /// The study's limits, tightened by the machine's limits and replaced by those of the command line.
    pub(crate) fn limits_of(&self, study: &Limits) -> Limits {
        let (held, said) = (study.on(&self.session.settings.limits), &self.limits);
        Limits {
            wall_time_s: said.wall_time_s.or(held.wall_time_s),
            stalled_after_s: said.stalled_after_s.or(held.stalled_after_s),
            memory_mb: said.memory_mb.or(held.memory_mb),
            retries: said.retries.or(held.retries),
            retry_on: said.retry_on.clone().or(held.retry_on),
            retry_delay_s: said.retry_delay_s.or(held.retry_delay_s),
        }
    }
}

/// The total after the number of trials that run, as ` of 12`; empty if all of them run.
fn of_how_many(planned: &[Planned], tasks: usize) -> String {
    let ids: BTreeSet<&str> = planned
        .iter()
        .flat_map(|one| &one.plan.trials)
        .map(|trial| trial.id.as_str())
        .collect();
    if ids.len() > tasks {
        format!(" of {}", ids.len())
    } else {
        String::new()
    }
}

/// Whether a trial has reached its pause and its measurement there is stored.
pub(crate) fn has_paused(task: &Task<'_>, store: &Store) -> bool {
    let measured = || store.measured_until(&task.trial.id);
    task.until
        .is_some_and(|until| measured().is_some_and(|step| step >= until))
}

/// The pace of the stored trials.
fn paces<'p>(planned: &'p [Planned], ends: &Ends) -> Paces<'p> {
    let trials = planned.iter().zip(ends).flat_map(|(one, ends)| {
        let trials = one.plan.trials.iter().zip(&one.costs).zip(ends);
        trials.map(|((trial, cost), end)| (&*trial.cell, *cost, end.as_ref()))
    });
    Paces::of_ended(trials)
}

fn of_all<'e>(
    planned: &'e [Planned],
    ends: &'e Ends,
) -> impl Iterator<Item = (&'e Trial, &'e Option<TrialEnd>)> {
    planned
        .iter()
        .zip(ends)
        .flat_map(|(one, ends)| one.plan.trials.iter().map(AsRef::as_ref).zip(ends))
}
