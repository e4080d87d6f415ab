//! Tests whether programs give the same values again. `check --rehearse` starts each program of a study twice, with the
//! same seed and for a short time. `run` computes one trial of each program a second time, up to its first measurement,
//! for the report.

use crate::{
    Failure, Planned, Session,
    compute::Compute,
    programs::{self, Program},
};
use contract::{
    Error, Registry,
    metrics_file::MetricsTable,
    repeats::{Recorded, Repeats},
    trial::Trial,
    trial_end::EndState,
};
use execution::{limits::Limits, scheduler::Task, store::Store};
use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
};

/// A line for a program; an error if the program did not reach its first measurement.
pub type Rehearsed = Result<String, String>;

impl Session<'_> {
    /// The programs that [`rehearse`](Self::rehearse) starts.
    ///
    /// # Errors
    /// A program that cannot be built.
    pub fn programs_to_rehearse(&self, planned: &[Planned]) -> Result<BTreeSet<Program>, Failure> {
        let trials = planned.iter().flat_map(|one| first_of_each(self.registry, one));
        let trials = trials.map(|(trial, _)| &**trial);
        programs::of_trials(self.registry, trials, self.selection.specs.first())
    }

    /// Starts each program of the studies twice, for at most `longest_s` seconds each, and reports whether both gave
    /// the same values.
    ///
    /// # Errors
    /// Programs that do not fit the machine, and stores that cannot be written.
    pub fn rehearse(&self, planned: &[Planned], longest_s: f64) -> Result<Vec<Rehearsed>, Failure> {
        let how = Compute::of(self, self.settings.workers);
        let mut all = Vec::new();
        for one in planned {
            let limits = Arc::new(Limits {
                wall_time_s: Some(longest_s),
                retries: Some(0),
                ..how.limits_of(&one.study.limits)
            });
            all.extend(rehearsed(&how, one, &limits)?);
        }
        Ok(all)
    }
}

/// The first trial of each program in each environment, with its cost.
fn first_of_each<'a>(registry: &Registry, one: &'a Planned) -> Vec<(&'a Arc<Trial>, u64)> {
    let mut known = BTreeSet::new();
    let trials = one.plan.trials.iter().zip(one.costs.iter().copied());
    trials
        .filter(|(trial, _)| is_program(registry, trial))
        .filter(|(trial, _)| known.insert((trial.cell.environment.clone(), trial.cell.agent.clone())))
        .collect()
}

/// A line for each program of a study; an error for each that did not reach its first measurement.
fn rehearsed(
    how: &Compute<'_>,
    one: &Planned,
    limits: &Arc<Limits>,
) -> Result<Vec<Result<String, String>>, Failure> {
    let trials = first_of_each(how.session.registry, one);
    let tasks: Vec<Task<'_>> = trials
        .iter()
        .map(|(trial, cost)| task(how, trial, *cost, limits))
        .collect();
    if tasks.is_empty() {
        return Ok(Vec::new());
    }
    how.refuse_unfit(&tasks)?;
    let folders = [temporary()?, temporary()?];
    let stores = [&folders[0], &folders[1]].map(|folder| Store::at(folder.path()));
    for store in &stores {
        how.work(&tasks, store)?;
    }
    let line = |(trial, _): &(&Arc<Trial>, u64)| {
        let name = format!("`{}` in `{}`", trial.cell.agent, trial.cell.environment);
        let repeats = match (recorded(trial, &stores[0])?, recorded(trial, &stores[1])?) {
            (Ok(first), Ok(second)) => compared(&first, &second, trial),
            (Err(problem), _) | (_, Err(problem)) => {
                return Ok(Err(format!("  {name} was not rehearsed: {problem}")));
            }
        };
        Ok(Ok(format!("  {name} {}", repeats.in_words())))
    };
    trials.iter().map(line).collect()
}

fn is_program(registry: &Registry, trial: &Trial) -> bool {
    let agent = trial.key.agent.agent();
    agent.is_some_and(|part| registry.program(part).is_some())
}

/// The missing trials of one program in one environment, before any of them was computed twice; one of them will be.
pub(crate) struct Candidates {
    trials: Vec<Arc<Trial>>,
    /// The limits of their study.
    limits: Limits,
}

/// The candidates of each program in each environment. `run` is about to start these programs, so consent was given.
pub(crate) fn candidates(registry: &Registry, planned: &[Planned], store: &Store) -> Vec<Candidates> {
    let known = store.repeats();
    let mut programs: BTreeMap<(&str, &str, &str), Candidates> = BTreeMap::new();
    let mut answered = BTreeSet::new();
    for one in planned {
        for trial in one.plan.trials.iter().filter(|trial| is_program(registry, trial)) {
            let key = (&*one.study.name, &*trial.cell.environment, &*trial.cell.agent);
            if known.contains_key(&trial.id) {
                answered.insert(key);
            }
            if !matches!(store.end(&trial.id), Ok(Some(_))) {
                let none = || Candidates {
                    trials: Vec::new(),
                    limits: one.study.limits.clone(),
                };
                programs
                    .entry(key)
                    .or_insert_with(none)
                    .trials
                    .push(Arc::clone(trial));
            }
        }
    }
    programs.retain(|key, _| !answered.contains(key));
    programs.into_values().collect()
}

