//! `import`: looks into files of other programs and writes the entry that a study names them with.

use super::{Common, Format, complain, say};
use clap::Args;
use contract::Error;
use execution::{
    store::{self, write_durably},
    world::fs,
};
use imported::{
    Columns, Copies, Found, ImportedText, LeftOut, Mapping, Patterns, Restart, RunPer, SameStep, Step,
    columns, read,
};
use serde_json::{Value, json};
use session::{Exit, Failure, Whole};
use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Component, Path, PathBuf},
};
use study::{name_from, section_yaml};

/// What is imported, and how it is read.
#[derive(Debug, Clone, Args)]
pub(super) struct ImportOptions {
    /// Tables as CSV, JSON, JSON lines or Parquet, and event files of TensorBoard, each also packed by gzip.
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Study that shall name them; the entry names files as seen from its folder.
    #[arg(long, value_name = "SPEC")]
    study: PathBuf,
    /// Name of the entry, by which tables and claims speak of the runs.
    #[arg(long, value_name = "NAME", value_parser = entry_name)]
    name: String,
    /// Metric of the study and the column or tag that holds it, as in `return=charts/episodic_return`; a pattern
    /// with `*`, or one metric several times, takes several columns as runs.
    #[arg(long = "metric", value_name = "METRIC=COLUMN", value_parser = pair)]
    metrics: Vec<(String, String)>,
    /// Environment of the study that the runs are of.
    #[arg(long, value_name = "NAME")]
    environment: Option<String>,
    /// Column with the step.
    #[arg(long, value_name = "COLUMN", default_value = "step")]
    step: String,
    /// Column whose running sum is the step, as `l` of a Monitor of Stable-Baselines3.
    #[arg(long, value_name = "COLUMN", conflicts_with = "step")]
    step_sum: Option<String>,
    /// Column with the seed; without it runs are numbered.
    #[arg(long, value_name = "COLUMN")]
    seed: Option<String>,
    /// Column that tells the runs of one file apart, where that is not the seed.
    #[arg(long, value_name = "COLUMN")]
    run: Option<String>,
    /// Files that make a run, where no column tells runs apart: each a table of its own, all event files of a folder.
    #[arg(long)]
    run_per: Option<RunPer>,
    /// Meaning of steps that go back.
    #[arg(long)]
    restart: Option<Restart>,
    /// Meaning of several values of a run at one step.
    #[arg(long)]
    same_step: Option<SameStep>,
    /// Runs without a value, or values that are not finite, are left out.
    #[arg(long)]
    leave_out: Vec<LeftOut>,
    /// Meaning of files with the same content, which otherwise count once.
    #[arg(long)]
    copies: Option<Copies>,
    /// Only lines with this value in this column.
    #[arg(long, value_name = "COLUMN=VALUE", value_parser = pair)]
    only: Vec<(String, String)>,
    /// How many of a run's last values are averaged to its final one.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..))]
    last: u64,
    /// Whose runs they are, with version and address.
    #[arg(long, value_name = "TEXT", default_value = "")]
    about: String,
    /// Copy the files to `imported/NAME` beside the study, with a manifest of where they came from.
    #[arg(long)]
    copy: bool,
}

/// Name of the file that says where copies came from.
const MANIFEST: &str = "manifest.json";

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

/// Files that are named wrongly are a mistake of the command line.
fn unread(error: contract::Error) -> Failure {
    let told = error.to_string();
    let keys = ["restart: ", "same_step: ", "run_per: ", "leave_out: "];
    let names_a_key = keys.iter().any(|key| told.contains(&format!("`{key}")));
    let help = if names_a_key {
        "\n  = help: on the command line keys are options, as in `--restart new_run` and `--leave-out empty`"
    } else {
        ""
    };
    Failure::refusal(told + help)
}

/// 2 where the files are not as the options say; it prints the entry.
pub(super) fn import(options: &ImportOptions, common: &Common) -> Result<Exit, Failure> {
    if !fs::is_file(&options.study) {
        return Err(Failure::refusal(format!(
            "there is no study `{}`",
            options.study.display()
        )));
    }
    if options.metrics.is_empty() {
        return Err(Failure::refusal(question(
            &columns(&options.files).map_err(unread)?,
        )));
    }
    let mut files = options.files.clone();
    files.sort();
    let mapping = options.text(Vec::new()).mapping();
    let found = read(&files, &mapping).map_err(unread)?;
    // Numbers of seeds are checked as the study checks them.
    found
        .trials(&options.name, "", 0, &mapping)
        .map_err(Failure::refusal)?;
    let folder = options.study.parent().unwrap_or(Path::new(""));
    let named = if options.copy {
        options.copied(folder, &found)?
    } else {
        files
    };
    let from = named
        .iter()
        .map(|path| name_from(folder, path).display().to_string())
        .collect();
    let text = options.text(from);
    match common.format {
        Format::Json => say(&as_json(options, &text, &found).to_string()),
        Format::Text => {
            complain(&summary(options, &found, &mapping));
            say(&section_yaml("imported", json!({ options.name.clone(): text }))?);
        }
    }
    Ok(Exit::Ok)
}

