//! Files and folders.
//!
//! The calls are those of the standard library, by their names, and what a path alone can be asked stands beside
//! them, because a method of a path would go past a simulated disk.

#[cfg(test)]
pub use super::simulated::files::{
    File, Metadata, OpenOptions, canonicalize, copy, create_dir, create_dir_all, hard_link, metadata, read,
    read_dir, read_link, read_to_string, remove_dir, remove_dir_all, remove_file, rename, symlink_metadata,
    write,
};
#[cfg(not(test))]
pub use std::fs::{
    File, Metadata, OpenOptions, canonicalize, copy, create_dir, create_dir_all, hard_link, metadata, read,
    read_dir, read_link, read_to_string, remove_dir, remove_dir_all, remove_file, rename, symlink_metadata,
    write,
};

use std::path::{Component, Path};

/// True for a name that leads to no place outside the folder from which it is seen, where no link stands in it.
pub fn is_inside(name: &Path) -> bool {
    name.components().all(|part| matches!(part, Component::Normal(_)))
}

/// True where something is there; a link is followed.
pub fn exists(path: &Path) -> bool {
    metadata(path).is_ok()
}

/// True where something is there, be it a link that leads nowhere.
pub fn is_taken(path: &Path) -> bool {
    symlink_metadata(path).is_ok()
}

/// True where two paths lead to the same file or folder.
pub fn is_same(one: &Path, other: &Path) -> bool {
    canonicalize(one).is_ok_and(|one| canonicalize(other).is_ok_and(|other| one == other))
}

/// True for a file; a link is followed.
pub fn is_file(path: &Path) -> bool {
    metadata(path).is_ok_and(|data| data.is_file())
}

/// True for a folder; a link is followed.
pub fn is_folder(path: &Path) -> bool {
    metadata(path).is_ok_and(|data| data.is_dir())
}
