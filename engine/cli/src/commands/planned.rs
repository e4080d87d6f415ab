//! `check`, `plan`, `status`, `resolve`: what is known of studies without running anything.

use super::{
    BAD_SPEC, Common, Failure, Format, INCOMPLETE, NOTHING_SELECTED, OK, Selection, TRIALS_FAILED, UNCHECKED,
    absent, complain,
    confirmations::{self, Confirms},
    consent, cost,
    fitting::Machines,
    looks,
    prepare::failed_in_words,
    running::{running, tried_again},
    say, searches, settings, stages, submit,
    waiting::Waiting,
};
use analysis::{claim, results::SearchResult};
use contract::{
    Registry,
    complete_config::CompleteConfig,
    trial::{Trial, TrialKey},
    trial_end::{EndState, TrialEnd},
};
use document::{
    count::{count, either},
    diagnostic::{self, Diagnostic, Severity},
};
use execution::store::{Announcements, Found, Store};
use presentation::claim_spec::ClaimSpec;
use serde_json::json;
use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
    sync::Arc,
};
use study::{
    Study,
    plan::{self, Estimate, Novelty, Plan, Wanted},
};

/// Stored trials among which the nearest to a missing one is looked for.
const MOST_STORED: usize = 500_000;

/// A study that passed its checks, and its trials.
pub(super) struct Planned {
    /// Its file.
    pub(super) path: PathBuf,
    /// The study.
    pub(super) study: Study,
    /// Its trials, narrowed by `--only`.
    pub(super) plan: Plan,
    /// Steps of every trial, for progress and estimates.
    pub(super) costs: Vec<u64>,
    /// The combinations that have come to a later look.
    pub(super) wanted: Wanted,
    /// How many judged values and claims are open; `None` where that was not looked at.
    pub(super) open: Option<usize>,
    /// Steps at which searches pause trials, by id.
    pub(super) pauses: BTreeMap<String, u64>,
    /// Trials of searches that have come to their pause; none of them is missing.
    pub(super) paused: Vec<Arc<Trial>>,
    set_aside: BTreeSet<String>,
    /// The confirmation that it is; `None` for a study that stands for itself.
    pub(super) confirms: Option<Confirms>,
    /// What the searches came to.
    pub(super) searched: Vec<SearchResult>,
    /// What it was read with.
    pub(super) options: study::Options,
    pub(super) only: Vec<String>,
}

impl Planned {
    /// A study that is not planned yet.
    pub(super) fn of(path: &Path, study: Study, options: study::Options, only: &[String]) -> Self {
        Self {
            path: path.to_owned(),
            plan: Plan {
                study: study.name.clone(),
                title: study.title.clone(),
                trials: Vec::new(),
            },
            study,
            costs: Vec::new(),
            wanted: Wanted::new(),
            open: None,
            pauses: BTreeMap::new(),
            paused: Vec::new(),
            set_aside: BTreeSet::new(),
            confirms: None,
            searched: Vec::new(),
            options,
            only: only.to_vec(),
        }
    }

    /// Plans the study anew, with other numbers of seeds.
    pub(super) fn replan(&mut self, registry: &Registry, wanted: Wanted) {
        self.plan = self.study.plan_with(&wanted);
        self.wanted = wanted;
        if let Some(confirms) = &self.confirms {
            self.plan
                .keep(|trial| confirms.cells.contains(&trial.cell.names()));
        }
        narrow(&mut self.plan, &self.only);
        self.pauses = self.study.pauses(&self.plan);
        let has_paused = |trial: &mut Arc<Trial>| {
            self.set_aside.contains(&trial.id) && self.pauses.contains_key(&trial.id)
        };
        self.paused = self.plan.trials.extract_if(.., has_paused).collect();
        self.costs = costs(registry, &self.plan);
    }

    /// Takes trials that have come to their pause out of the plan.
    pub(super) fn set_aside(&mut self, registry: &Registry, paused: BTreeSet<String>) {
        if paused != self.set_aside {
            self.set_aside = paused;
            let wanted = std::mem::take(&mut self.wanted);
            self.replan(registry, wanted);
        }
    }
}

