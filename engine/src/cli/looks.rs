//! Planned looks: combinations get seeds until what is judged is decided; and a record of the verdicts that
//! were seen.
//!
//! What a combination gets is a function of the stored results alone, so that running, resuming, reporting
//! and running elsewhere come to the same trials.

use super::{complain, study::Planned};
use crate::{
    Error, Registry,
    plan::Wanted,
    report::{Contents, Open},
    results::{CellName, Results},
    store::{Store, write_durably},
    trial,
};
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::{
    collections::{BTreeMap, BTreeSet},
    fs, io,
    path::Path,
};

/// Gives combinations the seeds that the stored results ask for, look by look. True where one has more than
/// before.
///
/// It begins at the first look whatever the plan was before: a failed trial that was tried again may change
/// what an earlier look decides.
pub(super) fn grow(one: &mut Planned, registry: &Registry, store: &Store) -> bool {
    let Some(design) = one.study.design.clone() else {
        return false;
    };
    let info = super::run::info(one, registry);
    let before = std::mem::take(&mut one.wanted);
    if !before.is_empty() {
        one.replan(registry, Wanted::new());
    }
    loop {
        let results = super::run::collect(one, store, None);
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

/// How many seeds combinations need for the next look at what is open; at least as many as they have.
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

fn raise(wanted: &mut Wanted, cell: &CellName, seeds: u32) {
    let now = wanted.entry(cell.clone()).or_insert(seeds);
    *now = seeds.max(*now);
}

/// A trial needs its sources: their combinations come to the same look.
fn raise_sources(one: &Planned, wanted: &mut Wanted) {
    let by_id: BTreeMap<&str, &trial::Trial> = one
        .plan
        .trials
        .iter()
        .map(|trial| (trial.id.as_str(), trial))
        .collect();
    let wanting = one
        .plan
        .trials
        .iter()
        .filter_map(|trial| Some((trial, wanted.get(&cell(trial)).copied()?)));
    let mut open: Vec<(&trial::Trial, u32)> = wanting.collect();
    let mut seen: BTreeSet<(&str, u32)> = BTreeSet::new();
    while let Some((taker, seeds)) = open.pop() {
        for source in taker.key.sources() {
            let Some((id, source)) = by_id.get_key_value(source.as_str()) else {
                continue;
            };
            if seen.insert((*id, seeds)) {
                open.push((*source, seeds));
                // What is prepared has no seeds of its own: it runs for those that take from it.
                if source.purpose != trial::Purpose::Prepared {
                    raise(wanted, &cell(source), seeds);
                }
            }
        }
    }
}

fn cell(trial: &trial::Trial) -> CellName {
    (
        trial.environment.clone(),
        trial.agent.clone(),
        trial.setting.clone(),
    )
}

/// What a study plans and how far it is, as a line; `None` where its number of seeds is fixed.
pub(super) fn line(one: &Planned) -> Option<String> {
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
        format!("; {open} judged values and claims are open")
    });
    let later = match one.wanted.len() {
        0 => String::new(),
        n => format!("; {n} combinations are past the first look"),
    };
    Some(format!("  looks at {looks} seeds{open}{later}"))
}

/// Numbers of seeds at which a verdict was seen, by what was judged.
#[derive(Debug, Default, Serialize, Deserialize)]
struct Seen {
    /// By table and cell, or claim and place, and by the trials of the first seeds: another version of a
    /// trial is another experiment.
    verdicts: BTreeMap<String, BTreeSet<u32>>,
}

