//! Two sets of results side by side.

use crate::{Exit, Failure, MachineOptions, Selection, Session, folders, results};
use contract::Error;
use execution::{
    store,
    world::{fs, process::Command},
};
use report::{
    Contents, Verdicts,
    compare::{Compared, Named, Side, parse_study},
};
use std::path::{Path, PathBuf};

/// Results to compare with.
#[derive(Debug, Clone)]
pub struct Other {
    /// A study file, a folder of results, or such a folder in a commit as `REV:FOLDER`.
    pub path: PathBuf,
    /// The store of the study's trials, if `path` is a study; the store of the machine where absent.
    pub store: Option<PathBuf>,
}

impl Session<'_> {
    /// The differences of the selected study, or folder of results, from other results.
    ///
    /// # Errors
    /// Fails if results cannot be read, or if the two have nothing in common.
    pub fn compare(&self, other: &Other) -> Result<Compared, Failure> {
        let [path] = self.selection.specs.as_slice() else {
            return Err(Failure::refusal(format!(
                "one study or folder of results is held against `{}`, and {} are named",
                other.path.display(),
                self.selection.specs.len()
            )));
        };
        let own = &self.settings.store;
        let asked = |path: &Path, store: Option<&PathBuf>| ComparisonInput {
            session: self,
            path: path.to_owned(),
            store: store.unwrap_or(own).clone(),
        };
        let (a, b) = (asked(&other.path, other.store.as_ref()), asked(path, None));
        let compared = Compared::of(&a.side(&b.path)?, &b.side(&a.path)?);
        if compared.is_empty() {
            return Err(Failure {
                exit: Exit::NothingSelected,
                text: format!(
                    "`{}` and `{}` have no cell, verdict or claim in common: name two results of the same study",
                    a.path.display(),
                    b.path.display()
                ),
            });
        }
        Ok(compared)
    }
}

/// One of the two inputs, as the command line names it.
struct ComparisonInput<'a> {
    session: &'a Session<'a>,
    path: PathBuf,
    store: PathBuf,
}

impl ComparisonInput<'_> {
    /// Reads the input. If `other` is a folder of results, files that the study names get the names that `other` gives
    /// them.
    fn side(&self, other: &Path) -> Result<Side, Failure> {
        if fs::is_folder(&self.path) {
            return self.folder(&self.path);
        }
        if fs::is_file(&self.path) {
            return self.study(other);
        }
        let text = self.path.display().to_string();
        let Some((revision, folder)) = text.split_once(':') else {
            return Err(Failure::refusal(format!(
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
            Failure::refusal(format!(
                "`{from}` is no folder of results: it has neither `verdicts.json` nor tables; `regimen report` writes \
                 one"
            ))
        })
    }

    fn study(&self, other: &Path) -> Result<Side, Failure> {
        if let Some(problem) = store::no_store(&self.store)? {
            return Err(Failure::refusal(problem));
        }
        let selection = Selection {
            profile: self.session.selection.profile.clone(),
            ..Selection::of(&self.path)
        };
        let machine = MachineOptions {
            store: Some(self.store.clone()),
            ..self.session.machine.clone()
        };
        let mut session = Session::open(self.session.registry, selection, machine, self.session.observer)?;
        session.settings.bucket = None;
        let planned = session.load_with_looks()?;
        let [one] = planned.as_slice() else {
            return Err(Failure::refusal(format!(
                "`{}` holds no study",
                self.path.display()
            )));
        };
        let info = results::info(one, session.registry);
        let results = results::judged(one, session.store()?);
        let contents = Contents::judged(&info, &results);
        let verdicts = Verdicts::of(&info, &results, &contents);
        // Two studies name their files relative to their own folders.
        let beside = if fs::is_folder(other) {
            other
        } else {
            self.path.parent().unwrap_or(Path::new(""))
        };
        let resolved = parse_study(&self.path, &study::resolved_yaml(&one.study, beside)?)?;
        let named = Named {
            from: format!("{} in {}", self.path.display(), self.store.display()),
            study: one.study.name.clone(),
            options: folders::options(&session.selection),
        };
        Ok(Side::of(named, &contents, verdicts, &resolved))
    }
}

/// Copies the compared files of a folder of results in a commit into `to`.
fn check_out(revision: &str, folder: &str, to: &Path) -> Result<(), Failure> {
    let folder = folder.trim_end_matches('/');
    if revision.starts_with('-') {
        return Err(Failure::refusal(format!(
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
        return Err(Failure::refusal(format!(
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

/// The output of `git`.
fn git(arguments: &[&str]) -> Result<Vec<u8>, Failure> {
    let output = Command::new("git").args(arguments).output();
    let output = output.map_err(|error| Failure::refusal(format!("cannot start `git`: {error}")))?;
    if output.status.success() {
        return Ok(output.stdout);
    }
    let said = String::from_utf8_lossy(&output.stderr);
    Err(Failure::refusal(format!(
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
