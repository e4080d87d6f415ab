//! The record of seen verdicts and of fixed rounds of confirmations.

use crate::{Observer, Planned, Session};
use analysis::results::Results;
use contract::{
    Error, digest,
    trial::{Combination, Trial},
    trial_end::is_missing,
};
use execution::store::{self, Fixed, SeenVerdicts, Store};
use presentation::{claim_spec::Relevance, table::Grid};
use report::{ClaimLine, Contents};
use serde_json::json;
use statistics::{Reference, Verdict};
use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
};
use study::Study;

/// Records the date and the hash of rounds of confirmations that are computed for the first time, before their first
/// trial. The hash covers what each round judges, and its seeds.
///
/// # Errors
/// [`Error::File`] where a record cannot be written.
pub(crate) fn fix(session: &Session<'_>, planned: &[Planned], store: &Store) -> Result<(), Error> {
    for one in planned.iter().filter(|one| one.confirms.is_some()) {
        let study = &one.study.name;
        let mut seen = read(session.observer, store, study)?;
        if seen.fixed.is_some() {
            continue;
        }
        let has_ended = |trial: &&Arc<Trial>| store.end(&trial.id).is_ok_and(|end| !is_missing(end.as_ref()));
        seen.fixed = Some(Fixed {
            digest: digest_of_round(&one.study),
            at: store::now(),
            ended: one.plan.trials.iter().filter(has_ended).count(),
        });
        store.keep_seen(study, &seen)?;
    }
    Ok(())
}

/// The hash of the claims, published values and seeds of a round. Texts do not enter it.
fn digest_of_round(round: &Study) -> String {
    let claims = round.claims.iter();
    let claims: Vec<_> = claims
        .map(|it| json!([it.claim, it.environment, it.min_effect]))
        .collect();
    let tables = round.tables.iter();
    let tables: Vec<_> = tables
        .map(|(name, spec)| json!([name, spec.published, spec.margin]))
        .collect();
    let looks = round.design.as_ref().map(|design| design.looks().to_vec());
    contract::digest::of_bytes(json!([claims, tables, round.seeds, looks]).to_string().as_bytes())
}

/// A sentence on when a round was fixed; `None` if that was not recorded.
pub(crate) fn fixed_in_words(round: &Study, seen: &SeenVerdicts) -> Option<String> {
    let Fixed { digest, at, ended } = seen.fixed.as_ref()?;
    let name = round.name.rsplit('/').next().unwrap_or(&round.name);
    let day = at.get(..10).unwrap_or(at);
    let before = match ended {
        0 => "before its first trial".into(),
        1 => "after 1 of its trials had ended".into(),
        n => format!("after {n} of its trials had ended"),
    };
    let changed = if *digest == digest_of_round(round) {
        ""
    } else {
        "; it was changed since"
    };
    Some(format!(
        "`{name}` was fixed on {day}, {before} (hash {digest:.12}){changed}."
    ))
}

/// Marks verdicts that were seen earlier with fewer seeds and no plan for that, and verdicts whose margin has changed
/// since they were first seen; then records the verdicts that are seen now. Returns the part of the record about these
/// verdicts and these trials, without the ids of trials in its keys.
///
/// # Errors
/// [`Error::File`] where the record cannot be written.
pub(crate) fn record(
    session: &Session<'_>,
    one: &Planned,
    store: &Store,
    results: &Results,
    contents: &mut Contents,
) -> Result<SeenVerdicts, Error> {
    let study = &one.study.name;
    let mut noting = Noting::of(one, read(session.observer, store, study)?, results);
    noting.ids = Some(FirstIds::of(results));
    noting.all(contents);
    // A record of an earlier program without a checksum gets one.
    if noting.changed || !noting.seen.is_sealed() && !noting.seen.verdicts.is_empty() {
        store.keep_seen(study, &noting.seen)?;
    }
    Ok(noting.noted)
}

/// The same for a record of these trials alone; entries that are no longer judged are kept.
pub(crate) fn record_again(
    one: &Planned,
    seen: SeenVerdicts,
    results: &Results,
    contents: &mut Contents,
) -> SeenVerdicts {
    let mut noting = Noting::of(one, seen, results);
    noting.all(contents);
    let Noting { mut noted, seen, .. } = noting;
    noted.extend(seen);
    noted
}

