//! Groups of values with the same key of files and columns. A group is one run, or several if steps go back or several
//! columns are runs.

use super::{
    columns::MetricColumns,
    content::Content,
    found::{ImportedRun, RunCollection},
    restarts::{Log, Rules, SeparatedRun},
};
use contract::Error;
use std::path::PathBuf;

/// The values of a group while its files are read.
#[derive(Debug, Default)]
pub(super) struct LogGroup {
    /// Name of the group, for messages.
    pub(super) name: String,
    pub(super) seed: Option<u64>,
    /// The file in which it begins.
    pub(super) file: PathBuf,
    pub(super) log: Log,
    /// The metric of each slot of the log, and the column if several columns are runs.
    slots: Vec<(String, Option<String>)>,
}

impl LogGroup {
    pub(super) fn new(name: String, seed: Option<u64>, file: PathBuf) -> Self {
        Self {
            name,
            seed,
            file,
            ..Self::default()
        }
    }

    /// The slots of the log for the columns of a file.
    pub(super) fn slots(&mut self, chosen: &MetricColumns) -> Vec<usize> {
        let mut places = Vec::new();
        for slot in &chosen.slots {
            let key = (slot.metric.clone(), chosen.runs[slot.run].clone());
            let place = self.slots.iter().position(|other| *other == key);
            places.push(place.unwrap_or_else(|| {
                self.slots.push(key);
                self.slots.len() - 1
            }));
        }
        places
    }

    /// Separates the runs and adds them to `found`.
    pub(super) fn end(
        self,
        rules: &Rules,
        files: &[&Content],
        found: &mut RunCollection,
    ) -> Result<(), Error> {
        let mut columns: Vec<&Option<String>> = Vec::new();
        for (_, column) in &self.slots {
            if !columns.contains(&column) {
                columns.push(column);
            }
        }
        if columns.is_empty() {
            columns.push(&None);
        }
        let mut passes = rules.told_apart(self.log, self.slots.len(), files)?;
        if passes.is_empty() {
            passes.push(SeparatedRun::default());
        }
        for pass in passes {
            let from = match pass.from {
                Some((_, line)) => format!(" from {} {line}", rules.unit),
                None => String::new(),
            };
            let first = found.runs.len();
            found.runs.extend(columns.iter().map(|column| ImportedRun {
                name: match column {
                    Some(column) => format!("{}, column `{column}`{from}", self.name),
                    None => format!("{}{from}", self.name),
                },
                seed: self.seed,
                file: self.file.clone(),
                ..ImportedRun::default()
            }));
            let mut curves: Vec<Vec<(u64, f64)>> = vec![Vec::new(); self.slots.len()];
            for entry in &pass.entries {
                curves[entry.slot].push((entry.step, entry.value));
            }
            for ((metric, column), curve) in self
                .slots
                .iter()
                .zip(curves)
                .filter(|(_, curve)| !curve.is_empty())
            {
                let run = first + columns.iter().position(|other| *other == column).unwrap_or(0);
                found.runs[run].curves.insert(metric.clone(), curve);
            }
            found.restarted += usize::from(pass.from.is_some());
            found.repeated += pass.repeated;
            found.purged += pass.purged;
        }
        Ok(())
    }
}
