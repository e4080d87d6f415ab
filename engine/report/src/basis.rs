//! The basis of a report, as one line at its head: seeds that the design allows, seeds that were used, and
//! exploratory parts.

use super::{Contents, StudyInfo};
use analysis::results::{Results, search_sentence};
use contract::trial::{Combination, Purpose};
use document::count::count;
use std::collections::BTreeMap;

/// The line, as in `Seeds: a design of 4, 7 or 10; 3 combinations used 4, 1 used 10. Exploratory: 1 table.`
#[must_use]
pub fn basis(study: &StudyInfo, results: &Results, contents: &Contents) -> String {
    let combinations = Combinations::of(results);
    let seen = seen_before(contents);
    let seeds = match &results.design {
        Some(design) => designed(design.looks(), &combinations, seen),
        None => fixed(study, &combinations, seen, contents.lost_record.is_some()),
    };
    let searches = results
        .searches
        .iter()
        .map(|it| format!(" {}", search_sentence(it)));
    let repeats = study
        .repeats
        .map_or_else(String::new, |repeats| format!(" Sweep: {repeats}."));
    format!(
        "Seeds: {seeds}. {}{repeats}{}{}",
        exploratory(study, contents),
        format_args!("{}{}", confirmations(study), family(study)),
        searches.collect::<String>()
    )
}

/// Sentence on the verdicts that are taken together with those of the study; empty where there are none.
fn family(study: &StudyInfo) -> String {
    let words =
        |family| format!(" Verdicts are each alone; the overview takes those of {family} together (Holm).");
    study.family.as_ref().map_or_else(String::new, words)
}

/// Sentence on the number of rounds on further seeds; empty where there are none.
fn confirmations(study: &StudyInfo) -> String {
    match study.confirm.len() {
        0 => String::new(),
        n => format!(" {} on further seeds.", count(n, "confirmation")),
    }
}

fn designed(looks: &[u32], combinations: &Combinations, seen: Option<u32>) -> String {
    let seen = seen.map_or(String::new(), |seeds| {
        format!(", planned after verdicts were seen with {seeds}")
    });
    format!("a design of {}{seen}; {}", either(looks), combinations.sentence())
}

fn fixed(study: &StudyInfo, combinations: &Combinations, seen: Option<u32>, is_lost: bool) -> String {
    let asked = study.options.iter().find(|option| option.starts_with("--seeds "));
    let when = match (seen, asked) {
        (Some(seeds), _) => {
            format!("not fixed before the first trial: verdicts were seen with {seeds} before")
        }
        (None, Some(option)) => format!("by `{option}` in place of the study's number"),
        (None, None) if is_lost => "as the study has it now".into(),
        (None, None) => "fixed before the first trial".into(),
    };
    // Where every combination used all seeds, no other number is needed.
    let used = if combinations.are_complete() {
        String::new()
    } else {
        format!("; {}", combinations.sentence())
    };
    format!("{}, {when}{used}", combinations.most_planned())
}

/// Number of seeds planned and number of seeds that ended well, by combination.
struct Combinations(BTreeMap<Combination, (usize, usize)>);

impl Combinations {
    fn of(results: &Results) -> Self {
        let mut seeds: BTreeMap<Combination, BTreeMap<u64, bool>> = BTreeMap::new();
        // The trials of a play are meetings of combinations, which are counted on their own.
        for trial in results
            .trials
            .iter()
            .filter(|it| it.trial.cell.purpose == Purpose::Cell)
        {
            // Equal settings of a search are one trial.
            seeds
                .entry(trial.combination().clone())
                .or_default()
                .insert(trial.trial.key.seed, trial.is_ok());
        }
        let counted =
            |seeds: BTreeMap<u64, bool>| (seeds.len(), seeds.values().filter(|is_ok| **is_ok).count());
        Self(
            seeds
                .into_iter()
                .map(|(cell, seeds)| (cell, counted(seeds)))
                .collect(),
        )
    }

    fn most_planned(&self) -> usize {
        self.0.values().map(|(planned, _)| *planned).max().unwrap_or(0)
    }

