//! Files by patterns, where `*` stands for any part of one name, and `**` for folders of any depth.

use crate::made_files::is_made;
use contract::Error;
use document::reach::{Outside, Reach};
use execution::{store::names, world::fs};
use std::path::{Component, Path, PathBuf};

/// Maximum depth of `**`.
const DEEPEST: usize = 64;
/// Maximum number of names that are examined for one pattern. A pattern is meant for a folder of runs, not for a disk.
const MOST_NAMES: usize = 200_000;

/// The reason why the files of a pattern cannot be listed.
#[derive(Debug, thiserror::Error)]
pub enum PatternError {
    /// The pattern, or a link that it follows, leads out of the study's folder and project.
    #[error(transparent)]
    Outside(Outside),
    /// A folder on the path cannot be read.
    #[error(transparent)]
    Unreadable(Error),
    /// The folders of the pattern have too many names.
    #[error("more than {MOST_NAMES} names would be looked at for `{0}`: name the folder of the runs")]
    TooMany(String),
}

/// The files that match a pattern relative to `folder`, in the order of their names; empty if no file matches. A
/// study's files lie within `reach`.
///
/// # Errors
/// [`PatternError`].
pub fn matching(reach: &Reach, folder: &Path, pattern: &str) -> Result<Vec<PathBuf>, PatternError> {
    found(reach, folder, pattern, |_| false)
}

/// Like [`matching`], for the sources of a program: a pattern enters no store, no folder of results, no virtual
/// environment and no `__pycache__`. A name without a star may lead there.
///
/// # Errors
/// [`PatternError`].
pub fn matching_sources(reach: &Reach, folder: &Path, pattern: &str) -> Result<Vec<PathBuf>, PatternError> {
    match pattern.contains('*') {
        true => found(reach, folder, pattern, is_made),
        false => matching(reach, folder, pattern),
    }
}

fn found(
    reach: &Reach,
    folder: &Path,
    pattern: &str,
    skips: fn(&Path) -> bool,
) -> Result<Vec<PathBuf>, PatternError> {
    // Nothing is listed until the path before the first star is known to be allowed.
    let fixed = pattern.split('*').next().unwrap_or_default();
    let fixed = fixed.rsplit_once('/').map_or(".", |(folder, _)| folder);
    let is_absolute = Path::new(pattern).is_absolute();
    if !is_absolute {
        let outside = |_| PatternError::Outside(Outside { name: pattern.into() });
        reach.find(folder, fixed).map_err(outside)?;
    }
    let found = FolderWalk {
        pattern,
        skips,
        looked_at: 0,
    }
    .files(folder)?;
    for path in &found {
        let name = if is_absolute {
            path
        } else {
            path.strip_prefix(folder).unwrap_or(path)
        };
        let name = name.to_string_lossy();
        reach.find(folder, &name).map_err(PatternError::Outside)?;
    }
    Ok(found)
}

/// A walk through the folders that a pattern names.
struct FolderWalk<'a> {
    pattern: &'a str,
    /// Whether a folder below the first one is not entered.
    skips: fn(&Path) -> bool,
    looked_at: usize,
}

impl FolderWalk<'_> {
    fn files(&mut self, folder: &Path) -> Result<Vec<PathBuf>, PatternError> {
        let mut found = vec![folder.to_owned()];
        for part in Path::new(self.pattern).components() {
            let name = part.as_os_str().to_string_lossy().into_owned();
            let is_name = matches!(part, Component::Normal(_));
            let is_pattern = is_name && name.contains('*');
            if !is_pattern {
                found.iter_mut().for_each(|path| path.push(&name));
                found.retain(|path| !is_name || !(self.skips)(path));
            } else if name == "**" {
                let mut below = Vec::new();
                for path in found {
                    self.with_folders(path, DEEPEST, &mut below)?;
                }
                found = below;
            } else {
                found = self.children(&found, &name)?;
            }
        }
        // A pattern such as `a/**/**/b` finds the same file several times.
        found.sort();
        found.dedup();
        found.retain(|path| fs::is_file(path));
        Ok(found)
    }

    /// A folder and all folders below it. Links are not followed, so that no folder is visited twice. Hidden folders
    /// are skipped, as in a shell.
    fn with_folders(
        &mut self,
        path: PathBuf,
        deepest: usize,
        found: &mut Vec<PathBuf>,
    ) -> Result<(), PatternError> {
        let entries = self.entries(&path)?;
        for entry in entries.into_iter().filter(|entry| !entry.starts_with('.')) {
            let below = path.join(entry);
            let is_folder = || fs::symlink_metadata(&below).is_ok_and(|data| data.is_dir());
            if deepest > 0 && is_folder() && !(self.skips)(&below) {
                self.with_folders(below, deepest - 1, found)?;
            }
        }
        found.push(path);
        Ok(())
    }

    /// The names in these folders that match a part of the pattern.
    fn children(&mut self, folders: &[PathBuf], part: &str) -> Result<Vec<PathBuf>, PatternError> {
        let mut below = Vec::new();
        for path in folders
            .iter()
            .filter(|path| path.as_os_str().is_empty() || fs::is_folder(path))
        {
            let hidden = |entry: &String| entry.starts_with('.') && !part.starts_with('.');
            let entries = self
                .entries(path)?
                .into_iter()
                .filter(|entry| !hidden(entry) && parts(part, entry).is_some());
            below.extend(entries.map(|entry| path.join(entry)));
        }
        below.retain(|path| !(self.skips)(path));
        Ok(below)
    }

    fn entries(&mut self, folder: &Path) -> Result<Vec<String>, PatternError> {
        let is_here = folder.as_os_str().is_empty();
        let entries =
            names(if is_here { Path::new(".") } else { folder }).map_err(PatternError::Unreadable)?;
        self.looked_at += entries.len();
        if self.looked_at > MOST_NAMES {
            return Err(PatternError::TooMany(self.pattern.into()));
        }
        Ok(entries)
    }
}

