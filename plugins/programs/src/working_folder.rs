//! The working folder of a trial: the files that the study declares, and no others.
//!
//! ```text
//! work/                   the sources and the lock file, under their names; what the program writes
//!      checkpoint/        what the program saves
//!      .regimen/          of the engine: who runs, how it ended, its output
//!               inputs/NAME/   copies of the inputs
//!               parameters.json
//!               trial.json      the data of `regimen_trial`
//!               log.jsonl       what `trial.log` writes
//!               python/         the module `regimen_trial`
//! ```

use crate::{
    ProgramConfig,
    config::{Lock, NamedFile},
};
use contract::{DataFile, Error, own_training::Assignment};
pub use execution::guard::NOTES;
use serde_json::json;
use std::{
    collections::BTreeMap,
    fs, io,
    path::{Path, PathBuf},
};

/// The Python module through which a program reaches its trial; the package `regimen` has the same module.
const MODULE: &str = include_str!("../../wheel/regimen/_trial.py");

/// Paths in a working folder.
#[derive(Debug, Clone)]
pub struct WorkingFolder {
    /// The folder in which the program runs.
    pub folder: PathBuf,
    /// Paths of the inputs, by name.
    pub inputs: BTreeMap<String, String>,
}

impl WorkingFolder {
    /// The paths in a folder, which need not exist.
    pub fn at(folder: &Path, config: &ProgramConfig) -> Self {
        let place = |(name, input): (&String, &NamedFile)| {
            let file = input.file.path().file_name().unwrap_or_default();
            let path = folder.join(NOTES).join("inputs").join(name).join(file);
            (name.clone(), path.display().to_string())
        };
        Self {
            folder: folder.to_owned(),
            inputs: config.inputs.iter().map(place).collect(),
        }
    }

    /// Folder of the engine's own files.
    pub fn notes(&self) -> PathBuf {
        self.folder.join(NOTES)
    }

    /// The folder in which the program saves its state.
    pub fn checkpoint(&self) -> PathBuf {
        self.folder.join("checkpoint")
    }

    /// Folder of the module `regimen_trial`.
    pub fn python(&self) -> PathBuf {
        self.notes().join("python")
    }

    /// JSON file with all parameters.
    pub fn parameters(&self) -> PathBuf {
        self.notes().join("parameters.json")
    }

    /// JSON file from which `regimen_trial` knows its trial.
    pub fn trial(&self) -> PathBuf {
        self.notes().join("trial.json")
    }

    /// Writes the trial's data for the program; the program requests measurements at `measured_at`.
    ///
    /// # Errors
    /// [`Error::File`] where the file cannot be written.
    pub fn tell(&self, of: &Assignment, measured_at: Option<&Path>) -> Result<(), Error> {
        let told = json!({ "seed": of.seed, "simulator": of.simulator, "measured_at": measured_at });
        let path = self.trial();
        fs::write(&path, told.to_string()).map_err(Error::file("write", &path))
    }

    /// Whether the program saved any state.
    pub fn has_checkpoint(&self) -> bool {
        fs::read_dir(self.checkpoint()).is_ok_and(|mut names| names.next().is_some())
    }

    /// Removes all files of an earlier attempt.
    ///
    /// # Errors
    /// [`Error::File`] where one cannot be removed.
    pub fn empty(&self) -> Result<(), Error> {
        let cannot = || Error::file("empty", &self.folder);
        for name in fs::read_dir(&self.folder).map_err(cannot())? {
            let path = name.map_err(cannot())?.path();
            let is_folder = path.symlink_metadata().is_ok_and(|it| it.is_dir());
            let removed = if is_folder {
                fs::remove_dir_all(&path)
            } else {
                fs::remove_file(&path)
            };
            removed.map_err(Error::file("remove", &path))?;
        }
        Ok(())
    }

