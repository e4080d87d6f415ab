//! The runs in files of other programs, and remarks on how they were read.

use super::{
    content::{input, listed},
    mapping::{LeftOut, Mapping, SameStep},
};
use contract::Error;
use std::{collections::BTreeMap, path::PathBuf};

/// The files of a part of an entry, and the runs in them.
#[derive(Debug, Clone, Default)]
pub struct RunCollection {
    /// Every file that counts, with its SHA-256.
    pub files: Vec<(PathBuf, String)>,
    /// The runs, in the order of the files.
    pub runs: Vec<ImportedRun>,
    /// Sentences on copies, incomplete last lines, and logs that belong together.
    pub notes: Vec<String>,
    /// Number of values that were left out because they are not finite.
    pub not_finite: usize,
    /// Number of runs that were split from another one in the same log because steps go back.
    pub restarted: usize,
    /// Number of values at a step of a run that has another value.
    pub repeated: usize,
    /// Number of values that were purged because the run resumed from an earlier step.
    pub purged: usize,
}

/// One run of another program.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ImportedRun {
    /// Name of the run, for messages.
    pub name: String,
    /// The file in which it begins.
    pub file: PathBuf,
    /// Seed of the run, if the files contain it.
    pub seed: Option<u64>,
    /// Steps with values, by metric of the study; a step may occur more than once.
    pub curves: BTreeMap<String, Vec<(u64, f64)>>,
}

impl RunCollection {
    /// Refuses or leaves out runs that lack a metric.
    pub(super) fn complete(&mut self, mapping: &Mapping) -> Result<(), Error> {
        let lacking = |run: &ImportedRun| {
            mapping
                .metrics
                .keys()
                .find(|metric| !run.curves.contains_key(*metric))
                .cloned()
        };
        let problem = |run: &ImportedRun, metric: &str| {
            let columns = mapping.metrics[metric].all().join("`, `");
            format!(
                "{} has no value of `{columns}`, which is to be `{metric}`",
                run.name
            )
        };
        let lacks: Vec<(usize, String)> = self
            .runs
            .iter()
            .enumerate()
            .filter_map(|(place, run)| Some((place, lacking(run)?)))
            .collect();
        let Some((first, metric)) = lacks.first().filter(|_| !mapping.is_own) else {
            return Ok(());
        };
        let (run, all) = (&self.runs[*first], lacks.len() == self.runs.len());
        if all || !mapping.leaves_out(LeftOut::Empty) {
            let more = match lacks.len() - 1 {
                0 => String::new(),
                1 => ", and neither has another run".to_owned(),
                n => format!(", and neither have {n} other runs"),
            };
            let advice = if all {
                ""
            } else {
                ": `leave_out: [empty]` leaves such runs out"
            };
            return Err(input(
                &run.file,
                None,
                None,
                problem(run, metric) + &more + advice,
            ));
        }
        let names: Vec<String> = lacks
            .iter()
            .map(|(place, _)| self.runs[*place].name.clone())
            .collect();
        let note = match names.len() {
            1 => format!("1 run without a value is left out ({})", names[0]),
            n => format!("{n} runs without a value are left out ({})", listed(&names)),
        };
        self.notes.push(note);
        self.runs.retain(|run| lacking(run).is_none());
        Ok(())
    }

    /// Notes runs whose values are all equal: either runs of a deterministic task, or copies that were saved again.
    pub(super) fn compare(&mut self) {
        let mut alike = Vec::new();
        for (place, run) in self.runs.iter().enumerate() {
            let more_than_one = run.curves.values().any(|curve| curve.len() > 1);
            let other = self.runs[..place]
                .iter()
                .find(|other| more_than_one && same(run, other));
            alike.extend(other.map(|other| format!("{} and {}", other.name, run.name)));
        }
        if !alike.is_empty() {
            self.notes
                .push(format!("some runs have equal values ({})", listed(&alike)));
        }
    }

    /// Remarks on how the files were read, in sentences without a full stop.
    #[must_use]
    pub fn said(&self, mapping: &Mapping) -> Vec<String> {
        let mut said = self.notes.clone();
        let count = |n: usize, one: &str, several: &str| {
            if n == 1 {
                format!("1 {one}")
            } else {
                format!("{n} {several}")
            }
        };
        let mut say = |n: usize, one: &str, several: &str| {
            if n > 0 {
                said.push(count(n, one, several));
            }
        };
        say(
            self.restarted,
            "run begins where steps of a log go back",
            "runs begin where steps of a log go back",
        );
        say(
            self.purged,
            "value is purged, because the run went on from an earlier step",
            "values are purged, because the run went on from an earlier step",
        );
        let last = mapping.same_step == Some(SameStep::Last);
        let (one, several) = if last {
            (
                "value is replaced by a later one at the same step",
                "values are replaced by later ones at the same step",
            )
        } else {
            (
                "value stands at a step with another one, where their mean is shown",
                "values stand at steps with others, where their mean is shown",
            )
        };
        say(self.repeated, one, several);
        say(
            self.not_finite,
            "value that is not finite is left out",
            "values that are not finite are left out",
        );
        said
    }
}

/// Whether two runs have the same values, bit by bit.
fn same(one: &ImportedRun, other: &ImportedRun) -> bool {
    one.curves.len() == other.curves.len()
        && one
            .curves
            .iter()
            .zip(&other.curves)
            .all(|((metric, curve), (name, others))| {
                let same_point = |((step, value), (at, other)): (&(u64, f64), &(u64, f64))| {
                    step == at && value.to_bits() == other.to_bits()
                };
                metric == name && curve.len() == others.len() && curve.iter().zip(others).all(same_point)
            })
}
