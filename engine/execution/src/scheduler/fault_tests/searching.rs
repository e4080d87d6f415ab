//! The same with a search that pauses its trials. Programs on one or several machines advance it as far as the stored
//! trials allow, run the trials that it asks for, and try failed ones again if the failure was not their own. One more
//! property holds: each program reaches the choice of a single program without faults.
//!
//! `REGIMEN_SIM_SEARCH=<seed>` runs one seed alone.

use super::{Bench, EXPIRY, SETTLES, faults, play, seeds, task, variable};
use crate::{
    scheduler::Task,
    store::{Claim, Leases, Store},
    world::{
        clock,
        simulated::{Faults, Machine, quietly},
    },
};
use analysis::{
    results::SearchResult,
    search::{Direction, Failed, Halving, Method, Next, Numbers, Progress, Range, Search},
};
use contract::{
    Error,
    part::Part,
    sweep_point::SweepPoint,
    trial::{Purpose, Trial},
    trial_end::{EndState, is_missing},
    trial_result::TrialResult,
};
use rayon::prelude::*;
use serde_json::{Value, json};
use std::{
    sync::{Arc, Mutex, OnceLock, PoisonError},
    time::Duration,
};

/// The chosen setting, and the step at which each setting pauses.
type Choice = (Option<usize>, Vec<Option<u64>>);

/// State that all processes of one seed share.
struct Site {
    bench: Bench,
    search: Search,
    /// Choices of the processes that came to an end.
    chosen: Mutex<Vec<Choice>>,
}

fn search() -> Search {
    let numbers = Numbers {
        low: 0.1,
        high: 0.9,
        log: false,
        integer: false,
    };
    Search {
        name: "rates".into(),
        environment: "throw".into(),
        agent: "tally".into(),
        plugin: "tally".into(),
        keys: vec![("tally.rate".into(), Range::Numbers(numbers))],
        metric: "return".into(),
        direction: Direction::Maximize,
        settings: 5,
        seeds: vec![0],
        method: Method::Halving(Halving {
            pauses: vec![2, 4],
            keep: 0.5,
            brackets: 1,
        }),
        failed: Failed::Wait,
    }
}

/// The trial of a setting.
fn tried(search: &Search, point: &[Value]) -> Trial {
    let mut trial = super::trial(
        json!({ "fails": false, "leaves_nothing": true, "rate": point[0], "falls": true }),
        None,
        0,
    );
    let steps = json!({ "steps": 6, "environments": 1, "evaluate_every": 2, "episodes": 1, "final_episodes": 1,
        "trace_episodes": 0 });
    trial.key.protocol = Part::new("train_evaluate", 1, steps).into();
    trial.id = trial.key.id();
    let cell = trial.cell_mut();
    cell.point = SweepPoint::from_iter([("tally.rate", point[0].clone())]);
    cell.purpose = Purpose::Tried(search.name.clone());
    trial
}

impl Site {
    fn new(hosts: &[usize], calls_fail: bool) -> Self {
        let search = search();
        let Next::Try(points, _) = search.next(&[]) else {
            unreachable!("nothing is known")
        };
        let bench = Bench {
            trials: points.iter().map(|point| tried(&search, point)).collect(),
            tries_again: true,
            ..Bench::new(hosts, calls_fail)
        };
        Self {
            bench,
            search,
            chosen: Mutex::default(),
        }
    }

    /// Progress of the search according to the stored trials.
    fn grown(&self, store: &Store) -> Result<Progress, Error> {
        let mut results = Vec::new();
        for trial in &self.bench.trials {
            let mut result: TrialResult = store.load(&Arc::new(trial.clone()))?;
            store.read_partial(&mut result)?;
            results.push(result);
        }
        let mut progress = Progress::default();
        loop {
            let known = SearchResult::of(&self.search, &progress, &results).known();
            let (stops, chosen) = match self.search.next(&known) {
                Next::Try(_, stops) => (stops, None),
                Next::Chosen(chosen, stops) => (stops, chosen),
            };
            let points = self.bench.trials.iter();
            let next = Progress {
                points: points
                    .map(|it| it.cell.point.values().into_iter().cloned().collect())
                    .collect(),
                stops,
                parents: Vec::new(),
                chosen,
            };
            if next == progress {
                return Ok(progress);
            }
            progress = next;
        }
    }

    /// Runs the trials that the search asks for; true if it has chosen.
    fn run(&self, place: usize) -> bool {
        let store = Store::at("/store");
        self.bench.ledger.holds(&store, &self.bench.trials);
        match self.attempt(place, &store) {
            Err(error @ Error::Damaged { .. }) if !self.bench.calls_fail => panic!("{error}"),
            outcome => outcome.is_ok_and(|done| done),
        }
    }

