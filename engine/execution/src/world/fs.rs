//! Files and folders.
//!
//! The calls have the names of those of the standard library. Questions that a method of a path would answer have
//! functions here, because such a method would bypass a simulated disk.

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

/// Whether a name stays inside the folder from which it is seen, provided that it contains no link.
pub fn is_inside(name: &Path) -> bool {
    name.components().all(|part| matches!(part, Component::Normal(_)))
}

/// Makes a file readable only for its owner.
///
/// # Errors
/// The error of the system.
pub fn make_private(path: &Path) -> std::io::Result<()> {
    use std::os::unix::fs::PermissionsExt as _;
    std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o600))
}

/// Whether a path leads to an entry; links are followed.
pub fn exists(path: &Path) -> bool {
    metadata(path).is_ok()
}

/// Whether a path has an entry, even if it is a link that leads nowhere.
pub fn is_taken(path: &Path) -> bool {
    symlink_metadata(path).is_ok()
}

/// Whether two paths lead to the same file or folder.
pub fn is_same(one: &Path, other: &Path) -> bool {
    canonicalize(one).is_ok_and(|one| canonicalize(other).is_ok_and(|other| one == other))
}

/// File systems that no other machine can see, by their names in the table of mounts.
const OF_ONE_MACHINE: [&str; 11] = [
    "bcachefs", "btrfs", "ext2", "ext3", "ext4", "f2fs", "overlay", "ramfs", "tmpfs", "xfs", "zfs",
];

/// Whether a path lies on a file system of this machine alone; false if that is not known.
pub fn is_of_this_machine(path: &Path) -> bool {
    let (Ok(path), Ok(mounts)) = (canonicalize(path), read_to_string("/proc/self/mountinfo")) else {
        return false;
    };
    kind_of_mount(&mounts, &path).is_some_and(|kind| OF_ONE_MACHINE.contains(&kind))
}

/// The kind of the file system on which a path lies, from the table of mounts: the deepest mount, and the last of
/// several at one place.
fn kind_of_mount<'a>(mounts: &'a str, path: &Path) -> Option<&'a str> {
    let mount = |line: &'a str| {
        let (before, after) = line.split_once(" - ")?;
        // Spaces and backslashes are written as octal numbers.
        let place = before
            .split(' ')
            .nth(4)?
            .replace("\\040", " ")
            .replace("\\134", "\\");
        let depth = Path::new(&place).components().count();
        let kind = after.split(' ').next()?;
        path.starts_with(&place).then_some((depth, kind))
    };
    mounts
        .lines()
        .filter_map(mount)
        .max_by_key(|(depth, _)| *depth)
        .map(|(_, kind)| kind)
}

/// Whether a path leads to a file; links are followed.
pub fn is_file(path: &Path) -> bool {
    metadata(path).is_ok_and(|data| data.is_file())
}

/// Whether a path leads to a folder; links are followed.
pub fn is_folder(path: &Path) -> bool {
    metadata(path).is_ok_and(|data| data.is_dir())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_deepest_mount_and_the_last_of_several_tells_where_a_path_lies() {
        let mounts = "1 0 8:1 / / rw - ext4 /dev/sda1 rw\n\
            2 1 0:5 / /home rw,relatime shared:1 - nfs4 server:/home rw\n\
            3 2 0:6 / /home/a\\040b rw - xfs /dev/sdb rw\n\
            4 1 0:7 / /work rw - tmpfs none rw\n\
            5 1 0:8 / /work rw - lustre none rw\n";
        let kind = |path: &str| kind_of_mount(mounts, Path::new(path));
        assert_eq!(kind("/srv/store"), Some("ext4"));
        assert_eq!(kind("/home/c/store"), Some("nfs4"));
        assert_eq!(kind("/home/a b/store"), Some("xfs"));
        assert_eq!(kind("/homes"), Some("ext4"));
        assert_eq!(kind("/work"), Some("lustre"));
        assert_eq!(kind_of_mount("", Path::new("/")), None);
    }
}
