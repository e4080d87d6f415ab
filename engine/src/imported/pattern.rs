//! Files by patterns in which `*` stands for any part of one name.

use crate::{
    Error,
    reach::{Outside, Reach},
    store::names,
    world::fs,
};
use std::path::{Component, Path, PathBuf};

/// Most names that are looked at for one pattern: a pattern is for a folder of runs, and not for a disk.
const MOST_NAMES: usize = 200_000;

/// Why the files of a pattern cannot be listed.
#[derive(Debug, thiserror::Error)]
pub enum PatternError {
    /// It, or a link that it leads to, leads out of the study's folder and project.
    #[error(transparent)]
    Outside(Outside),
    /// A folder on the way cannot be read.
    #[error(transparent)]
    Unreadable(Error),
    /// Its folders have too many names.
    #[error("more than {MOST_NAMES} names would be looked at for `{0}`: name the folder of the runs")]
    TooMany(String),
}

/// The files that a pattern names, seen from `folder`, in the order of their names; none where no file matches. A study's
/// files lie within `reach`.
///
/// # Errors
/// [`PatternError`].
pub fn matching(reach: &Reach, folder: &Path, pattern: &str) -> Result<Vec<PathBuf>, PatternError> {
    // Nothing is listed before it is known that a study may name it.
    let fixed = pattern.split('*').next().unwrap_or_default();
    let fixed = fixed.rsplit_once('/').map_or(".", |(folder, _)| folder);
    let is_absolute = Path::new(pattern).is_absolute();
    if !is_absolute {
        let outside = |_| PatternError::Outside(Outside { name: pattern.into() });
        reach.find(folder, fixed).map_err(outside)?;
    }
    let found = listed(folder, pattern)?;
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

fn listed(folder: &Path, pattern: &str) -> Result<Vec<PathBuf>, PatternError> {
    let (mut found, mut looked_at) = (vec![folder.to_owned()], 0);
    for part in Path::new(pattern).components() {
        let name = part.as_os_str().to_string_lossy().into_owned();
        let is_pattern = matches!(part, Component::Normal(_)) && name.contains('*');
        if !is_pattern {
            found.iter_mut().for_each(|path| path.push(&name));
            continue;
        }
        let mut below = Vec::new();
        for path in found
            .iter()
            .filter(|path| path.as_os_str().is_empty() || fs::is_folder(path))
        {
            let listed = if path.as_os_str().is_empty() {
                Path::new(".")
            } else {
                path
            };
            let hidden = |entry: &String| entry.starts_with('.') && !name.starts_with('.');
            let entries = names(listed).map_err(PatternError::Unreadable)?;
            looked_at += entries.len();
            if looked_at > MOST_NAMES {
                return Err(PatternError::TooMany(pattern.into()));
            }
            let entries = entries
                .into_iter()
                .filter(|entry| !hidden(entry) && fits(&name, entry));
            below.extend(entries.map(|entry| path.join(entry)));
        }
        found = below;
    }
    found.retain(|path| fs::is_file(path));
    Ok(found)
}

/// Whether a name is of a pattern.
fn fits(pattern: &str, name: &str) -> bool {
    let mut parts = pattern.split('*');
    let first = parts.next().unwrap_or_default();
    let Some(mut rest) = name.strip_prefix(first) else {
        return false;
    };
    let Some(last) = parts.next_back() else {
        return rest.is_empty();
    };
    // Of what stands between two stars the first place is as good as any.
    for part in parts {
        match rest.find(part) {
            Some(place) => rest = &rest[place + part.len()..],
            None => return false,
        }
    }
    rest.ends_with(last)
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
            assert_eq!(fits(pattern, name), wanted, "{pattern} {name}");
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
