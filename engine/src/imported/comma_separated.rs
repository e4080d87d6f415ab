//! Runs in CSV files: a line for every step, a column for every metric.

use super::{Content, Mapping, Run, input};
use crate::{Error, diagnostic::nearest};
use std::collections::BTreeMap;

/// The runs of all files together, in the order in which they begin. Without a column that tells runs apart every file
/// is one.
pub(super) fn runs(files: &[&Content], mapping: &Mapping) -> Result<Vec<Run>, Error> {
    let (mut runs, mut places): (Vec<Run>, BTreeMap<Key, Place>) = (Vec::new(), BTreeMap::new());
    for (file, place) in files.iter().zip(0..) {
        let head = columns(file)?;
        let mut reader = csv::Reader::from_reader(file.bytes.as_slice());
        let chosen = Columns::of(file, &head, mapping)?;
        let before = runs.len();
        let mut counted = 0;
        for record in reader.records() {
            let record = record.map_err(|error| wrong(file, &error))?;
            let line = Line {
                file,
                number: record.position().map_or(0, csv::Position::line),
                head: &head,
                record: &record,
            };
            if chosen.only.iter().all(|(column, value)| line.is(*column, value)) {
                counted += 1;
                chosen.take(&line, place, &mut runs, &mut places)?;
            }
        }
        if counted == 0 && before == runs.len() {
            let problem = if mapping.only.is_empty() {
                "it has no line"
            } else {
                "no line has the values of `only`"
            };
            return Err(input(&file.path, None, None, problem.into()));
        }
    }
    match places.values().find_map(|place| Some((place, place.apart()?))) {
        Some((place, apart)) => Err(two_runs(&runs[place.run], apart.map(|file| files[file]))),
        None => Ok(runs),
    }
}

fn two_runs(run: &Run, [one, other]: [&Content; 2]) -> Error {
    let problem = format!(
        "has steps of {} that `{}` has, too: where these are two runs, name the column that tells them apart under `run`, or \
         leave out `seed`, so that every file is a run",
        run.name,
        one.path.display()
    );
    input(&other.path, None, None, problem)
}

/// The names of a file's columns.
pub(super) fn columns(file: &Content) -> Result<Vec<String>, Error> {
    let mut reader = csv::Reader::from_reader(file.bytes.as_slice());
    let head = reader.headers().map_err(|error| wrong(file, &error))?;
    Ok(head.iter().map(|name| name.trim().to_owned()).collect())
}

/// What tells runs apart: the file where nothing else does, the run, and the seed.
type Key = (Option<usize>, String, Option<u64>);

/// What the files have of a run.
struct Place {
    /// Its index among the runs.
    run: usize,
    /// First and last step of each file that has some of it, by the index of the file.
    parts: BTreeMap<usize, (u64, u64)>,
}

impl Place {
    fn takes(&mut self, file: usize, step: u64) {
        let (first, last) = self.parts.entry(file).or_insert((step, step));
        (*first, *last) = ((*first).min(step), (*last).max(step));
    }

    /// Two files of which neither goes on where the other ends, so that they are of two runs.
    fn apart(&self) -> Option<[usize; 2]> {
        let mut parts: Vec<(u64, u64, usize)> = self
            .parts
            .iter()
            .map(|(file, (first, last))| (*first, *last, *file))
            .collect();
        parts.sort_unstable();
        // A run that goes on repeats the step at which it stopped.
        let begins_again = |pair: &&[(u64, u64, usize)]| pair[1].0 < pair[0].1 || pair[1].0 == pair[0].0;
        let pair = parts.windows(2).find(begins_again)?;
        Some([pair[0].2, pair[1].2])
    }
}

fn wrong(file: &Content, error: &csv::Error) -> Error {
    let line = error.position().map(csv::Position::line);
    input(&file.path, line, None, error.to_string())
}

