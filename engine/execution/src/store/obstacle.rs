//! Obstacles at the place of one trial: that trial cannot run, but all others can.

use super::{Store, inside, names};
use crate::world::fs;
use contract::Error;
use std::{
    io::ErrorKind,
    path::{Path, PathBuf},
};

/// Names of the files of a trial.
const FILES: [&str; 5] = [
    "lease",
    "trial.json",
    "earlier.json",
    "metrics.parquet",
    "running/metrics.log",
];

impl Store {
    /// The obstacle at the trial's place that keeps it from being run: a file instead of its folder, a folder or a pipe
    /// with the name of a file, or a result of a later program. Pipes are not opened, since they could block.
    #[must_use]
    pub fn obstacle(&self, id: &str) -> Option<Error> {
        let folder = self.folder(id);
        let in_the_way = self.no_folder(&folder).or_else(|| no_file(&folder));
        if let Some(path) = in_the_way {
            return Some(self.no_place(&path));
        }
        match self.end(id) {
            Err(error @ (Error::Newer { .. } | Error::File { .. })) => Some(error),
            // The run itself sets damaged files aside.
            _ => names(&folder).err(),
        }
    }

    /// The error for an obstacle at a path of the store, with its remedy.
    pub(crate) fn no_place(&self, path: &Path) -> Error {
        let problem = format!(
            "it stands where the store keeps another kind of file: `regimen fsck {}` sets it aside",
            self.root.display()
        );
        let path = path.to_owned();
        Error::Damaged { path, problem }
    }

    /// Like [`obstacle`](Self::obstacle), once a file of the trial could not be written: missing permissions at its
    /// place count too.
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

    /// The first path that should be a folder and is not: one above the trial's folder, or that folder itself.
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
