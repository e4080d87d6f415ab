//! The results of a study, and the facts about it that a report shows.

use crate::{Planned, Session, stages};
use analysis::{
    results::{RepeatCheck, Results, SearchResult},
    search::{Progress, Search},
};
use contract::{
    ArtifactKind, Error, Registry, artifact::Taken, drawing::Drawings, part::Part,
    standard_metrics::names_times, trial::Trial, trial_result::TrialResult,
};
use execution::store::Store;
use report::StudyInfo;
use serde_json::Value;
use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
};
use study::Study;

impl Session<'_> {
    /// The results of a study from the store. Damaged trials are reported and count as missing.
    ///
    /// # Errors
    /// A store that cannot be opened.
    pub fn collect(&self, one: &Planned) -> Result<Results, crate::Failure> {
        let store = self.store()?;
        let mend = self.command("run", &[]);
        let is_missing = |error: &Error| {
            let then = match error {
                Error::Damaged { .. } => format!(": `{mend}` sets it aside and runs it again"),
                _ => String::new(),
            };
            self.notice(&format!("warning: {error}; the trial counts as missing{then}"));
        };
        let trials = load(one, store, is_missing);
        Ok(Results {
            drawings: drawings(self, one, store, &trials),
            ..of_trials(one, store, trials)
        })
    }
}

/// The same without messages, for verdicts alone; it leaves out the drawings of figures.
pub(crate) fn judged(one: &Planned, store: &Store) -> Results {
    of_trials(one, store, load(one, store, |_| {}))
}

/// All trials of a study with their records. Unreadable trials count as missing, and `say` receives the reason.
fn load(one: &Planned, store: &Store, say: impl Fn(&Error)) -> Vec<TrialResult> {
    // Trials follow the order of the settings that searches try, including paused ones.
    let planned: Vec<&Arc<Trial>> = one.paused.iter().chain(&one.plan.trials).collect();
    load_some(&one.study, &planned, store, say)
}

fn load_some(
    study: &Study,
    planned: &[&Arc<Trial>],
    store: &Store,
    say: impl Fn(&Error),
) -> Vec<TrialResult> {
    let (mut trials, unreadable) = store.load_all(planned);
    unreadable.iter().for_each(|(_, error)| say(error));
    for it in &mut trials {
        if let Err(error) = store.read_partial(it) {
            it.end = None;
            say(&error);
        }
    }
    if names_times_of(study) {
        trials.iter_mut().for_each(TrialResult::add_times);
    }
    trials
}

/// The trials of the searches of a study with their records, each of which is read once after it has ended `ok`.
pub(crate) fn tried(one: &mut Planned, store: &Store) -> Vec<TrialResult> {
    let planned = one.paused.iter().chain(&one.plan.trials);
    let tried: Vec<&Arc<Trial>> = planned.filter(|it| it.cell.purpose.is_tried()).collect();
    let is_new = |it: &&Arc<Trial>| !one.recorded.contains_key(&it.id);
    let new: Vec<&Arc<Trial>> = tried.iter().copied().filter(is_new).collect();
    let mut new = load_some(&one.study, &new, store, |_| {});
    if let Some(success) = &one.study.success {
        new.iter_mut().for_each(|trial| trial.judge_success(success));
    }
    let mut new = new.into_iter();
    let of_trial = |trial: &Arc<Trial>| match one.recorded.get(&trial.id) {
        Some(known) => Some(TrialResult {
            trial: Arc::clone(trial),
            ..known.clone()
        }),
        None => new.next(),
    };
    let results: Vec<TrialResult> = tried.into_iter().filter_map(of_trial).collect();
    let ended = results.iter().filter(|it| it.is_ok());
    one.recorded = ended.map(|it| (it.trial.id.clone(), it.clone())).collect();
    results
}

fn of_trials(one: &Planned, store: &Store, trials: Vec<TrialResult>) -> Results {
    Results {
        repeated: repeat_checks(&trials, store),
        ..assembled(&one.study, trials)
    }
}

/// The facts on a study.
pub(crate) fn info(one: &Planned, registry: &Registry) -> StudyInfo {
    let study = &one.study;
    StudyInfo {
        name: study.name.clone(),
        title: study.title.clone(),
        source: study.source.clone(),
        family: study.family.clone(),
        summary: study.summary.clone(),
        answers: study.answers.clone(),
        deviations: study.deviations.clone(),
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
                .or_insert_with(|| about.defaults.whole().into_owned());
        }
    }
    defaults
}

/// Whether programs give the same values again: the first stored check of each combination.
fn repeat_checks(trials: &[TrialResult], store: &Store) -> Vec<RepeatCheck> {
    let known = store.repeats();
    let check = |it: &TrialResult| {
        let trial = &it.trial;
        Some(RepeatCheck {
            environment: trial.cell.environment.to_string(),
            agent: trial.cell.agent.to_string(),
            seed: trial.key.seed,
            repeats: known.get(&trial.id)?.clone(),
        })
    };
    let mut cells = BTreeSet::new();
    let is_first = |it: &RepeatCheck| cells.insert((it.environment.clone(), it.agent.clone()));
    trials.iter().filter_map(check).filter(is_first).collect()
}

/// True if a part of a study shows the durations of trials.
pub(crate) fn names_times_of(study: &Study) -> bool {
    names_times(&(&study.tables, &study.figures, &study.claims, &study.success))
}

/// The results of a study from those of its trials.
pub(crate) fn assembled(study: &Study, mut trials: Vec<TrialResult>) -> Results {
    // The durations of imported runs are not known here.
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

/// The drawings that trials left and figures of the study show, by id. An unreadable drawing is reported, and the
/// figure shows the problem too.
fn drawings(
    session: &Session<'_>,
    one: &Planned,
    store: &Store,
    trials: &[TrialResult],
) -> BTreeMap<String, Drawings> {
    let figures = one.study.figures.iter();
    let kinds: BTreeSet<ArtifactKind> = figures.filter_map(|(_, spec)| spec.kind.shows()).collect();
    let mut all: BTreeMap<String, Drawings> = BTreeMap::new();
    // Imported runs left no drawings.
    let own = trials.iter().filter(|trial| !trial.is_imported());
    for trial in own.filter(|trial| trial.is_ok()) {
        for kind in &kinds {
            let (id, drawings) = (&trial.trial.id, all.entry(trial.trial.id.clone()).or_default());
            if let Err(error) = read_drawing(store, id, *kind, drawings) {
                session.notice(&format!("warning: {error}; it is not shown"));
                drawings.problem = Some(error.to_string());
            }
        }
    }
    all
}

fn read_drawing(store: &Store, id: &str, kind: ArtifactKind, drawings: &mut Drawings) -> Result<(), Error> {
    let taken = Taken {
        trial: id.to_owned(),
        kind,
    };
    let folder = store.artifact_if_left(&taken)?;
    folder.map_or(Ok(()), |folder| drawings.read(kind, &folder))
}
