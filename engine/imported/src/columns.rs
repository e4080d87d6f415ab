//! The columns or tags that hold the metrics of a study: one for each metric, or several that are runs of one metric.

use super::mapping::{Mapping, Patterns};
use super::pattern::parts;
use document::{diagnostic::nearest, reach};

/// The columns of a file that hold metrics.
#[derive(Debug, PartialEq)]
pub(super) struct MetricColumns {
    /// The runs of the file, by the column of each; one run without a name if columns are not runs.
    pub(super) runs: Vec<Option<String>>,
    /// The columns, each with its run and its metric.
    pub(super) slots: Vec<Slot>,
}

/// A column that holds a metric of a run.
#[derive(Debug, PartialEq)]
pub(super) struct Slot {
    pub(super) run: usize,
    pub(super) metric: String,
    pub(super) column: usize,
}

/// A column that is missing or ambiguous.
#[derive(Debug, PartialEq)]
pub(super) struct MissingColumn {
    pub(super) name: String,
    pub(super) problem: String,
}

impl MissingColumn {
    pub(super) fn of(name: &str, known: &[String]) -> Self {
        let ends = |column: &&String| column.ends_with(name) && !is_bound(column, known);
        let near = if known.iter().filter(ends).count() > 1 {
            format!("`*{name}` takes several columns, a run each; ")
        } else {
            let plain: Vec<&str> = known
                .iter()
                .map(String::as_str)
                .filter(|it| !is_bound(it, known))
                .collect();
            nearest(name, &plain).map_or_else(String::new, |near| format!("did you mean `{near}`? "))
        };
        let problem = if known.is_empty() {
            "there is no such column, and no other one".into()
        } else {
            format!("there is no such column; {near}its columns are {}", named(known))
        };
        Self {
            name: name.into(),
            problem,
        }
    }

    pub(super) fn twice(name: &str) -> Self {
        let problem = "two columns have this name: rename one of them in the file".into();
        Self {
            name: name.into(),
            problem,
        }
    }

    fn because(name: &str, problem: impl Into<String>) -> Self {
        Self {
            name: name.into(),
            problem: problem.into(),
        }
    }
}

/// Names of columns for a message. A file with one column may not be a table at all, so its text is cut.
pub(super) fn named(names: &[String]) -> String {
    const MOST: usize = 20;
    if let [one] = names {
        return reach::excerpt(one);
    }
    let shown = |name: &String| -> String {
        name.chars()
            .filter(|letter| !letter.is_control())
            .take(80)
            .collect()
    };
    let more = if names.len() > MOST { ", …" } else { "" };
    // The index column that pandas writes has no name.
    let named = names.iter().filter(|name| !name.is_empty());
    named.take(MOST).map(shown).collect::<Vec<_>>().join(", ") + more
}

/// Whether a column is one of the two that W&B adds to a column for the minimum and maximum of merged values.
pub(super) fn is_bound(name: &str, known: &[String]) -> bool {
    let of = name.strip_suffix("__MIN").or_else(|| name.strip_suffix("__MAX"));
    of.is_some_and(|of| known.iter().any(|other| other == of))
}

impl MetricColumns {
    /// The columns that hold the metrics among `known`.
    ///
    /// # Errors
    /// The column that is missing, occurs twice, or belongs to no run.
    pub(super) fn of(known: &[String], mapping: &Mapping) -> Result<Self, MissingColumn> {
        let mut chosen = Self {
            runs: Vec::new(),
            slots: Vec::new(),
        };
        let mut keys: Option<(Vec<String>, &str)> = None;
        for (metric, columns) in &mapping.metrics {
            let found = expand(known, columns)?;
            let ours: Vec<String> = found.iter().map(|(key, _)| key.clone()).collect();
            match &keys {
                None => {
                    chosen.runs = found
                        .iter()
                        .map(|(key, place)| (!key.is_empty()).then(|| known[*place].clone()))
                        .collect();
                    keys = Some((ours.clone(), metric));
                }
                Some((theirs, other)) if !same(theirs, &ours) => {
                    let problem = format!(
                        "`{metric}` has {} columns and `{other}` {}, or they are of other runs: every run takes one column of each",
                        ours.len(),
                        theirs.len()
                    );
                    return Err(MissingColumn::because(&columns.all()[0], problem));
                }
                Some(_) => {}
            }
            let (order, _) = keys
                .as_ref()
                .map_or((&ours, ""), |(keys, metric)| (keys, *metric));
            for (key, column) in found {
                let run = order.iter().position(|other| *other == key).unwrap_or(0);
                chosen.slots.push(Slot {
                    run,
                    metric: metric.clone(),
                    column,
                });
            }
        }
        let by_column = chosen.runs.iter().any(Option::is_some);
        match (&mapping.seed, &mapping.run) {
            (Some(column), _) | (_, Some(column)) if by_column => Err(MissingColumn::because(
                column,
                "columns of `metrics` are the runs, so that no column tells runs apart: leave `seed` and `run` out",
            )),
            _ => Ok(chosen),
        }
    }
}

