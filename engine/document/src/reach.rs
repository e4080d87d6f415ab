//! Files that a study may name, and those of them that a message may quote.
//!
//! The files of a study lie in its folder, or in the project that contains the folder: everything under the nearest
//! folder above it with a file `regimen.toml`. For a folder of results without such a file, the project is the current
//! folder, if that contains the results. A name that leads outside, by `..` or by a link, is refused; a file that lies
//! elsewhere must be named by its absolute path. A file outside the study's own folder is foreign: messages name the
//! position and the kind of a mistake in it, but quote none of its text.
//!
//! Every key that names files uses [`Reach::find`], and every message that quotes one uses [`quoted`].

use std::{
    collections::BTreeSet,
    fs,
    path::{Path, PathBuf},
    sync::{
        PoisonError, RwLock,
        atomic::{AtomicBool, Ordering},
    },
};

/// The file that makes its folder a project.
pub const PROJECT: &str = "regimen.toml";
/// The file that a report writes into a folder of results.
const REPORTED: &str = "manifest.json";

/// The folders that contain the files of a study.
#[derive(Debug, Clone)]
pub struct Reach {
    /// The study's own, without links.
    own: PathBuf,
    /// The project's folder, or the study's own if it belongs to none.
    project: PathBuf,
}

/// A name that leads out of the study's folder and its project.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{name}` leads out of the folder of the study")]
pub struct Outside {
    /// The name, as it is written.
    pub name: String,
}

impl Outside {
    /// Advice for a name that leads out.
    pub const HELP: &str = "move the file into that folder, write its absolute path, or put a file `regimen.toml` into \
                            the folder of the project that holds both";
}

impl Reach {
    /// The reach of a study in `folder`.
    #[must_use]
    pub fn of(folder: &Path) -> Self {
        let own = without_links(folder);
        let is_project = |folder: &&Path| folder.join(PROJECT).is_file();
        let said = own.ancestors().find(is_project).map(Path::to_owned);
        let project = said.or_else(|| project_of_results(&own));
        Self {
            project: project.unwrap_or_else(|| own.clone()),
            own,
        }
    }

    /// The folder of the project, without links.
    #[must_use]
    pub fn project(&self) -> &Path {
        &self.project
    }

    /// The reach of a study that is written out into `folder`, among the results or for a reader: that of a study
    /// there, or the current folder if that contains it.
    #[must_use]
    pub fn of_written_out(folder: &Path) -> Self {
        let (reach, current) = (Self::of(folder), without_links(Path::new(".")));
        let project = if reach.project == reach.own && reach.own.starts_with(&current) {
            current
        } else {
            reach.project
        };
        Self { project, ..reach }
    }

    /// The path of a file that is named relative to `folder`. A foreign file is noted, so that no message quotes it.
    ///
    /// # Errors
    /// [`Outside`] for a relative name that leads out.
    pub fn find(&self, folder: &Path, name: &str) -> Result<PathBuf, Outside> {
        let path = folder.join(name);
        let place = without_links(&path);
        if !Path::new(name).is_absolute() && !place.starts_with(&self.project) {
            return Err(Outside { name: name.into() });
        }
        if !place.starts_with(&self.own) {
            note_foreign(&path);
        }
        Ok(path)
    }

    /// Whether a path leads to a place inside the study's folder or its project; links are followed.
    #[must_use]
    pub fn holds(&self, path: &Path) -> bool {
        without_links(path).starts_with(&self.project)
    }
}

/// The current folder, if it contains a folder that a report wrote: the study with all defaults written out, which is
/// among the results, names files as the original study does.
fn project_of_results(own: &Path) -> Option<PathBuf> {
    let current = without_links(Path::new("."));
    (own.join(REPORTED).is_file() && own.starts_with(&current)).then_some(current)
}

/// The path without links; the part of it that does not exist is unchanged.
fn without_links(path: &Path) -> PathBuf {
    // A file that is named alone has the empty path as its folder.
    let path = if path.as_os_str().is_empty() {
        Path::new(".")
    } else {
        path
    };
    let absolute = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let there = absolute.ancestors().find_map(|above| {
        let rest = absolute.strip_prefix(above).ok()?;
        Some((fs::canonicalize(above).ok()?, rest))
    });
    let Some((mut place, rest)) = there else {
        return absolute;
    };
    for part in rest.components() {
        match part {
            std::path::Component::ParentDir => drop(place.pop()),
            other => place.push(other),
        }
    }
    place
}

/// Files outside its folder that a study named.
static FOREIGN: RwLock<BTreeSet<PathBuf>> = RwLock::new(BTreeSet::new());
/// Whether this process does not know which study the files belong to.
static ALL_FOREIGN: AtomicBool = AtomicBool::new(false);

fn note_foreign(path: &Path) {
    let mut foreign = FOREIGN.write().unwrap_or_else(PoisonError::into_inner);
    foreign.insert(path.to_owned());
}

/// Disables quotes from now on, since a worker process knows no study.
pub fn quote_nothing() {
    ALL_FOREIGN.store(true, Ordering::Relaxed);
}

/// Whether a study named the file and it lies outside its folder.
#[must_use]
pub fn is_foreign(path: &Path) -> bool {
    let foreign = FOREIGN.read().unwrap_or_else(PoisonError::into_inner);
    !foreign.is_empty() && path.ancestors().any(|part| foreign.contains(part))
}

/// Sign in a message that replaces words of a foreign file.
const UNSAID: &str = "…";

/// A piece of the content of the file at `path`, for a message: short, without characters that control a terminal, and
/// empty for a foreign file.
#[must_use]
pub fn quoted(path: &Path, cell: &str) -> String {
    if is_foreign(path) || ALL_FOREIGN.load(Ordering::Relaxed) {
        UNSAID.into()
    } else {
        excerpt(cell)
    }
}