/// A study that cannot be planned: its file, and everything that is wrong.
type Refused<'a> = (&'a Path, Vec<Diagnostic>);

/// Loads and plans all selected studies; every problem of every file is in the failure.
pub(super) fn load(
    registry: &Registry,
    selection: &Selection,
    announced: Option<&Announcements>,
) -> Result<Vec<Planned>, Failure> {
    let (planned, refused) = read(registry, selection, announced);
    no_error(&refused)?;
    selects_something(&planned, selection)?;
    Ok(confirmations::planned(planned, registry))
}

/// The studies that can be planned, and the others.
fn read<'a>(
    registry: &Registry,
    selection: &'a Selection,
    announced: Option<&Announcements>,
) -> (Vec<Planned>, Vec<Refused<'a>>) {
    let (mut planned, mut refused) = (Vec::new(), Vec::new());
    for path in &selection.specs {
        match load_one(registry, path, selection, options(selection, announced)) {
            Ok(one) => planned.push(one),
            Err(problems) => refused.push((path.as_path(), problems)),
        }
    }
    (planned, refused)
}

/// Fails with everything that is wrong with studies.
fn no_error(refused: &[Refused<'_>]) -> Result<(), Failure> {
    let problems = refused.iter();
    let problems: Vec<String> = problems
        .map(|(_, problems)| diagnostic::render_first(problems))
        .collect();
    if problems.is_empty() {
        return Ok(());
    }
    Err(Failure {
        code: BAD_SPEC,
        text: problems.join("\n"),
    })
}

/// Fails where no trial is selected, or what no study has.
fn selects_something(planned: &[Planned], selection: &Selection) -> Result<(), Failure> {
    if let Some(text) = absent::unknown_names(planned, &selection.only) {
        return Err(Failure {
            code: NOTHING_SELECTED,
            text,
        });
    }
    // A search has no trials before it is asked for its first settings.
    if planned
        .iter()
        .all(|one| one.plan.trials.is_empty() && one.study.searches.is_empty())
    {
        return Err(nothing_selected());
    }
    Ok(())
}

fn nothing_selected() -> Failure {
    Failure {
        code: NOTHING_SELECTED,
        text: "no trial matches what was selected".into(),
    }
}

/// Loads and plans one study.
pub(super) fn load_one(
    registry: &Registry,
    path: &Path,
    selection: &Selection,
    options: study::Options,
) -> Result<Planned, Vec<Diagnostic>> {
    let study = study::load(path, registry, &options)?;
    let mut planned = Planned::of(path, study, options, &selection.only);
    planned.replan(registry, Wanted::new());
    if planned
        .options
        .announced
        .as_ref()
        .is_some_and(Announcements::has_store)
    {
        keep_announced(&planned);
    }
    Ok(planned)
}

/// Keeps the trials of some environments and agents, with those that they take from; all where none is named.
fn narrow(plan: &mut Plan, only: &[String]) {
    if only.is_empty() {
        return;
    }
    let named = |name: &String| only.contains(name);
    let by_environment = plan.trials.iter().any(|trial| named(&trial.cell.environment));
    let by_agent = plan.trials.iter().any(|trial| named(&trial.cell.agent));
    plan.keep(|trial| {
        let known = by_environment || by_agent;
        known
            && (!by_environment || named(&trial.cell.environment))
            && (!by_agent || named(&trial.cell.agent))
    });
}

/// Loads and plans all selected studies, those with planned looks as far as the stored results ask for.
pub(super) fn load_with_looks(
    registry: &Registry,
    selection: &Selection,
    store: &Store,
) -> Result<Vec<Planned>, Failure> {
    let mut planned = load(registry, selection, Some(&Announcements::of(store.root())))?;
    absent::say_if_new(store.root());
    for one in &mut planned {
        grow(one, registry, store)?;
    }
    confirmations::follow(&mut planned, registry);
    Ok(planned)
}

/// Takes a study as far as the stored results ask for, and those that other machines share.
fn grow(one: &mut Planned, registry: &Registry, store: &Store) -> Result<(), Failure> {
    let mut said = BTreeSet::new();
    loop {
        let planned = one.plan.trials.len();
        let fetched = store.fetch(one.plan.trials.iter().map(|trial| trial.id.as_str()))?;
        for damage in fetched.damaged {
            let text = format!("warning: {damage}; its trial counts as missing, and `run` computes it again");
            if said.insert(damage) {
                complain(&text);
            }
        }
        searches::grow(one, registry, store)?;
        looks::grow(one, registry, store);
        // Without anything new there is nothing that could ask for more.
        if fetched.taken == 0 && one.plan.trials.len() == planned || store.bucket().is_none() {
            return Ok(());
        }
    }
}

/// Says what can be run and is probably not meant.
pub(super) fn warn(planned: &[Planned]) {
    planned.iter().for_each(|one| warn_of(&one.study));
}

fn warn_of(study: &Study) {
    if !study.warnings.is_empty() {
        complain(&diagnostic::render_first(&study.warnings));
    }
}

/// The options with which the studies of a selection are read.
pub(super) fn options(selection: &Selection, announced: Option<&Announcements>) -> study::Options {
    study::Options {
        profile: selection.profile.clone(),
        sets: selection.sets.clone(),
        seeds: selection.seeds,
        announced: announced.cloned(),
        ..study::Options::default()
    }
}

/// Steps of every trial; neighbours in a plan mostly share their protocol, so that few protocols are built.
pub(super) fn costs(registry: &Registry, plan: &Plan) -> Vec<u64> {
    let mut known: Option<(&CompleteConfig, u64)> = None;
    let mut costs = Vec::with_capacity(plan.trials.len());
    for trial in &plan.trials {
        let config = &trial.key.protocol.config;
        let steps = match known {
            Some((same, steps)) if same.is_same(config) => steps,
            _ => total_steps(registry, &trial.key).unwrap_or(0),
        };
        known = Some((config, steps));
        costs.push(steps);
    }
    costs
}

/// `None` for a protocol that this program does not know.
pub(super) fn total_steps(registry: &Registry, key: &TrialKey) -> Option<u64> {
    let entry = registry.protocols.get(key.protocol.plugin.as_str())?;
    let protocol = (entry.build)(&key.protocol.config).ok()?;
    Some(protocol.total_steps())
}

/// `check`: one line per good study, and one per study that this machine cannot check.
pub(super) fn check(registry: &Registry, selection: &Selection, common: &Common) -> Result<u8, Failure> {
    if common.format == Format::Json {
        return check_as_json(registry, selection);
    }
    let announced = doubted(common);
    let (checked, refused) = examined(registry, selection, announced.as_ref())?;
    let unavailable = |(_, problems): &Refused<'_>| diagnostic::are_unavailable(problems);
    let (unchecked, refused): (Vec<_>, Vec<_>) = refused.into_iter().partition(unavailable);
    unchecked.iter().for_each(say_unchecked);
    no_error(&refused)?;
    let is_empty = |(trials, study): &Checked| *trials == 0 && study.searches.is_empty();
    if unchecked.is_empty() && checked.iter().all(is_empty) {
        return Err(nothing_selected());
    }
    checked.iter().for_each(|(_, study)| warn_of(study));
    let machines = Machines::of(&settings::read(common)?)?;
    for (trials, study) in checked {
        let agents = study.built_agents();
        if let Some(machines) = &machines {
            machines.refuse_unfit(registry, agents.iter().map(|it| &**it))?;
        }
        say(&format!(
            "{}: ok, {}, {}, {}, {}{}",
            study.name,
            count(trials, "trial"),
            count(study.tables.len(), "table"),
            count(study.figures.len(), "figure"),
            count(study.claims.len(), "claim"),
            any_difference(&study)
        ));
        for program in consent::shown(registry, agents.iter().map(|it| &**it)) {
            say(&format!("  `run` starts `{program}`"));
        }
    }
    Ok(if unchecked.is_empty() { OK } else { UNCHECKED })
}

/// That any difference decides some claims, for which the study names nothing that matters.
fn any_difference(study: &Study) -> String {
    let lacks = |spec: &&ClaimSpec| {
        let is_direction = claim::parse(&spec.claim).is_ok_and(|claim| claim.relation.is_direction());
        is_direction && spec.matters.is_none()
    };
    match study.claims.iter().filter(lacks).count() {
        n if n == 0 || study.relevance.is_some() => String::new(),
        n => format!(" ({n} decided by any difference: `relevance` says which one matters)"),
    }
}

/// A study that holds, with the number of its trials that are selected.
type Checked = (usize, Study);

/// The studies that hold, and the others. Of whole studies the trials are only counted; what is selected of them
/// has to be planned.
fn examined<'a>(
    registry: &Registry,
    selection: &'a Selection,
    announced: Option<&Announcements>,
) -> Result<(Vec<Checked>, Vec<Refused<'a>>), Failure> {
    if !selection.only.is_empty() {
        let (planned, refused) = read(registry, selection, announced);
        if refused.is_empty() {
            selects_something(&planned, selection)?;
        }
        let checked = planned.into_iter().map(|one| (one.plan.trials.len(), one.study));
        return Ok((checked.collect(), refused));
    }
    let (mut checked, mut refused) = (Vec::new(), Vec::new());
    for path in &selection.specs {
        match study::load(path, registry, &options(selection, announced)) {
            Ok(study) => checked.push((study.n_trials(), study)),
            Err(problems) => refused.push((path.as_path(), problems)),
        }
    }
    Ok((checked, refused))
}

