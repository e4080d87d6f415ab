//! Runs in tables: a line for every step, a column for every metric.

use super::{
    arrays,
    columns::{MetricColumns, MissingColumn},
    content::{Content, LogFormat, input},
    found::RunCollection,
    group::LogGroup,
    json,
    mapping::{LeftOut, Mapping, NOT_FINITE, Restart, RunPer, Step},
    restarts::{LogValue, Rules},
    separated,
    table::{Keys, LogLine, LogTable, by_time, is_of_environment},
    wandb,
};
use contract::{Error, panics, parquet::ParquetTable};
use std::{collections::BTreeMap, path::PathBuf};

/// Adds the runs of all files together, in the order of their first lines. If no column distinguishes runs, every file
/// is one.
pub(super) fn runs(
    files: &[(&Content, LogFormat)],
    mapping: &Mapping,
    found: &mut RunCollection,
) -> Result<(), Error> {
    let contents: Vec<&Content> = files.iter().map(|(file, _)| *file).collect();
    let mut tables = Vec::new();
    for (place, (file, form)) in files.iter().enumerate() {
        let mut table = table(file, *form)?;
        table.is_own = mapping.is_own;
        found.notes.append(&mut table.notes);
        tables.push((place, table));
    }
    let mut gathered = RunCollector::new(mapping);
    for (file, table) in merged(tables, mapping, found)? {
        gathered.take(file, &table)?;
    }
    gathered.end(&contents, found)
}

/// The table in a file.
pub(super) fn table(file: &Content, form: LogFormat) -> Result<LogTable, Error> {
    match form {
        LogFormat::Json => json::table(file),
        LogFormat::Arrays => arrays::table(file),
        LogFormat::Wandb => wandb::table(file),
        LogFormat::Parquet => panics::or_damaged(&file.path, || from_parquet(file)),
        _ => separated::table(file),
    }
}

fn from_parquet(file: &Content) -> Result<LogTable, Error> {
    let read = ParquetTable::decode(file.bytes.clone(), &file.path)?;
    let (names, columns): (Vec<String>, Vec<Vec<String>>) = read.as_texts().into_iter().unzip();
    let rows = columns.first().map_or(0, Vec::len);
    let line = |row: usize| LogLine {
        number: row as u64 + 1,
        begins_again: false,
        cells: columns.iter().map(|column| column[row].as_str()).collect(),
    };
    Ok(LogTable {
        path: file.path.clone(),
        names,
        lines: (0..rows).map(line).collect(),
        ..LogTable::default()
    })
}

/// The tables of environments that belong to one run, merged if the entry defines a folder as a run.
fn merged(
    tables: Vec<(usize, LogTable)>,
    mapping: &Mapping,
    found: &mut RunCollection,
) -> Result<Vec<(usize, LogTable)>, Error> {
    let is_summed = matches!(mapping.step, Step::Sum(_)) && mapping.seed.is_none() && mapping.run.is_none();
    let mut folders: BTreeMap<PathBuf, Vec<(usize, LogTable)>> = BTreeMap::new();
    let mut others = Vec::new();
    for (place, table) in tables {
        let is_one = is_summed && table.started.is_some() && is_of_environment(&table.path);
        match table
            .path
            .parent()
            .filter(|_| is_one && mapping.run_per != Some(RunPer::File))
        {
            Some(folder) => folders.entry(folder.to_owned()).or_default().push((place, table)),
            None => others.push((place, table)),
        }
    }
    for tables in folders.into_values() {
        let (place, several) = (tables[0].0, tables.len() > 1);
        if several && mapping.run_per.is_none() {
            let problem = "Stable-Baselines3 writes such files, numbered from 0, for the environments of one run: write \
                           `run_per: folder` where they are of one run, and `run_per: file` where each is a run";
            return Err(input(&tables[0].1.path, None, None, problem.into()));
        }
        if several {
            let folder = tables[0]
                .1
                .path
                .parent()
                .unwrap_or(&tables[0].1.path)
                .display()
                .to_string();
            found.notes.push(format!(
                "the {} logs in `{folder}` are of one run, in the order of time",
                tables.len()
            ));
        }
        let table = by_time(tables.into_iter().map(|(_, table)| table).collect())?;
        others.push((place, table));
    }
    others.sort_by_key(|(place, _)| *place);
    Ok(others)
}

