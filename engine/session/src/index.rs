//! The index page over several studies, made from files that their reports wrote.

use crate::{Failure, Planned, ReportOptions, Session, folders};
use contract::Error;
use execution::{store::write_durably, world::fs};
use report::{IndexEntry, Manifest, Verdicts};
use std::{
    io,
    path::{Path, PathBuf},
};
use study::along;

/// Name of the file with the verdicts in a folder of results.
const VERDICTS: &str = "verdicts.json";

/// Maximum depth of folders of results below the named folder.
const DEEPEST: usize = 3;

impl Session<'_> {
    /// Writes the index page over all studies whose reports lie in the same folder with the same options. Returns its
    /// path; `None` if fewer than two studies are planned.
    ///
    /// # Errors
    /// A folder that cannot be read or written.
    pub fn write_index(
        &self,
        planned: &[Planned],
        reporting: &ReportOptions,
    ) -> Result<Option<PathBuf>, Failure> {
        if planned.iter().filter(|one| !one.is_confirmation()).count() < 2 {
            return Ok(None);
        }
        // The folder that `-o` names holds no other reports, so the name of its index needs no options.
        let name = reporting
            .out
            .as_ref()
            .map_or_else(|| folders::asked(&self.selection), |_| String::new());
        let (folder, options) = (folders::around(reporting), folders::options(&self.selection));
        Ok(Some(write_index(&folder, &name, &options)?))
    }
}

/// A study with its folder of results.
pub struct Studied {
    place: PathBuf,
    manifest: Manifest,
    /// Its verdicts.
    pub verdicts: Verdicts,
}

impl Studied {
    /// The report in its folder.
    #[must_use]
    pub fn report(&self) -> PathBuf {
        self.place.join("report.md")
    }

    /// The study file.
    #[must_use]
    pub fn file(&self) -> PathBuf {
        along(&self.place, Path::new(&self.manifest.spec))
    }
}

/// The studies whose results lie in a folder, without results of other command line options.
///
/// # Errors
/// A folder that cannot be read.
pub fn studies_within(folder: &Path) -> Result<Vec<Studied>, Error> {
    Ok(asked_with(folder, &[])?.0)
}

/// The studies whose results lie in a folder and were computed with these options, with the verdicts of each family
/// taken together. The second list holds the folders without verdicts.
fn asked_with(folder: &Path, options: &[String]) -> Result<(Vec<Studied>, Vec<PathBuf>), Error> {
    let (mut studies, mut unread) = (Vec::new(), Vec::new());
    for place in places(folder, DEEPEST)? {
        let manifest = Manifest::read(&place).unwrap_or_default();
        if manifest.options != options {
            continue;
        }
        match verdicts(&place)? {
            Some(verdicts) => studies.push(Studied {
                place,
                manifest,
                verdicts,
            }),
            None => unread.push(place),
        }
    }
    let mut together: Vec<Verdicts> = studies.iter().map(|it| it.verdicts.clone()).collect();
    report::take_together(&mut together);
    for (study, verdicts) in studies.iter_mut().zip(together) {
        study.verdicts = verdicts;
    }
    Ok((studies, unread))
}

/// The verdicts of a folder of results; `None` if its report wrote none.
fn verdicts(place: &Path) -> Result<Option<Verdicts>, Error> {
    let Some(text) = read(place, VERDICTS)? else {
        return Ok(None);
    };
    let path = place.join(VERDICTS);
    let verdicts = serde_json::from_str(&text)
        .map_err(io::Error::from)
        .map_err(Error::file("read", &path))?;
    Ok(Some(verdicts))
}

/// The folders of results in a folder and in its subfolders down to a depth, by name. Links are not followed.
fn places(folder: &Path, depth: usize) -> Result<Vec<PathBuf>, Error> {
    let is_folder = |path: &PathBuf| fs::symlink_metadata(path).is_ok_and(|data| data.is_dir());
    let mut places = Vec::new();
    for path in within(folder)?.into_iter().filter(is_folder) {
        if fs::is_file(&path.join(VERDICTS)) || Manifest::read(&path).is_some() {
            places.push(path);
        } else if depth > 1 {
            places.extend(self::places(&path, depth - 1)?);
        }
    }
    Ok(places)
}

/// Everything in a folder, by name.
fn within(folder: &Path) -> Result<Vec<PathBuf>, Error> {
    let entries = fs::read_dir(folder).and_then(|entries| {
        entries
            .map(|entry| entry.map(|it| it.path()))
            .collect::<io::Result<Vec<PathBuf>>>()
    });
    let mut entries = entries.map_err(Error::file("read", folder))?;
    entries.sort_unstable();
    Ok(entries)
}

/// A file of a folder of results; `None` if the file does not exist or `place` is not a folder.
fn read(folder: &Path, name: &str) -> Result<Option<String>, Error> {
    let path = folder.join(name);
    match fs::read_to_string(&path) {
        Ok(text) => Ok(Some(text)),
        Err(error) if is_absence(&error) => Ok(None),
        Err(error) => Err(Error::file("read", &path)(error)),
    }
}

/// Writes `index<name>.html` over the reports in a folder that were computed with these options.
///
/// # Errors
/// A folder that cannot be read or written.
pub fn write_index(folder: &Path, name: &str, options: &[String]) -> Result<PathBuf, Error> {
    let (studies, unread) = asked_with(folder, options)?;
    let name_of = |place: &Path| place.strip_prefix(folder).unwrap_or(place).display().to_string();
    let is_drawing = |file: &&String| file.starts_with("figures/") && file.ends_with(".svg");
    let entry = |study: Studied| IndexEntry {
        folder: name_of(&study.place),
        drawings: study.manifest.files.keys().filter(is_drawing).cloned().collect(),
        verdicts: study.verdicts,
    };
    let entries: Vec<IndexEntry> = studies.into_iter().map(entry).collect();
    let unread: Vec<String> = unread.iter().map(|place| name_of(place)).collect();
    let path = folder.join(format!("index{name}.html"));
    write_durably(&path, report::index(&entries, options, &unread).as_bytes())?;
    Ok(path)
}

fn is_absence(error: &io::Error) -> bool {
    [io::ErrorKind::NotFound, io::ErrorKind::NotADirectory].contains(&error.kind())
}
