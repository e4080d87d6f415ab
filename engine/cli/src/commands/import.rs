//! `import`: reads files of other programs and prints the entry for a study.

use super::{Common, Format, complain, say};
use clap::Args;
use imported::{
    Columns, Copies, ImportedText, LeftOut, Mapping, Patterns, Restart, RunCollection, RunPer, SameStep, Step,
};
use serde_json::{Value, json};
use session::{Exit, Failure, Import};
use std::{collections::BTreeMap, path::PathBuf};
use study::section_yaml;

/// The log to import, and the way to read it.
#[derive(Debug, Clone, Args)]
pub(super) struct ImportOptions {
    /// Tables as CSV, JSON, JSON lines or Parquet, and event files of TensorBoard, each also packed by gzip.
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Study that will contain the entry; the entry names files relative to its folder.
    #[arg(long, value_name = "SPEC")]
    study: PathBuf,
    /// Name of the entry, which tables and claims use for the runs.
    #[arg(long, value_name = "NAME", value_parser = entry_name)]
    name: String,
    /// Metric of the study and the column or tag that holds it, as in `return=charts/episodic_return`; a pattern with
    /// `*`, or a repeated metric, takes several columns as runs.
    #[arg(long = "metric", value_name = "METRIC=COLUMN", value_parser = pair)]
    metrics: Vec<(String, String)>,
    /// Environment of the study to which the runs belong.
    #[arg(long, value_name = "NAME")]
    environment: Option<String>,
    /// Column with the step.
    #[arg(long, value_name = "COLUMN", default_value = "step")]
    step: String,
    /// Column whose running sum is the step, such as `l` in logs of the Monitor of Stable-Baselines3.
    #[arg(long, value_name = "COLUMN", conflicts_with = "step")]
    step_sum: Option<String>,
    /// Column with the seed; without it, runs are numbered.
    #[arg(long, value_name = "COLUMN")]
    seed: Option<String>,
    /// Column that distinguishes the runs of one file, if it is not the seed.
    #[arg(long, value_name = "COLUMN")]
    run: Option<String>,
    /// Files that form a run, if no column distinguishes runs: each table, or all event files of a folder.
    #[arg(long)]
    run_per: Option<RunPer>,
    /// Meaning of steps that go back.
    #[arg(long)]
    restart: Option<Restart>,
    /// Meaning of several values of a run at one step.
    #[arg(long)]
    same_step: Option<SameStep>,
    /// Leave out runs without a value, or values that are not finite.
    #[arg(long)]
    leave_out: Vec<LeftOut>,
    /// Meaning of files with the same content; where absent, they count once.
    #[arg(long)]
    copies: Option<Copies>,
    /// Only lines with this value in this column.
    #[arg(long, value_name = "COLUMN=VALUE", value_parser = pair)]
    only: Vec<(String, String)>,
    /// Number of a run's last values that are averaged to its final value.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..))]
    last: u64,
    /// Origin of the runs, with version and address.
    #[arg(long, value_name = "TEXT", default_value = "")]
    about: String,
    /// Copy the files to `imported/NAME` beside the study, with a manifest of their origins.
    #[arg(long)]
    copy: bool,
}

fn pair(text: &str) -> Result<(String, String), String> {
    let (name, value) = text
        .split_once('=')
        .filter(|(name, _)| !name.is_empty())
        .ok_or("write NAME=COLUMN")?;
    Ok((name.to_owned(), value.to_owned()))
}

fn entry_name(text: &str) -> Result<String, String> {
    let mut letters = text.chars();
    let first = letters
        .next()
        .is_some_and(|letter| letter.is_ascii_alphabetic() || letter == '_');
    let rest = letters.all(|letter| letter.is_ascii_alphanumeric() || "_-".contains(letter));
    if first && rest {
        Ok(text.to_owned())
    } else {
        Err("use letters, digits, `_` and `-`, and begin with a letter or `_`".into())
    }
}

/// Prints the entry; exit code 2 if the files do not match the options.
pub(super) fn import(options: &ImportOptions, common: &Common) -> Result<Exit, Failure> {
    let import = Import {
        study: &options.study,
        name: &options.name,
        files: &options.files,
        reading: options.reading(),
        copies: options.copy,
    };
    if options.metrics.is_empty() {
        let columns = import.columns().map_err(with_options)?;
        return Err(Failure::refusal(question(&columns)));
    }
    let (entry, found) = import.read().map_err(with_options)?;
    match common.format {
        Format::Json => say(&as_json(options, &entry, &found).to_string()),
        Format::Text => {
            complain(&summary(options, &found, &entry.mapping()));
            say(&section_yaml("imported", json!({ options.name.clone(): entry }))?);
        }
    }
    Ok(Exit::Ok)
}

/// Adds the options of the command line to a failure that names keys of an entry.
fn with_options(mut failure: Failure) -> Failure {
    let keys = ["restart: ", "same_step: ", "run_per: ", "leave_out: "];
    if keys.iter().any(|key| failure.text.contains(&format!("`{key}"))) {
        failure.text.push_str(
            "\n  = help: on the command line keys are options, as in `--restart new_run` and `--leave-out empty`",
        );
    }
    failure
}

