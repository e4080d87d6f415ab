//! Files by patterns in which `*` stands for any part of one name, and `**` for folders of any depth.

use crate::{Error, store::names, world::fs};
use std::path::{Component, Path, PathBuf};

/// The deepest that `**` looks, and the most folders that it looks into.
const DEEPEST: usize = 64;
const MOST_FOLDERS: usize = 100_000;

/// The files that a pattern names, seen from `folder`, in the order of their names; none where no file matches.
///
/// # Errors
/// [`Error::File`] where a folder on the way cannot be read, [`Error::Input`] where `**` meets too many.
pub fn matching(folder: &Path, pattern: &str) -> Result<Vec<PathBuf>, Error> {
    let mut found = vec![folder.to_owned()];
    for part in Path::new(pattern).components() {
        let name = part.as_os_str().to_string_lossy().into_owned();
        let is_pattern = matches!(part, Component::Normal(_)) && name.contains('*');
        if !is_pattern {
            found.iter_mut().for_each(|path| path.push(&name));
        } else if name == "**" {
            let mut below = Vec::new();
            for path in found {
                with_folders(path, DEEPEST, &mut below)?;
            }
            found = below;
        } else {
            found = children(&found, &name)?;
        }
    }
    // Of `a/**/**/b` the same file is found in several ways.
    found.sort();
    found.dedup();
    found.retain(|path| fs::is_file(path));
    Ok(found)
}

/// A folder and all folders below it. Links are not followed, so that none is met again; hidden folders are passed
/// over, as a shell does.
fn with_folders(path: PathBuf, deepest: usize, found: &mut Vec<PathBuf>) -> Result<(), Error> {
    if found.len() >= MOST_FOLDERS {
        return Err(Error::Input {
            path,
            line: None,
            column: None,
            problem: format!(
                "`**` looks into no more than {MOST_FOLDERS} folders: begin the pattern further down"
            ),
        });
    }
    for entry in entries(&path)?
        .into_iter()
        .filter(|entry| !entry.starts_with('.'))
    {
        let below = path.join(entry);
        if deepest > 0 && fs::symlink_metadata(&below).is_ok_and(|data| data.is_dir()) {
            with_folders(below, deepest - 1, found)?;
        }
    }
    found.push(path);
    Ok(())
}

/// What stands in these folders under names of a pattern.
fn children(folders: &[PathBuf], pattern: &str) -> Result<Vec<PathBuf>, Error> {
    let mut below = Vec::new();
    for path in folders
        .iter()
        .filter(|path| path.as_os_str().is_empty() || fs::is_folder(path))
    {
        let hidden = |entry: &String| entry.starts_with('.') && !pattern.starts_with('.');
        let entries = entries(path)?
            .into_iter()
            .filter(|entry| !hidden(entry) && parts(pattern, entry).is_some());
        below.extend(entries.map(|entry| path.join(entry)));
    }
    Ok(below)
}

fn entries(folder: &Path) -> Result<Vec<String>, Error> {
    let is_here = folder.as_os_str().is_empty();
    names(if is_here { Path::new(".") } else { folder })
}

/// The parts of a name that the stars of a pattern stand for, where the name is of the pattern.
pub(super) fn parts<'a>(pattern: &str, name: &'a str) -> Option<Vec<&'a str>> {
    let mut texts = pattern.split('*');
    let mut rest = name.strip_prefix(texts.next().unwrap_or_default())?;
    let Some(last) = texts.next_back() else {
        return rest.is_empty().then(Vec::new);
    };
    let mut found = Vec::new();
    // Of the texts between two stars the first place is as good as any.
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
            let found = matching(dir.path(), pattern).unwrap();
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
    fn files_come_in_the_order_of_their_names() {
        let dir = tempfile::tempdir().unwrap();
        for name in ["b/y.csv", "a/x.csv", "a/z.txt", "a/.hidden.csv", "top.csv"] {
            let path = dir.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, "").unwrap();
        }
        let found = |pattern: &str| -> Vec<String> {
            let found = matching(dir.path(), pattern).unwrap();
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
