//! Runs of other programs, read from their files. They appear beside a study's own agents in tables, figures and
//! claims, are marked as imported, and are never mixed with trials that this program computed.
//!
//! | | own trial | imported run |
//! |---|---|---|
//! | id | 32 digits | `imported-` and 32 digits, of the content of its files and of how they are read |
//! | seed | as the study says | [`FIRST_SEED`] and more, so that no run is paired with an own trial |
//! | where | the store | the files that the study names |

mod arrays;
mod columns;
mod content;
pub mod event_file;
mod event_files;
mod found;
mod group;
mod json;
mod made_files;
mod mapping;
mod pattern;
mod reading;
mod restarts;
mod separated;
mod table;
mod tables;
mod wandb;

pub use found::{ImportedRun, RunCollection};
pub use json::{BEGINS_AGAIN, of_line};
pub use mapping::{Copies, ImportedText, LeftOut, Mapping, Patterns, Restart, RunPer, SameStep, Step, SumOf};
pub use pattern::{PatternError, matching, matching_sources};
pub use reading::{Columns, columns, read};

use analysis::results::Origin;
use contract::{
    Phase,
    cast::Actors,
    digest,
    part::Part,
    recorder::Row,
    trial::{Purpose, Trial, TrialCell, TrialKey},
    trial_end::{EndState, TrialEnd},
    trial_result::TrialResult,
};
use serde_json::{Value, json};
use std::{collections::BTreeMap, sync::Arc};

/// Beginning of the id of every imported run; ids of own trials are digits alone.
pub const MARK: &str = "imported-";
/// The seed of the first run of the first entry. Every entry has a block of this many seeds of its own. Equal seeds
/// mean equal random streams among own trials, which does not hold for runs of other programs.
pub const FIRST_SEED: u64 = 1_000_000;

/// A name that distinguishes imported runs from own agents wherever it is shown.
#[must_use]
pub fn marked(name: &str) -> String {
    format!("{name} (imported)")
}

/// An entry of the section `imported`, with the runs of its files.
#[derive(Debug, Clone)]
pub struct Imported {
    /// Source of the runs.
    pub origin: Origin,
    /// The runs as trials that ended `ok`.
    pub trials: Vec<TrialResult>,
}

impl RunCollection {
    /// The runs as trials of `name` in `environment`. `block` is the index of the entry in its section; `mapping` is
    /// the way its files were read.
    ///
    /// # Errors
    /// A description of the fault in the seeds of the runs.
    pub fn trials(
        &self,
        name: &str,
        environment: &str,
        block: u64,
        mapping: &Mapping,
    ) -> Result<Vec<TrialResult>, String> {
        let first = FIRST_SEED * (block + 1);
        let mut taken: BTreeMap<u64, &str> = BTreeMap::new();
        let mut trials = Vec::new();
        for (run, place) in self.runs.iter().zip(0..) {
            let seed = run.seed.unwrap_or(place);
            if seed >= FIRST_SEED {
                return Err(format!(
                    "seed {seed} of {} is not below {FIRST_SEED}: leave `seed` out, and runs are numbered",
                    run.name
                ));
            }
            if let Some(other) = taken.insert(seed, &run.name) {
                return Err(format!("{other} and {} both have seed {seed}", run.name));
            }
            trials.push(self.trial(run, (name, environment), first + seed, mapping));
        }
        Ok(trials)
    }

    fn trial(
        &self,
        run: &ImportedRun,
        (name, environment): (&str, &str),
        seed: u64,
        mapping: &Mapping,
    ) -> TrialResult {
        let digests: Vec<&String> = self.files.iter().map(|(_, digest)| digest).collect();
        let part = |config: Value| Part::new("imported", 0, config);
        let key = TrialKey {
            environment: part(Value::Null).into(),
            agent: Actors::Agent(part(
                json!({ "sha256": digests, "read": mapping, "run": run.name }),
            ))
            .into(),
            protocol: part(Value::Null).into(),
            seed,
            numerics: 0,
        };
        let id = format!(
            "{MARK}{}",
            digest::of_json(&json!([digests, mapping, run.name, seed]))
        );
        let (names, rows) = rows(run, mapping.last);
        TrialResult {
            trial: Arc::new(Trial {
                id,
                cell: TrialCell {
                    purpose: Purpose::Imported,
                    ..TrialCell::of(environment, name)
                }
                .into(),
                key,
            }),
            end: Some(Box::new(TrialEnd {
                state: EndState::Ok,
                reason: String::new(),
                wall_s: 0.0,
                decision_s: None,
                device: None,
                digest: String::new(),
            })),
            names: names.into(),
            rows,
        }
    }
}