fn same(one: &[String], other: &[String]) -> bool {
    one.len() == other.len() && other.iter().all(|key| one.contains(key))
}

/// The columns of a metric, each with a key that distinguishes runs: an empty text for a single column, the position in
/// a list, or the parts that the stars of a pattern stand for.
fn expand(known: &[String], columns: &Patterns) -> Result<Vec<(String, usize)>, MissingColumn> {
    match columns {
        Patterns::One(name) => match place(known, name) {
            Err(_) if name.contains('*') => matching(known, name),
            found => Ok(vec![(String::new(), found?)]),
        },
        Patterns::Several(names) => {
            let mut all = Vec::new();
            for name in names {
                let found = expand(known, &Patterns::One(name.clone()))?;
                all.extend(found.into_iter().map(|(_, column)| column));
            }
            Ok(all
                .into_iter()
                .enumerate()
                .map(|(at, column)| (format!("column {at}"), column))
                .collect())
        }
    }
}

fn place(known: &[String], name: &str) -> Result<usize, MissingColumn> {
    let mut places = (0..known.len()).filter(|place| known[*place] == name);
    match (places.next(), places.next()) {
        (Some(place), None) => Ok(place),
        (Some(_), Some(_)) => Err(MissingColumn::twice(name)),
        (None, _) => Err(MissingColumn::of(name, known)),
    }
}

fn matching(known: &[String], pattern: &str) -> Result<Vec<(String, usize)>, MissingColumn> {
    let mut found: Vec<(String, usize)> = Vec::new();
    for (at, name) in known
        .iter()
        .enumerate()
        .filter(|(_, name)| !is_bound(name, known))
    {
        let Some(key) = parts(pattern, name) else { continue };
        place(known, name)?;
        found.push((key.join("\u{0}") + "\u{0}", at));
    }
    if found.is_empty() {
        let problem = format!("no column fits this pattern; the columns are {}", named(known));
        return Err(MissingColumn::because(pattern, problem));
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn known() -> Vec<String> {
        let names = [
            "Step",
            "ppo__1 - charts/return",
            "ppo__1 - charts/return__MIN",
            "ppo__1 - charts/return__MAX",
            "ppo__2 - charts/return",
            "ppo__2 - charts/return__MIN",
            "ppo__2 - charts/length",
            "ppo__1 - charts/length",
        ];
        names.map(String::from).to_vec()
    }

    fn chosen(metrics: &[(&str, Patterns)]) -> Result<Vec<(usize, usize)>, String> {
        let metrics = metrics
            .iter()
            .map(|(metric, columns)| ((*metric).to_owned(), columns.clone()));
        let mapping = Mapping {
            metrics: metrics.collect(),
            ..Mapping::default()
        };
        let chosen = MetricColumns::of(&known(), &mapping).map_err(|missing| missing.problem)?;
        Ok(chosen.slots.iter().map(|slot| (slot.run, slot.column)).collect())
    }

    #[test]
    fn a_pattern_or_a_list_takes_several_columns_and_no_bounds() {
        let pattern = Patterns::from("ppo__* - charts/return*");
        assert_eq!(chosen(&[("return", pattern)]), Ok(vec![(0, 1), (1, 4)]));
        let list = Patterns::from(vec![known()[4].clone(), known()[1].clone()]);
        assert_eq!(chosen(&[("return", list)]), Ok(vec![(0, 4), (1, 1)]));
        assert_eq!(
            chosen(&[("return", "ppo__1 - charts/return__MIN".into())]),
            Ok(vec![(0, 2)])
        );
    }

    #[test]
    fn columns_of_several_metrics_are_paired_by_their_run() {
        let both = [
            ("length", "* - charts/length".into()),
            ("return", "* - charts/return".into()),
        ];
        assert_eq!(chosen(&both), Ok(vec![(0, 6), (1, 7), (1, 1), (0, 4)]));
        let one = [
            ("length", "ppo__1 - charts/length".into()),
            ("return", "* - charts/return".into()),
        ];
        assert!(
            chosen(&one)
                .unwrap_err()
                .contains("`return` has 2 columns and `length` 1")
        );
    }

    #[test]
    fn advice_names_columns_that_are_there() {
        let told = MissingColumn::of("charts/return", &known()).problem;
        assert!(
            told.contains("`*charts/return` takes several columns, a run each"),
            "{told}"
        );
        assert!(
            chosen(&[("return", "a*".into())])
                .unwrap_err()
                .contains("no column fits this pattern")
        );
        let twice = ["x", "x"].map(String::from);
        assert!(
            place(&twice, "x")
                .unwrap_err()
                .problem
                .contains("two columns have this name")
        );
        assert_eq!(
            named(&["root:x:0:0:root:/root:/bin/bash".into()]),
            "root:x:0:0:root:/roo…"
        );
    }
}
