//! Confirmations in a report: the verdict of each round of seeds alone, and the final verdict over all of them.
//!
//! Rounds that were not planned together are looks at one growing sample. The level is divided among all of them,
//! including rounds with an earlier decision, and the sample of the last one decides. The seeds of an exploratory
//! claim are no round of it, since the claim was found with them.

use super::{
    budgets,
    claim_line::{ClaimLine, claim_lines},
    contents::{Contents, make_table},
    passed::words,
    rounds::{ConfirmedVerdict, RoundVerdict},
    sheet::{NONE, Sheet, SheetEntry, Tone},
    study_info::StudyInfo,
};
use analysis::results::{Cost, Results};
use contract::trial::Combination;
use document::count::seed_ranges;
use presentation::table::{Cell, Grid};
use std::collections::BTreeSet;
use study::Confirmation;

const HEAD: [&str; 4] = ["question", "seeds", "verdict", "value or difference"];
const HOW_READ: &str = "The last word is that of all seeds together. Rounds that were not planned together count as looks \
                        at one sample, and the level is divided among all looks. A round on fresh seeds alone is a \
                        replication.";

/// The results of a confirmation, and their verdicts alone.
#[derive(Debug, Clone, Default)]
pub struct Round {
    /// Results of the trials of the round.
    pub results: Results,
    /// Its claims, and the tables whose published values it confirms.
    pub contents: Contents,
    /// Sentence on the date when the round was fixed.
    pub fixed: Option<String>,
}

impl Contents {
    /// Evaluates the confirmed claims and values over all seeds; `rounds` are those of the study's confirmations, in
    /// their order.
    pub fn confirm(&mut self, study: &StudyInfo, results: &Results, rounds: &[Round]) {
        for index in 0..study.claims.len() {
            self.confirm_claim(index, study, results, rounds);
        }
        for index in 0..study.tables.len() {
            self.confirm_table(index, study, results, rounds);
        }
        self.fixed = rounds.iter().filter_map(|round| round.fixed.clone()).collect();
        self.rounds = rounds.iter().map(|round| budgets::cost(&round.results)).collect();
        self.adjust();
    }

    fn confirm_claim(&mut self, index: usize, study: &StudyInfo, results: &Results, rounds: &[Round]) {
        let number = index + 1;
        let own: Vec<ClaimLine> = self.claims_of(number).cloned().collect();
        // Claims of a round are numbered in their order.
        let lines_of = |round: &Round, confirmation: &Confirmation| -> Vec<ClaimLine> {
            let place = confirmation.claims.iter().position(|claim| *claim == index);
            let lines = place.map(|place| round.contents.claims_of(place + 1).cloned().collect());
            lines.unwrap_or_default()
        };
        let put = study.confirm.iter().zip(rounds);
        let put = put.map(|(confirmation, round)| (confirmation, round, lines_of(round, confirmation)));
        let put: Vec<_> = put.filter(|(.., lines)| lines.iter().any(has_run)).collect();
        let Some((last, ..)) = put.last() else { return };
        let spec = last.claim(&study.claims[index]);
        let is_known = own.iter().any(ClaimLine::is_exploratory);
        let samples = (!is_known).then_some(results).into_iter();
        let samples: Vec<&Results> = samples
            .chain(put.iter().map(|(_, round, _)| &round.results))
            .collect();
        let pooled = Results::pooled(&samples);
        let alone = |line: &ClaimLine| {
            let first = own.iter().filter(|it| !is_known && it.place == line.place);
            let first = first.map(|it| alone(it, results));
            let others = put.iter().flat_map(|(_, round, lines)| {
                let here = lines.iter().filter(|it| it.place == line.place);
                here.map(|it| alone(it, &round.results))
            });
            first.chain(others).collect()
        };
        let mut lines = claim_lines(number, &spec, study, &pooled);
        for line in &mut lines {
            line.rounds = alone(line);
            self.confirmed.push(ConfirmedVerdict {
                about: format!("{} {}", spec.claim, place_in_words(&line.place)),
                rounds: line.rounds.clone(),
                all: self::alone(line, &pooled),
            });
        }
        let at = self.claims.iter().position(|line| line.number == number);
        self.claims.retain(|line| line.number != number);
        let at = at.unwrap_or(self.claims.len());
        self.claims.splice(at..at, lines);
    }

