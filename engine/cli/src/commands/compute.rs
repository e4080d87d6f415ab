//! Computes the missing trials of studies on this machine, and says what happens.

use super::{
    Common, Failure, INCOMPLETE, LimitOptions, OK, Selection, TRIALS_FAILED, complain,
    fitting::Machines,
    planned::{self, Planned},
    prepare::{Ends, failed_in_words},
    progress::Progress,
    settings::Settings,
};
use contract::{
    Registry,
    resources::{Capacity, Needs},
    trial::Trial,
    trial_end::{TrialEnd, is_missing},
};
use document::count::{count, either};
use execution::{
    limits::Limits,
    pace::Paces,
    scheduler::{self, Task, Workers, hosts::Hosts},
    store::Store,
};
use std::{
    collections::{BTreeMap, BTreeSet},
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
    /// What was asked for, to be said in commands that are shown.
    pub(super) asked: (&'a Selection, &'a Common),
    /// What holds on this machine.
    pub(super) settings: &'a Settings,
    /// What the command line says of limits.
    pub(super) limits: &'a LimitOptions,
    /// Worker processes, on this machine or on all hosts.
    pub(super) workers: usize,
    /// The hosts that run trials in the place of this machine, where there are any.
    pub(super) hosts: Hosts,
    /// Whether trials that ended otherwise than `ok` run again.
    pub(super) retry_failed: bool,
    /// Whether this is the whole command and not a part of one: it looks at what is stored before, and waits
    /// for trials that other programs run.
    pub(super) whole: bool,
}

/// What is known of a run besides what it stored.
pub(super) struct Ran {
    /// Whether some of its trials ended otherwise than `ok`.
    failed: bool,
    /// Whether it was asked to stop.
    stopped: bool,
    /// Trials that could not begin for want of what they take, by their places in the list of tasks.
    blocked: BTreeSet<usize>,
}

impl Ran {
    /// Whether it was asked to stop.
    pub(super) fn stopped(&self) -> bool {
        self.stopped
    }
}

