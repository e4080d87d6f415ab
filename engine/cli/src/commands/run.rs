//! `run`, `worker`: compute what is missing, then show what is there; and what is known of a study's results.

use super::{
    BAD_SPEC, Common, Failure, INCOMPLETE, OK, ReportOptions, RunOptions, Selection, TRIALS_FAILED,
    WorkerOptions, complain,
    compute::Compute,
    confirmations, folders, hosts, looks, overview, pack,
    planned::{self, Planned},
    rehearse, reports, searches, settings, stages,
    submit::{self, Asked},
};
use analysis::{
    results::{Results, SearchResult},
    search::{Progress, Search},
};
use contract::{
    Error, ProductKind, Registry,
    drawing::Drawings,
    product::Taken,
    standard_metrics::names_times,
    trial::{Part, Trial},
    trial_result::TrialResult,
};
use execution::{
    executor::{self, Way},
    store::Store,
};
use report::StudyInfo;
use serde_json::Value;
use std::{
    collections::{BTreeMap, BTreeSet},
    io::IsTerminal as _,
    sync::Arc,
};
use study::Study;

/// `run`: the missing trials of all studies together, then a report of each.
pub(super) fn run(
    registry: &Registry,
    selection: &Selection,
    options: &RunOptions,
    reporting: &ReportOptions,
    common: &Common,
) -> Result<u8, Failure> {
    if options.dry_run {
        return planned::plan(registry, selection, common);
    }
    let settings = settings::read(common)?;
    let (store, workers) = (settings.open()?, options.jobs.unwrap_or(settings.workers));
    let mut planned = planned::load_with_looks(registry, selection, &store)?;
    folders::check(&planned, selection, reporting)?;
    planned::warn(&planned);
    options.consent.ask(registry, &planned, &store)?;
    let mut how = Compute {
        registry,
        asked: (selection, common),
        settings: &settings,
        limits: &options.limits,
        workers,
        hosts: Default::default(),
        retry_failed: options.retry_failed,
        whole: true,
    };
    let kind = place(&mut how, &planned, options)?;
    looks::fix(&planned, &store)?;
    // Programs start where the trials do.
    let is_here = kind.is_none() && how.hosts.all.is_empty();
    let candidates = match is_here && !options.no_rehearsal {
        true => rehearse::candidates(registry, &planned, &store),
        false => Vec::new(),
    };
    let computed = match compute_all(&mut how, kind.as_ref(), &mut planned, &store, options)? {
        Computed::Left(code) => return Ok(code),
        Computed::Here(code) => code,
    };
    // Who was stopped starts nothing more.
    if computed != INCOMPLETE {
        rehearse::compute_again(&how, &candidates, &store)?;
    }
    let mut code = OK;
    for study in confirmations::by_study(&planned) {
        code = code.max(reports::write(
            registry, study, &store, selection, reporting, common,
        )?);
    }
    overview::index(&planned, selection, reporting, common)?;
    if computed == OK && kind.is_none() {
        pack::at_end(&planned, &store, &settings)?;
    }
    Ok(if computed == OK { code } else { computed })
}

/// The queue that trials are handed to, where there is one; hosts are reached, and are then those of `how`.
fn place(
    how: &mut Compute<'_>,
    planned: &[Planned],
    options: &RunOptions,
) -> Result<Option<executor::Kind>, Failure> {
    let settings = how.settings;
    let mut kind = elsewhere(options.executor.as_deref().unwrap_or(&settings.executor));
    let on_hosts = kind.take_if(|kind| matches!(kind.way, Way::Hosts(_)));
    if kind.is_none() && options.detach {
        return Err(Failure {
            code: BAD_SPEC,
            text: "error: --detach needs --executor slurm or another that has a queue".into(),
        });
    }
    if let Some(kind) = &on_hosts {
        let executor = settings.executor(kind, options.jobs)?;
        if let Some(access) = executor.access() {
            hosts::reach(how, planned, access)?;
        }
    }
    Ok(kind)
}