/// Computes one trial of each program again, beside the store, up to its first measurement, and stores whether the
/// values were equal.
pub(crate) fn compute_again(
    how: &Compute<'_>,
    candidates: &[Candidates],
    store: &Store,
) -> Result<(), Failure> {
    let ended_well = |trial: &&Arc<Trial>| {
        let end = store.end(&trial.id).ok().flatten();
        end.is_some_and(|end| end.state == EndState::Ok)
    };
    let mut quick = Vec::new();
    for of in candidates {
        let Some(trial) = of.trials.iter().find(ended_well) else {
            continue;
        };
        match reason_against(trial) {
            Some(reason) => store.keep_repeats(&trial.id, &Repeats::Unknown(reason.into())),
            None => quick.push((trial, Arc::new(limits_again(how, of)))),
        }
    }
    if quick.is_empty() {
        return Ok(());
    }
    let folder = temporary()?;
    let beside = Store::at(folder.path());
    let tasks: Vec<Task<'_>> = quick
        .iter()
        .map(|(trial, limits)| task(how, trial, 0, limits))
        .collect();
    let ran = how.work_quietly(&tasks, &beside)?;
    for (trial, _) in quick {
        let repeats = match (recorded(trial, store)?, recorded(trial, &beside)?) {
            (Ok(first), Ok(second)) => compared(&first, &second, trial),
            _ if ran.stopped => continue,
            (Err(problem), _) | (_, Err(problem)) => Repeats::Unknown(problem),
        };
        store.keep_repeats(&trial.id, &repeats);
    }
    Ok(())
}

/// Maximum time of an automatic second computation of a program, in seconds.
const AGAIN_S: f64 = 60.0;

/// The reason why a trial is not computed again.
fn reason_against(trial: &Trial) -> Option<&'static str> {
    if !trial.key.sources().is_empty() {
        return Some("it takes from other trials");
    }
    first_measurement(trial)
        .is_none()
        .then_some("nothing is measured before its end")
}

/// The limits of the second computation: those of the first, with at most a minute of time.
fn limits_again(how: &Compute<'_>, of: &Candidates) -> Limits {
    let limits = how.limits_of(&of.limits);
    Limits {
        wall_time_s: Some(limits.wall_time_s.map_or(AGAIN_S, |limit| limit.min(AGAIN_S))),
        retries: Some(0),
        ..limits
    }
}

/// A trial of a program as a task, up to its first measurement.
fn task<'a>(how: &Compute<'_>, trial: &'a Arc<Trial>, cost: u64, limits: &Arc<Limits>) -> Task<'a> {
    Task {
        trial,
        cost,
        pace_s: None,
        limits: Arc::clone(limits),
        before: None,
        after: trial.key.sources(),
        until: first_measurement(trial),
        needs: how.session.registry.needs(trial.key.agent.agent()),
    }
}

fn temporary() -> Result<tempfile::TempDir, Failure> {
    let made = tempfile::Builder::new().prefix("regimen-rehearsal-").tempdir();
    Ok(made.map_err(Error::file("create a folder in", &std::env::temp_dir()))?)
}

/// The step of the first measurement; `None` if the only measurement is the last one.
fn first_measurement(trial: &Trial) -> Option<u64> {
    let config = &trial.key.protocol.config;
    let every = config["evaluate_every"].as_u64().filter(|every| *every > 0)?;
    config["steps"]
        .as_u64()
        .is_none_or(|steps| every < steps)
        .then_some(every)
}

/// The comparison of two records of a trial. A quick program may end before it is stopped at its first measurement.
fn compared(one: &MetricsTable, other: &MetricsTable, trial: &Trial) -> Repeats {
    let [one, other] = [one, other].map(|it| Recorded {
        names: &it.names,
        rows: &it.rows,
    });
    Repeats::of(one, other, first_measurement(trial))
}

/// The record of a trial, or the reason why there is none.
fn recorded(trial: &Arc<Trial>, store: &Store) -> Result<Result<MetricsTable, String>, Failure> {
    // A record before a number that is not finite is none of a program that works.
    let partial = store.partial(&trial.id)?;
    if let Some(partial) = partial.filter(|it| it.file.end.state == EndState::Paused) {
        return Ok(Ok(partial.table));
    }
    let result = store.load(trial)?;
    Ok(match result.end.as_deref() {
        Some(end) if end.state == EndState::Ok => Ok(MetricsTable {
            names: result.names.to_vec(),
            rows: result.rows,
        }),
        Some(end) if end.state == EndState::Timeout => Err(format!(
            "{}; `check --rehearse` with `--rehearse-for` gives it longer, and a smaller `evaluate_every` measures \
             earlier",
            end.reason
        )),
        Some(end) => Err(format!("it ended as {}: {}", end.state.name(), end.reason)),
        None => Err("it was stopped".into()),
    })
}
