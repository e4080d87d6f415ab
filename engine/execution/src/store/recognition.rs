//! Recognises stores by their content, wherever they lie.

use super::{LOOKS, announced, names, pack, repeats};
use crate::world::fs;
use contract::{Error, digest};
use std::path::Path;

/// Folders of a store; every store that is not empty has at least one of them.
const FOLDERS: [&str; 6] = ["trials", "packs", "owners", "looks", "submissions", "aside"];

/// The reason why a folder is no store, as a phrase; `None` if it is a store, or empty. Commands that check and move
/// files call this first.
///
/// # Errors
/// [`Error::File`] if the folder cannot be read.
pub fn no_store(root: &Path) -> Result<Option<String>, Error> {
    if !fs::is_folder(root) {
        return Ok(Some(format!("there is no store at `{}`", root.display())));
    }
    let names = names(root)?;
    let is_one = names.is_empty() || names.iter().any(|name| FOLDERS.contains(&name.as_str()));
    Ok((!is_one).then(|| {
        format!(
            "`{}` is no store: it has other files, and no folder `{}` as a store has",
            root.display(),
            FOLDERS.join("`, `")
        )
    }))
}

/// Whether a folder is certainly a store: it has the folder of a trial, or that of the processes at work or of packs,
/// and no folder that a store does not have. Folders of other programs may be named `trials`, too.
#[must_use]
pub fn is_store(folder: &Path) -> bool {
    // A folder that cannot be read is no store.
    let visible = |folder: &Path| {
        let names = names(folder).unwrap_or_default();
        names.into_iter().filter(|name| !name.starts_with('.'))
    };
    let trials = folder.join("trials");
    let group = visible(&trials).next().filter(|name| name.len() == 2);
    let trial = group.and_then(|group| visible(&trials.join(group)).next());
    let is_id = |name: &String| name.len() == digest::LENGTH && name.bytes().all(|it| it.is_ascii_hexdigit());
    let is_own = |name: String| {
        [LOOKS, pack::FOLDER, announced::FOLDER, repeats::FOLDER].contains(&&*name)
            || FOLDERS.contains(&&*name)
    };
    let is_known = ["owners", pack::FOLDER]
        .iter()
        .any(|name| fs::is_folder(&folder.join(name)));
    trial.as_ref().is_some_and(is_id) || is_known && visible(folder).all(is_own)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_store_is_told_from_folders_of_other_programs() {
        for (is_one, names) in [
            (
                true,
                &[
                    "trials/ab/ab345678901234567890123456789012/trial.json",
                    "notes.txt",
                ][..],
            ),
            (true, &["owners/1.json", "repeats/x.json"]),
            (true, &["packs/1.pack", ".hidden"]),
            (false, &["trials/train.py"]),
            (false, &["trials/ab/train.py"]),
            (false, &["owners/a.py", "lib/b.py"]),
            (false, &["train.py"]),
        ] {
            let dir = tempfile::tempdir().unwrap();
            for name in names {
                let path = dir.path().join(name);
                std::fs::create_dir_all(path.parent().unwrap()).unwrap();
                std::fs::write(path, "").unwrap();
            }
            assert_eq!(is_store(dir.path()), is_one, "{names:?}");
        }
        assert!(!is_store(Path::new("/nowhere")));
    }
}