    fn attempt(&self, place: usize, store: &Store) -> Result<bool, Error> {
        let progress = self.grown(store)?;
        let leases = Leases::open(store, EXPIRY)?;
        let mut tasks: Vec<Task<'_>> = Vec::new();
        let mut waits = false;
        for (trial, stop) in self.bench.trials.iter().zip(&progress.stops) {
            let end = store.end(&trial.id)?;
            if end.as_ref().is_some_and(|end| end.state == EndState::Failed) {
                waits = true;
                self.try_again(&trial.id, store, &leases)?;
            } else if is_missing(end.as_ref()) && !has_paused(store, &trial.id, *stop) {
                tasks.push(Task {
                    until: *stop,
                    ..task(trial)
                });
            }
        }
        if tasks.is_empty() && !waits && progress.chosen.is_some() {
            let mut chosen = self.chosen.lock().unwrap_or_else(PoisonError::into_inner);
            chosen.push((progress.chosen, progress.stops));
            drop(chosen);
            store.pack(&leases, SETTLES)?;
            return Ok(true);
        }
        self.bench.work(place, &tasks, store, &leases)?;
        Ok(false)
    }

    /// Tries a failed trial again, like the command that runs failed trials again.
    fn try_again(&self, id: &str, store: &Store, leases: &Leases) -> Result<(), Error> {
        if leases.claim(id)? != Claim::Mine {
            return Ok(());
        }
        let failed = store
            .end(id)
            .map(|end| end.is_some_and(|end| end.state == EndState::Failed));
        let marked = match failed {
            Ok(true) => {
                self.bench.ledger.begins_anew(id);
                store.try_again(id)
            }
            Ok(false) => Ok(()),
            Err(error) => Err(error),
        };
        leases.release(id)?;
        marked
    }

    /// Asserts that the stored trials alone determine the choice, and that no lease is held.
    fn inspect(&self) {
        let store = Store::at("/store");
        self.bench.ledger.holds(&store, &self.bench.trials);
        clock::sleep(Duration::from_secs(900));
        let progress = quietly(|| self.grown(&store)).unwrap();
        for (trial, stop) in self.bench.trials.iter().zip(&progress.stops) {
            let is_there = quietly(|| match stop {
                Some(stop) => {
                    has_paused(&store, &trial.id, Some(*stop)) || store.end(&trial.id).unwrap().is_some()
                }
                None => store.end(&trial.id).unwrap().is_some(),
            });
            assert!(is_there, "{} is not as far as {stop:?}", trial.id);
            assert_eq!(quietly(|| store.running(&trial.id)), None, "a lease is left");
        }
        let mut chosen = self.chosen.lock().unwrap_or_else(PoisonError::into_inner);
        chosen.push((progress.chosen, progress.stops));
    }
}

fn has_paused(store: &Store, id: &str, stop: Option<u64>) -> bool {
    stop.is_some_and(|stop| store.measured_until(id).is_some_and(|step| step >= stop))
}

/// Runs a seed to its end and returns the choices.
fn simulate(
    faults: Faults,
    seed: u64,
    hosts: &[usize],
    traced: bool,
) -> (Machine, Result<Vec<Choice>, String>) {
    let site = Site::new(hosts, faults.fail > 0.0);
    let mut machine = Machine::new(seed, faults, hosts);
    machine.trace = traced.then(Vec::new);
    let (machine, outcome) = play(machine, |place| site.run(place), || site.inspect());
    let chosen = site.chosen.into_inner().unwrap_or_else(PoisonError::into_inner);
    (machine, outcome.map(|()| chosen))
}

/// The choice if nothing fails except the trials themselves.
fn expected() -> &'static Choice {
    static EXPECTED: OnceLock<Choice> = OnceLock::new();
    EXPECTED.get_or_init(|| {
        let chosen = simulate(Faults::default(), 0, &[0], false).1.unwrap();
        let (place, stops) = &chosen[0];
        assert!(place.is_some_and(|place| stops[place].is_none()));
        assert!(stops.contains(&Some(2)) && stops.contains(&Some(4)), "{stops:?}");
        chosen[0].clone()
    })
}

fn outcome(seed: u64, traced: bool) -> (Machine, Option<String>) {
    let (faults, hosts) = faults(seed);
    let (machine, chosen) = simulate(faults, seed, &hosts, traced);
    let wrong = match chosen {
        Err(why) => Some(why),
        Ok(chosen) => {
            let other = chosen.iter().find(|choice| *choice != expected());
            other.map(|choice| format!("{choice:?} was chosen in the place of {:?}", expected()))
        }
    };
    (machine, wrong)
}

#[test]
fn a_search_that_pauses_its_trials_chooses_the_same_whatever_happens() {
    if let Some(seed) = variable("REGIMEN_SIM_SEARCH") {
        let (machine, wrong) = outcome(seed.parse().unwrap(), true);
        let trace = machine.trace.unwrap_or_default().join("\n");
        assert!(wrong.is_none(), "{trace}\n{wrong:?}");
        return;
    }
    let failed = (0..seeds() / 2).into_par_iter().find_map_first(|seed| {
        let wrong = outcome(seed, false).1;
        wrong.map(|why| format!("REGIMEN_SIM_SEARCH={seed}: {why}"))
    });
    assert_eq!(failed, None);
}