/// Says of a study what this machine lacks, in one line.
fn say_unchecked((path, problems): &Refused<'_>) {
    let lacking = problems.iter().filter(|it| it.severity == Severity::Unavailable);
    // The first line says it; what Python said of it follows.
    let lacking: BTreeSet<&str> = lacking.filter_map(|it| it.message.lines().next()).collect();
    let lacking = lacking.into_iter().collect::<Vec<_>>().join("; ");
    complain(&format!("{}: not checked: {lacking}", path.display()));
}

fn check_as_json(registry: &Registry, selection: &Selection) -> Result<u8, Failure> {
    let mut code = OK;
    let mut reports = Vec::new();
    for path in &selection.specs {
        let problems = study::load(path, registry, &options(selection, None)).map_or_else(
            |errors| {
                let is_unchecked = diagnostic::are_unavailable(&errors) && code != BAD_SPEC;
                code = if is_unchecked { UNCHECKED } else { BAD_SPEC };
                errors
            },
            |study| study.warnings,
        );
        reports.push(json!({"spec": path, "problems": diagnostic::to_json(&problems)}));
    }
    say(&serde_json::Value::Array(reports).to_string());
    // What was selected is held against all studies together.
    if code == OK && !selection.only.is_empty() {
        load(registry, selection, None)?;
    }
    Ok(code)
}

