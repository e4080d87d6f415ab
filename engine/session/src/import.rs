//! Imports runs of other programs: reads their files and makes the entry for a study.

use crate::{Failure, whole::Whole};
use contract::Error;
use execution::{
    store::{self, write_durably},
    world::fs,
};
use imported::{Columns, ImportedText, Patterns, RunCollection, columns, read};
use serde_json::json;
use std::{
    collections::BTreeSet,
    path::{Component, Path, PathBuf},
};
use study::name_from;

/// Name of the file that records the origin of copies.
const MANIFEST: &str = "manifest.json";

/// Files of another program, and the study for which the entry is made.
pub struct Import<'a> {
    /// The study; the entry names files relative to its folder.
    pub study: &'a Path,
    /// Name of the entry.
    pub name: &'a str,
    /// The files.
    pub files: &'a [PathBuf],
    /// The way to read them: the entry without its files.
    pub reading: ImportedText,
    /// Whether the files are copied to `imported/NAME` beside the study, with a manifest of their origins.
    pub copies: bool,
}

impl Import<'_> {
    /// The columns and tags that the files hold.
    ///
    /// # Errors
    /// Fails if there is no such study, or if a file cannot be read.
    pub fn columns(&self) -> Result<Columns, Failure> {
        self.has_study()?;
        columns(self.files).map_err(Failure::refusal)
    }

    fn has_study(&self) -> Result<(), Failure> {
        if fs::is_file(self.study) {
            return Ok(());
        }
        Err(Failure::refusal(format!(
            "there is no study `{}`",
            self.study.display()
        )))
    }

    /// Reads the files; returns the entry and its runs.
    ///
    /// # Errors
    /// Fails if there is no such study, if the files do not match the entry, or if a copy cannot be written.
    pub fn read(&self) -> Result<(ImportedText, RunCollection), Failure> {
        self.has_study()?;
        let mut files = self.files.to_vec();
        files.sort();
        let mapping = self.reading.mapping();
        let found = read(&files, &mapping).map_err(Failure::refusal)?;
        // The study's own rules check the numbers of seeds.
        found
            .trials(self.name, "", 0, &mapping)
            .map_err(Failure::refusal)?;
        let folder = self.study.parent().unwrap_or(Path::new(""));
        let named = if self.copies {
            self.copied(folder, &found)?
        } else {
            files
        };
        let from: Vec<String> = named
            .iter()
            .map(|path| name_from(folder, path).display().to_string())
            .collect();
        let entry = ImportedText {
            from: Patterns::from(from),
            ..self.reading.clone()
        };
        Ok((entry, found))
    }

    /// Copies the files beside the study; the folder appears whole or not at all.
    fn copied(&self, beside: &Path, found: &RunCollection) -> Result<Vec<PathBuf>, Failure> {
        let folder = beside.join("imported").join(self.name);
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
            "schema": 1, "entry": self.name, "about": self.reading.about, "imported_at": store::now(), "files": listed,
            "read": self.reading.mapping(),
        });
        write_durably(
            &whole.folder().join(MANIFEST),
            format!("{manifest:#}\n").as_bytes(),
        )?;
        whole.end()?;
        Ok(taken.into_iter().map(|name| folder.join(name)).collect())
    }
}

/// The deepest folder that contains all files.
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

/// Copies keep the folders in which their paths differ, which may be all that distinguishes runs; event files keep at
/// least one.
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
}
