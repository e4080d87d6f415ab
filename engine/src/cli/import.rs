//! `import`: looks into files of other programs and writes the entry that a study names them with.

use super::{BAD_SPEC, Common, Failure, Format, OK, complain, export::Whole, say};
use crate::{
    Error,
    imported::{Found, ImportedText, Patterns, columns, read},
    spec::{name_from, section_yaml},
    store::{self, write_durably},
    world::fs,
};
use clap::Args;
use serde_json::{Value, json};
use std::{
    collections::{BTreeMap, BTreeSet},
    ffi::OsStr,
    path::{Path, PathBuf},
};

/// What is imported, and how it is read.
#[derive(Debug, Clone, Args)]
pub(super) struct ImportOptions {
    /// CSV files, and event files of TensorBoard, whose names hold `tfevents`.
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Study that shall name them; the entry names files as seen from its folder.
    #[arg(long, value_name = "SPEC")]
    study: PathBuf,
    /// Name of the entry, by which tables and claims speak of the runs.
    #[arg(long, value_name = "NAME", value_parser = entry_name)]
    name: String,
    /// Metric of the study and the column or tag that holds it, as in `return=charts/episodic_return`.
    #[arg(long = "metric", value_name = "METRIC=COLUMN", value_parser = pair)]
    metrics: Vec<(String, String)>,
    /// Environment of the study that the runs are of.
    #[arg(long, value_name = "NAME")]
    environment: Option<String>,
    /// Column with the step.
    #[arg(long, value_name = "COLUMN", default_value = "step")]
    step: String,
    /// Column with the seed; without it runs are numbered.
    #[arg(long, value_name = "COLUMN")]
    seed: Option<String>,
    /// Column that tells the runs of one file apart, where that is not the seed.
    #[arg(long, value_name = "COLUMN")]
    run: Option<String>,
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

fn refused(problem: String) -> Failure {
    Failure {
        code: BAD_SPEC,
        text: format!("error: {problem}"),
    }
}

/// Files that are named wrongly are a mistake of the command line.
fn unread(error: crate::Error) -> Failure {
    refused(error.to_string())
}

/// 2 where the files are not as the options say; it prints the entry.
pub(super) fn import(options: &ImportOptions, common: &Common) -> Result<u8, Failure> {
    if !fs::is_file(&options.study) {
        return Err(refused(format!(
            "there is no study `{}`",
            options.study.display()
        )));
    }
    if options.metrics.is_empty() {
        let known: Vec<String> = columns(&options.files).map_err(unread)?.into_iter().collect();
        return Err(refused(format!(
            "say which column or tag holds which metric of the study, as in `--metric return={}`; there are {}",
            known.first().map_or("COLUMN", String::as_str),
            known.join(", ")
        )));
    }
    let mut files = options.files.clone();
    files.sort();
    let mapping = options.text(Vec::new()).mapping();
    let found = read(&files, &mapping).map_err(unread)?;
    // Numbers of seeds are checked as the study checks them.
    found.trials(&options.name, "", 0, &mapping).map_err(refused)?;
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
            complain(&summary(options, &found));
            say(&section_yaml("imported", json!({ options.name.clone(): text }))?);
        }
    }
    Ok(OK)
}

impl ImportOptions {
    /// The entry with these files.
    fn text(&self, mut from: Vec<String>) -> ImportedText {
        let only = self
            .only
            .iter()
            .map(|(column, value)| (column.clone(), json!(value)));
        ImportedText {
            from: match from.as_slice() {
                [_] => Patterns::One(from.remove(0)),
                _ => Patterns::Several(from),
            },
            environment: self.environment.clone(),
            metrics: self.metrics.iter().cloned().collect(),
            step: self.step.clone(),
            seed: self.seed.clone(),
            run: self.run.clone(),
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
        for (path, sha256) in &found.files {
            let name = kept_name(path);
            if !taken.insert(name.clone()) {
                return Err(refused(format!(
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

/// Event files keep their folder, which is the run; every other file its name alone.
fn kept_name(path: &Path) -> PathBuf {
    let name = Path::new(path.file_name().unwrap_or(OsStr::new("file")));
    let folder = path.parent().and_then(Path::file_name);
    match folder.filter(|_| name.to_string_lossy().contains("tfevents")) {
        Some(folder) => Path::new(folder).join(name),
        None => name.to_owned(),
    }
}

/// What every run holds, a line each.
fn summary(options: &ImportOptions, found: &Found) -> String {
    let mut lines = vec![format!(
        "{}: {} runs in {} files",
        options.name,
        found.runs.len(),
        found.files.len()
    )];
    for run in &found.runs {
        let seed = run.seed.map_or_else(String::new, |seed| format!(", seed {seed}"));
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
    lines.join("\n")
}

fn as_json(options: &ImportOptions, text: &ImportedText, found: &Found) -> Value {
    let runs = found.runs.iter().map(|run| {
        let values: BTreeMap<&String, usize> = run
            .curves
            .iter()
            .map(|(metric, curve)| (metric, curve.len()))
            .collect();
        json!({ "run": run.name, "seed": run.seed, "values": values })
    });
    let files = found
        .files
        .iter()
        .map(|(path, sha256)| json!({ "file": path, "sha256": sha256 }));
    json!({
        "imported": { options.name.clone(): text }, "runs": runs.collect::<Vec<_>>(), "files": files.collect::<Vec<_>>(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn event_files_keep_the_folder_that_tells_them_apart() {
        assert_eq!(
            kept_name(Path::new("runs/a/events.out.tfevents.1")),
            Path::new("a/events.out.tfevents.1")
        );
        assert_eq!(kept_name(Path::new("runs/a/x.csv")), Path::new("x.csv"));
        assert_eq!(
            kept_name(Path::new("events.tfevents")),
            Path::new("events.tfevents")
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
