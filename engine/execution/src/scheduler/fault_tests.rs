//! Several programs work on one store while processes are killed and halted, machines lose their power, clocks jump,
//! calls fail and the disk is full. These properties must still hold:
//!
//! 1. A trial that was reported as ended has ended, with the same bytes, and does not run again, even if it was
//!    packed.
//! 2. Two computations of a trial give the same bytes.
//! 3. A saved step of a trial is there when the trial continues.
//! 4. No process takes a trial from a process that is alive and renews its lease.
//! 5. When the faults stop, everything is computed, and no lease of a process that is gone remains.
//! 6. No file outside the store is touched.
//! 7. Measurements of a trial at a pause are stored from the moment they are reported, and a search that pauses its
//!    trials makes the same choice, whatever failed meanwhile.
//!
//! A seed that fails is printed; `REGIMEN_SIM_SEED=<seed>` runs it alone and prints its calls.

mod batch;
mod ledger;
mod searching;
mod toys;

use super::{
    Reply, Task, Workers,
    queue::Queue,
    slot::{RequestOutcome, Runner, Slot, SlotContext},
    worker::{self, Request},
};
use crate::{
    limits::Limits,
    store::{Leases, Owner, Store},
    world::{
        clock, fs, process,
        simulated::{Faults, Machine, disk_date, lives, quietly, start},
    },
};
use contract::{
    ArtifactKind, Error, Registry,
    artifact::Taken,
    cast::Actors,
    part::Part,
    resources::{Capacity, Needs},
    trial::{Trial, TrialCell, TrialKey},
    trial_end::{EndState, is_missing},
};
use ledger::{Ledger, ProcessStatus};
use rayon::prelude::*;
use serde_json::{Value, json};
use std::{
    io::{self, Write},
    sync::{Arc, atomic::AtomicBool, mpsc},
    time::{Duration, Instant, UNIX_EPOCH},
};

const EXPIRY: Duration = Duration::from_secs(30);
const HEARTBEAT: Duration = Duration::from_secs(5);
/// Longer than the time for which any machine shows outdated names in a folder.
const SETTLES: Duration = Duration::from_secs(10);

/// State that all simulated processes share.
struct Bench {
    registry: Registry,
    trials: Vec<Trial>,
    ledger: Arc<Ledger>,
    /// The machine of each place, by its number.
    hosts: Vec<usize>,
    /// Whether file operations fail at random.
    calls_fail: bool,
    /// Whether failed trials are tried again, in which case a failure is not final.
    tries_again: bool,
}

fn trial(agent: Value, taken: Option<&Trial>, seed: u64) -> Trial {
    let steps = json!({ "steps": 5, "environments": 1, "evaluate_every": 3, "episodes": 1, "final_episodes": 2,
        "trace_episodes": 0 });
    let mut agent = Part::new("tally", 1, agent);
    agent.artifacts.extend(taken.map(|source| {
        let taken = Taken {
            trial: source.id.clone(),
            kind: ArtifactKind::Policy,
        };
        ("/from".to_owned(), taken)
    }));
    let key = TrialKey {
        environment: Part::new("throw", 1, json!({})).into(),
        agent: Actors::Agent(agent).into(),
        protocol: Part::new("train_evaluate", 1, steps).into(),
        seed,
        numerics: 1,
    };
    Trial {
        id: key.id(),
        cell: TrialCell::of("throw", "tally").into(),
        key,
    }
}

impl Bench {
    fn new(hosts: &[usize], calls_fail: bool) -> Self {
        let source = trial(json!({ "fails": false }), None, 0);
        let taker = trial(
            json!({ "from": { "from": "source", "product": "policy" }, "fails": false }),
            Some(&source),
            0,
        );
        let alone = trial(json!({ "fails": false }), None, 1);
        let short = trial(json!({ "fails": false, "leaves_nothing": true }), None, 2);
        let failing = trial(json!({ "fails": true }), None, 0);
        Self {
            registry: toys::registry(),
            trials: vec![source, taker, alone, short, failing],
            ledger: Arc::default(),
            hosts: hosts.to_vec(),
            calls_fail,
            tries_again: false,
        }
    }

    fn who(&self, place: usize, trial: &str) -> ProcessStatus {
        let lease = Store::at("/store").folder(trial).join("lease");
        let renewed = fs::metadata(&lease).and_then(|data| data.modified()).ok();
        let renewed = renewed.and_then(|date| date.duration_since(UNIX_EPOCH).ok());
        ProcessStatus {
            place,
            pid: process::id(),
            host: self.hosts[place],
            now: disk_date(),
            renewed: renewed.unwrap_or_default(),
            has_lease: Store::at("/store").running(trial) == Some(Owner::this_process()),
        }
    }

    /// Runs the missing trials as one program; true if none is missing.
    fn run(&self, place: usize) -> bool {
        let store = Store::at("/store");
        self.ledger.holds(&store, &self.trials);
        self.attempt(place, &store).is_ok_and(|done| done)
    }