    fn are_complete(&self) -> bool {
        let most = self.most_planned();
        self.0.values().all(|(_, used)| *used == most)
    }

    /// Number of combinations by number of used seeds.
    fn used(&self) -> BTreeMap<usize, usize> {
        let mut counts = BTreeMap::new();
        for (_, used) in self.0.values() {
            *counts.entry(*used).or_default() += 1;
        }
        counts
    }

    /// Numbers of combinations and seeds in words, as in `3 combinations used 4, 1 used 10`.
    fn sentence(&self) -> String {
        let phrase = |(index, (used, count)): (usize, (usize, usize))| match (index, count) {
            (0, 1) => format!("1 combination used {used}"),
            (0, _) => format!("{count} combinations used {used}"),
            _ => format!("{count} used {used}"),
        };
        let phrases: Vec<String> = self.used().into_iter().enumerate().map(phrase).collect();
        if phrases.is_empty() {
            "no combination has run".into()
        } else {
            phrases.join(", ")
        }
    }
}

/// The smallest number of seeds with which a verdict was seen before, without a plan for it.
fn seen_before(contents: &Contents) -> Option<u32> {
    let grids = contents.tables.iter().filter_map(|(_, grid)| grid.as_ref().ok());
    let cells = grids.flat_map(|grid| grid.cells.iter().flatten());
    let claims = contents.claims.iter().filter_map(|line| line.seen_at);
    cells.filter_map(|cell| cell.seen_at).chain(claims).min()
}

/// Sentence on the number of verdicts with a rule that was changed after they were seen; `None` where there are none.
fn changed(contents: &Contents) -> Option<String> {
    let grids = contents.tables.iter().filter_map(|(_, grid)| grid.as_ref().ok());
    let cells = grids.flat_map(|grid| grid.cells.iter().flatten());
    let cells = cells.filter(|cell| cell.first_judged_by.is_some()).count();
    let claims = contents
        .claims
        .iter()
        .filter(|line| line.first_judged_by.is_some());
    match cells + claims.count() {
        0 => None,
        1 => Some("1 verdict is exploratory, since its margin was changed after it was seen.".into()),
        n => Some(format!(
            "{n} verdicts are exploratory, since their margins were changed after they were seen."
        )),
    }
}

/// Sentence on exploratory tables and claims, as far as they are known.
fn exploratory(study: &StudyInfo, contents: &Contents) -> String {
    let lost = contents.lost_record.as_ref().map(|record| {
        format!(
            "Whether verdicts were seen before, or judged by other margins, is not known: the record of it was damaged, and \
             lies as `{}` in the store.",
            record.display()
        )
    });
    let tables = study.tables.iter().filter(|(_, spec)| spec.exploratory).count();
    let claims = study.claims.iter().filter(|spec| spec.exploratory).count();
    let parts: Vec<String> = [(tables, "table"), (claims, "claim")]
        .into_iter()
        .filter(|(count, _)| *count > 0)
        .map(|(number, what)| count(number, what))
        .collect();
    let planned = (!parts.is_empty()).then(|| format!("Exploratory: {}.", parts.join(", ")));
    let said: Vec<String> = planned.into_iter().chain(changed(contents)).chain(lost).collect();
    if said.is_empty() {
        "Nothing was exploratory.".into()
    } else {
        said.join(" ")
    }
}