fn keep_announced(one: &Planned) {
    if let Some(records) = &one.options.announced {
        one.study
            .announced
            .iter()
            .for_each(|(id, announced)| records.keep(id, announced));
    }
}

/// Where it is kept what environments announce to `check`, which believes no record.
fn doubted(common: &Common) -> Option<Announcements> {
    let settings = settings::read(common).ok()?;
    Some(Announcements::of(&settings.store).doubted())
}

/// Tries out the environments of a study of which only their records are known, before its trials run, and keeps what
/// all of them announced.
pub(super) fn try_out(registry: &Registry, one: &Planned) -> Result<(), Failure> {
    if !one.study.is_recalled {
        keep_announced(one);
        return Ok(());
    }
    let options = study::Options {
        announced: one.options.announced.clone().map(Announcements::doubted),
        ..one.options.clone()
    };
    let tried = study::load(&one.path, registry, &options);
    tried.map(drop).map_err(|problems| Failure {
        code: BAD_SPEC,
        text: diagnostic::render_first(&problems),
    })
}

/// The state of every trial; `None` where it has not run or must run again. What is damaged is said.
pub(super) fn ends(store: &Store, trials: &[Arc<Trial>]) -> Vec<Option<TrialEnd>> {
    told(store.outcomes(trials)).0
}