/// The command that runs again what failed.
pub(super) fn again(selection: &Selection, common: &Common) -> String {
    selection.command("run", common, &["--retry-failed"])
}

/// What came of computing.
enum Computed {
    /// The exit code; a report follows.
    Here(u8),
    /// The command leaves with this code, and others go on.
    Left(u8),
}

/// Computes what is missing, look by look where looks are planned.
fn compute_all(
    how: &mut Compute<'_>,
    kind: Option<&executor::Kind>,
    planned: &mut [Planned],
    store: &Store,
    options: &RunOptions,
) -> Result<Computed, Failure> {
    let (selection, common) = how.asked;
    loop {
        let code = match kind {
            None => how.run(planned, |_| true)?,
            Some(kind) => {
                let how = &*how;
                let asked = Asked {
                    kind,
                    planned,
                    selection,
                    common,
                    how,
                };
                match submit::run(&asked, options)? {
                    Some(code) => return Ok(Computed::Left(code)),
                    None => OK,
                }
            }
        };
        if !goes_on(code, how) || !grow_all(planned, how.registry, store)? {
            let searched = searches::told(planned, &again(selection, common));
            return Ok(Computed::Here(code.max(searched)));
        }
        // What fails now is not tried again at every look.
        how.retry_failed = false;
    }
}

/// The executor of a name that starts workers on other machines.
fn elsewhere(name: &str) -> Option<executor::Kind> {
    executor::find(name).filter(|kind| kind.options().is_some())
}

/// Whether a further look may follow what was computed: what is missing now would be missing then too.
fn goes_on(computed: u8, how: &Compute<'_>) -> bool {
    computed != INCOMPLETE && !(computed == TRIALS_FAILED && how.limits.fail_fast)
}

/// Takes every study with searches or planned looks as far as its results ask for; true where trials were added.
fn grow_all(planned: &mut [Planned], registry: &Registry, store: &Store) -> Result<bool, Failure> {
    let mut grown = false;
    for one in &mut *planned {
        if searches::grow(one, registry, store)? {
            searches::lines(one)
                .iter()
                .for_each(|line| complain(&format!("{}:{line}", one.study.name)));
            grown = true;
        }
        if looks::grow(one, registry, store) {
            complain(&format!(
                "{}:{}",
                one.study.name,
                looks::line(one).unwrap_or_default()
            ));
            grown = true;
        }
    }
    confirmations::follow(planned, registry);
    Ok(grown)
}

/// `worker`: the missing trials, or every Nth of them, without a report.
pub(super) fn worker(registry: &Registry, options: &WorkerOptions, common: &Common) -> Result<u8, Failure> {
    let settings = settings::read(common)?;
    let selection = &options.selection;
    let (part, parts) = options.index.as_deref().map_or(Ok((0, 1)), parse_index)?;
    let store = settings.open()?;
    let mut planned = planned::load_with_looks(registry, selection, &store)?;
    options.consent.ask(registry, &planned, &store)?;
    let how = Compute {
        registry,
        asked: (selection, common),
        settings: &settings,
        limits: &options.limits,
        workers: options.jobs,
        hosts: Default::default(),
        retry_failed: false,
        whole: false,
    };
    looks::fix(&planned, &store)?;
    let mut code = OK;
    loop {
        // What failed at one look is not made good by the next.
        code = code.max(how.run(&planned, |position| position % parts == part)?);
        if !goes_on(code, &how) || !grow_all(&mut planned, registry, &store)? {
            return Ok(code.max(searches::told(&planned, &again(selection, common))));
        }
    }
}

