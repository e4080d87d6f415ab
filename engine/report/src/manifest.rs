//! `manifest.json` of a folder of results: its study file, and the files that a report wrote. By this list the next
//! report removes files that it no longer writes, such as those of a renamed table, and no others.

use super::files;
use contract::Error;
use execution::world::fs;
use serde::{Deserialize, Serialize};
use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

const NAME: &str = "manifest.json";
/// Folders of a report with files of changing names.
const FOLDERS: [&str; 2] = [files::TABLES, files::FIGURES];

/// Manifest of a folder of results.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Manifest {
    /// Name of the study.
    pub study: String,
    /// Path of the study file, relative to the folder.
    pub spec: String,
    /// Options of the command line, where they change the study.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub options: Vec<String>,
    /// Hashes of the files that the report wrote, by their names inside the folder.
    pub files: BTreeMap<String, String>,
    /// Hashes of files of an earlier report, of tables and figures that this one could not make.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub earlier: BTreeMap<String, String>,
}

/// Files of an earlier report that the present one did not write, by names inside the folder.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Replaced {
    /// Files that were removed.
    pub removed: Vec<String>,
    /// Files that were left because they were changed since.
    pub changed: Vec<String>,
    /// Files that were left because this report could not make their tables or figures.
    pub kept: Vec<String>,
    /// Files beside tables and figures that were left because the folder had no manifest.
    pub unknown: Vec<String>,
}

impl Manifest {
    /// The manifest of a folder; `None` where there is no readable one.
    #[must_use]
    pub fn read(folder: &Path) -> Option<Self> {
        serde_json::from_slice(&fs::read(folder.join(NAME)).ok()?).ok()
    }

    /// The manifest of a report that wrote `written` into `folder`.
    ///
    /// # Errors
    /// [`Error::File`] where one of the files cannot be read.
    pub fn of(
        folder: &Path,
        study: &str,
        spec: String,
        options: Vec<String>,
        written: &[PathBuf],
    ) -> Result<Self, Error> {
        let mut files = BTreeMap::new();
        for path in written {
            let name = path.strip_prefix(folder).unwrap_or(path).display().to_string();
            files.insert(
                name,
                contract::digest::of_bytes(&fs::read(path).map_err(Error::file("read", path))?),
            );
        }
        Ok(Self {
            study: study.into(),
            spec,
            options,
            files,
            earlier: BTreeMap::new(),
        })
    }

    /// Whether a file of the folder belongs to the report, or to an earlier one.
    #[must_use]
    pub fn names(&self, file: &str) -> bool {
        self.files.contains_key(file) || self.earlier.contains_key(file)
    }

    /// The manifest of a folder whose files are to be read.
    ///
    /// # Errors
    /// [`Error::Record`] where there is no readable one.
    pub fn of_record(folder: &Path) -> Result<Self, Error> {
        Self::read(folder).ok_or_else(|| Error::Record {
            path: folder.join(NAME),
            problem: "is not there, or not as a report wrote it".into(),
        })
    }

    /// The bytes of a file of the folder, checked against their hash.
    ///
    /// # Errors
    /// [`Error::Record`] where the hash differs.
    pub fn checked(&self, folder: &Path, name: &str) -> Result<Vec<u8>, Error> {
        let wrong = |problem: &str| Error::Record {
            path: folder.join(name),
            problem: problem.into(),
        };
        let digest = self.files.get(name).or_else(|| self.earlier.get(name));
        let digest = digest.ok_or_else(|| wrong("is no file that the report in its folder wrote"))?;
        let bytes = own_file(folder, name).ok_or_else(|| wrong("cannot be read"))?;
        if contract::digest::of_bytes(&bytes) == *digest {
            Ok(bytes)
        } else {
            Err(wrong("was changed or cut off after its report wrote it"))
        }
    }

    /// Replaces the folder's manifest, and removes the files that only the earlier one lists; those of `unmade` stay.
    ///
    /// # Errors
    /// [`Error::File`] where a file cannot be removed or written.
    pub fn settle(&mut self, folder: &Path, unmade: &BTreeSet<String>) -> Result<Replaced, Error> {
        let replaced = match Self::read(folder) {
            Some(earlier) => self.remove_others(folder, &earlier, unmade)?,
            None => Replaced {
                unknown: self.unknown(folder),
                ..Replaced::default()
            },
        };
        let path = folder.join(NAME);
        let text = serde_json::to_string_pretty(self)
            .map_err(std::io::Error::from)
            .map_err(Error::file("write", &path))?;
        files::write(&path, (text + "\n").as_bytes())?;
        Ok(replaced)
    }

    fn remove_others(
        &mut self,
        folder: &Path,
        earlier: &Self,
        unmade: &BTreeSet<String>,
    ) -> Result<Replaced, Error> {
        let mut replaced = Replaced::default();
        let listed = earlier.files.iter().chain(&earlier.earlier);
        for (name, digest) in listed.filter(|(name, _)| !self.files.contains_key(*name)) {
            let path = folder.join(name);
            match own_file(folder, name) {
                Some(_) if unmade.contains(name) => {
                    self.earlier.insert(name.clone(), digest.clone());
                    replaced.kept.push(name.clone());
                }
                Some(bytes) if contract::digest::of_bytes(&bytes) == *digest => {
                    fs::remove_file(&path).map_err(Error::file("remove", &path))?;
                    replaced.removed.push(name.clone());
                }
                Some(_) => replaced.changed.push(name.clone()),
                None => {}
            }
        }
        Ok(replaced)
    }