/// What was found, once it is said what is damaged and counts as missing, and whether something is.
fn told<T>(found: Found<T>) -> (Vec<Option<T>>, bool) {
    for (_, error) in &found.unreadable {
        complain(&format!("warning: {error}; the trial counts as missing"));
    }
    (found.all, !found.unreadable.is_empty())
}

/// As [`ends`], and what mends it is said.
fn ends_with_advice(
    store: &Store,
    trials: &[Arc<Trial>],
    selection: &Selection,
    common: &Common,
) -> Vec<Option<TrialEnd>> {
    let (ends, damaged) = told(store.outcomes(trials));
    if damaged {
        complain(&format!(
            "`{}` sets aside what is damaged and runs it again",
            selection.command("run", common, &[])
        ));
    }
    ends
}

/// `plan`: trials by cell, what is done, why the rest is not, and what it will cost.
pub(super) fn plan(registry: &Registry, selection: &Selection, common: &Common) -> Result<u8, Failure> {
    let settings = settings::read(common)?;
    let store = settings.open()?;
    let planned = load_with_looks(registry, selection, &store)?;
    warn(&planned);
    for mut one in planned {
        one.plan.keep_once();
        let trials = &one.plan.trials;
        let ends = ends_with_advice(&store, trials, selection, common);
        let known = known(trials, &ends);
        // Where every trial is there, nothing else of the store is looked at.
        let cells = if known.len() < trials.len() {
            store.cells(&known, MOST_STORED)
        } else {
            Vec::new()
        };
        let novelties = plan::novelties(trials, &ends, &cells);
        let waiting = Waiting::of(trials, &ends, &store);
        let estimate = cost::estimate(registry, &one, &ends, &waiting, &cells);
        say(&overview(
            &one,
            &ends,
            Some(&novelties),
            (settings.workers, &waiting, estimate),
            common.format,
        ));
        say_waiting(&waiting, common);
        say_failed(trials, &ends, selection, common);
    }
    Ok(OK)
}

/// `status`: end states by cell, reasons of failures; 106 where trials are missing, 100 where some failed.
pub(super) fn status(registry: &Registry, selection: &Selection, common: &Common) -> Result<u8, Failure> {
    let settings = settings::read(common)?;
    let store = settings.open()?;
    let mut code = OK;
    for mut one in load_with_looks(registry, selection, &store)? {
        one.plan.keep_once();
        let ends = ends_with_advice(&store, &one.plan.trials, selection, common);
        let waiting = Waiting::of(&one.plan.trials, &ends, &store);
        let cells = store.cells(&known(&one.plan.trials, &ends), 0);
        let estimate = cost::estimate(registry, &one, &ends, &waiting, &cells);
        say(&overview(
            &one,
            &ends,
            None,
            (settings.workers, &waiting, estimate),
            common.format,
        ));
        if common.format == Format::Text {
            let trials = &one.plan.trials;
            let texts = [
                running(&store, trials, &ends),
                tried_again(&store, trials, &ends),
                failures(trials, &ends),
            ];
            texts
                .iter()
                .filter(|text| !text.is_empty())
                .for_each(|text| say(text));
            say_waiting(&waiting, common);
            say_failed(trials, &ends, selection, common);
        }
        let states = ends.iter().map(|end| Some(end.as_ref()?.state));
        code = code.max(code_of(states)).max(searches::code(&one));
    }
    submit::show(&settings.store, common.format);
    Ok(code)
}