/// Numbers with `or` before the last.
fn either(numbers: &[u32]) -> String {
    let words: Vec<String> = numbers.iter().map(u32::to_string).collect();
    match words.split_last() {
        Some((last, others)) if !others.is_empty() => format!("{} or {last}", others.join(", ")),
        _ => words.concat(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use contract::{trial_end::EndState, trial_result::TrialResult};
    use presentation::{
        claim_spec::ClaimSpec,
        table::{Cell, Comparison, Grid, TableSpec},
    };
    use statistics::SequentialDesign;
    use testing::synthetic::{ended, trial};

    /// Results with this number of seeds for each agent; the index of an agent is its name.
    fn results(seeds: &[u64]) -> Results {
        let agents = seeds.iter().enumerate();
        let of_agent = |(agent, seeds): (usize, &u64)| {
            let name = format!("agent-{agent}");
            (0..*seeds)
                .map(|seed| trial("cells", &name, "", seed, &Vec::new()))
                .collect::<Vec<_>>()
        };
        Results::of(agents.flat_map(of_agent).collect())
    }

    fn line(study: &StudyInfo, results: &Results) -> String {
        basis(study, results, &Contents::default())
    }

    #[test]
    fn a_design_says_what_it_allowed_and_what_combinations_used() {
        let results = Results {
            design: Some(SequentialDesign::new(vec![4, 7, 10])),
            ..results(&[4, 10, 4, 4])
        };
        assert_eq!(
            line(&StudyInfo::default(), &results),
            "Seeds: a design of 4, 7 or 10; 3 combinations used 4, 1 used 10. Nothing was exploratory."
        );
        let of_nothing = Results {
            design: results.design,
            ..Results::default()
        };
        assert_eq!(
            line(&StudyInfo::default(), &of_nothing),
            "Seeds: a design of 4, 7 or 10; no combination has run. Nothing was exploratory."
        );
    }

    #[test]
    fn a_fixed_number_says_who_fixed_it_and_what_is_missing() {
        let study = StudyInfo::default();
        assert_eq!(
            line(&study, &results(&[10, 10])),
            "Seeds: 10, fixed before the first trial. Nothing was exploratory."
        );
        let mut short = results(&[3, 3]);
        short.trials[5] = ended(short.trials[5].clone(), EndState::Nan, "told");
        assert_eq!(
            line(&study, &short),
            "Seeds: 3, fixed before the first trial; 1 combination used 2, 1 used 3. Nothing was exploratory."
        );
        let asked = StudyInfo {
            options: vec!["--profile smoke".into(), "--seeds 3".into()],
            ..StudyInfo::default()
        };
        assert!(line(&asked, &results(&[3])).starts_with("Seeds: 3, by `--seeds 3` in place of the study's"));
    }

    #[test]
    fn a_number_that_was_raised_after_a_look_was_not_fixed() {
        let seen = Cell {
            seen_at: Some(3),
            ..Cell::default()
        };
        let grid = Grid {
            cells: vec![vec![seen]],
            ..Grid::default()
        };
        let contents = Contents {
            tables: vec![("t".into(), Ok(grid))],
            ..Contents::default()
        };
        let mut results = results(&[5]);
        let line = |results: &Results| basis(&StudyInfo::default(), results, &contents);
        assert!(
            line(&results)
                .contains("Seeds: 5, not fixed before the first trial: verdicts were seen with 3 before.")
        );
        results.design = Some(SequentialDesign::new(vec![5, 8]));
        assert!(
            line(&results).contains(
                "a design of 5 or 8, planned after verdicts were seen with 3; 1 combination used 5."
            )
        );
    }

    #[test]
    fn a_seed_of_one_setting_that_two_samples_make_is_one() {
        let mut results = results(&[3]);
        results.trials.extend(results.trials.clone());
        assert!(line(&StudyInfo::default(), &results).starts_with("Seeds: 3, fixed before the first trial."));
    }

    #[test]
    fn encounters_of_a_play_are_no_combinations() {
        let mut results = results(&[2]);
        let encounter = |seed| {
            let mut it: TrialResult = trial("play", "both", "", seed, &Vec::new());
            it.trial_mut().cell_mut().purpose = Purpose::Play(BTreeMap::new());
            it
        };
        results.trials.extend((0..4).map(encounter));
        assert!(line(&StudyInfo::default(), &results).starts_with("Seeds: 2, fixed before the first trial."));
    }

    #[test]
    fn what_was_exploratory_is_counted() {
        let claim = ClaimSpec {
            exploratory: true,
            ..ClaimSpec::default()
        };
        let table = TableSpec {
            exploratory: true,
            ..TableSpec::of(Comparison::default())
        };
        let study = StudyInfo {
            tables: vec![("a".into(), table.clone()), ("b".into(), table)],
            claims: vec![claim, ClaimSpec::default()],
            ..StudyInfo::default()
        };
        assert!(line(&study, &results(&[2])).ends_with(". Exploratory: 2 tables, 1 claim."));
    }
}
