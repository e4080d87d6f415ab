//! The same with a batch system in between: two programs submit tasks and wait, and the tasks are workers on machines
//! of their own. The batch system keeps its jobs, whatever happens to the others; it may be busy, and may take a job
//! without answering. Two more properties hold:
//!
//! 1. No task lives without a record of its job in the store.
//! 2. Together, the waiting programs submit no more tasks than trials are missing, unless one of them sees an
//!    outdated list of records or was halted between its check and its submission.
//!
//! `REGIMEN_SIM_BATCH=<seed>` runs one seed alone.

use super::{Bench, faults, inspect, play, seeds, variable};
use crate::{
    executor::{Dispatch, Error, Queue, Stop, Submission, Task, WaitEnd, Watch, Work},
    store::Store,
    world::{
        clock, fs, process,
        simulated::{Machine, lives, quietly},
    },
};
use contract::trial_end::is_missing;
use rayon::prelude::*;
use serde_json::{Value, json};
use std::{
    collections::BTreeSet,
    num::NonZeroUsize,
    path::Path,
    sync::{Mutex, MutexGuard, PoisonError},
    time::Duration,
};

/// The machines of the two programs that wait, and of two workers.
const HOSTS: [usize; 4] = [0, 1, 2, 3];
const WAITING: usize = 2;

/// A batch system without faults of its own.
#[derive(Default)]
struct Batch {
    jobs: Mutex<Vec<Job>>,
    /// Largest number of living tasks; `None` if more are allowed.
    most: Option<usize>,
}

struct Job {
    name: String,
    tasks: Vec<TaskState>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum TaskState {
    Waits,
    /// Running in the process with this id.
    Runs(u32),
    Over,
}

impl TaskState {
    /// Whether the task is still alive; a task that its machine lost is over.
    fn is_alive(self) -> bool {
        match self {
            TaskState::Waits => true,
            TaskState::Runs(pid) => lives(pid),
            TaskState::Over => false,
        }
    }
}

impl Batch {
    fn lock(&self) -> MutexGuard<'_, Vec<Job>> {
        self.jobs.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes the script of an array.
    fn accept(&self, script: &str) -> String {
        let (name, tasks) = script.split_once(' ').unwrap();
        let mut jobs = self.lock();
        jobs.push(Job {
            name: name.into(),
            tasks: vec![TaskState::Waits; tasks.parse().unwrap()],
        });
        let alive = jobs
            .iter()
            .flat_map(|job| &job.tasks)
            .filter(|task| task.is_alive());
        let alive = alive.count();
        assert!(self.most.is_none_or(|most| alive <= most), "{alive} tasks live");
        jobs.len().to_string()
    }

    /// Takes a waiting task for this process, and returns the places of its job and of the task.
    fn begin(&self) -> Option<(usize, usize)> {
        let me = process::id();
        let mut jobs = self.lock();
        for (place, job) in jobs.iter_mut().enumerate() {
            if let Some(task) = job.tasks.iter().position(|task| *task == TaskState::Waits) {
                job.tasks[task] = TaskState::Runs(me);
                return Some((place, task));
            }
        }
        None
    }

    /// Names of the jobs with a living task.
    fn alive(&self) -> BTreeSet<String> {
        let jobs = self.lock();
        let alive = jobs
            .iter()
            .filter(|job| job.tasks.iter().any(|task| task.is_alive()));
        alive.map(|job| job.name.clone()).collect()
    }
}

impl Queue for Batch {
    fn name(&self) -> &'static str {
        "simulated"
    }

    fn options(&self) -> Value {
        json!({})
    }

    fn largest_array(&self, _: &Stop) -> Result<usize, Error> {
        Ok(3)
    }

    fn patience(&self) -> Duration {
        Duration::from_secs(300)
    }

    fn max_tasks(&self) -> usize {
        16
    }

    fn poll_s(&self) -> f64 {
        5.0
    }

    fn resubmissions(&self) -> usize {
        20
    }

    fn script(&self, submission: &Submission, array: usize) -> String {
        format!("{} {}", submission.job_name(), submission.arrays[array].tasks)
    }

    fn script_ending(&self) -> &'static str {
        "txt"
    }

    fn tasks(&self, submissions: &[Submission], _: &Stop) -> Result<Vec<Task>, Error> {
        if process::random_number().is_multiple_of(20) {
            return Err(busy());
        }
        let names: Vec<String> = submissions.iter().map(Submission::job_name).collect();
        let jobs = self.lock();
        let named = jobs
            .iter()
            .enumerate()
            .filter(|(_, job)| names.contains(&job.name));
        let task = |(place, job): (usize, &Job), state: &TaskState| Task {
            name: job.name.clone(),
            job: (place + 1).to_string(),
            state: format!("{state:?}"),
            alive: state.is_alive(),
            waits_for: None,
        };
        Ok(named
            .flat_map(|job| job.1.tasks.iter().map(move |state| task(job, state)))
            .collect())
    }

    fn submit(&self, script: &Path, _: &Stop) -> Result<String, Error> {
        let script = fs::read_to_string(script).map_err(contract::Error::file("read", script))?;
        match process::random_number() % 10 {
            0 => Err(busy()),
            1 => {
                self.accept(&script);
                let (program, after_s) = ("batch", 60.0);
                Err(Error::Silent { program, after_s })
            }
            _ => Ok(self.accept(&script)),
        }
    }

    fn cancel(&self, name: &str, waiting_only: bool, _: &Stop) -> Result<(), Error> {
        for task in self
            .lock()
            .iter_mut()
            .filter(|job| job.name == name)
            .flat_map(|job| &mut job.tasks)
        {
            if !waiting_only || *task == TaskState::Waits {
                *task = TaskState::Over;
            }
        }
        Ok(())
    }
}

