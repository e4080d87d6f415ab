//! `run`, `worker`, `report`: compute what is missing, then show what is there.

use super::{
    BAD_SPEC, Common, DIFFERS, Failure, Format, INCOMPLETE, OK, ReportOptions, RunOptions, Selection, TRIALS_FAILED, complain,
    progress::Progress,
    provenance, say, settings,
    study::{self, Planned},
    submit::{self, Executor},
};
use crate::{
    Metric, Registry,
    report::{self, Contents, ReportPaths, StudyInfo},
    results::{EndState, Results},
    scheduler::{self, Workers},
    spec,
    store::{self, Store, write_durably},
    trial::Trial,
};
use serde_json::json;
use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
    sync::{Arc, atomic::AtomicBool, mpsc},
};

/// `run`: the missing trials of all studies together, then a report of each.
pub(super) fn run(
    registry: &Registry,
    selection: &Selection,
    options: &RunOptions,
    reporting: &ReportOptions,
    common: &Common,
) -> Result<u8, Failure> {
    if options.dry_run {
        return study::plan(registry, selection, common);
    }
    let settings = settings::read(common)?;
    let (store, workers) = (Store::at(&settings.store), options.jobs.unwrap_or(settings.workers).max(1));
    let planned = study::load(registry, selection)?;
    let computed = match options.executor.unwrap_or(settings.executor) {
        Executor::Local if options.detach => {
            return Err(Failure { code: BAD_SPEC, text: "error: --detach needs --executor slurm".into() });
        }
        Executor::Local => compute(&planned, &store, workers, options.retry_failed, |_| true)?,
        Executor::Slurm => match submit::run(&planned, selection, options, &settings, common)? {
            Some(code) => return Ok(code),
            None => OK,
        },
    };
    let mut code = OK;
    for one in &planned {
        code = code.max(write_report(registry, one, &store, selection, reporting, common)?);
    }
    Ok(if computed == INCOMPLETE { INCOMPLETE } else { code })
}

/// `worker`: the missing trials, or every Nth of them, without a report.
pub(super) fn worker(
    registry: &Registry,
    selection: &Selection,
    index: Option<&str>,
    jobs: usize,
    common: &Common,
) -> Result<u8, Failure> {
    let settings = settings::read(common)?;
    let (part, parts) = index.map_or(Ok((0, 1)), parse_index)?;
    let planned = study::load(registry, selection)?;
    compute(&planned, &Store::at(&settings.store), jobs.max(1), false, |position| position % parts == part)
}

fn parse_index(text: &str) -> Result<(usize, usize), Failure> {
    let wrong = || Failure { code: BAD_SPEC, text: format!("error: --index {text}: write I/N with I below N, as in 0/4") };
    let (part, parts) = text.split_once('/').ok_or_else(wrong)?;
    let (part, parts) = (part.parse().map_err(|_| wrong())?, parts.parse().map_err(|_| wrong())?);
    if part < parts { Ok((part, parts)) } else { Err(wrong()) }
}

/// `report`: tables, figures and the page from the store.
pub(super) fn report(
    registry: &Registry,
    selection: &Selection,
    reporting: &ReportOptions,
    common: &Common,
) -> Result<u8, Failure> {
    let store = Store::at(&settings::read(common)?.store);
    let mut code = OK;
    for one in &study::load(registry, selection)? {
        code = code.max(write_report(registry, one, &store, selection, reporting, common)?);
    }
    Ok(code)
}

/// Runs the trials that are missing (of those that `mine` picks by position); 106 where some still are.
fn compute(
    planned: &[Planned],
    store: &Store,
    workers: usize,
    retry_failed: bool,
    mine: impl Fn(usize) -> bool,
) -> Result<u8, Failure> {
    let (trials, costs) = missing(planned, store, retry_failed, mine);
    if trials.is_empty() {
        complain("every trial is in the store already; nothing runs");
        return Ok(OK);
    }
    complain(&format!("running {} trials on {} worker processes", trials.len(), workers.min(trials.len())));
    let stop = Arc::new(AtomicBool::new(false));
    listen_for_signals(&stop)?;
    let (events, received) = mpsc::channel();
    let mut progress = Progress::new(&trials, workers);
    let ran = std::thread::scope(|scope| {
        let workers = Workers { count: workers, stop: Arc::clone(&stop) };
        let (trials, costs) = (&trials, &costs);
        let running = scope.spawn(move || scheduler::run(trials, costs, store, &workers, &events));
        received.iter().for_each(|event| progress.show(&event));
        running.join()
    });
    match ran {
        Ok(outcome) => outcome?,
        Err(panic) => std::panic::resume_unwind(panic),
    }
    let failed = progress.failed();
    drop(progress);
    let left = trials.iter().zip(study::ends(store, &trials)).filter(|(_, end)| study::is_missing(end.as_ref())).count();
    if left > 0 {
        complain(&format!("{left} trials are still missing; the same command goes on"));
        return Ok(INCOMPLETE);
    }
    Ok(if failed > 0 { TRIALS_FAILED } else { OK })
}

/// The trials to run, each once though several studies share it, and their costs in steps.
pub(super) fn missing(
    planned: &[Planned],
    store: &Store,
    retry_failed: bool,
    mine: impl Fn(usize) -> bool,
) -> (Vec<Trial>, Vec<u64>) {
    let (mut seen, mut trials, mut costs) = (BTreeSet::new(), Vec::new(), Vec::new());
    for one in planned {
        let ends = study::ends(store, &one.plan.trials);
        for (position, ((trial, cost), end)) in one.plan.trials.iter().zip(&one.costs).zip(&ends).enumerate() {
            let retry = retry_failed && end.as_ref().is_some_and(|end| end.state != EndState::Ok);
            if mine(position) && (retry || study::is_missing(end.as_ref())) && seen.insert(trial.id.clone()) {
                trials.push(trial.clone());
                costs.push(*cost);
            }
        }
    }
    (trials, costs)
}