    fn confirm_table(&mut self, index: usize, study: &StudyInfo, results: &Results, rounds: &[Round]) {
        let (name, spec) = &study.tables[index];
        let grid_of = |round: &'_ Round| -> Option<Grid> {
            let (_, grid) = round.contents.tables.iter().find(|(known, _)| known == name)?;
            grid.clone().ok()
        };
        let put = study.confirm.iter().zip(rounds);
        let put = put.filter(|(confirmation, _)| confirmation.tables.contains(name));
        let put = put.filter_map(|(_, round)| Some((round, grid_of(round)?)));
        let put: Vec<(&Round, Grid)> = put
            .filter(|(_, grid)| grid.cells.iter().flatten().any(has_value))
            .collect();
        if put.is_empty() {
            return;
        }
        let samples = std::iter::once(results).chain(put.iter().map(|(round, _)| &round.results));
        let samples: Vec<&Results> = samples.collect();
        let pooled = Results::pooled(&samples);
        let Ok(mut grid) = make_table(spec, study, &pooled) else {
            return;
        };
        let own = self.tables[index].1.clone().ok();
        let grids = own.iter().map(|own| (results, own));
        let grids: Vec<(&Results, &Grid)> = grids
            .chain(put.iter().map(|(round, grid)| (&round.results, grid)))
            .collect();
        for (place, cell) in grid.places().filter(|(_, cell)| cell.published().is_some()) {
            let here = grids.iter().filter_map(|(results, grid)| {
                let (_, cell) = grid.places().find(|(known, _)| *known == place)?;
                Some(value_alone(grid, cell, results))
            });
            let confirmed = ConfirmedVerdict {
                about: format!("{name}: {place}"),
                rounds: here.filter(|round| !round.seeds.is_empty()).collect(),
                all: value_alone(&grid, cell, &pooled),
            };
            // A row without any round has the seeds of the study alone.
            self.confirmed
                .extend((confirmed.rounds.len() > 1).then_some(confirmed));
        }
        grid.notes.push(
            "Values and verdicts are of all seeds of the study and its confirmations; what each round says alone stands \
             under Confirmations."
                .into(),
        );
        self.tables[index].1 = Ok(grid);
    }

    fn claims_of(&self, number: usize) -> impl Iterator<Item = &ClaimLine> {
        self.claims.iter().filter(move |line| line.number == number)
    }

    /// Number and time of the trials of the study and its confirmations.
    pub(super) fn cost(&self, results: &Results) -> Cost {
        let mut cost = budgets::cost(results);
        for round in &self.rounds {
            cost.trials += round.trials;
            cost.seconds += round.seconds;
        }
        cost
    }
}

/// Whether some trials of the line have ended.
fn has_run(line: &ClaimLine) -> bool {
    line.verdict.as_ref().is_ok_and(|claim| claim.n > 0)
}

fn has_value(cell: &Cell) -> bool {
    cell.estimate.is_some()
}

fn place_in_words(place: &str) -> String {
    match place {
        "" => String::new(),
        place => format!("in {place}"),
    }
}

fn alone(line: &ClaimLine, results: &Results) -> RoundVerdict {
    RoundVerdict {
        seeds: seeds(&line.rests_on, results),
        verdict: line.word().into(),
        value: line.difference().unwrap_or_default(),
    }
}

fn value_alone(grid: &Grid, cell: &Cell, results: &Results) -> RoundVerdict {
    let verdict = cell.verdict().map_or(NONE, |verdict| verdict.word());
    let value = cell.estimate.map(|value| grid.format.write(value));
    RoundVerdict {
        seeds: seeds(&cell.rests_on, results),
        verdict: verdict.into(),
        value: value.unwrap_or_default(),
    }
}

/// The seeds of combinations that ended well, as ranges.
fn seeds(cells: &BTreeSet<Combination>, results: &Results) -> String {
    let behind = results
        .trials
        .iter()
        .filter(|it| it.is_ok() && cells.contains(&it.combination().clone()));
    let seeds: BTreeSet<u64> = behind.map(|it| it.trial.key.seed).collect();
    seed_ranges(&seeds.into_iter().collect::<Vec<_>>())
}

/// A row for each round and one for all rounds together; `None` without a confirmed claim or value.
pub(super) fn sheet(contents: &Contents) -> Option<Sheet> {
    let rows = |it: &ConfirmedVerdict| {
        let row = |about: SheetEntry, round: &RoundVerdict, seeds: String| {
            let verdict = SheetEntry::of(Tone::Verdict(known_word(&round.verdict)), round.verdict.clone());
            vec![
                about,
                SheetEntry::plain(seeds),
                verdict,
                SheetEntry::plain(round.value.clone()),
            ]
        };
        let about = SheetEntry::of(Tone::Code, it.about.clone());
        let all = row(about, &it.all, format!("all: {}", it.all.seeds));
        // A single round equals all rounds together.
        let rounds = it.rounds.iter().filter(|_| it.rounds.len() > 1);
        let rounds = rounds.map(|round| row(SheetEntry::default(), round, round.seeds.clone()));
        std::iter::once(all).chain(rounds).collect::<Vec<_>>()
    };
    (!contents.confirmed.is_empty()).then(|| Sheet {
        head: HEAD.map(String::from).to_vec(),
        words: 3,
        rows: contents.confirmed.iter().flat_map(rows).collect(),
        notes: std::iter::once(HOW_READ.to_owned())
            .chain(contents.fixed.iter().cloned())
            .collect(),
        ..Sheet::default()
    })
}

/// The static word of a verdict that equals `word`.
fn known_word(word: &str) -> &'static str {
    words().into_iter().find(|known| *known == word).unwrap_or(NONE)
}
