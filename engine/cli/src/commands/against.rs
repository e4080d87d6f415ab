//! `report --against`: two sets of results side by side.

use super::{
    BAD_SPEC, Common, DIFFERS, Failure, Format, NOTHING_SELECTED, OK, Selection, folders, planned, run, say,
    settings,
};
use clap::Args;
use contract::{Error, Registry};
use execution::{
    store::{self, Store, write_durably},
    world::{fs, process::Command},
};
use report::{
    Contents, Verdicts,
    compare::{Compared, Named, Side, markdown, parse_study, text},
};
use std::path::{Path, PathBuf};

/// Other results that a report is held against, and how the differences are shown.
#[derive(Debug, Clone, Args)]
pub(super) struct Against {
    /// Say what SPEC, a study or a folder of results, differs in from these results: which values moved beyond the
    /// interval of their difference, which verdicts changed, which settings differ. They are a study file, a folder of
    /// results, or such a folder in a commit as `REV:FOLDER`.
    #[arg(long, value_name = "RESULTS", conflicts_with_all = ["sets", "seeds", "only", "out", "verbose", "recorded"])]
    pub(super) against: Option<PathBuf>,
    /// Store of the trials of RESULTS, where that is a study; `--store` where absent.
    #[arg(long, value_name = "DIR", requires = "against")]
    against_store: Option<PathBuf>,
    /// Show cells that did not move, too.
    #[arg(long, requires = "against")]
    all: bool,
    /// Write the comparison into a file as well, as Markdown.
    #[arg(long, value_name = "FILE", requires = "against")]
    changes: Option<PathBuf>,
}

/// 4 where the two have nothing in common, 101 under `--strict` where something moved.
pub(super) fn report(
    registry: &Registry,
    (selection, strict): (&Selection, bool),
    (earlier, options): (&Path, &Against),
    common: &Common,
) -> Result<u8, Failure> {
    let [path] = selection.specs.as_slice() else {
        return Err(refused(format!(
            "one study or folder of results is held against `{}`, and {} are named",
            earlier.display(),
            selection.specs.len()
        )));
    };
    let own = settings::read(common)?.store;
    let asked = |path: &Path, store: &Option<PathBuf>| Asked {
        registry,
        path: path.to_owned(),
        store: store.clone().unwrap_or_else(|| own.clone()),
        profile: selection.profile.clone(),
    };
    let (a, b) = (asked(earlier, &options.against_store), asked(path, &None));
    let compared = Compared::of(&a.side(&b.path)?, &b.side(&a.path)?);
    if compared.is_empty() {
        return Err(Failure {
            code: NOTHING_SELECTED,
            text: format!(
                "`{}` and `{}` have no cell, verdict or claim in common: name two results of the same study",
                earlier.display(),
                path.display()
            ),
        });
    }
    if let Some(path) = &options.changes {
        write_durably(path, markdown(&compared, options.all).as_bytes())?;
    }
    say(&match common.format {
        Format::Json => serde_json::to_string(&compared).map_err(|error| refused(error.to_string()))?,
        Format::Text => text(&compared, options.all, run::terminal_width()),
    });
    Ok(if strict && compared.differs() { DIFFERS } else { OK })
}

fn refused(problem: String) -> Failure {
    Failure {
        code: BAD_SPEC,
        text: format!("error: {problem}"),
    }
}

/// One of the two, as it was asked for.
struct Asked<'a> {
    registry: &'a Registry,
    path: PathBuf,
    store: PathBuf,
    profile: Option<String>,
}