    /// Copies the declared files into the folder. Other files of the program stay.
    ///
    /// # Errors
    /// [`Error::DataFileChanged`] where a file differs from that in the trial's id, and [`Error::File`].
    pub fn lay(&self, config: &ProgramConfig) -> Result<(), Error> {
        for folder in [self.python(), self.checkpoint()] {
            fs::create_dir_all(&folder).map_err(Error::file("create", &folder))?;
        }
        for (name, source) in &config.sources.0 {
            copy(&source.file, &self.folder.join(name))?;
        }
        if let Some(Lock::File(lock)) = &config.lock {
            let name = lock.file.path().file_name().unwrap_or_default();
            copy(&lock.file, &self.folder.join(name))?;
        }
        for (name, input) in &config.inputs {
            copy(&input.file, Path::new(&self.inputs[name]))?;
        }
        let path = self.python().join("regimen_trial.py");
        fs::write(&path, MODULE).map_err(Error::file("write", &path))?;
        let path = self.parameters();
        let text = serde_json::to_vec_pretty(&config.parameters).map_err(io::Error::from);
        text.and_then(|text| fs::write(&path, text))
            .map_err(Error::file("write", &path))
    }
}

/// Copies a file. A script can be started as a program.
fn copy(file: &DataFile, to: &Path) -> Result<(), Error> {
    use std::os::unix::fs::PermissionsExt as _;
    if let Some(folder) = to.parent() {
        fs::create_dir_all(folder).map_err(Error::file("create", folder))?;
    }
    // The program may have made it read-only, or replaced it by a link.
    match fs::remove_file(to) {
        Err(source) if source.kind() != io::ErrorKind::NotFound => {
            return Err(Error::File {
                doing: "replace",
                path: to.into(),
                source,
            });
        }
        _ => {}
    }
    file.copy_to(to)?;
    let mut first = [0; 4];
    let read = fs::File::open(to).and_then(|mut file| io::Read::read(&mut file, &mut first));
    let length = read.map_err(Error::file("read", to))?;
    if first[..length].starts_with(b"#!") || first[..length] == *b"\x7fELF" {
        fs::set_permissions(to, fs::Permissions::from_mode(0o755)).map_err(Error::file("write", to))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::tests::config;

    #[test]
    fn a_working_folder_holds_what_is_declared_and_scripts_can_be_started() {
        let (from, to) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let file = |name: &str, text: &str| {
            fs::write(from.path().join(name), text).unwrap();
            json!({ "file": from.path().join(name) })
        };
        let config = config(json!({
            "parameters": { "lr": 0.5 },
            "sources": { "run.sh": file("a.sh", "#!/bin/sh\n"), "lib/b.awk": file("b.awk", "x") },
            "lock": file("packages.lock", "none"),
            "inputs": { "cases": file("cases.csv", "a,b\n") },
        }));
        let place = WorkingFolder::at(to.path(), &config);
        place.lay(&config).unwrap();
        place.lay(&config).unwrap();
        let read = |path: &Path| fs::read_to_string(path).unwrap();
        assert_eq!(read(&to.path().join("lib/b.awk")), "x");
        assert_eq!(read(&to.path().join("packages.lock")), "none");
        assert_eq!(read(Path::new(&place.inputs["cases"])), "a,b\n");
        assert_eq!(read(&place.parameters()), "{\n  \"lr\": 0.5\n}");
        let mode = |name: &str| {
            use std::os::unix::fs::PermissionsExt as _;
            fs::metadata(to.path().join(name)).unwrap().permissions().mode() & 0o111
        };
        assert!(mode("run.sh") != 0 && mode("lib/b.awk") == 0);
        assert!(!place.has_checkpoint());
        fs::write(place.checkpoint().join("state"), "1").unwrap();
        assert!(place.has_checkpoint());
        place.empty().unwrap();
        assert_eq!(fs::read_dir(to.path()).unwrap().count(), 0);
    }

    #[test]
    fn a_source_that_changed_since_the_trial_got_its_id_is_refused() {
        let (from, to) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let path = from.path().join("weights.bin");
        fs::write(&path, b"\0\x01").unwrap();
        let config = config(
            json!({ "sources": { "weights.bin": { "file": { "path": path, "digest": "0".repeat(64) } } } }),
        );
        let problem = WorkingFolder::at(to.path(), &config).lay(&config).unwrap_err();
        assert!(matches!(problem, Error::DataFileChanged { .. }), "{problem}");
    }
}