/// Asks for the columns of metrics, with an example option.
fn question(columns: &Columns) -> String {
    let (names, example) = columns.for_a_question();
    let column = example.unwrap_or("COLUMN");
    let is_plain = |letter: char| letter.is_ascii_alphanumeric() || "_-./:@".contains(letter);
    let quote = if column.chars().all(is_plain) { "" } else { "'" };
    let sum = if columns.is_monitor { " --step-sum l" } else { "" };
    format!(
        "say which column or tag holds which metric of the study, as in `--metric {quote}return={column}{quote}{sum}`; there \
         are {}",
        if names.is_empty() { "none" } else { &names }
    )
}

impl ImportOptions {
    /// The entry without its files.
    fn reading(&self) -> ImportedText {
        let only = self
            .only
            .iter()
            .map(|(column, value)| (column.clone(), json!(value)));
        let mut metrics: BTreeMap<String, Vec<String>> = BTreeMap::new();
        for (metric, column) in &self.metrics {
            metrics.entry(metric.clone()).or_default().push(column.clone());
        }
        ImportedText {
            from: Patterns::from(Vec::new()),
            environment: self.environment.clone(),
            metrics: metrics
                .into_iter()
                .map(|(metric, columns)| (metric, Patterns::from(columns)))
                .collect(),
            step: self
                .step_sum
                .as_ref()
                .map_or_else(|| Step::Column(self.step.clone()), |column| Step::sum_of(column)),
            seed: self.seed.clone(),
            run: self.run.clone(),
            run_per: self.run_per,
            restart: self.restart,
            same_step: self.same_step,
            leave_out: self.leave_out.iter().copied().collect(),
            copies: self.copies,
            only: only.collect(),
            last: self.last,
            about: self.about.clone(),
        }
    }
}

/// The runs, a line each.
fn summary(options: &ImportOptions, found: &RunCollection, mapping: &Mapping) -> String {
    let count = |n: usize, one: &str| {
        if n == 1 {
            format!("1 {one}")
        } else {
            format!("{n} {one}s")
        }
    };
    let (runs, files) = (count(found.runs.len(), "run"), count(found.files.len(), "file"));
    let mut lines = vec![format!("{}: {runs} in {files}", options.name)];
    for run in &found.runs {
        let told = |seed: &u64| run.name != format!("seed {seed}");
        let seed = run
            .seed
            .filter(told)
            .map_or_else(String::new, |seed| format!(", seed {seed}"));
        let curves = run.curves.iter().map(|(metric, curve)| {
            let last = curve.iter().max_by_key(|(step, _)| *step);
            let end = last.map_or_else(String::new, |(step, value)| format!(", {value} at step {step}"));
            format!("{} values of {metric}{end}", curve.len())
        });
        lines.push(format!(
            "  {}{seed}: {}",
            run.name,
            curves.collect::<Vec<_>>().join("; ")
        ));
    }
    lines.extend(
        found
            .said(mapping)
            .into_iter()
            .map(|note| format!("  note: {note}")),
    );
    lines.join("\n")
}

/// The entry, and every value that was read.
fn as_json(options: &ImportOptions, text: &ImportedText, found: &RunCollection) -> Value {
    let runs = found.runs.iter().map(|run| {
        let counts: BTreeMap<&String, usize> = run
            .curves
            .iter()
            .map(|(metric, curve)| (metric, curve.len()))
            .collect();
        json!({ "run": run.name, "seed": run.seed, "values": counts, "curves": run.curves })
    });
    let files = found
        .files
        .iter()
        .map(|(path, sha256)| json!({ "file": path, "sha256": sha256 }));
    json!({
        "imported": { options.name.clone(): text }, "runs": runs.collect::<Vec<_>>(), "files": files.collect::<Vec<_>>(), "notes": found.said(&text.mapping()),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_example_names_a_column_that_is_there() {
        let columns = |names: &[&str], is_monitor| Columns {
            names: names.iter().map(|it| (*it).to_owned()).collect(),
            is_monitor,
            ..Columns::default()
        };
        assert!(question(&columns(&["r", "l", "t"], true)).contains("`--metric return=r --step-sum l`"));
        let told = question(&columns(&["Step", "ppo - x"], false));
        assert!(
            told.contains("`--metric 'return=ppo - x'`; there are Step, ppo - x"),
            "{told}"
        );
    }

    #[test]
    fn pairs_and_names_are_held_against_their_form() {
        assert_eq!(
            pair("return=charts/a=b"),
            Ok(("return".into(), "charts/a=b".into()))
        );
        assert!(pair("return").is_err() && pair("=x").is_err());
        assert!(entry_name("clean-rl_2").is_ok() && entry_name("2nd").is_err() && entry_name("a/b").is_err());
    }
}