/// The first printable letters of a text.
pub fn excerpt(cell: &str) -> String {
    const LONGEST: usize = 20;
    let mut shown: String = cell
        .chars()
        .take(LONGEST)
        .filter(|letter| !crate::plain_text::is_unprintable(*letter) && !letter.is_control())
        .collect();
    if cell.chars().nth(LONGEST).is_some() {
        shown.push('…');
    }
    shown
}

/// Names of the first columns of the file at `path`, for a message; empty for a foreign file.
#[must_use]
pub fn quoted_names<'a>(path: &Path, names: impl IntoIterator<Item = &'a str>) -> String {
    const MOST: usize = 12;
    if is_foreign(path) {
        return "others, which are not quoted: the file lies outside the study's folder".into();
    }
    let all: Vec<String> = names
        .into_iter()
        .take(MOST + 1)
        .map(|name| quoted(path, name))
        .collect();
    let more = if all.len() > MOST { ", …" } else { "" };
    all[..all.len().min(MOST)].join(", ") + more
}

/// A message about a foreign text without the text between its first and its last quotation mark, and without the text
/// after a semicolon, since both may be words of that file.
#[must_use]
pub fn without_words(message: &str) -> String {
    const MARKS: [char; 2] = ['`', '"'];
    let (before, behind) = match (message.find(MARKS), message.rfind(MARKS)) {
        (Some(first), Some(last)) => (&message[..first], format!("`{UNSAID}`{}", &message[last + 1..])),
        _ => ("", message.to_owned()),
    };
    let whole = format!("{before}{behind}");
    whole.split(';').next().unwrap_or_default().to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    /// A project with a study in a folder, and a file beside the project.
    fn tree() -> tempfile::TempDir {
        let dir = tempfile::tempdir().unwrap();
        for name in [
            "lab/studies/data/own.csv",
            "lab/data/shared.csv",
            "other/secret.csv",
        ] {
            let path = dir.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(&path, "a,b\n").unwrap();
        }
        symlink(dir.path().join("other"), dir.path().join("lab/studies/away")).unwrap();
        symlink("data/own.csv", dir.path().join("lab/studies/near.csv")).unwrap();
        dir
    }

    #[test]
    fn files_stay_in_the_folder_of_the_study_by_dots_and_by_links() {
        let dir = tree();
        let folder = dir.path().join("lab/studies");
        let reach = Reach::of(&folder);
        for name in [
            "data/own.csv",
            "near.csv",
            "data/../absent.csv",
            "new/absent.csv",
            "data/../data/own.csv",
        ] {
            assert_eq!(reach.find(&folder, name), Ok(folder.join(name)));
            assert!(!is_foreign(&folder.join(name)), "{name}");
        }
        let out = [
            "../data/shared.csv",
            "../../other/secret.csv",
            "away/secret.csv",
            "away/absent.csv",
            "data/../../absent.csv",
            "absent/../../../other/secret.csv",
            "..",
        ];
        for name in out {
            let told = reach.find(&folder, name).unwrap_err().to_string();
            assert_eq!(told, format!("`{name}` leads out of the folder of the study"));
        }
    }

    #[test]
    fn a_project_is_reached_as_a_whole_and_quoted_no_more_than_what_is_named_absolutely() {
        let dir = tree();
        let (folder, lab) = (dir.path().join("lab/studies"), dir.path().join("lab"));
        fs::write(lab.join(PROJECT), "").unwrap();
        let reach = Reach::of(&folder);
        let shared = reach.find(&folder, "../data/shared.csv").unwrap();
        assert!(reach.find(&folder, "../../other/secret.csv").is_err());
        assert!(reach.find(&folder, "away/secret.csv").is_err());
        let secret = dir.path().join("other/secret.csv");
        assert_eq!(reach.find(&folder, secret.to_str().unwrap()), Ok(secret.clone()));
        for path in [&shared, &secret] {
            assert_eq!((quoted(path, "s3cr3t"), is_foreign(path)), ("…".into(), true));
            assert!(!quoted_names(path, ["s3cr3t"]).contains("s3cr3t"));
        }
        let own = folder.join("data/own.csv");
        assert_eq!(reach.find(&folder, own.to_str().unwrap()), Ok(own.clone()));
        assert_eq!(quoted(&own, "1.5x"), "1.5x");
    }

    #[test]
    fn the_current_folder_is_a_folder() {
        let reach = Reach::of(Path::new(""));
        assert_eq!(reach.own, fs::canonicalize(Path::new(".")).unwrap());
        assert!(
            reach
                .find(Path::new(""), "../../../../../../../../../../etc/passwd")
                .is_err()
        );
        assert!(reach.find(Path::new(""), "absent.csv").is_ok());
    }

    #[test]
    fn little_of_a_file_is_quoted() {
        let own = Path::new("own.csv");
        assert_eq!(
            quoted(own, "root:x:0:0:root:/root:/bin/bash"),
            "root:x:0:0:root:/roo…"
        );
        assert_eq!(quoted(own, "\u{1b}[31m1.5"), "[31m1.5");
        assert_eq!(quoted_names(own, ["a", "b"]), "a, b");
        assert!(quoted_names(own, vec!["a"; 100]).ends_with("a, …"));
    }

    #[test]
    fn words_of_a_message_are_left_out() {
        let told = without_words("unknown key `token`; did you mean `tok`n`? \"x\" is no number");
        assert_eq!(told, "unknown key `…` is no number");
        assert_eq!(
            without_words("there is no such column; there are a, b"),
            "there is no such column"
        );
        assert_eq!(without_words("the file is empty"), "the file is empty");
    }
}
