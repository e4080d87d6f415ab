//! Planned looks: combinations get more seeds until every verdict is decided.
//!
//! The seeds of a combination are a function of the stored results alone. Running, resuming, reporting and running on
//! another machine therefore lead to the same trials.

use crate::{Planned, results};
use contract::{
    Registry,
    trial::{self, Combination},
};
use document::count::{count, either};
use execution::store::Store;
use report::{Contents, Open};
use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
};
use study::plan::Wanted;

/// Adds the seeds that the stored results ask for, look by look. True if a combination gets more seeds than before.
///
/// It starts at the first look whatever the plan was before, because a failed trial that was run again may change the
/// decision of an earlier look.
pub(crate) fn grow(one: &mut Planned, registry: &Registry, store: &Store) -> bool {
    let Some(design) = one.study.design.clone() else {
        return false;
    };
    let info = results::info(one, registry);
    let before = std::mem::take(&mut one.wanted);
    if !before.is_empty() {
        one.replan(registry, Wanted::new());
    }
    loop {
        let results = results::judged(one, store);
        let contents = Contents::judged(&info, &results);
        let open = contents.open();
        one.open = Some(open.len());
        let wanted = wanted(one, design.looks(), &open);
        if wanted == one.wanted {
            return wanted
                .iter()
                .any(|(cell, seeds)| before.get(cell).is_none_or(|had| had < seeds));
        }
        one.replan(registry, wanted);
    }
}

/// The number of seeds that combinations need for the next look at open verdicts; at least as many as they have.
fn wanted(one: &Planned, looks: &[u32], open: &[Open<'_>]) -> Wanted {
    let mut wanted = one.wanted.clone();
    for it in open {
        let Some(next) = looks.get(it.complete) else {
            continue;
        };
        it.rests_on
            .iter()
            .for_each(|cell| raise(&mut wanted, cell, *next));
    }
    raise_sources(one, &mut wanted);
    // Combinations that are still at the first look are not listed.
    wanted.retain(|_, seeds| *seeds > looks[0]);
    wanted
}

fn raise(wanted: &mut Wanted, cell: &Combination, seeds: u32) {
    let now = wanted.entry(cell.clone()).or_insert(seeds);
    *now = seeds.max(*now);
}

/// Raises the sources of trials to the same look, because a trial needs its sources.
fn raise_sources(one: &Planned, wanted: &mut Wanted) {
    let by_id: BTreeMap<&str, &Arc<trial::Trial>> = one
        .plan
        .trials
        .iter()
        .map(|trial| (trial.id.as_str(), trial))
        .collect();
    let wanting = one
        .plan
        .trials
        .iter()
        .filter_map(|trial| Some((trial, wanted.get(&trial.cell.combination).copied()?)));
    let mut open: Vec<(&Arc<trial::Trial>, u32)> = wanting.collect();
    let mut seen: BTreeSet<(&str, u32)> = BTreeSet::new();
    while let Some((taker, seeds)) = open.pop() {
        for source in taker.key.sources() {
            let Some((id, source)) = by_id.get_key_value(source.as_str()) else {
                continue;
            };
            if seen.insert((*id, seeds)) {
                open.push((*source, seeds));
                // A prepared trial has no seeds of its own: it runs for the trials that take from it.
                if source.cell.purpose != trial::Purpose::Prepared {
                    raise(wanted, &source.cell.combination, seeds);
                }
            }
        }
    }
}

/// The planned looks of a study and its progress through them, as a line; `None` if its number of seeds is fixed.
#[must_use]
pub fn line(one: &Planned) -> Option<String> {
    let looks = one
        .study
        .design
        .as_ref()?
        .looks()
        .iter()
        .map(u32::to_string)
        .collect::<Vec<_>>()
        .join(", ");
    let open = one.open.map_or(String::new(), |open| {
        format!(
            "; {open} judged values and claims {} open",
            either(&open, "is", "are")
        )
    });
    let later = match one.wanted.len() {
        0 => String::new(),
        n => format!(
            "; {} {} past the first look",
            count(n, "combination"),
            either(&n, "is", "are")
        ),
    };
    Some(format!("  looks at {looks} seeds{open}{later}"))
}