/// The rows of a run: every value as a measurement during learning, several values of one step as its episodes, and the
/// mean of the last ones as the final measurement.
fn rows(run: &ImportedRun, last: u64) -> (Vec<String>, Vec<Row>) {
    let (mut names, mut rows) = (Vec::new(), Vec::new());
    for (metric, curve) in &run.curves {
        let index = u16::try_from(names.len()).unwrap_or(u16::MAX);
        names.push(metric.clone());
        let mut curve = curve.clone();
        curve.sort_by_key(|(step, _)| *step);
        let row = |phase, step, episode, value| Row {
            phase,
            step,
            episode,
            seat: 0,
            metric: index,
            value,
        };
        let (mut episode, mut before) = (0, None);
        for (step, value) in &curve {
            episode = if before == Some(*step) { episode + 1 } else { 0 };
            before = Some(*step);
            rows.push(row(Phase::Evaluate, *step, episode, *value));
        }
        let from = curve
            .len()
            .saturating_sub(usize::try_from(last).unwrap_or(usize::MAX));
        let end =
            statistics::estimators::mean(&curve[from..].iter().map(|(_, value)| *value).collect::<Vec<_>>());
        rows.push(row(Phase::Final, before.unwrap_or(0), 0, end));
    }
    (names, rows)
}

#[cfg(test)]
mod tests {
    use super::*;
    use content::sha256;

    fn mapping() -> Mapping {
        Mapping {
            metrics: [("return".to_owned(), "reward".into())].into(),
            last: 2,
            ..Mapping::default()
        }
    }

    fn found(seeds: &[Option<u64>]) -> RunCollection {
        let run = |seed: &Option<u64>| ImportedRun {
            name: format!("run {seed:?}"),
            file: "a.csv".into(),
            seed: *seed,
            curves: [("return".to_owned(), vec![(10, 4.0), (0, 1.0), (10, 6.0)])].into(),
        };
        RunCollection {
            files: vec![("a.csv".into(), sha256(b"a"))],
            runs: seeds.iter().map(run).collect(),
            ..RunCollection::default()
        }
    }

    #[test]
    fn a_run_is_a_trial_that_no_own_one_can_be() {
        let trials = found(&[None, None])
            .trials("other", "cells", 1, &mapping())
            .unwrap();
        let seeds: Vec<u64> = trials.iter().map(|it| it.trial.key.seed).collect();
        assert_eq!(seeds, [2_000_000, 2_000_001]);
        for it in &trials {
            assert!(it.trial.id.starts_with(MARK) && it.trial.id != it.trial.key.id() && it.is_ok());
            assert_eq!(it.curve(Phase::Evaluate, "return"), [(0, 1.0), (10, 5.0)]);
            assert_eq!(it.mean(Phase::Final, "return"), Some(5.0));
        }
        assert!(trials[0].trial.id != trials[1].trial.id);
        let other = RunCollection {
            files: vec![("a.csv".into(), sha256(b"b"))],
            ..found(&[None])
        };
        let changed = other.trials("other", "cells", 1, &mapping()).unwrap();
        assert!(
            changed[0].trial.id != trials[0].trial.id,
            "other content is another run"
        );
    }

    #[test]
    fn seeds_are_those_of_the_files_and_none_twice() {
        let trials = found(&[Some(7), Some(3)])
            .trials("other", "cells", 0, &mapping())
            .unwrap();
        assert_eq!(trials[0].trial.key.seed, 1_000_007);
        let wrong = |seeds: &[Option<u64>]| found(seeds).trials("other", "cells", 0, &mapping()).unwrap_err();
        assert!(wrong(&[Some(7), Some(7)]).ends_with("both have seed 7"));
        assert!(wrong(&[Some(1_000_000)]).contains("leave `seed` out"));
    }

    #[test]
    fn the_digest_is_the_one_that_other_programs_print() {
        assert_eq!(
            sha256(b"abc"),
            "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
        );
    }
}
