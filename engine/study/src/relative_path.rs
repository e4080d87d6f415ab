//! Relative paths from folders to files, computed from the names alone. They stay valid if the folder and the file are
//! moved together.

use document::reach::Reach;
use std::{
    ffi::OsString,
    path::{Component, Path, PathBuf},
};

/// The relative path from one folder to a file, both seen from the current folder.
#[must_use]
pub fn way(from: &Path, to: &Path) -> PathBuf {
    let (from, to) = (parts(from), parts(to));
    let shared = from.iter().zip(&to).take_while(|(one, two)| one == two).count();
    let up = std::iter::repeat_n("..".into(), from.len() - shared);
    up.chain(to[shared..].iter().cloned()).collect()
}

/// The name of a file in a study of `folder`: the relative path to it, or its absolute path if the relative one would
/// lead out of the folder and its project.
#[must_use]
pub fn name_from(folder: &Path, to: &Path) -> PathBuf {
    name_within(&Reach::of(folder), folder, to)
}

/// Like [`name_from`], for a study that is written out into `folder`.
#[must_use]
pub fn name_written_out(folder: &Path, to: &Path) -> PathBuf {
    name_within(&Reach::of_written_out(folder), folder, to)
}

fn name_within(reach: &Reach, folder: &Path, to: &Path) -> PathBuf {
    if reach.holds(to) {
        way(folder, to)
    } else {
        along(Path::new(""), to)
    }
}

/// The path that a relative path leads to from a folder.
#[must_use]
pub fn along(from: &Path, way: &Path) -> PathBuf {
    parts(&from.join(way)).into_iter().collect()
}

/// The parts of a path from the root, without `.` and `..`.
fn parts(path: &Path) -> Vec<OsString> {
    // A file that is named alone has the empty path as its folder.
    let path = if path.as_os_str().is_empty() {
        Path::new(".")
    } else {
        path
    };
    let absolute = std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf());
    absolute.components().fold(Vec::new(), |mut parts, part| {
        match part {
            Component::ParentDir => drop(parts.pop()),
            Component::CurDir => {}
            other => parts.push(other.as_os_str().to_os_string()),
        }
        parts
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_way_leads_back_to_its_file() {
        let (folder, file) = (Path::new("results/small"), Path::new("experiments/small.yaml"));
        assert_eq!(way(folder, file), Path::new("../../experiments/small.yaml"));
        assert_eq!(
            along(folder, &way(folder, file)),
            std::path::absolute(file).unwrap()
        );
        assert_eq!(
            way(Path::new("a"), Path::new("./b/../small.yaml")),
            Path::new("../small.yaml")
        );
        assert_eq!(
            way(Path::new(""), &std::path::absolute("runs/a.csv").unwrap()),
            Path::new("runs/a.csv")
        );
    }
}