impl Asked<'_> {
    /// Reads it. Files that a study names are named as `other` names them, where that is a folder of results.
    fn side(&self, other: &Path) -> Result<Side, Failure> {
        if fs::is_folder(&self.path) {
            return self.folder(&self.path);
        }
        if fs::is_file(&self.path) {
            return self.study(other);
        }
        let text = self.path.display().to_string();
        let Some((revision, folder)) = text.split_once(':') else {
            return Err(refused(format!(
                "there is nothing at `{text}`: name a study file, a folder of results, or one in a commit, as \
                 `main:results/x`"
            )));
        };
        let checked_out = tempfile::Builder::new().prefix("regimen-compare-").tempdir();
        let checked_out = checked_out.map_err(Error::file("create a folder in", &std::env::temp_dir()))?;
        check_out(revision, folder, checked_out.path())?;
        self.folder(checked_out.path())
    }

    fn folder(&self, folder: &Path) -> Result<Side, Failure> {
        let from = self.path.display().to_string();
        Side::read(folder, &from)?.ok_or_else(|| {
            refused(format!(
                "`{from}` is no folder of results: it has neither `verdicts.json` nor tables; `regimen report` writes \
                 one"
            ))
        })
    }

    fn study(&self, other: &Path) -> Result<Side, Failure> {
        if let Some(problem) = store::no_store(&self.store)? {
            return Err(refused(problem));
        }
        let selection = Selection {
            specs: vec![self.path.clone()],
            profile: self.profile.clone(),
            sets: Vec::new(),
            seeds: None,
            only: Vec::new(),
        };
        let store = Store::at(&self.store);
        let planned = planned::load_with_looks(self.registry, &selection, &store)?;
        let [one] = planned.as_slice() else {
            return Err(refused(format!("`{}` holds no study", self.path.display())));
        };
        let info = run::info(one, self.registry);
        let results = run::collect(one, &store, None);
        let contents = Contents::judged(&info, &results);
        let verdicts = Verdicts::of(&info, &results, &contents);
        // Two studies name their files as seen from where they lie.
        let beside = if fs::is_folder(other) {
            other
        } else {
            self.path.parent().unwrap_or(Path::new(""))
        };
        let resolved = parse_study(&self.path, &study::resolved_yaml(&one.study, beside)?)?;
        let named = Named {
            from: format!("{} in {}", self.path.display(), self.store.display()),
            study: one.study.name.clone(),
            options: folders::options(&selection),
        };
        Ok(Side::of(named, &contents, verdicts, &resolved))
    }
}

/// Puts what is compared of a folder of results in a commit into `to`.
fn check_out(revision: &str, folder: &str, to: &Path) -> Result<(), Failure> {
    let folder = folder.trim_end_matches('/');
    if revision.starts_with('-') {
        return Err(refused(format!(
            "`{revision}` is no commit: names of commits and branches do not begin with `-`"
        )));
    }
    let listed = git(&[
        "ls-tree",
        "-r",
        "--name-only",
        revision,
        "--",
        &format!("{folder}/"),
    ])?;
    let listed = String::from_utf8_lossy(&listed).into_owned();
    let inside = |line: &str| line.strip_prefix(folder)?.strip_prefix('/').map(str::to_owned);
    let names: Vec<String> = listed
        .lines()
        .filter_map(inside)
        .filter(|name| is_compared(name))
        .collect();
    if names.is_empty() {
        return Err(refused(format!(
            "commit `{revision}` has no results in `{folder}`: name a folder as seen from here"
        )));
    }
    for name in names {
        let bytes = git(&["show", &format!("{revision}:./{folder}/{name}")])?;
        let path = to.join(name);
        let parent = path.parent().unwrap_or(to);
        fs::create_dir_all(parent).map_err(Error::file("create", parent))?;
        fs::write(&path, bytes).map_err(Error::file("write", &path))?;
    }
    Ok(())
}

/// Whether a comparison reads a file of a folder of results.
fn is_compared(name: &str) -> bool {
    let table = name
        .strip_prefix("tables/")
        .and_then(|name| name.strip_suffix(".csv"));
    table.is_some_and(|table| !table.contains('/'))
        || ["verdicts.json", "resolved.yaml", "manifest.json"].contains(&name)
}

/// What `git` prints.
fn git(arguments: &[&str]) -> Result<Vec<u8>, Failure> {
    let output = Command::new("git").args(arguments).output();
    let output = output.map_err(|error| refused(format!("cannot start `git`: {error}")))?;
    if output.status.success() {
        return Ok(output.stdout);
    }
    let said = String::from_utf8_lossy(&output.stderr);
    Err(refused(format!(
        "git {}: {}",
        arguments.join(" "),
        said.trim().lines().next().unwrap_or_default()
    )))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_comparison_reads_stays_in_its_folder() {
        assert!(is_compared("tables/x.csv") && is_compared("verdicts.json"));
        for name in [
            "tables/x.md",
            "figures/x.csv",
            "tables/../../x.csv",
            "evaluations.parquet",
        ] {
            assert!(!is_compared(name), "{name}");
        }
    }
}