fn parse_index(text: &str) -> Result<(usize, usize), Failure> {
    let wrong = || Failure {
        code: BAD_SPEC,
        text: format!("error: --index {text}: write I/N with I below N, as in 0/4"),
    };
    let (part, parts) = text.split_once('/').ok_or_else(wrong)?;
    let (part, parts) = (
        part.parse().map_err(|_| wrong())?,
        parts.parse().map_err(|_| wrong())?,
    );
    if part < parts {
        Ok((part, parts))
    } else {
        Err(wrong())
    }
}

pub(super) fn info(one: &Planned, registry: &Registry) -> StudyInfo {
    let study = &one.study;
    StudyInfo {
        name: study.name.clone(),
        title: study.title.clone(),
        source: study.source.clone(),
        family: study.family.clone(),
        summary: study.summary.clone(),
        answers: study.answers.clone(),
        departures: study.departures.clone(),
        repeats: study.repeats,
        tables: study.tables.clone(),
        figures: study.figures.clone(),
        claims: study.claims.clone(),
        confirm: study.confirm.clone(),
        agents: study.agents.clone(),
        environments: study.environments.clone(),
        is_rehearsal: study.profile.as_deref() == Some(report::REHEARSAL),
        floors: study.floors.clone(),
        relevance: study.relevance.clone(),
        better: study
            .metrics
            .iter()
            .map(|it| (it.name.clone(), it.better))
            .collect(),
        units: study.units.clone(),
        stages: stages::of(one),
        learners: learners(one, registry),
        defaults: defaults(one, registry),
        ..StudyInfo::default()
    }
}

/// The agents that learn.
fn learners(one: &Planned, registry: &Registry) -> BTreeSet<String> {
    let learns = |trial: &&Arc<Trial>| {
        let learns = |part: &Part| {
            let entry = registry.agents.get(part.plugin.as_str());
            entry.is_some_and(|entry| entry.learns_with(&part.config))
        };
        trial.key.agent.agent().is_some_and(learns)
    };
    one.plan
        .trials
        .iter()
        .filter(learns)
        .map(|trial| trial.cell.agent.clone())
        .collect()
}

/// Configs with every default of the plugins that trials use, by kind and name.
fn defaults(one: &Planned, registry: &Registry) -> BTreeMap<String, Value> {
    let mut defaults = BTreeMap::new();
    for key in one.plan.trials.iter().map(|trial| &trial.key) {
        let [environment, protocol] = [&key.environment, &key.protocol].map(|part| part.plugin.as_str());
        let abouts = [
            (
                "environment",
                environment,
                registry.environments.get(environment).map(|entry| &entry.about),
            ),
            (
                "protocol",
                protocol,
                registry.protocols.get(protocol).map(|entry| &entry.about),
            ),
        ];
        let agents = key.agent.parts().into_iter().map(|part| part.plugin.as_str());
        let agents = agents.map(|name| ("agent", name, registry.agents.get(name).map(|entry| &entry.about)));
        for (kind, name, about) in abouts.into_iter().chain(agents) {
            let Some(about) = about else { continue };
            defaults
                .entry(format!("{kind} {name}"))
                .or_insert_with(|| about.defaults.clone());
        }
    }
    defaults
}

/// Columns of the terminal, as the shell or the terminal tells; 100 elsewhere.
#[expect(
    clippy::disallowed_methods,
    reason = "it says how wide the summary is, and reaches no result"
)]
pub(super) fn terminal_width() -> usize {
    let told = std::env::var("COLUMNS").ok().and_then(|text| text.parse().ok());
    let asked = || {
        let size = std::io::stdout()
            .is_terminal()
            .then(ratatui::crossterm::terminal::size)?;
        size.ok().map(|(columns, _)| usize::from(columns))
    };
    told.or_else(asked).filter(|width| *width >= 40).unwrap_or(100)
}

/// Trials with what they recorded. One that cannot be read counts as missing, and `say` says why.
pub(super) fn load(trials: &[&Arc<Trial>], store: &Store, say: impl Fn(&Error)) -> Vec<TrialResult> {
    let (results, unreadable) = store.load_all(trials);
    unreadable.iter().for_each(|(_, error)| say(error));
    results
}