/// The trials that have ended, and how.
fn known<'a>(trials: &'a [Arc<Trial>], ends: &'a [Option<TrialEnd>]) -> Vec<(&'a Trial, &'a TrialEnd)> {
    let known = trials.iter().zip(ends);
    known
        .filter_map(|(trial, end)| Some((&**trial, end.as_ref()?)))
        .collect()
}

fn say_waiting(waiting: &Waiting, common: &Common) {
    let lines = waiting.lines();
    if common.format == Format::Text && !lines.is_empty() {
        say(&lines.join("\n"));
    }
}

/// What runs again the trials that did not end well.
fn say_failed(trials: &[Arc<Trial>], ends: &[Option<TrialEnd>], selection: &Selection, common: &Common) {
    let again = selection.command("run", common, &["--retry-failed"]);
    let ends = trials
        .iter()
        .zip(ends)
        .map(|(trial, end)| (trial.id.as_str(), end.as_ref()));
    if let Some(words) = failed_in_words(ends, &again).filter(|_| common.format == Format::Text) {
        say(&format!("  {words}"));
    }
}

/// Says what becomes of a study's imported runs, where it has some.
pub(super) fn say_imported(one: &Planned, what: &str) {
    for it in &one.study.imported {
        complain(&format!(
            "{}: {} of `{}` {} imported and {what}",
            one.study.name,
            count(it.trials.len(), "run"),
            it.origin.name,
            either(&it.trials.len(), "is", "are")
        ));
    }
}

/// The exit code that fits the states of trials; `None` for one that has not run.
pub(super) fn code_of(states: impl IntoIterator<Item = Option<EndState>>) -> u8 {
    let code = |state: Option<EndState>| match state {
        Some(EndState::Ok) => OK,
        None | Some(EndState::Killed | EndState::Paused) => INCOMPLETE,
        Some(_) => TRIALS_FAILED,
    };
    states.into_iter().map(code).max().unwrap_or(OK)
}

/// `resolve`: the study with every default.
pub(super) fn resolve(registry: &Registry, selection: &Selection) -> Result<u8, Failure> {
    let planned = load(registry, selection, None)?;
    for (one, _) in confirmations::by_study(&planned) {
        say(&study::resolved_yaml(&one.study, Path::new(""))?);
    }
    Ok(OK)
}

/// Trials of one environment, agent and setting.
#[derive(Default)]
struct Cell {
    ok: usize,
    failed: usize,
    missing: usize,
    /// Missing ones that do not run by themselves.
    blocked: usize,
}

/// Names of environment, agent and setting.
type Names<'a> = (&'a str, &'a str, &'a str);