    fn unknown(&self, folder: &Path) -> Vec<String> {
        let entries = |name: &'static str| {
            let entries = fs::read_dir(folder.join(name)).into_iter().flatten().flatten();
            entries.map(move |entry| format!("{name}/{}", entry.file_name().to_string_lossy()))
        };
        let mut unknown: Vec<String> = FOLDERS
            .into_iter()
            .flat_map(entries)
            .filter(|name| !self.files.contains_key(name))
            .collect();
        unknown.sort_unstable();
        unknown
    }
}

/// The bytes of a file inside the folder; `None` where the name leads out of it or to anything but a file.
fn own_file(folder: &Path, name: &str) -> Option<Vec<u8>> {
    let inside = fs::is_inside(Path::new(name));
    let mut way = folder.to_owned();
    for part in Path::new(name).components().filter(|_| inside) {
        way.push(part);
        if fs::symlink_metadata(&way).ok()?.is_symlink() {
            return None;
        }
    }
    fs::read(way).ok().filter(|_| inside)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Writes files as a report does, and its manifest.
    fn report(folder: &Path, names: &[&str]) -> Replaced {
        let paths: Vec<PathBuf> = names.iter().map(|name| folder.join(name)).collect();
        for path in &paths {
            files::write(path, path.to_string_lossy().as_bytes()).unwrap();
        }
        settled(folder, &paths, &[])
    }

    fn settled(folder: &Path, paths: &[PathBuf], unmade: &[&str]) -> Replaced {
        let spec = "../small.yaml".to_owned();
        let mut manifest = Manifest::of(folder, "small", spec, Vec::new(), paths).unwrap();
        let unmade = unmade.iter().map(ToString::to_string).collect();
        let replaced = manifest.settle(folder, &unmade).unwrap();
        assert_eq!(Manifest::read(folder), Some(manifest));
        replaced
    }

    /// Tables and figures that a report cannot make stay as an earlier one made them, through any number of such
    /// reports, until one makes them or the study drops them.
    #[test]
    fn what_could_not_be_made_stays_until_it_is_made_or_no_more_asked_for() {
        let dir = tempfile::tempdir().unwrap();
        let folder = dir.path();
        report(folder, &["report.md", "tables/one.csv", "tables/two.csv"]);
        let page = [folder.join("report.md")];
        for _ in 0..2 {
            let replaced = settled(folder, &page, &["tables/one.csv", "tables/two.csv"]);
            assert_eq!(replaced.kept, ["tables/one.csv", "tables/two.csv"]);
            assert_eq!(replaced.removed, [""; 0]);
        }
        let replaced = settled(folder, &page, &["tables/two.csv"]);
        assert_eq!(
            (&replaced.removed[..], &replaced.kept[..]),
            (
                &["tables/one.csv".to_owned()][..],
                &["tables/two.csv".to_owned()][..]
            )
        );
        assert_eq!(
            report(folder, &["report.md", "tables/two.csv"]),
            Replaced::default()
        );
        assert_eq!(Manifest::read(folder).unwrap().earlier, BTreeMap::new());
    }

    #[test]
    fn a_report_removes_what_an_earlier_one_wrote_and_nothing_else() {
        let dir = tempfile::tempdir().unwrap();
        let folder = dir.path();
        report(
            folder,
            &["report.md", "tables/old.md", "tables/edited.md", "tables/kept.md"],
        );
        fs::write(folder.join("tables/edited.md"), "by hand").unwrap();
        fs::write(folder.join("tables/mine.md"), "by hand").unwrap();
        let replaced = report(folder, &["report.md", "tables/kept.md", "tables/new.md"]);
        assert_eq!(
            (replaced.removed, replaced.changed),
            (
                vec!["tables/old.md".to_owned()],
                vec!["tables/edited.md".to_owned()]
            )
        );
        assert_eq!(replaced.unknown, [""; 0]);
        let there = |name: &str| folder.join(name).exists();
        assert!(
            !there("tables/old.md")
                && there("tables/edited.md")
                && there("tables/mine.md")
                && there("tables/new.md")
        );
    }

    #[test]
    fn without_a_manifest_nothing_is_removed_and_what_is_not_of_the_report_is_said() {
        let dir = tempfile::tempdir().unwrap();
        files::write(&dir.path().join("figures/old.svg"), b"old").unwrap();
        files::write(&dir.path().join("notes.txt"), b"mine").unwrap();
        let replaced = report(dir.path(), &["figures/new.svg"]);
        assert_eq!(
            replaced,
            Replaced {
                unknown: vec!["figures/old.svg".into()],
                ..Replaced::default()
            }
        );
        assert!(dir.path().join("figures/old.svg").exists());
    }

    #[test]
    fn a_manifest_that_names_files_elsewhere_removes_none_of_them() {
        let dir = tempfile::tempdir().unwrap();
        let (folder, outside) = (dir.path().join("results"), dir.path().join("mine.md"));
        fs::write(&outside, "mine").unwrap();
        fs::create_dir(&folder).unwrap();
        std::os::unix::fs::symlink(dir.path(), folder.join("tables")).unwrap();
        let names = ["../mine.md", "tables/mine.md", outside.to_str().unwrap()];
        let files = names
            .into_iter()
            .map(|name| (name.to_owned(), contract::digest::of_bytes(b"mine")))
            .collect();
        let manifest = Manifest {
            files,
            ..Manifest::default()
        };
        fs::write(folder.join(NAME), serde_json::to_vec(&manifest).unwrap()).unwrap();
        assert_eq!(report(&folder, &["report.md"]).removed, [""; 0]);
        assert!(outside.exists());
    }
}