/// Asks which column is which metric, with an example that can be written.
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
    /// The entry with these files.
    fn text(&self, from: Vec<String>) -> ImportedText {
        let only = self
            .only
            .iter()
            .map(|(column, value)| (column.clone(), json!(value)));
        let mut metrics: BTreeMap<String, Vec<String>> = BTreeMap::new();
        for (metric, column) in &self.metrics {
            metrics.entry(metric.clone()).or_default().push(column.clone());
        }
        ImportedText {
            from: Patterns::from(from),
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

    /// Copies the files beside the study; the folder appears whole or not at all.
    fn copied(&self, beside: &Path, found: &Found) -> Result<Vec<PathBuf>, Failure> {
        let folder = beside.join("imported").join(&self.name);
        let whole = Whole::begin(&folder)?;
        let (mut taken, mut listed) = (BTreeSet::new(), Vec::new());
        let shared = shared_folder(found.files.iter().map(|(path, _)| path.as_path()));
        for (path, sha256) in &found.files {
            let name = kept_name(path, &shared);
            if !taken.insert(name.clone()) {
                return Err(Failure::refusal(format!(
                    "two files are called `{}`; rename one, or import without --copy",
                    name.display()
                )));
            }
            let bytes = fs::read(path).map_err(Error::file("read", path))?;
            let to = whole.folder().join(&name);
            let parent = to.parent().unwrap_or(whole.folder());
            fs::create_dir_all(parent).map_err(Error::file("create", parent))?;
            write_durably(&to, &bytes)?;
            listed.push(json!({ "file": name, "source": path, "sha256": sha256 }));
        }
        let manifest = json!({
            "schema": 1, "entry": self.name, "about": self.about, "imported_at": store::now(), "files": listed,
            "read": self.text(Vec::new()).mapping(),
        });
        write_durably(
            &whole.folder().join(MANIFEST),
            format!("{manifest:#}\n").as_bytes(),
        )?;
        whole.end()?;
        Ok(taken.into_iter().map(|name| folder.join(name)).collect())
    }
}

/// The folder in which all files lie, at some depth.
fn shared_folder<'a>(files: impl Iterator<Item = &'a Path>) -> PathBuf {
    let folders = files.map(|file| file.parent().unwrap_or(Path::new("")).to_owned());
    let shared = |one: PathBuf, other: PathBuf| {
        let same = one
            .components()
            .zip(other.components())
            .take_while(|(one, other)| one == other);
        same.map(|(part, _)| part).collect()
    };
    folders.reduce(shared).unwrap_or_default()
}

/// Files keep the folders in which they differ, which may be all that tells runs apart; event files keep one at least.
fn kept_name(path: &Path, shared: &Path) -> PathBuf {
    let below = path.strip_prefix(shared).unwrap_or(path);
    let below: PathBuf = below
        .components()
        .filter(|part| matches!(part, Component::Normal(_)))
        .collect();
    let folder = path.parent().and_then(Path::file_name);
    let is_events = below.to_string_lossy().contains("tfevents") && below.components().count() == 1;
    match folder.filter(|_| is_events) {
        Some(folder) => Path::new(folder).join(below),
        None => below,
    }
}

/// What every run holds, a line each.
fn summary(options: &ImportOptions, found: &Found, mapping: &Mapping) -> String {
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
fn as_json(options: &ImportOptions, text: &ImportedText, found: &Found) -> Value {
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
    fn copies_keep_the_folders_that_tell_them_apart() {
        let kept = |files: &[&str]| -> Vec<String> {
            let shared = shared_folder(files.iter().map(Path::new));
            files
                .iter()
                .map(|file| kept_name(Path::new(file), &shared).display().to_string())
                .collect()
        };
        assert_eq!(kept(&["runs/a/x.csv"]), ["x.csv"]);
        assert_eq!(
            kept(&["runs/a/progress.csv", "runs/b/progress.csv"]),
            ["a/progress.csv", "b/progress.csv"]
        );
        assert_eq!(
            kept(&["../runs/a/x.csv", "logs/b/x.csv"]),
            ["runs/a/x.csv", "logs/b/x.csv"]
        );
        assert_eq!(
            kept(&["runs/a/events.out.tfevents.1"]),
            ["a/events.out.tfevents.1"]
        );
        assert_eq!(kept(&["events.tfevents"]), ["events.tfevents"]);
    }

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