impl Compute<'_> {
    /// Runs the trials that are missing (of those that `mine` picks by position); 106 where some still are,
    /// 100 where some of them failed.
    pub(super) fn run(&self, planned: &[Planned], mine: impl Fn(usize) -> bool) -> Result<u8, Failure> {
        let store = self.settings.open()?.by(self.registry.build.clone());
        let ends = self.prepare(planned, &store)?;
        // What is damaged is set aside by now.
        self.bring(planned, &store)?;
        let mut tasks = self.tasks(planned, &ends, mine);
        tasks.extend(self.unsealed(planned, &store));
        if tasks.is_empty() {
            complain(&self.nothing_runs(planned, &ends));
            return Ok(OK);
        }
        self.refuse_unfit(&tasks)?;
        let missing: BTreeSet<&str> = tasks.iter().map(|task| task.trial.id.as_str()).collect();
        let runs = |one: &&Planned| one.plan.trials.iter().any(|it| missing.contains(it.id.as_str()));
        for one in planned.iter().filter(runs) {
            planned::try_out(self.registry, one)?;
        }
        complain(&format!(
            "running {}{} on {}; the store is `{}`",
            count(tasks.len(), "trial"),
            of_how_many(planned, tasks.len()),
            self.processes(tasks.len()),
            self.settings.store.display()
        ));
        let ran = self.work(&tasks, &store)?;
        let now: Vec<Option<TrialEnd>> = tasks
            .iter()
            .map(|task| store.end(&task.trial.id).unwrap_or(None))
            .collect();
        let ends_now = of_all(planned, &ends).chain(tasks.iter().map(|task| task.trial).zip(&now));
        if let Some(words) = self.failed(ends_now) {
            complain(&words);
        }
        let left = tasks
            .iter()
            .zip(&now)
            .enumerate()
            .filter(|(_, (task, end))| is_missing(end.as_ref()) && !has_paused(task, &store));
        let left: Vec<_> = left
            .map(|(place, (task, _))| (task, ran.blocked.contains(&place)))
            .collect();
        Ok(self.code(&left, &store, &ran))
    }

    /// Brings what has ended here and is not shared yet into the bucket, where there is one.
    fn bring(&self, planned: &[Planned], store: &Store) -> Result<(), Failure> {
        let trials = planned
            .iter()
            .flat_map(|one| one.paused.iter().chain(&one.plan.trials));
        let brought = store.bring(trials.map(|trial| trial.id.as_str()))?;
        if let (Some(address), 1..) = (&self.settings.bucket, brought) {
            complain(&format!("brought {} into `{address}`", count(brought, "trial")));
        }
        Ok(())
    }

    /// How many processes run so many tasks, in words.
    pub(super) fn processes(&self, tasks: usize) -> String {
        let processes = self.workers.min(tasks);
        let of_hosts = match self.hosts.all.len() {
            0 => String::new(),
            hosts => format!(" of {}", count(hosts, "host")),
        };
        format!(
            "{processes} worker {}{of_hosts}",
            either(&processes, "process", "processes")
        )
    }

    /// Runs the tasks and shows what happens.
    pub(super) fn work(&self, tasks: &[Task<'_>], store: &Store) -> Result<Ran, Failure> {
        let stop = Arc::new(AtomicBool::new(false));
        listen_for_signals(&stop)?;
        let (events, received) = mpsc::channel();
        let mut progress = Progress::new(tasks, self.workers);
        let ran = std::thread::scope(|scope| {
            let workers = self.workers(&stop);
            let running = scope.spawn(move || scheduler::run(tasks, store, &workers, &events));
            received.iter().for_each(|event| progress.show(&event));
            running.join()
        });
        let (failed, blocked) = (progress.failed() > 0, progress.blocked().clone());
        drop(progress);
        match ran {
            Ok(outcome) => outcome?,
            Err(panic) => std::panic::resume_unwind(panic),
        }
        Ok(Ran {
            failed,
            stopped: stop.load(Ordering::SeqCst),
            blocked,
        })
    }

    /// Runs the tasks without a word.
    pub(super) fn work_quietly(&self, tasks: &[Task<'_>], store: &Store) -> Result<Ran, Failure> {
        let stop = Arc::new(AtomicBool::new(false));
        listen_for_signals(&stop)?;
        let (events, _) = mpsc::channel();
        scheduler::run(tasks, store, &self.workers(&stop), &events)?;
        Ok(Ran {
            failed: false,
            stopped: stop.load(Ordering::SeqCst),
            blocked: BTreeSet::new(),
        })
    }

    /// What is said where no trial is missing.
    pub(super) fn nothing_runs(&self, planned: &[Planned], ends: &Ends) -> String {
        let failed = self.failed(of_all(planned, ends));
        failed.map_or_else(
            || "every trial is in the store already; nothing runs".into(),
            |failed| format!("no trial is missing, so nothing runs; {failed}"),
        )
    }

    fn failed<'e>(&self, ends: impl Iterator<Item = (&'e Trial, &'e Option<TrialEnd>)>) -> Option<String> {
        let (selection, common) = self.asked;
        let ends = ends.map(|(trial, end)| (trial.id.as_str(), end.as_ref()));
        failed_in_words(ends, &selection.command("run", common, &["--retry-failed"]))
    }

    /// The exit code, from the trials that are left, each with whether it could not begin for want of what
    /// they take.
    fn code(&self, left: &[(&Task<'_>, bool)], store: &Store, ran: &Ran) -> u8 {
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
            complain(&format!(
                "{} {} blocked, because what {} from others is not there",
                count(unready, "trial"),
                either(&unready, "is", "are"),
                either(&unready, "it takes", "they take")
            ));
        }
        if elsewhere > 0 {
            let with = either(&elsewhere, "is with another program", "are with other programs");
            complain(&format!("{} {with}", count(elsewhere, "trial")));
        }
        if ours > 0 {
            complain(&format!(
                "{} {} still missing; the same command goes on",
                count(ours, "trial"),
                either(&ours, "is", "are")
            ));
        }
        // A worker leaves to others what takes from their trials.
        match (ours > 0 || unready > 0 && self.whole, ran.failed) {
            (true, true) if self.limits.fail_fast && !ran.stopped => TRIALS_FAILED,
            (true, _) => INCOMPLETE,
            (false, true) => TRIALS_FAILED,
            (false, false) => OK,
        }
    }

    fn workers(&self, stop: &Arc<AtomicBool>) -> Workers {
        let lease_expiry = self.settings.lease_expiry;
        Workers {
            capacity: Capacity {
                cores: self.workers,
                gpus: self.settings.gpus.clone(),
            },
            hosts: self.hosts.clone(),
            stop: Arc::clone(stop),
            fail_fast: self.limits.fail_fast,
            wait_for_others: self.whole,
            checkpoint_every: self.settings.checkpoint_every,
            // Several renewals may be late or lost before a lease looks dead.
            heartbeat: lease_expiry / 6,
            lease_expiry,
        }
    }

    /// The trials to run, each once though several studies share it.
    pub(super) fn tasks<'p>(
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
                // A part of the trials may lack what the other parts leave: whoever finds it there runs what
                // takes it.
                let mine = mine(position) || !after.is_empty();
                if !mine || !is_missing(end.as_ref()) {
                    continue;
                }
                let until = one.pauses.get(&trial.id).copied();
                if let Some(place) = seen.get(trial.id.as_str()) {
                    // What somebody needs whole goes to its end.
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

    /// The trials whose measurement at their pause lies in their logs alone, since an earlier program left it
    /// there or this one was killed: they go on from their checkpoints for a moment, and it is stored.
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

    /// Refuses trials that fit no machine.
    pub(super) fn refuse_unfit(&self, tasks: &[Task<'_>]) -> Result<(), Failure> {
        let machines = match &self.hosts.all[..] {
            [] => Machines::here(self.settings, self.workers),
            hosts => Machines::hosts(hosts),
        };
        let agents = tasks.iter().filter_map(|task| task.trial.key.agent.agent());
        machines.refuse_unfit(self.registry, agents)
    }

    fn needs(&self, trial: &Trial) -> Needs {
        Needs::of(self.registry, trial.key.agent.agent())
    }

    /// The study's limits, tightened by the machine's, and what the command line says in their place.
    pub(super) fn limits_of(&self, study: &Limits) -> Limits {
        let (held, said) = (study.on(&self.settings.limits), self.limits);
        Limits {
            wall_time_s: said.wall_time_s.or(held.wall_time_s),
            stalled_after_s: said.stalled_after_s.or(held.stalled_after_s),
            memory_mb: said.memory_mb.or(held.memory_mb),
            retries: said.retries.or(held.retries),
            retry_on: if said.retry_on.is_empty() {
                held.retry_on
            } else {
                Some(said.retry_on.clone())
            },
            retry_delay_s: said.retry_delay_s.or(held.retry_delay_s),
        }
    }
}

/// Of how many trials those are that run, where others are there already; empty where none is.
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

/// Whether a trial has come to its pause, and what it measured there is stored.
pub(super) fn has_paused(task: &Task<'_>, store: &Store) -> bool {
    let measured = || store.measured_until(&task.trial.id);
    task.until
        .is_some_and(|until| measured().is_some_and(|step| step >= until))
}

/// How fast trials went that are stored.
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

/// The first Ctrl-C (or SIGTERM) stops the run in order, the second one at once. SIGUSR1, the early warning
/// of a batch system, stops in order too.
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
    listen().map_err(|error| Failure {
        code: INCOMPLETE,
        text: format!("error: cannot listen for signals: {error}"),
    })
}
