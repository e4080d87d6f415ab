//! Tables of any file format: names of columns, and lines of cells as text.

use super::{columns::MissingColumn, content::input, mapping::Mapping};
use contract::Error;
use csv::StringRecord;
use document::reach::{excerpt, quoted};
use std::path::{Path, PathBuf};

/// A table that was read.
#[derive(Debug, Default)]
pub(super) struct LogTable {
    pub(super) path: PathBuf,
    /// The line of the file with the names; 0 if every record contains them.
    pub(super) head: u64,
    pub(super) names: Vec<String>,
    pub(super) lines: Vec<LogLine>,
    /// The decimal sign of numbers.
    pub(super) decimals: Decimals,
    /// The time at which a log of the Monitor of Stable-Baselines3 begins, in seconds since 1970.
    pub(super) started: Option<f64>,
    /// Whether it was merged from the logs of several environments, in the order of time.
    pub(super) is_merged: bool,
    /// Remarks on values that were changed while reading.
    pub(super) notes: Vec<String>,
    /// Whether a program wrote it in its own trial, so that messages quote it.
    pub(super) is_own: bool,
}

/// A line of a table.
#[derive(Debug, Clone)]
pub(super) struct LogLine {
    /// Number of the line in the file, from 1.
    pub(super) number: u64,
    /// Whether names or a comment precede it, for example because a second log was appended.
    pub(super) begins_again: bool,
    /// Its cells; missing cells at the end are empty.
    pub(super) cells: StringRecord,
}

/// The decimal sign of a table's numbers.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) enum Decimals {
    /// A point; a comma in a number is an error.
    #[default]
    Point,
    /// A comma, as in `0,5`; a point in a number is ambiguous.
    Comma,
    /// Unknown: between semicolons or tabs, a comma or a point may group thousands, and no number in the table shows
    /// which.
    Unclear,
}