    fn attempt(&self, place: usize, store: &Store) -> Result<bool, Error> {
        let mut missing = Vec::new();
        for trial in &self.trials {
            match store.end(&trial.id) {
                Ok(end) => missing.extend(is_missing(end.as_ref()).then_some(trial)),
                Err(error @ Error::Damaged { .. }) => panic!("{error}"),
                Err(error) => return Err(error),
            }
        }
        let leases = Leases::open(store, EXPIRY)?;
        if missing.is_empty() {
            store.pack(&leases, SETTLES)?;
            return Ok(true);
        }
        let tasks: Vec<Task<'_>> = missing.into_iter().map(task).collect();
        self.work(place, &tasks, store, &leases)?;
        Ok(false)
    }

    /// Runs these tasks in one slot.
    fn work(&self, place: usize, tasks: &[Task<'_>], store: &Store, leases: &Leases) -> Result<(), Error> {
        let (queue, halt, workers) = (Queue::new(tasks, [one_core()]), AtomicBool::new(false), workers());
        let all = SlotContext {
            tasks,
            store,
            leases,
            shared_leases: None,
            workers: &workers,
            queue: &queue,
            halt: &halt,
        };
        let (events, _) = mpsc::channel();
        let runner = InThreadRunner {
            bench: self,
            place,
            leases,
        };
        Slot::new((0, 0), all, runner, &events).work()
    }
}

fn task(trial: &Trial) -> Task<'_> {
    Task {
        trial,
        cost: 5,
        pace_s: None,
        limits: Arc::new(Limits::default()),
        before: None,
        after: trial.key.taken().into_iter().map(|taken| taken.trial).collect(),
        until: None,
        needs: Needs::default(),
    }
}

fn one_core() -> Capacity {
    let gpus = Vec::new();
    Capacity { cores: 1, gpus }
}

fn workers() -> Workers {
    Workers {
        hosts: super::hosts::Hosts::default(),
        devices: Vec::new(),
        capacity: one_core(),
        idle: Arc::default(),
        stop: Arc::default(),
        fail_fast: false,
        wait_for_others: true,
        checkpoint_every: Duration::ZERO,
        heartbeat: HEARTBEAT,
        lease_expiry: EXPIRY,
    }
}

/// Runs trials in the process of the scheduler itself.
struct InThreadRunner<'a> {
    bench: &'a Bench,
    place: usize,
    leases: &'a Leases,
}

impl Runner for InThreadRunner<'_> {
    fn run(
        &mut self,
        request: Request,
        _: &Arc<Limits>,
        _: &mut dyn FnMut(u64, u64),
    ) -> Result<RequestOutcome, Error> {
        let (id, ledger) = (request.trial.id.clone(), &self.bench.ledger);
        ledger.begins(&id, quietly(|| self.bench.who(self.place, &id)), EXPIRY, lives);
        let mut replies = LeaseRenewer {
            runner: self,
            trial: id.clone(),
            last: quietly(clock::now),
        };
        let reply = worker::run(
            (&self.bench.registry, None),
            &request,
            &worker::Stops::default(),
            &mut replies,
        );
        // A result that cannot be read at this moment counts as incomplete.
        let broken = ledger.broken().filter(|_| !self.bench.calls_fail);
        assert_eq!(broken, None);
        match &reply {
            Reply::Ended { end } if self.bench.tries_again && end.state == EndState::Failed => {}
            Reply::Ended { end } => ledger.ends(&id, end),
            Reply::Paused => ledger.pauses(&id, request.until.unwrap_or_default()),
            _ => {}
        }
        ledger.leaves(&id, quietly(process::id));
        Ok(RequestOutcome::Said(reply))
    }

    fn dismiss(&mut self) {}
}

/// Renews the leases when there is progress, as the watching thread does in a real run.
struct LeaseRenewer<'a, 'b> {
    runner: &'a InThreadRunner<'b>,
    trial: String,
    last: Instant,
}