/// Marks verdicts that were seen with fewer seeds before and without a plan for it, and records those that
/// are seen now.
///
/// # Errors
/// [`Error::File`] where the record cannot be written.
pub(super) fn record(
    one: &Planned,
    store: &Store,
    results: &Results,
    contents: &mut Contents,
) -> Result<(), Error> {
    let path = store.seen_verdicts(&one.study.name);
    let mut seen = read(&path);
    let first_trials = FirstTrials::of(results);
    let planned: BTreeSet<u32> = one
        .study
        .design
        .iter()
        .flat_map(|design| design.looks().iter().copied())
        .collect();
    let mut changed = false;
    let mut look = |key: String, rests_on: &BTreeSet<CellName>, seeds: Option<u32>| {
        let seeds = seeds?;
        let before = seen
            .verdicts
            .entry(format!("{key} @ {}", first_trials.hash(rests_on)))
            .or_default();
        changed |= before.insert(seeds);
        before
            .iter()
            .copied()
            .find(|earlier| *earlier < seeds && !planned.contains(earlier))
    };
    for (name, grid) in contents
        .tables
        .iter_mut()
        .filter_map(|(name, grid)| Some((name, grid.as_mut().ok()?)))
    {
        for (row, cells) in grid.rows.iter().zip(&mut grid.cells) {
            for (column, cell) in grid.columns.iter().zip(cells) {
                let judged = cell.verdict().is_some_and(crate::statistics::Verdict::is_judged);
                let seeds = number(judged, cell.planned, cell.seeds.len() + cell.failed, &cell.looks);
                cell.seen_at = look(
                    format!("{name}: {}, {}", row.name, column.name),
                    &cell.rests_on,
                    seeds,
                );
            }
        }
    }
    for line in &mut contents.claims {
        let judged = line.verdict.as_ref().is_ok_and(|claim| claim.verdict.is_judged());
        let n = line.verdict.as_ref().map_or(0, |claim| claim.n);
        let seeds = number(judged, first_trials.planned(&line.rests_on), n, &line.looks);
        line.seen_at = look(
            format!("{} in {}", line.spec.claim, line.place),
            &line.rests_on,
            seeds,
        );
    }
    if changed {
        let folder = path.parent().unwrap_or(store.root());
        fs::create_dir_all(folder).map_err(Error::file("create", folder))?;
        write_durably(&path, json!(seen).to_string().as_bytes())?;
    }
    Ok(())
}

/// With how many seeds a verdict is seen; `None` where there is none yet or seeds of the plan are missing.
fn number(judged: bool, planned: usize, ended: usize, looks: &crate::statistics::Seeds) -> Option<u32> {
    let seeds = match &looks.design {
        Some(design) => design.looks()[..looks.complete].last().copied(),
        None => u32::try_from(planned).ok().filter(|_| ended >= planned),
    };
    seeds.filter(|_| judged)
}

/// A record that cannot be read is begun anew: it guards against mistakes and holds no result.
fn read(path: &Path) -> Seen {
    let read = fs::read(path).and_then(|text| serde_json::from_slice(&text).map_err(io::Error::from));
    read.unwrap_or_else(|error| {
        if error.kind() != io::ErrorKind::NotFound {
            complain(&format!(
                "warning: {}: {error}; the record of verdicts that were seen begins anew",
                path.display()
            ));
        }
        Seen::default()
    })
}

/// The trial of the first seed of every combination, and how many seeds each has.
struct FirstTrials<'a> {
    by_cell: BTreeMap<CellName, (&'a str, usize)>,
}

impl<'a> FirstTrials<'a> {
    fn of(results: &'a Results) -> Self {
        let mut by_cell: BTreeMap<CellName, (&str, usize)> = BTreeMap::new();
        for it in &results.trials {
            by_cell.entry(it.cell()).or_insert((it.trial.id.as_str(), 0)).1 += 1;
        }
        Self { by_cell }
    }

    fn hash(&self, cells: &BTreeSet<CellName>) -> String {
        trial::hash(&json!(
            cells
                .iter()
                .filter_map(|cell| Some(self.by_cell.get(cell)?.0))
                .collect::<Vec<_>>()
        ))
    }

    fn planned(&self, cells: &BTreeSet<CellName>) -> usize {
        cells
            .iter()
            .filter_map(|cell| Some(self.by_cell.get(cell)?.1))
            .max()
            .unwrap_or(0)
    }
}