/// All trials of a study with what they recorded; `mend` is the command that mends what is damaged, where
/// that shall be said.
pub(super) fn collect(one: &Planned, store: &Store, mend: Option<&str>) -> Results {
    // In the order of the settings that searches try, some of which are set aside.
    let planned: Vec<&Arc<Trial>> = one.paused.iter().chain(&one.plan.trials).collect();
    let mut trials = load(&planned, store, |error| {
        let then = |mend| match error {
            Error::Damaged { .. } => format!(": `{mend}` sets it aside and runs it again"),
            _ => String::new(),
        };
        if let Some(then) = mend.map(then) {
            complain(&format!("warning: {error}; the trial counts as missing{then}"));
        }
    });
    for it in &mut trials {
        let Err(error) = store.read_partial(it) else {
            continue;
        };
        it.end = None;
        if let Some(mend) = mend {
            complain(&format!(
                "warning: {error}; the trial counts as missing: `{mend}` sets it aside and runs it again"
            ));
        }
    }
    if names_times_of(&one.study) {
        trials.iter_mut().for_each(TrialResult::add_times);
    }
    let drawings = match mend {
        Some(_) => drawings(one, store, &trials),
        // Who only looks at verdicts shows no figure.
        None => BTreeMap::new(),
    };
    Results {
        drawings,
        repeated: rehearse::answers(&trials, store),
        ..assembled(&one.study, trials)
    }
}

/// True where something of a study shows how long trials took.
pub(super) fn names_times_of(study: &Study) -> bool {
    names_times(&(&study.tables, &study.figures, &study.claims, &study.success))
}

/// The results of a study from those of its trials.
pub(super) fn assembled(study: &Study, mut trials: Vec<TrialResult>) -> Results {
    // Nobody here knows how long runs of others took.
    trials.extend(study.imported.iter().flat_map(|it| it.trials.iter().cloned()));
    if let Some(success) = &study.success {
        trials.iter_mut().for_each(|trial| trial.judge_success(success));
    }
    let of_search = |(search, progress): &(Search, Progress)| SearchResult::of(search, progress, &trials);
    let searches = study.searches.iter().map(of_search).collect();
    Results {
        searches,
        design: study.design.clone(),
        first_seed: study.first_seed(),
        success: study.success.clone(),
        paper_budget: study.paper_budget.clone(),
        imported: study.imported.iter().map(|it| it.origin.clone()).collect(),
        ..Results::of(trials)
    }
}

/// What trials left that figures of the study show, by id. What cannot be read is said, and the figure says it
/// too.
fn drawings(one: &Planned, store: &Store, trials: &[TrialResult]) -> BTreeMap<String, Drawings> {
    let figures = one.study.figures.iter();
    let kinds: BTreeSet<ProductKind> = figures.filter_map(|(_, spec)| spec.kind.shows()).collect();
    let mut all: BTreeMap<String, Drawings> = BTreeMap::new();
    // Runs of others left nothing here.
    let own = trials.iter().filter(|trial| !trial.is_imported());
    for trial in own.filter(|trial| trial.is_ok()) {
        for kind in &kinds {
            let (id, drawings) = (&trial.trial.id, all.entry(trial.trial.id.clone()).or_default());
            if let Err(error) = read_drawing(store, id, *kind, drawings) {
                complain(&format!("warning: {error}; it is not shown"));
                drawings.problem = Some(error.to_string());
            }
        }
    }
    all
}

fn read_drawing(store: &Store, id: &str, kind: ProductKind, drawings: &mut Drawings) -> Result<(), Error> {
    let taken = Taken {
        trial: id.to_owned(),
        kind,
    };
    let folder = store.product_if_left(&taken)?;
    folder.map_or(Ok(()), |folder| drawings.read(kind, &folder))
}