impl LogTable {
    pub(super) fn cell<'a>(&self, line: &'a LogLine, column: usize) -> &'a str {
        line.cells.get(column).unwrap_or_default().trim()
    }

    /// Whether it is a log of the Monitor of Stable-Baselines3: return, length and time of each episode.
    pub(super) fn is_monitor(&self) -> bool {
        let has = |name: &str| self.names.iter().any(|other| other == name);
        has("r") && has("l") && has("t")
    }

    /// The column with the time at which an episode ended, counted from the beginning of the log.
    pub(super) fn time(&self) -> Option<usize> {
        let is_log = self.is_monitor() && !self.is_merged;
        is_log.then(|| self.names.iter().position(|name| name == "t"))?
    }

    /// The index of a column.
    ///
    /// # Errors
    /// [`Error::Input`] where there is none, or two.
    pub(super) fn column(&self, name: &str) -> Result<usize, Error> {
        let mut places = (0..self.names.len()).filter(|place| self.names[*place] == name);
        match (places.next(), places.next()) {
            (Some(place), None) => Ok(place),
            (Some(_), Some(_)) => Err(self.lacks(&MissingColumn::twice(name))),
            (None, _) => Err(self.lacks(&MissingColumn::of(name, &self.names))),
        }
    }

    /// Refuses a table that has numbers in the line of its names.
    pub(super) fn has_names(&self) -> Result<(), Error> {
        if self.names.is_empty() || !self.names.iter().all(|name| name.parse::<f64>().is_ok()) {
            return Ok(());
        }
        let problem =
            "numbers stand where the names of the columns are expected: write a line of names above";
        Err(input(&self.path, self.head(), None, problem.into()))
    }

    /// The error about a column that is missing.
    pub(super) fn lacks(&self, missing: &MissingColumn) -> Error {
        self.has_names().err().unwrap_or_else(|| {
            input(
                &self.path,
                self.head(),
                Some(&missing.name),
                missing.problem.clone(),
            )
        })
    }

    /// The line with the names; `None` if they are not in a line of text.
    pub(super) fn head(&self) -> Option<u64> {
        Some(self.head).filter(|line| *line > 0)
    }

    pub(super) fn wrong(&self, line: &LogLine, column: usize, problem: &str) -> Error {
        input(
            &self.path,
            Some(line.number),
            Some(&self.names[column]),
            problem.into(),
        )
    }

    fn is_no(&self, line: &LogLine, column: usize, problem: &str) -> Error {
        let cell = self.cell(line, column);
        let shown = if self.is_own {
            excerpt(cell)
        } else {
            quoted(&self.path, cell)
        };
        self.wrong(line, column, &format!("`{shown}` {problem}"))
    }

    /// The number in a cell, which may be infinite or NaN.
    pub(super) fn number(&self, line: &LogLine, column: usize) -> Result<f64, Error> {
        let text = self.cell(line, column);
        let unclear =
            "may be a fraction or a number of thousands: write fractions with a point and no thousands apart";
        let clean = match (self.decimals, commas(text)) {
            (Decimals::Comma, Some(_)) => text.replace(',', "."),
            (Decimals::Comma, None) if text.contains('.') => return Err(self.is_no(line, column, unclear)),
            (Decimals::Unclear, Some(_)) => return Err(self.is_no(line, column, unclear)),
            (Decimals::Point, Some(true)) => {
                return Err(self.is_no(line, column, "is no number: write a decimal point"));
            }
            (Decimals::Point, Some(false)) => return Err(self.is_no(line, column, unclear)),
            _ => text.to_owned(),
        };
        clean
            .parse()
            .map_err(|_| self.is_no(line, column, "is no number"))
    }

    /// A number of steps or a seed, which some programs write as `1000.0`.
    pub(super) fn whole(&self, line: &LogLine, column: usize) -> Result<u64, Error> {
        let text = self.cell(line, column);
        if text.is_empty() {
            return Err(self.wrong(line, column, "the cell is empty, and the line has values"));
        }
        if let Ok(whole) = text.parse() {
            return Ok(whole);
        }
        if self.decimals != Decimals::Point && has_groups(text) {
            return Err(self.is_no(
                line,
                column,
                "may be a number of thousands: write it without a point",
            ));
        }
        let number = self.number(line, column)?;
        whole(number).ok_or_else(|| self.is_no(line, column, "is no whole number from 0 to 9e15"))
    }

    /// Whether a column holds a value, as text or as the same number.
    pub(super) fn is(&self, line: &LogLine, column: usize, value: &str) -> bool {
        let number = |text: &str| text.parse::<f64>().ok().map(f64::to_bits);
        let text = self.cell(line, column);
        text == value || number(value).is_some_and(|wanted| number(text) == Some(wanted))
    }
}

/// A number as a count; `None` if it is not a whole number.
pub(super) fn whole(number: f64) -> Option<u64> {
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "whole and from 0 to 9e15"
    )]
    Some(number)
        .filter(|number| number.fract() == 0.0 && (0.0..9e15).contains(number))
        .map(|number| number as u64)
}

/// Whether digits form groups of three with points between them, as in `1.000`.
pub(super) fn has_groups(text: &str) -> bool {
    let mut groups = text.split('.');
    let digits = |group: &str| !group.is_empty() && group.bytes().all(|byte| byte.is_ascii_digit());
    let first = groups
        .next()
        .is_some_and(|group| group.len() <= 3 && digits(group) && !group.starts_with('0'));
    let rest: Vec<&str> = groups.collect();
    first && !rest.is_empty() && rest.iter().all(|group| group.len() == 3 && digits(group))
}

