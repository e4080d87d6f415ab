//! What stands in the way of one trial: then that trial cannot run, and all others can.

use super::{Store, inside, names};
use crate::world::fs;
use contract::Error;
use std::{
    io::ErrorKind,
    path::{Path, PathBuf},
};

/// Files of a trial, by their names.
const FILES: [&str; 5] = [
    "lease",
    "trial.json",
    "earlier.json",
    "metrics.parquet",
    "running/metrics.log",
];

impl Store {
    /// Why a trial cannot be taken up, where that is for something that lies at its place: a file where its
    /// folder should be, a folder or a pipe with the name of a file, a result of a later program. Nothing is
    /// opened that could be waited for.
    #[must_use]
    pub fn obstacle(&self, id: &str) -> Option<Error> {
        let folder = self.folder(id);
        let in_the_way = self.no_folder(&folder).or_else(|| no_file(&folder));
        if let Some(path) = in_the_way {
            return Some(self.no_place(&path));
        }
        match self.end(id) {
            Err(error @ (Error::Newer { .. } | Error::File { .. })) => Some(error),
            // What is damaged is set aside by the run itself.
            _ => names(&folder).err(),
        }
    }

    /// What stands where the store keeps something else, and what helps.
    pub(crate) fn no_place(&self, path: &Path) -> Error {
        let problem = format!(
            "it stands where the store keeps another kind of file: `regimen fsck {}` sets it aside",
            self.root.display()
        );
        let path = path.to_owned();
        Error::Damaged { path, problem }
    }

    /// As [`obstacle`](Self::obstacle), once it is known that something of the trial could not be written: rights
    /// that lack at its place count, too.
    #[must_use]
    pub fn obstacle_to_writing(&self, id: &str) -> Option<Error> {
        let folder = self.folder(id);
        let probe = folder.join(format!(".probe.{}.tmp", crate::world::process::id()));
        let write = || {
            fs::create_dir_all(&folder)?;
            fs::write(&probe, "")?;
            fs::remove_file(&probe)
        };
        let refused = |error: &std::io::Error| error.kind() == ErrorKind::PermissionDenied;
        let denied = || write().err().filter(refused);
        self.obstacle(id)
            .or_else(|| denied().map(Error::file("write into", &folder)))
    }

    /// What is no folder and should be one: those that the trial's lies in, and itself.
    fn no_folder(&self, folder: &Path) -> Option<PathBuf> {
        let above = folder.ancestors().take_while(|path| *path != self.root);
        let all: Vec<PathBuf> = above.map(Path::to_owned).collect();
        let running = folder.join("running");
        let stands = |path: &PathBuf| fs::is_taken(path) && !fs::is_folder(path);
        all.into_iter().rev().chain([running]).find(stands)
    }
}

fn no_file(folder: &Path) -> Option<PathBuf> {
    let mut files = FILES.iter().map(|name| folder.join(name));
    files.find(|path| fs::is_taken(path) && !inside::is_file(path))
}
