//! `manifest.json` of a folder of results: which study file they are of, and which files a report wrote. With
//! it the next report takes away what it does not write any more, such as a table that was renamed, and
//! nothing else.

use super::files;
use crate::{Error, store, world::fs};
use serde::{Deserialize, Serialize};
use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

const NAME: &str = "manifest.json";
/// Folders in which reports put files of changing names.
const FOLDERS: [&str; 2] = ["tables", "figures"];

/// What a folder of results says of itself.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Manifest {
    /// Name of the study.
    pub study: String,
    /// The study file, seen from the folder.
    pub spec: String,
    /// Options of the command line, where the results are not of the study as it is written.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub options: Vec<String>,
    /// Hashes of the files that the report wrote, by their names inside the folder.
    pub files: BTreeMap<String, String>,
}

/// What became of files that an earlier report wrote and this one did not; names inside the folder.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Replaced {
    /// They were removed.
    pub removed: Vec<String>,
    /// They were left, because somebody changed them since.
    pub changed: Vec<String>,
    /// Where no earlier report noted what it wrote: files beside its tables and figures, which were left.
    pub unknown: Vec<String>,
}

impl Manifest {
    /// The manifest of a folder; `None` where there is none that can be read.
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
                store::digest(&fs::read(path).map_err(Error::file("read", path))?),
            );
        }
        Ok(Self {
            study: study.into(),
            spec,
            options,
            files,
        })
    }

    /// Takes the place of the folder's manifest, and removes the files that only the earlier one lists.
    ///
    /// # Errors
    /// [`Error::File`] where a file cannot be removed or written.
    pub fn settle(&self, folder: &Path) -> Result<Replaced, Error> {
        let replaced = match Self::read(folder) {
            Some(earlier) => self.remove_others(folder, &earlier)?,
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

    fn remove_others(&self, folder: &Path, earlier: &Self) -> Result<Replaced, Error> {
        let mut replaced = Replaced::default();
        for (name, digest) in earlier
            .files
            .iter()
            .filter(|(name, _)| !self.files.contains_key(*name))
        {
            let path = folder.join(name);
            match own_file(folder, name) {
                Some(bytes) if store::digest(&bytes) == *digest => {
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

/// What a file inside the folder holds; `None` where the name leads out of it or to something else than a
/// file.
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

    /// Writes files and what a report of them notes.
    fn report(folder: &Path, names: &[&str]) -> Replaced {
        let paths: Vec<PathBuf> = names.iter().map(|name| folder.join(name)).collect();
        for path in &paths {
            files::write(path, path.to_string_lossy().as_bytes()).unwrap();
        }
        let manifest = Manifest::of(folder, "small", "../small.yaml".into(), Vec::new(), &paths).unwrap();
        let replaced = manifest.settle(folder).unwrap();
        assert_eq!(Manifest::read(folder), Some(manifest));
        replaced
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
            .map(|name| (name.to_owned(), store::digest(b"mine")))
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