/// Whether a number with one comma certainly has a fraction: `Some(false)` if the comma may group thousands, `None` if
/// it is not a number with one comma.
pub(super) fn commas(text: &str) -> Option<bool> {
    let (before, behind) = text.split_once(',')?;
    let (fraction, exponent) = behind.split_once(['e', 'E']).unwrap_or((behind, "0"));
    let digits = |text: &str| text.bytes().all(|byte| byte.is_ascii_digit());
    let before = before.trim_start_matches(['+', '-']);
    let is_number =
        digits(before) && !fraction.is_empty() && digits(fraction) && exponent.parse::<i32>().is_ok();
    is_number.then(|| fraction.len() != 3 || before.len() > 3 || before.is_empty() || before.starts_with('0'))
}

/// Logs of the Monitor of Stable-Baselines3 in one folder, merged as that program merges them: the episodes of all
/// environments of a run in the order of time.
pub(super) fn by_time(tables: Vec<LogTable>) -> Result<LogTable, Error> {
    let mut timed = Vec::new();
    for table in &tables {
        let time = table.column("t")?;
        for line in &table.lines {
            let passed = table.number(line, time)?;
            timed.push((table.started.unwrap_or(0.0) + passed, line.clone()));
        }
    }
    timed.sort_by(|one, other| one.0.total_cmp(&other.0));
    let mut tables = tables;
    let mut whole = tables.swap_remove(0);
    whole.path = whole.path.with_file_name("*.monitor.csv");
    whole.is_merged = true;
    whole.lines = timed.into_iter().map(|(_, line)| line).collect();
    Ok(whole)
}

/// Whether the name is one that Stable-Baselines3 gives to the log of one of several environments.
pub(super) fn is_of_environment(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let place = name.strip_suffix(".monitor.csv");
    place.is_some_and(|place| !place.is_empty() && place.bytes().all(|byte| byte.is_ascii_digit()))
}

/// The columns of a table that a mapping uses other than for metrics and steps.
pub(super) struct Keys<'m> {
    pub(super) seed: Option<usize>,
    pub(super) run: Option<usize>,
    only: Vec<(usize, &'m str)>,
}

impl<'m> Keys<'m> {
    pub(super) fn of(table: &LogTable, mapping: &'m Mapping) -> Result<Self, Error> {
        let column = |name: &Option<String>| name.as_ref().map(|name| table.column(name)).transpose();
        let only = mapping.only.iter();
        Ok(Self {
            seed: column(&mapping.seed)?,
            run: column(&mapping.run)?,
            only: only
                .map(|(name, value)| Ok((table.column(name)?, value.as_str())))
                .collect::<Result<_, Error>>()?,
        })
    }

    pub(super) fn counts(&self, table: &LogTable, line: &LogLine) -> bool {
        self.only
            .iter()
            .all(|(column, value)| table.is(line, *column, value))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_comma_is_a_fraction_or_unclear() {
        for (text, wanted) in [
            ("1,5", Some(true)),
            ("-0,125", Some(true)),
            (",5", Some(true)),
            ("1,5E+03", Some(true)),
            ("1,125", Some(false)),
            ("1234,125", Some(true)),
            ("1,2,3", None),
            ("1.234,5", None),
            ("a,b", None),
            ("1.5", None),
        ] {
            assert_eq!(commas(text), wanted, "{text}");
        }
        assert!(has_groups("1.000") && has_groups("12.000.000"));
        assert!(!has_groups("1000.0") && !has_groups("1.5") && !has_groups("1000"));
    }

    #[test]
    fn counts_are_whole_and_not_negative() {
        assert_eq!(whole(1000.0), Some(1000));
        assert!(whole(-1.0).is_none() && whole(0.5).is_none() && whole(f64::NAN).is_none());
    }

    #[test]
    fn environments_of_one_run_are_told_by_the_names_of_their_logs() {
        for (name, wanted) in [
            ("a/0.monitor.csv", true),
            ("a/monitor.csv", false),
            ("a/s0.monitor.csv", false),
        ] {
            assert_eq!(is_of_environment(Path::new(name)), wanted, "{name}");
        }
    }
}