/// The key of a run: the file or folder, the run, and the seed.
type Key = (Option<PathBuf>, String, Option<u64>);

/// The runs of some tables while they are read.
struct RunCollector<'m> {
    mapping: &'m Mapping,
    /// The groups, in the order of their first lines.
    groups: Vec<Sums>,
    places: BTreeMap<Key, usize>,
    /// Number of lines that have the values of `only`.
    counted: usize,
    not_finite: usize,
}

/// A group with the running sum of its steps.
struct Sums {
    group: LogGroup,
    sum: u64,
    /// File and time of the last added line.
    last: Option<(usize, Option<f64>)>,
}

/// A line with the table and the file in which it stands.
#[derive(Clone, Copy)]
struct LineContext<'a> {
    table: &'a LogTable,
    file: usize,
    line: &'a LogLine,
}

impl<'m> RunCollector<'m> {
    fn new(mapping: &'m Mapping) -> Self {
        Self {
            mapping,
            groups: Vec::new(),
            places: BTreeMap::new(),
            counted: 0,
            not_finite: 0,
        }
    }

    fn take(&mut self, file: usize, table: &LogTable) -> Result<(), Error> {
        if table.lines.is_empty() {
            self.group(table, None, None);
        }
        if table.names.is_empty() {
            return Ok(());
        }
        let step = steps(table, self.mapping)?;
        let keys = Keys::of(table, self.mapping)?;
        let chosen =
            MetricColumns::of(&table.names, self.mapping).map_err(|missing| table.lacks(&missing))?;
        let mut slots: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for line in table.lines.iter().filter(|line| keys.counts(table, line)) {
            self.counted += 1;
            let seed = keys.seed.map(|column| table.whole(line, column)).transpose()?;
            let run = keys.run.map(|column| table.cell(line, column).to_owned());
            let group = self.group(table, run, seed);
            if line.begins_again && self.mapping.is_own && self.mapping.restart == Some(Restart::Resume) {
                self.groups[group].group.log.begins.insert((file, line.number));
            }
            let slots = slots
                .entry(group)
                .or_insert_with(|| self.groups[group].group.slots(&chosen));
            self.line(LineContext { table, file, line }, step, (&chosen, slots), group)?;
        }
        for before in self.mapping.begins.get(&table.path).into_iter().flatten() {
            for sums in &mut self.groups {
                sums.group.log.begins.insert((file, before + 1));
            }
        }
        Ok(())
    }

    /// The group of a line; a table without lines also has one.
    fn group(&mut self, table: &LogTable, run: Option<String>, seed: Option<u64>) -> usize {
        let folder = table
            .path
            .parent()
            .filter(|_| self.mapping.run_per == Some(RunPer::Folder));
        let name = match (&run, seed, folder) {
            (Some(run), ..) => format!("run `{run}`"),
            (None, Some(seed), _) => format!("seed {seed}"),
            (None, None, Some(folder)) => format!("`{}`", folder.display()),
            (None, None, None) => format!(
                "`{}`",
                table.path.file_name().unwrap_or_default().to_string_lossy()
            ),
        };
        let alone = (run.is_none() && seed.is_none()).then(|| folder.unwrap_or(&table.path).to_owned());
        let next = self.groups.len();
        let place = *self
            .places
            .entry((alone, run.unwrap_or_default(), seed))
            .or_insert(next);
        if place == next {
            let group = LogGroup::new(name, seed, table.path.clone());
            self.groups.push(Sums {
                group,
                sum: 0,
                last: None,
            });
        }
        place
    }