/// Which columns hold what.
struct Columns<'m> {
    step: usize,
    seed: Option<usize>,
    run: Option<usize>,
    metrics: Vec<(&'m String, usize)>,
    only: Vec<(usize, &'m String)>,
}

impl<'m> Columns<'m> {
    fn of(file: &Content, head: &[String], mapping: &'m Mapping) -> Result<Self, Error> {
        let column = |name: &String| {
            let found = head.iter().position(|known| known == name);
            found.ok_or_else(|| {
                let known: Vec<&str> = head.iter().map(String::as_str).collect();
                let near =
                    nearest(name, &known).map_or_else(String::new, |near| format!("did you mean `{near}`? "));
                let problem = format!(
                    "there is no such column; {near}its columns are {}",
                    known.join(", ")
                );
                input(&file.path, Some(1), Some(name), problem)
            })
        };
        let metric = |(metric, name): (&'m String, &String)| Ok((metric, column(name)?));
        let only = |(name, value): (&String, &'m String)| Ok((column(name)?, value));
        Ok(Self {
            step: column(&mapping.step)?,
            seed: mapping.seed.as_ref().map(column).transpose()?,
            run: mapping.run.as_ref().map(column).transpose()?,
            metrics: mapping.metrics.iter().map(metric).collect::<Result<_, Error>>()?,
            only: mapping.only.iter().map(only).collect::<Result<_, Error>>()?,
        })
    }

    /// Adds what a line holds to its run.
    fn take(
        &self,
        line: &Line<'_>,
        file: usize,
        runs: &mut Vec<Run>,
        places: &mut BTreeMap<Key, Place>,
    ) -> Result<(), Error> {
        let seed = self.seed.map(|column| line.whole(column)).transpose()?;
        let name = self.run.map(|column| line.text(column).to_owned());
        let alone = name.is_none() && seed.is_none();
        let key = (alone.then_some(file), name.clone().unwrap_or_default(), seed);
        let step = line.whole(self.step)?;
        let place = places.entry(key).or_insert_with(|| {
            runs.push(Run {
                name: line.run(name.as_deref(), seed),
                seed,
                ..Run::default()
            });
            Place {
                run: runs.len() - 1,
                parts: BTreeMap::new(),
            }
        });
        place.takes(file, step);
        let place = place.run;
        for (metric, column) in &self.metrics {
            // Programs that log metrics at different steps leave gaps.
            if !line.text(*column).is_empty() {
                let curve = runs[place].curves.entry((*metric).clone()).or_default();
                curve.push((step, line.number(*column)?));
            }
        }
        Ok(())
    }
}

/// A line of a file.
struct Line<'a> {
    file: &'a Content,
    number: u64,
    head: &'a [String],
    record: &'a csv::StringRecord,
}

impl Line<'_> {
    fn text(&self, column: usize) -> &str {
        self.record.get(column).unwrap_or_default().trim()
    }

    fn wrong(&self, column: usize, problem: &str) -> Error {
        let problem = format!("`{}` {problem}", self.text(column));
        input(
            &self.file.path,
            Some(self.number),
            Some(&self.head[column]),
            problem,
        )
    }

    fn number(&self, column: usize) -> Result<f64, Error> {
        let number: f64 = self
            .text(column)
            .parse()
            .map_err(|_| self.wrong(column, "is no number"))?;
        if number.is_finite() {
            Ok(number)
        } else {
            Err(self.wrong(
                column,
                "is not finite: leave the cell empty where nothing was measured",
            ))
        }
    }

    /// A number of steps or a seed, which some programs write as `1000.0`.
    fn whole(&self, column: usize) -> Result<u64, Error> {
        let text = self.text(column);
        if let Ok(whole) = text.parse() {
            return Ok(whole);
        }
        let number = text
            .parse::<f64>()
            .ok()
            .filter(|number| number.fract() == 0.0 && (0.0..9e15).contains(number));
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "whole and from 0 to 9e15"
        )]
        number
            .map(|number| number as u64)
            .ok_or_else(|| self.wrong(column, "is no whole number from 0 on"))
    }

    /// Whether a column holds a value, as text or as the same number.
    fn is(&self, column: usize, value: &str) -> bool {
        let number = |text: &str| text.parse::<f64>().ok().map(f64::to_bits);
        self.text(column) == value
            || number(value).is_some_and(|wanted| number(self.text(column)) == Some(wanted))
    }

    fn run(&self, name: Option<&str>, seed: Option<u64>) -> String {
        match (name, seed) {
            (Some(name), _) => format!("run `{name}`"),
            (None, Some(seed)) => format!("seed {seed}"),
            (None, None) => format!(
                "`{}`",
                self.file.path.file_name().unwrap_or_default().to_string_lossy()
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn content(name: &str, text: &str) -> Content {
        Content {
            path: name.into(),
            bytes: text.as_bytes().to_vec(),
        }
    }

    fn mapping() -> Mapping {
        Mapping {
            metrics: [("return".to_owned(), "charts/episodic_return".to_owned())].into(),
            step: "global_step".into(),
            ..Mapping::default()
        }
    }

    fn refused(text: &str, mapping: &Mapping) -> String {
        runs(&[&content("a.csv", text)], mapping).unwrap_err().to_string()
    }

    const LONG: &str =
        "global_step,seed,env,charts/episodic_return\n0,1,a,1.5\n100.0,1,a,\n200,1,a,2.5\n0,2,b,7\n0,3,a,4\n";

    #[test]
    fn a_file_is_a_run_unless_a_column_tells_runs_apart() {
        let (one, two) = (content("a.csv", LONG), content("b.csv", LONG));
        let whole = runs(&[&one, &two], &mapping()).unwrap();
        assert_eq!(
            whole.iter().map(|run| run.name.as_str()).collect::<Vec<_>>(),
            ["`a.csv`", "`b.csv`"]
        );
        let by_seed = Mapping {
            seed: Some("seed".into()),
            ..mapping()
        };
        let found = runs(&[&one], &by_seed).unwrap();
        let seeds: Vec<_> = found.iter().map(|run| run.seed).collect();
        assert_eq!(seeds, [Some(1), Some(2), Some(3)]);
        assert_eq!(found[0].curves["return"], [(0, 1.5), (200, 2.5)]);
        let in_a = Mapping {
            only: [("env".to_owned(), "a".to_owned())].into(),
            ..by_seed
        };
        assert_eq!(runs(&[&one], &in_a).unwrap().len(), 2);
    }

    #[test]
    fn a_run_goes_on_in_another_file_and_does_not_begin_there_again() {
        let (one, later) = (
            content("a.csv", LONG),
            content(
                "b.csv",
                "global_step,seed,env,charts/episodic_return\n300,1,a,3\n",
            ),
        );
        let by = |run: Option<&str>, seed: Option<&str>| Mapping {
            run: run.map(Into::into),
            seed: seed.map(Into::into),
            ..mapping()
        };
        for (by, last) in [(by(Some("env"), None), 300), (by(None, Some("seed")), 300)] {
            let found = runs(&[&one, &later], &by).unwrap();
            assert_eq!(found[0].curves["return"].last().unwrap().0, last);
        }
        // Whatever the order of their names, and where the last step stands in both.
        let by_seed = by(None, Some("seed"));
        assert_eq!(runs(&[&later, &one], &by_seed).unwrap().len(), 3);
        let file = |name: &str, steps: [u32; 2]| {
            let [first, last] = steps.map(|step| format!("{step},1,a,3\n"));
            content(
                name,
                &format!("global_step,seed,env,charts/episodic_return\n{first}{last}"),
            )
        };
        assert_eq!(
            runs(&[&one, &file("c.csv", [200, 400])], &by_seed).unwrap().len(),
            3
        );
        for steps in [[0, 400], [100, 150], [0, 0]] {
            let refused = runs(&[&one, &file("c.csv", steps)], &by_seed)
                .unwrap_err()
                .to_string();
            assert!(refused.contains("has steps of seed 1 that `"), "{refused}");
        }
    }

    #[test]
    fn numbers_in_only_are_compared_as_numbers() {
        let two = Mapping {
            only: [("seed".to_owned(), "2.0".to_owned())].into(),
            ..mapping()
        };
        assert_eq!(
            runs(&[&content("a.csv", LONG)], &two).unwrap()[0].curves["return"],
            [(0, 7.0)]
        );
        let none = Mapping {
            only: [("seed".to_owned(), "9".to_owned())].into(),
            ..mapping()
        };
        assert!(refused(LONG, &none).contains("no line has the values of `only`"));
    }

    #[test]
    fn what_is_wrong_is_named_with_its_place() {
        let columns = refused("global_step,episodic_return\n0,1\n", &mapping());
        assert!(
            columns.contains("column `charts/episodic_return`: there is no such column"),
            "{columns}"
        );
        let number = refused("global_step,charts/episodic_return\n0,1\n5,high\n", &mapping());
        assert!(
            number.contains("`a.csv`, line 3, column `charts/episodic_return`: `high` is no number"),
            "{number}"
        );
        let step = refused("global_step,charts/episodic_return\n-1,1\n", &mapping());
        assert!(step.contains("`-1` is no whole number"), "{step}");
        assert!(refused("global_step,charts/episodic_return\n1,NaN\n", &mapping()).contains("is not finite"));
        assert!(refused("global_step,charts/episodic_return\n", &mapping()).contains("it has no line"));
        assert!(refused("global_step,charts/episodic_return\n1,2,3\n", &mapping()).contains("line 2"));
    }
}