impl Write for LeaseRenewer<'_, '_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if clock::since(self.last) >= HEARTBEAT {
            let who = quietly(|| self.runner.bench.who(self.runner.place, &self.trial));
            if self.runner.leases.beat().is_ok() {
                self.runner.bench.ledger.hears(who);
                self.last = clock::now();
            }
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// The faults of a seed: only power losses, only process failures, or everything, on one machine or on three that share
/// a disk.
fn faults(seed: u64) -> (Faults, Vec<usize>) {
    let calls = 500 + seed % 1500;
    let quiet = Faults {
        calls,
        ..Faults::default()
    };
    let (power, kill) = (0.002, 0.004);
    let (one, three) = (vec![0, 0], vec![0, 1, 2]);
    match seed % 5 {
        0 => (Faults { power, ..quiet }, vec![0]),
        1 => (Faults { kill, power, ..quiet }, one),
        2 => {
            let halt = 0.002;
            (
                Faults {
                    kill,
                    halt,
                    clock: 0.01,
                    ..quiet
                },
                three,
            )
        }
        3 => {
            let (stale, host_power) = (Duration::from_secs(3), 0.002);
            (
                Faults {
                    kill,
                    host_power,
                    stale,
                    power,
                    ..quiet
                },
                three,
            )
        }
        _ => {
            let (fail, full, halt, clock) = (0.004, 0.002, 0.001, 0.01);
            (
                Faults {
                    kill,
                    power,
                    fail,
                    full,
                    halt,
                    clock,
                    ..quiet
                },
                one,
            )
        }
    }
}

/// Runs a seed of programs that share a store to its end.
fn simulate(seed: u64, prepare: impl FnOnce(&mut Machine)) -> (Machine, Result<(), String>) {
    let (faults, hosts) = faults(seed);
    let bench = Bench::new(&hosts, faults.fail > 0.0);
    let mut machine = Machine::new(seed, faults, &hosts);
    prepare(&mut machine);
    play(machine, |place| bench.run(place), || inspect(&bench))
}

/// Runs `run` at each place to its end, and inspects the store after a further loss of power.
fn play(
    machine: Machine,
    run: impl Fn(usize) -> bool + Sync,
    inspect: impl Fn() + Sync,
) -> (Machine, Result<(), String>) {
    let (mut machine, outcome) = start(machine, &run);
    if outcome.is_err() {
        return (machine, outcome);
    }
    machine.lose_power();
    machine.again();
    // A trial that was stored by a process which was killed before it could report it may be lost again, and is then
    // computed again.
    let (mut machine, outcome) = start(machine, &run);
    if outcome.is_err() {
        return (machine, outcome);
    }
    machine.again();
    let (machine, outcome) = start(machine, |_| {
        inspect();
        true
    });
    let outside = machine
        .files()
        .into_iter()
        .find(|path| !path.starts_with("/store"));
    let outcome =
        outcome.and_then(|()| outside.map_or(Ok(()), |path| Err(format!("{} was written", path.display()))));
    (machine, outcome)
}

/// Asserts that every trial was computed and is stored, and that every process that held a lease is gone.
fn inspect(bench: &Bench) {
    let store = Store::at("/store");
    bench.ledger.holds(&store, &bench.trials);
    // An owner on another machine counts as gone after a long silence.
    clock::sleep(Duration::from_secs(900));
    for trial in &bench.trials {
        let end = quietly(|| store.end(&trial.id));
        assert!(end.is_ok_and(|end| end.is_some()), "{} never ended", trial.id);
        let runs = quietly(|| store.running(&trial.id));
        assert_eq!(runs, None, "a lease of {} is left", trial.id);
    }
}

/// Number of seeds to run; `REGIMEN_SIM_SEEDS` replaces it.
fn seeds() -> u64 {
    let usual = if variable("CI").is_some() { 5_000 } else { 1_000 };
    variable("REGIMEN_SIM_SEEDS").map_or(usual, |text| text.parse().unwrap())
}

#[expect(
    clippy::disallowed_methods,
    reason = "whoever runs the tests says how thoroughly, and names a seed that failed"
)]
fn variable(name: &str) -> Option<String> {
    std::env::var(name).ok()
}

#[test]
fn what_was_promised_holds_whatever_happens() {
    if let Some(seed) = variable("REGIMEN_SIM_SEED") {
        let seed = seed.parse().unwrap();
        let (machine, outcome) = simulate(seed, |machine| machine.trace = Some(Vec::new()));
        let trace = machine.trace.unwrap_or_default().join("\n");
        assert!(outcome.is_ok(), "{trace}\n{outcome:?}");
        return;
    }
    let failed = (0..seeds()).into_par_iter().find_map_first(|seed| {
        let (_, outcome) = simulate(seed, |_| ());
        outcome.err().map(|why| format!("REGIMEN_SIM_SEED={seed}: {why}"))
    });
    assert_eq!(failed, None);
}

#[test]
fn a_seed_gives_the_same_again() {
    for seed in 0..10 {
        let trace = || simulate(seed, |machine| machine.trace = Some(Vec::new())).0.trace;
        assert!(trace() == trace(), "{seed}");
    }
}

/// Without any one of the flushes, some promise breaks: each of them is needed, and the simulation detects each
/// omission.
#[test]
fn without_any_one_flush_a_seed_fails() {
    let flushed: std::collections::BTreeSet<String> = (0..50)
        .into_par_iter()
        .flat_map_iter(|seed| simulate(seed, |_| ()).0.flushed)
        .collect();
    assert!(flushed.len() > 3, "{flushed:?}");
    for place in flushed {
        let fails = |seed: &u64| {
            let without = |machine: &mut Machine| machine.without_flush = Some(place.clone());
            simulate(*seed, without).1.is_err()
        };
        let found = (0..20_000_u64).into_par_iter().find_any(fails);
        assert!(found.is_some(), "nothing breaks without the flush at {place}");
    }
}