/// The parts of a name that the stars of a pattern stand for; `None` if the name does not match.
pub(super) fn parts<'a>(pattern: &str, name: &'a str) -> Option<Vec<&'a str>> {
    let mut texts = pattern.split('*');
    let mut rest = name.strip_prefix(texts.next().unwrap_or_default())?;
    let Some(last) = texts.next_back() else {
        return rest.is_empty().then(Vec::new);
    };
    let mut found = Vec::new();
    // For a text between two stars, the first match is as good as any.
    for text in texts {
        let place = rest.find(text)?;
        found.push(&rest[..place]);
        rest = &rest[place + text.len()..];
    }
    found.push(rest.strip_suffix(last)?);
    Some(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_star_is_any_part_of_a_name() {
        for (pattern, name, wanted) in [
            ("*", "a", true),
            ("a", "a", true),
            ("a", "ab", false),
            ("*.csv", "x.csv", true),
            ("*.csv", "x.csv.gz", false),
            ("a*b*c", "abc", true),
            ("a*b*c", "axxbyyc", true),
            ("a*b*c", "axxcyyb", false),
            ("ab*ba", "aba", false),
            ("**", "any", true),
        ] {
            assert_eq!(parts(pattern, name).is_some(), wanted, "{pattern} {name}");
        }
    }

    #[test]
    fn stars_stand_for_parts() {
        assert_eq!(parts("ppo__* - *", "ppo__1 - return"), Some(vec!["1", "return"]));
        assert_eq!(parts("*", "a"), Some(vec!["a"]));
    }

    #[test]
    fn two_stars_are_folders_of_any_depth_and_no_link_is_followed() {
        let dir = tempfile::tempdir().unwrap();
        for name in ["top.csv", "a/x.csv", "a/b/c/x.csv", ".hidden/x.csv", "a/b/y.txt"] {
            let path = dir.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, "").unwrap();
        }
        std::os::unix::fs::symlink(".", dir.path().join("a/again")).unwrap();
        let found = |pattern: &str| -> Vec<String> {
            let found = matching(&Reach::of(dir.path()), dir.path(), pattern).unwrap();
            found
                .iter()
                .map(|path| path.strip_prefix(dir.path()).unwrap().display().to_string())
                .collect()
        };
        assert_eq!(found("**/*.csv"), ["a/b/c/x.csv", "a/x.csv", "top.csv"]);
        assert_eq!(found("a/**/x.csv"), ["a/b/c/x.csv", "a/x.csv"]);
        assert_eq!(found("**/**/x.csv"), ["a/b/c/x.csv", "a/x.csv"]);
        assert_eq!(found("**"), [""; 0], "a folder is no file");
    }

    #[test]
    fn sources_are_not_sought_among_made_files_unless_one_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let write = |name: &str, text: &str| {
            let path = dir.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        };
        let trial = "kept/trials/ab/ab345678901234567890123456789012/running/work";
        let made = [
            "__pycache__/a.py",
            "env/lib/a.py",
            "out/s/a.py",
            &format!("{trial}/a.py"),
        ];
        for name in ["a.py", "lib/a.py", "lib/trials/a.py"].iter().chain(&made) {
            write(name, "");
        }
        write("env/pyvenv.cfg", "");
        write("out/index.html", "");
        write(
            "out/s/manifest.json",
            r#"{ "study": "s", "spec": "../../s.yaml", "files": {} }"#,
        );
        write("lib/manifest.json", "{}");
        let found = |pattern: &str| -> Vec<String> {
            let found = matching_sources(&Reach::of(dir.path()), dir.path(), pattern).unwrap();
            let name = |path: &PathBuf| path.strip_prefix(dir.path()).unwrap().display().to_string();
            found.iter().map(name).collect()
        };
        assert_eq!(found("**/*.py"), ["a.py", "lib/a.py", "lib/trials/a.py"]);
        assert_eq!(found("*"), ["a.py"]);
        assert_eq!(
            found("**/*"),
            ["a.py", "lib/a.py", "lib/manifest.json", "lib/trials/a.py"]
        );
        assert_eq!(found("*/*.py"), ["lib/a.py"]);
        assert_eq!(found("./*.py").len(), 1);
        assert_eq!(found("env/**/*.py"), [""; 0]);
        for name in made {
            assert_eq!(found(name), [name], "it is named");
        }
    }

    #[test]
    fn files_come_in_the_order_of_their_names() {
        let dir = tempfile::tempdir().unwrap();
        for name in ["b/y.csv", "a/x.csv", "a/z.txt", "a/.hidden.csv", "top.csv"] {
            let path = dir.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, "").unwrap();
        }
        let found = |pattern: &str| -> Vec<String> {
            let found = matching(&Reach::of(dir.path()), dir.path(), pattern).unwrap();
            found
                .iter()
                .map(|path| path.strip_prefix(dir.path()).unwrap().display().to_string())
                .collect()
        };
        assert_eq!(found("*/*.csv"), ["a/x.csv", "b/y.csv"]);
        assert_eq!(found("a/x.csv"), ["a/x.csv"]);
        assert_eq!(found("a"), [""; 0], "a folder is no file");
        assert_eq!(found("c/*.csv"), [""; 0]);
        assert_eq!(found("a/../top.*"), ["a/../top.csv"]);
    }
}