    /// Adds the values of a line to its group. Programs that log metrics at different steps leave empty cells.
    fn line(
        &mut self,
        at: LineContext<'_>,
        step: usize,
        (chosen, slots): (&MetricColumns, &[usize]),
        group: usize,
    ) -> Result<(), Error> {
        let (table, line) = (at.table, at.line);
        let has_value = chosen
            .slots
            .iter()
            .any(|slot| !table.cell(line, slot.column).is_empty());
        let step = match self.mapping.step {
            Step::Sum(_) => self.groups[group].add(at, step, self.mapping)?,
            Step::Column(_) if has_value => table.whole(line, step)?,
            Step::Column(_) => return Ok(()),
        };
        for (column, slot) in chosen.slots.iter().map(|slot| slot.column).zip(slots) {
            if table.cell(line, column).is_empty() {
                continue;
            }
            let value = table.number(line, column)?;
            if value.is_finite() || self.mapping.is_own {
                let entry = LogValue {
                    place: (at.file, line.number),
                    step,
                    slot: *slot,
                    value,
                };
                self.groups[group].group.log.entries.push(entry);
            } else if self.mapping.leaves_out(LeftOut::NotFinite) {
                self.not_finite += 1;
            } else {
                let problem = format!("`{value}` is not finite: {NOT_FINITE}");
                return Err(table.wrong(line, column, &problem));
            }
        }
        Ok(())
    }

    /// Separates the runs of every group.
    fn end(self, files: &[&Content], found: &mut RunCollection) -> Result<(), Error> {
        if let Some(first) = files
            .first()
            .filter(|_| self.counted == 0 && !self.mapping.only.is_empty())
        {
            let wanted = self
                .mapping
                .only
                .iter()
                .map(|(column, value)| format!("{column}: {value}"));
            let wanted = wanted.collect::<Vec<_>>().join(", ");
            let others = if files.len() > 1 {
                format!(" of {} files", files.len())
            } else {
                String::new()
            };
            return Err(first.wrong(
                None,
                format!("no line{others} has the values of `only` ({wanted})"),
            ));
        }
        found.not_finite += self.not_finite;
        let rules = Rules::of_tables(self.mapping);
        self.groups
            .into_iter()
            .try_for_each(|sums| sums.group.end(&rules, files, found))
    }
}

impl Sums {
    /// The step of a line as the running sum of a column. A new log begins after names or a comment in the middle of a
    /// file, and where the time of a Monitor goes back.
    fn add(&mut self, at: LineContext<'_>, column: usize, mapping: &Mapping) -> Result<u64, Error> {
        let length = at.table.whole(at.line, column)?;
        let time = at
            .table
            .time()
            .map(|column| at.table.number(at.line, column))
            .transpose()?;
        let goes_on = self
            .last
            .is_none_or(|(file, last)| file == at.file && !at.line.begins_again && last <= time);
        if !goes_on && mapping.restart != Some(Restart::Resume) {
            self.group.log.begins.insert((at.file, at.line.number));
            self.sum = 0;
        }
        self.last = Some((at.file, time));
        self.sum = self.sum.saturating_add(length);
        Ok(self.sum)
    }
}

/// The column with the steps, or with their increments.
fn steps(table: &LogTable, mapping: &Mapping) -> Result<usize, Error> {
    let name = mapping.step.column();
    let found = table.column(name);
    let wrong = |problem: String| input(&table.path, table.head(), Some(name), problem);
    let is_of_episode =
        matches!(&mapping.step, Step::Column(name) if found.is_err() || name == "l" || name == "t");
    if table.is_monitor() && is_of_episode {
        let problem = "a log of the Monitor of Stable-Baselines3 has no column of steps, and lengths of episodes in `l` \
                       which add up to them: write `step: { sum: l }`, on the command line `--step-sum l`";
        return Err(wrong(problem.into()));
    }
    if *name == *Step::default().column() && !table.names.iter().any(|other| other == name) {
        table.has_names()?;
        let problem = MissingColumn::of(name, &table.names).problem;
        return Err(wrong(format!("{problem}: `step` names the one with the steps")));
    }
    found
}

#[cfg(test)]
mod tests;