/// The first Ctrl-C (or SIGTERM) stops the run in order, the second one at once.
pub(super) fn listen_for_signals(stop: &Arc<AtomicBool>) -> Result<(), Failure> {
    use signal_hook::{consts::SIGINT, consts::SIGTERM, flag};
    let listen = || -> std::io::Result<()> {
        for signal in [SIGINT, SIGTERM] {
            flag::register_conditional_shutdown(signal, 128 + signal, Arc::clone(stop))?;
            flag::register(signal, Arc::clone(stop))?;
        }
        Ok(())
    };
    listen().map_err(|error| Failure { code: INCOMPLETE, text: format!("error: cannot listen for signals: {error}") })
}

fn write_report(
    registry: &Registry,
    one: &Planned,
    store: &Store,
    selection: &Selection,
    reporting: &ReportOptions,
    common: &Common,
) -> Result<u8, Failure> {
    let (results, dir, study) = (collect(one, store), folder(one, selection, reporting), info(one, registry));
    let contents = Contents::of(&study, &results);
    let paths = report::write(&dir, &study, &results, &contents, &provenance::of(registry, &one.study))?;
    write_durably(&dir.join("resolved.yaml"), spec::resolved_yaml(&one.study, &dir).as_bytes())?;
    store::write_results(&dir.join("evaluations.parquet"), &results)?;
    if common.format == Format::Json {
        say(&as_json(&study, &contents, &paths).to_string());
    } else {
        say(&report::summary(&study, &contents, &paths.page, terminal_width()));
    }
    let ends: Vec<_> = results.trials.iter().map(|result| result.end.clone()).collect();
    let code = study::code_of(&ends);
    Ok(if code == OK && reporting.strict && contents.contradicts() { DIFFERS } else { code })
}

fn info(one: &Planned, registry: &Registry) -> StudyInfo {
    let study = &one.study;
    StudyInfo {
        name: study.name.clone(),
        title: study.title.clone(),
        source: study.source.clone(),
        departures: study.departures.clone(),
        tables: study.tables.clone(),
        figures: study.figures.clone(),
        claims: study.claims.iter().map(|claim| (claim.claim.clone(), claim.environment.clone())).collect(),
        agents: study.agents.clone(),
        environments: study.environments.clone(),
        units: units(one, registry),
    }
}

/// Units of everything that the trials record, by metric or trace channel. What cannot be built here was refused by the check.
fn units(one: &Planned, registry: &Registry) -> BTreeMap<String, String> {
    let mut units = BTreeMap::new();
    let mut built = BTreeSet::new();
    for trial in &one.plan.trials {
        let key = &trial.key;
        if !built.insert((&trial.environment, &trial.agent)) {
            continue;
        }
        let mut note = |metrics: &[Metric]| units.extend(metrics.iter().map(|metric| (metric.name.clone(), metric.unit.clone())));
        if let Some(entry) = registry.agents.get(key.agent.plugin.as_str()) {
            note(&entry.metrics);
        }
        if let Some(Ok(protocol)) =
            registry.protocols.get(key.protocol.plugin.as_str()).map(|entry| (entry.build)(&key.protocol.config))
        {
            note(&protocol.metrics());
        }
        let entry = registry.environments.get(key.environment.plugin.as_str());
        if let Some(Ok(environment)) = entry.map(|entry| (entry.build)(&key.environment.config)) {
            note(environment.metrics());
            units.extend(environment.trace_channels().into_iter().map(|channel| (channel.name, channel.unit)));
        }
    }
    units
}

fn as_json(study: &StudyInfo, contents: &Contents, paths: &ReportPaths) -> serde_json::Value {
    let counts = |pairs: &[(&'static str, usize)]| pairs.iter().map(|(word, count)| ((*word).to_owned(), json!(count))).collect();
    let verdicts: serde_json::Map<String, serde_json::Value> = counts(&contents.verdicts());
    let claims: serde_json::Map<String, serde_json::Value> = counts(&contents.outcomes());
    json!({"study": study.name, "published": verdicts, "claims": claims, "page": paths.page, "files": paths.files})
}

/// Columns of the terminal, as the shell tells; 100 elsewhere.
fn terminal_width() -> usize {
    std::env::var("COLUMNS").ok().and_then(|text| text.parse().ok()).filter(|width| *width >= 40).unwrap_or(100)
}

fn folder(one: &Planned, selection: &Selection, reporting: &ReportOptions) -> PathBuf {
    if let Some(dir) = &reporting.out {
        return dir.clone();
    }
    let name = match &selection.profile {
        Some(profile) => format!("{}-{profile}", one.study.name),
        None => one.study.name.clone(),
    };
    Path::new("results").join(name)
}

fn collect(one: &Planned, store: &Store) -> Results {
    let trials = one.plan.trials.iter().map(|trial| {
        store.load(trial).unwrap_or_else(|error| {
            complain(&format!("warning: {error}; the trial counts as missing"));
            crate::results::TrialResult { trial: trial.clone(), end: None, names: Vec::new(), rows: Vec::new() }
        })
    });
    Results { trials: trials.collect() }
}