fn cells<'a>(one: &'a Planned, ends: &[Option<TrialEnd>], waiting: &Waiting) -> Vec<(Names<'a>, Cell)> {
    let (mut cells, mut places): (Vec<(Names<'a>, Cell)>, BTreeMap<Names<'a>, usize>) =
        (Vec::new(), BTreeMap::new());
    for (index, (trial, end)) in one.plan.trials.iter().zip(ends).enumerate() {
        let names = (
            trial.cell.environment.as_str(),
            trial.cell.agent.as_str(),
            trial.cell.setting.as_str(),
        );
        // The trials of a cell stand side by side in a plan, except for those of later looks.
        let place = *places.entry(names).or_insert(cells.len());
        if place == cells.len() {
            cells.push((names, Cell::default()));
        }
        if waiting.is_blocked(index) {
            cells[place].1.blocked += 1;
        } else {
            cells[place].1.add(end.as_ref());
        }
    }
    cells
}

impl Cell {
    fn add(&mut self, end: Option<&TrialEnd>) {
        match end {
            Some(end) if end.state == EndState::Ok => self.ok += 1,
            Some(end) if end.state != EndState::Killed => self.failed += 1,
            _ => self.missing += 1,
        }
    }
}

fn overview(
    one: &Planned,
    ends: &[Option<TrialEnd>],
    novelties: Option<&[Novelty]>,
    (workers, waiting, estimate): (usize, &Waiting, Estimate),
    format: Format,
) -> String {
    let cells = cells(one, ends, waiting);
    if format == Format::Json {
        let mut overview = as_json(one, &cells, novelties);
        overview["waiting"] = waiting.to_json();
        overview["estimate"] = json!(estimate);
        return overview.to_string();
    }
    let mut lines = vec![format!(
        "{}: {}",
        one.study.name,
        count(one.plan.trials.len(), "trial")
    )];
    lines.extend(one.study.repeats.map(|repeats| format!("  {repeats}")));
    lines.extend(rows(&cells));
    lines.extend(looks::line(one));
    lines.extend(searches::lines(one));
    lines.extend(stages::lines(one));
    let why = novelties.map(plan::explain).filter(|text| !text.is_empty());
    lines.extend(why);
    let sum = |of: fn(&Cell) -> usize| cells.iter().map(|(_, cell)| of(cell)).sum();
    let (blocked, failed) = (sum(|cell| cell.blocked), sum(|cell| cell.failed));
    lines.push(cost::line(&estimate, blocked, failed, workers));
    lines.join("\n")
}

/// A line for each cell under one that says what they are; settings and blocked trials only where there are any.
fn rows(cells: &[(Names<'_>, Cell)]) -> Vec<String> {
    let width = |of: fn(&Names<'_>) -> usize, least: usize| {
        cells.iter().map(|(key, _)| of(key)).max().unwrap_or(0).max(least)
    };
    let (first, second, third) = (
        width(|key| key.0.len(), 11),
        width(|key| key.1.len(), 5),
        width(|key| key.2.len(), 0),
    );
    let is_blocked = cells.iter().any(|(_, cell)| cell.blocked > 0);
    let row = |(environment, agent, setting): Names<'_>, [ok, failed, missing, blocked]: [&str; 4]| {
        let setting = match third {
            0 => String::new(),
            _ => format!("{setting:<width$}  ", width = third.max("setting".len())),
        };
        let blocked = if is_blocked {
            format!(" {blocked:>7}")
        } else {
            String::new()
        };
        format!(
            "  {environment:<first$}  {agent:<second$}  {setting}{ok:>6} {failed:>6} {missing:>7}{blocked}"
        )
    };
    let head = row(
        ("environment", "agent", "setting"),
        ["ok", "failed", "missing", "blocked"],
    );
    let of_cell = |(names, cell): &(Names<'_>, Cell)| {
        let counts = [cell.ok, cell.failed, cell.missing, cell.blocked].map(|count| count.to_string());
        row(*names, counts.each_ref().map(String::as_str))
    };
    std::iter::once(head).chain(cells.iter().map(of_cell)).collect()
}

fn as_json(one: &Planned, cells: &[(Names<'_>, Cell)], novelties: Option<&[Novelty]>) -> serde_json::Value {
    let row = |((environment, agent, setting), cell): &(Names<'_>, Cell)| {
        json!({"environment": environment,
        "agent": agent, "setting": setting, "ok": cell.ok, "failed": cell.failed, "missing": cell.missing,
        "blocked": cell.blocked})
    };
    let rows: Vec<_> = cells.iter().map(row).collect();
    let stages: Vec<_> = stages::of(one).iter().map(|stage| json!(stage)).collect();
    let mut overview =
        json!({"study": one.study.name, "trials": one.plan.trials.len(), "cells": rows, "stages": stages});
    if let Some(novelties) = novelties {
        overview["why"] = plan::to_json(novelties);
    }
    overview
}

fn failures(trials: &[Arc<Trial>], ends: &[Option<TrialEnd>]) -> String {
    let failed = trials
        .iter()
        .zip(ends)
        .filter_map(|(trial, end)| Some((trial, end.as_ref().filter(|end| end.state != EndState::Ok)?)));
    let lines =
        failed.map(|(trial, end)| format!("  {:<8} {}: {}", end.state.name(), trial.title(), end.reason));
    lines.collect::<Vec<_>>().join("\n")
}