fn busy() -> Error {
    let (program, said) = ("batch", "busy".into());
    Error::Busy { program, said }
}

/// State that all processes of one seed share.
struct Site {
    bench: Bench,
    batch: Batch,
}

impl Site {
    fn new(seed: u64) -> (Self, Machine) {
        let (faults, _) = faults(seed);
        let bench = Bench::new(&HOSTS, faults.fail > 0.0);
        let sees_what_is = faults.stale == Duration::ZERO && faults.halt == 0.0;
        let most = sees_what_is.then_some(bench.trials.len());
        let batch = Batch {
            most,
            ..Batch::default()
        };
        (Self { bench, batch }, Machine::new(seed, faults, &HOSTS))
    }

    fn run(&self, place: usize) -> bool {
        self.bench.ledger.holds(&Store::at("/store"), &self.bench.trials);
        self.has_records();
        if place < WAITING {
            self.wait()
        } else {
            self.serve(place)
        }
    }

    /// Asserts that every job with a living task in the queue has its record in the store.
    fn has_records(&self) {
        for name in self.batch.alive() {
            let id = name.trim_start_matches("regimen-");
            let record = Path::new("/store/submissions").join(id).join("submission.json");
            let text = quietly(|| fs::read(&record));
            assert!(
                text.is_ok_and(|text| serde_json::from_slice::<Submission>(&text).is_ok()),
                "{name} has no record"
            );
        }
    }

    /// Runs a program that submits the missing trials and waits; true if it saw the end.
    fn wait(&self) -> bool {
        let ids = self.bench.trials.iter().map(|trial| trial.id.clone());
        let work = Work {
            specs: vec!["study.yaml".into()],
            program: "regimen".into(),
            arguments: vec!["worker".into()],
            folder: "/".into(),
        };
        let registry = contract::Registry::default();
        let dispatch = Dispatch {
            registry: &registry,
            store: "/store".into(),
            work,
            queue: &self.batch,
            trials_per_task: NonZeroUsize::MIN,
            trials: ids.collect(),
            stop: Stop::default(),
        };
        let mut watch = WaitingProgram { bench: &self.bench };
        let missing = watch.missing();
        if missing.is_empty() {
            return true;
        }
        let begun = dispatch.begin(&missing, &mut watch);
        let followed = begun.and_then(|view| dispatch.follow(view, &mut watch));
        matches!(followed, Ok(WaitEnd::Ended))
    }

    /// Runs one task after the other on a machine until no trial is missing.
    fn serve(&self, place: usize) -> bool {
        let store = Store::at("/store");
        while !(WaitingProgram { bench: &self.bench }).missing().is_empty() {
            let Some((job, task)) = self.batch.begin() else {
                clock::sleep(Duration::from_secs(5));
                continue;
            };
            // A worker that fails is a task that is over; the waiting program submits another one.
            let _ = self.bench.attempt(place, &store);
            self.batch.lock()[job].tasks[task] = TaskState::Over;
        }
        true
    }
}

struct WaitingProgram<'a> {
    bench: &'a Bench,
}

impl Watch for WaitingProgram<'_> {
    fn missing(&mut self) -> BTreeSet<String> {
        let store = Store::at("/store");
        let ids = self.bench.trials.iter().map(|trial| &trial.id);
        // A trial that cannot be read at this moment counts as missing.
        ids.filter(|id| store.end(id).map_or(true, |end| is_missing(end.as_ref())))
            .cloned()
            .collect()
    }

    fn saved(&mut self) -> u64 {
        0
    }

    fn queue(&mut self, _: &[Task]) {}

    fn say(&mut self, _: &str) {}
}

fn simulate(seed: u64, prepare: impl FnOnce(&mut Machine)) -> (Machine, Result<(), String>) {
    let (site, mut machine) = Site::new(seed);
    prepare(&mut machine);
    play(machine, |place| site.run(place), || inspect(&site.bench))
}

#[test]
fn what_was_handed_over_is_computed_whatever_happens() {
    if let Some(seed) = variable("REGIMEN_SIM_BATCH") {
        let (machine, outcome) = simulate(seed.parse().unwrap(), |machine| machine.trace = Some(Vec::new()));
        let trace = machine.trace.unwrap_or_default().join("\n");
        assert!(outcome.is_ok(), "{trace}\n{outcome:?}");
        return;
    }
    // Waiting programs check again and again, so a seed takes about ten times as long as without them.
    let failed = (0..seeds() / 10).into_par_iter().find_map_first(|seed| {
        let (_, outcome) = simulate(seed, |_| ());
        outcome
            .err()
            .map(|why| format!("REGIMEN_SIM_BATCH={seed}: {why}"))
    });
    assert_eq!(failed, None);
}