/// The record of verdicts while the verdicts of a report are compared with it.
struct Noting<'a> {
    seen: SeenVerdicts,
    /// The part about this report's verdicts, without the ids of trials in its keys.
    noted: SeenVerdicts,
    changed: bool,
    relevance: Option<&'a Relevance>,
    /// Number of trials of each combination.
    numbers: BTreeMap<Combination, usize>,
    /// The ids of first trials; `None` if the record is of these trials alone.
    ids: Option<FirstIds<'a>>,
    /// The numbers of seeds of planned looks.
    planned: BTreeSet<u32>,
}

impl<'a> Noting<'a> {
    fn of(one: &'a Planned, seen: SeenVerdicts, results: &Results) -> Self {
        let mut numbers: BTreeMap<Combination, usize> = BTreeMap::new();
        for it in &results.trials {
            *numbers.entry(it.combination().clone()).or_default() += 1;
        }
        let design = one.study.design.iter();
        let mut noted = SeenVerdicts::default();
        noted.lost.clone_from(&seen.lost);
        noted.fixed.clone_from(&seen.fixed);
        Self {
            noted,
            seen,
            changed: false,
            relevance: one.study.relevance.as_ref(),
            numbers,
            ids: None,
            planned: design.flat_map(|design| design.looks().iter().copied()).collect(),
        }
    }

    /// Compares every verdict with the record.
    fn all(&mut self, contents: &mut Contents) {
        let tables = contents.tables.iter_mut();
        tables
            .filter_map(|(name, grid)| Some((name, grid.as_mut().ok()?)))
            .for_each(|(name, grid)| self.table(name, grid));
        contents.claims.iter_mut().for_each(|line| self.claim(line));
        contents.lost_record.clone_from(&self.seen.lost);
        // Exploratory verdicts belong to no family.
        contents.adjust();
    }

    /// The largest number of trials of a combination behind a verdict.
    fn most_planned(&self, cells: &BTreeSet<Combination>) -> usize {
        let numbers = cells.iter().filter_map(|cell| self.numbers.get(cell));
        numbers.copied().max().unwrap_or(0)
    }

    /// The key of a verdict in the record. It contains the trials, because another version of a trial is another
    /// experiment.
    fn key(&self, place: &str, rests_on: &BTreeSet<Combination>) -> String {
        match &self.ids {
            Some(ids) => format!("{place} @ {}", ids.hash(rests_on)),
            None => place.to_owned(),
        }
    }

    fn table(&mut self, name: &str, grid: &mut Grid) {
        for (row, cells) in grid.rows.iter().zip(&mut grid.cells) {
            for (column, cell) in grid.columns.iter().zip(cells) {
                let judged = cell.verdict().is_some_and(Verdict::is_judged);
                let seeds = number(judged, cell.planned, cell.seeds.len() + cell.failed, &cell.looks);
                let place = format!("{name}: {}, {}", row.name, column.name);
                cell.seen_at = self.look(&place, &cell.rests_on, seeds);
                let rule = cell.judgement.as_ref().map(|it| rule_of_value(&it.reference));
                cell.first_judged_by = self.first_rule(&place, &cell.rests_on, seeds.and(rule));
            }
        }
    }

    fn claim(&mut self, line: &mut ClaimLine) {
        let judged = line.verdict.as_ref().is_ok_and(|claim| claim.verdict.is_judged());
        let n = line.verdict.as_ref().map_or(0, |claim| claim.n);
        let seeds = number(judged, self.most_planned(&line.rests_on), n, &line.looks);
        let place = format!("{} in {}", line.spec.claim, line.place);
        line.seen_at = self.look(&place, &line.rests_on, seeds);
        let rule = rule_of_claim(line.spec.min_effect, self.relevance);
        line.first_judged_by = self.first_rule(&place, &line.rests_on, seeds.map(|_| rule));
    }

    /// Records the rule by which a seen verdict is judged. Returns the rule at the first sight of the verdict, if that
    /// was another one.
    fn first_rule(
        &mut self,
        place: &str,
        rests_on: &BTreeSet<Combination>,
        rule: Option<String>,
    ) -> Option<String> {
        let rule = rule?;
        let key = self.key(place, rests_on);
        let first = self.seen.rules.get(&key).cloned();
        if first.is_none() {
            self.seen.rules.insert(key, rule.clone());
            self.changed = true;
        }
        let first = first.unwrap_or_else(|| rule.clone());
        self.noted.rules.insert(place.to_owned(), first.clone());
        Some(first).filter(|first| *first != rule)
    }

