//! Confirmations of studies. Each is planned and computed after its study, as a study of its own, and shown in its
//! report.

use crate::{Planned, ReportOptions, Selection, folders, planned::Confirms, results};
use contract::{Registry, trial::Combination, trial_result::TrialResult};
use report::Contents;
use std::{collections::BTreeSet, path::PathBuf, sync::Arc};
use study::{Study, plan::Wanted};

/// The studies, each followed by its confirmations.
pub(crate) fn planned(studies: Vec<Planned>, registry: &Registry) -> Vec<Planned> {
    let with_own = |one: Planned| {
        let own: Vec<Planned> = (0..one.study.confirm.len())
            .map(|index| confirmation(&one, index, registry))
            .collect();
        std::iter::once(one).chain(own)
    };
    studies.into_iter().flat_map(with_own).collect()
}

/// Each study with its confirmations, if they are planned.
#[must_use]
pub fn by_study(planned: &[Planned]) -> Vec<(&Planned, &[Planned])> {
    let mut left = planned;
    let mut all = Vec::new();
    while let Some((one, others)) = left.split_first() {
        let own = others.iter().take_while(|it| it.confirms.is_some()).count();
        all.push((one, &others[..own]));
        left = &others[own..];
    }
    all
}

/// Each study with the trials of its confirmations among its own.
pub(crate) fn joined(planned: Vec<Planned>) -> Vec<Planned> {
    let mut all: Vec<Planned> = Vec::new();
    for one in planned {
        match all.last_mut().filter(|_| one.confirms.is_some()) {
            Some(study) => study.plan.trials.extend(one.plan.trials),
            None => all.push(one),
        }
    }
    all
}

/// The folder with the record of a confirmation, beside the report of its study.
pub(crate) fn folder(one: &Planned, selection: &Selection, reporting: &ReportOptions) -> PathBuf {
    let (study, own) = one.study.name.split_once('/').unwrap_or((&one.study.name, ""));
    folders::folder_of(&one.path, study, selection, reporting).join(own)
}

/// Applies the settings that searches of the studies have chosen since.
pub(crate) fn follow(planned: &mut [Planned], registry: &Registry) {
    let mut study: Option<Study> = None;
    for one in planned {
        match (&one.confirms, &study) {
            (Some(confirms), Some(study)) => {
                one.study = study.confirmation(confirms.index);
                let wanted = std::mem::take(&mut one.wanted);
                one.replan(registry, wanted);
            }
            _ => study = Some(one.study.clone()).filter(|it| !it.searches.is_empty()),
        }
    }
}

/// The confirmation of a study.
fn confirmation(one: &Planned, index: usize, registry: &Registry) -> Planned {
    let study = one.study.confirmation(index);
    let mut planned = Planned::of(&one.path, study, one.options.clone(), &one.only);
    planned.plan = planned.study.plan();
    let cells = cells_behind(&planned, registry);
    planned.confirms = Some(Confirms { index, cells });
    planned.replan(registry, Wanted::new());
    planned
}

/// The combinations behind the claims and tables of a plan, including those that show whether anything was learned and
/// which difference matters.
fn cells_behind(one: &Planned, registry: &Registry) -> BTreeSet<Combination> {
    let trials = one.plan.trials.iter().map(Arc::clone).map(TrialResult::missing);
    let results = results::assembled(&one.study, trials.collect());
    let mut cells = Contents::judged(&results::info(one, registry), &results).rests_on();
    let environments: BTreeSet<String> = cells.iter().map(|it| it.environment.clone()).collect();
    let relevance = one.study.relevance.iter();
    let ends: BTreeSet<&String> = relevance
        .flat_map(|it| [&it.floor, &it.bound])
        .chain(&one.study.floors)
        .collect();
    let all = results.trials.iter().map(TrialResult::combination);
    let more = all.filter(|it| environments.contains(&it.environment) && ends.contains(&it.agent));
    cells.extend(more.cloned());
    cells
}
