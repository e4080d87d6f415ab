//! Searches for settings. The next settings follow from the stored results alone, so running, resuming, reporting and
//! running on another machine lead to the same settings.

use crate::{Exit, Failure, Planned, Session, results};

use analysis::{
    results::{SearchResult, Sight},
    search::{Next, Progress, Proposals},
};
use contract::{Registry, trial::Purpose, trial_result::TrialResult};
use execution::store::Store;
use std::collections::{BTreeMap, BTreeSet};

/// Extends every search of a study as far as the stored results allow. True if a setting was added.
///
/// # Errors
/// A setting that a search proposes but a plugin refuses.
pub(crate) fn grow(one: &mut Planned, registry: &Registry, store: &Store) -> Result<bool, Failure> {
    let mut grown = false;
    loop {
        if one.study.searches.is_empty() || one.confirms.is_some() {
            return Ok(grown);
        }
        let tried = results::tried(one, store);
        let of_search = |(search, progress): &(_, _)| SearchResult::of(search, progress, &tried);
        one.searched = one.study.searches.iter().map(of_search).collect();
        let mut searches = BTreeMap::new();
        for it in &one.searched {
            let earlier = one.proposals.entry(it.search.name.clone()).or_default();
            searches.insert(it.search.name.clone(), progress(it, earlier));
        }
        let options = study::Options {
            searches,
            ..one.options.clone()
        };
        if options == one.options {
            one.set_aside(registry, paused(&tried, one));
            return Ok(grown);
        }
        grown = true;
        one.study =
            study::load(&one.path, registry, &options).map_err(|problems| Failure::study(&problems))?;
        one.options = options;
        let wanted = std::mem::take(&mut one.wanted);
        one.replan(registry, wanted);
    }
}

fn progress(it: &SearchResult, earlier: &mut Proposals) -> Progress {
    let known = it.known();
    let parents = it.search.parents(&known);
    match it.search.next_after(&known, earlier) {
        Next::Try(points, stops) => Progress {
            points,
            stops,
            parents,
            chosen: None,
        },
        Next::Chosen(chosen, stops) => Progress {
            points: it.tried.iter().map(|tried| tried.point.clone()).collect(),
            stops,
            parents,
            chosen,
        },
    }
}

/// Ids of the trials that the search has measured as far as it asks; they wait for nothing and are not missing. Their
/// later states, for another study, do not concern the search.
fn paused(tried: &[TrialResult], one: &Planned) -> BTreeSet<String> {
    let has_paused = |it: &&TrialResult| {
        let search = match &it.trial.cell.purpose {
            Purpose::Tried(name) => one.study.searches.iter().find(|(search, _)| search.name == *name),
            _ => None,
        };
        let stop = one.pauses.get(&it.trial.id).copied();
        let (Some((search, _)), Some(stop)) = (search, stop) else {
            return false;
        };
        !it.is_ok() && it.measured_at(&search.metric, stop).is_some()
    };
    tried
        .iter()
        .filter(has_paused)
        .map(|it| it.trial.id.clone())
        .collect()
}

/// The exit for the searches of a study. It is [`Exit::TrialsFailed`] if a search found no setting, since its agent
/// cannot run then, or if a setting could not be compared with the choice.
#[must_use]
pub fn exit_of_searches(one: &Planned) -> Exit {
    let saw_all = |it: &SearchResult| {
        [Sight::Failed, Sight::Last]
            .iter()
            .all(|sight| it.seen_so(*sight).is_empty())
    };
    match one.searched.iter().all(|it| !it.found_nothing() && saw_all(it)) {
        true => Exit::Ok,
        false => Exit::TrialsFailed,
    }
}

/// Reports why searches cannot choose a setting, or which settings they could not compare with their choice. Returns
/// the exit of [`exit_of_searches`] for all.
pub(crate) fn tell(session: &Session<'_>, planned: &[Planned]) -> Exit {
    let again = session.again();
    for it in planned.iter().flat_map(|one| &one.searched) {
        let (words, by) = (analysis::results::search_in_words(it), &it.search.metric);
        if !it.seen_so(Sight::Failed).is_empty() {
            session.notice(&format!("error: {words}: `{again}` runs them again"));
        } else if it.found_nothing() {
            session.notice(&format!(
                "error: {words}: no trial has a final value of `{by}`, so no setting can be chosen"
            ));
        } else if it.chosen.is_some() && !it.seen_so(Sight::Last).is_empty() {
            session.notice(&format!("warning: {words}"));
        }
    }
    planned.iter().map(exit_of_searches).max().unwrap_or(Exit::Ok)
}

/// The progress of the searches of a study, one line for each.
#[must_use]
pub fn lines(one: &Planned) -> Vec<String> {
    one.searched
        .iter()
        .map(|it| format!("  {}", analysis::results::search_in_words(it)))
        .collect()
}