    /// Records the number of seeds with which a verdict is seen. Returns the smallest other number with which it was
    /// seen without a plan. A larger number that was seen and is not shown counts just as a smaller one does.
    fn look(&mut self, place: &str, rests_on: &BTreeSet<Combination>, seeds: Option<u32>) -> Option<u32> {
        let seeds = seeds?;
        let key = self.key(place, rests_on);
        let plans = self.seen.plans.entry(key.clone()).or_default();
        let before = self.seen.verdicts.entry(key).or_default();
        if before.insert(seeds) {
            self.changed = true;
            plans.insert(seeds, self.planned.clone());
        }
        let [place, noted] = [place.to_owned(), place.to_owned()];
        self.noted.verdicts.insert(place, before.clone());
        if !plans.is_empty() {
            self.noted.plans.insert(noted, plans.clone());
        }
        // A look that was seen under another plan is not a planned look of this one, since it was tested at the whole
        // level then.
        let was_planned = |earlier: &u32| {
            self.planned.contains(earlier) && plans.get(earlier).is_none_or(|plan| *plan == self.planned)
        };
        before
            .iter()
            .copied()
            .find(|other| *other != seeds && !was_planned(other))
    }
}

/// The rule of a published value: the band within which a result counts as the same, in words.
fn rule_of_value(reference: &Reference) -> String {
    let (low, high) = reference.band;
    format!("a band from {low} to {high}")
}

/// The rule of a claim: the smallest difference that counts. The words of the claim are part of its key.
fn rule_of_claim(min_effect: Option<f64>, relevance: Option<&Relevance>) -> String {
    match (min_effect, relevance) {
        (Some(min_effect), _) => format!("differences of {min_effect} or more"),
        (None, Some(relevance)) => format!("differences of {relevance} or more"),
        (None, None) => "any difference".into(),
    }
}

/// The number of seeds with which a verdict is seen; `None` if there is no verdict yet or planned seeds are missing.
fn number(judged: bool, planned: usize, ended: usize, looks: &statistics::Seeds) -> Option<u32> {
    let seeds = match &looks.design {
        Some(design) => design.looks()[..looks.complete()].last().copied(),
        None => u32::try_from(planned).ok().filter(|_| ended >= planned),
    };
    seeds.filter(|_| judged)
}

/// The record of a study's verdicts. A damaged record is set aside with a warning.
fn read(observer: &dyn Observer, store: &Store, study: &str) -> Result<SeenVerdicts, Error> {
    let (seen, problem) = store.seen_or_begun(study)?;
    if let (Some(problem), Some(lost)) = (problem, &seen.lost) {
        observer.notice(&format!(
            "warning: the record of verdicts of `{study}` that were seen is damaged: {problem}; it was set aside as `{}` \
             of the store, and the report says that what was seen before is not known",
            lost.display()
        ));
    }
    Ok(seen)
}

/// Adds the records of one store to those of another, because a person who takes over trials has seen their verdicts
/// too. True if every record of the source could be read.
///
/// # Errors
/// [`Error::File`] where a record cannot be read or written.
pub fn unite(observer: &dyn Observer, into: &Store, from: &Store, dry_run: bool) -> Result<bool, Error> {
    let mut all = true;
    for study in from.studies_seen()? {
        let more = match from.seen_verdicts(&study) {
            Ok(more) => more.unwrap_or_default(),
            Err(error @ (Error::Damaged { .. } | Error::Newer { .. })) => {
                observer.notice(&format!(
                    "warning: {error}; the verdicts that it says were seen are not taken"
                ));
                all = false;
                continue;
            }
            Err(error) => return Err(error),
        };
        if dry_run {
            continue;
        }
        let before = read(observer, into, &study)?;
        let mut seen = before.clone();
        seen.extend(more);
        if seen != before {
            into.keep_seen(&study, &seen)?;
        }
    }
    Ok(all)
}

/// The id of the trial of the first seed of every combination.
struct FirstIds<'a>(BTreeMap<Combination, &'a str>);

impl<'a> FirstIds<'a> {
    fn of(results: &'a Results) -> Self {
        let mut by_cell = BTreeMap::new();
        for it in &results.trials {
            by_cell
                .entry(it.combination().clone())
                .or_insert(it.trial.id.as_str());
        }
        Self(by_cell)
    }

    fn hash(&self, cells: &BTreeSet<Combination>) -> String {
        let ids: Vec<&str> = cells
            .iter()
            .filter_map(|cell| self.0.get(cell).copied())
            .collect();
        digest::of_json(&json!(ids))
    }
}
