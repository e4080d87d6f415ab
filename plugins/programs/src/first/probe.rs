//! One run of a program for its help and its metrics: in a folder of its own with its sources, as in a trial,
//! under the guard.

use super::error::DraftRefusal;
use crate::{
    ProgramConfig, agent,
    config::{Lock, NamedFile, NoLock, Sources},
    lines::Filter,
    output::{OutputReader, STREAMS},
    process::Process,
    working_folder::WorkingFolder,
};
use contract::{DataFile, Error, own_training::Assignment, resources::Share};
use document::reach::Reach;
use imported::matching;
use std::{collections::BTreeMap, path::Path, time::Duration};

/// Longest time for the output of `--help`.
const LONGEST_HELP: Duration = Duration::from_secs(60);

/// A temporary folder in which a program runs for inspection.
#[derive(Debug)]
pub struct Probe {
    config: ProgramConfig,
    folder: tempfile::TempDir,
}

/// Result of a program's run in the probe.
#[derive(Debug, Default)]
pub struct ProbeRun {
    /// Whether the program ended by itself.
    pub has_ended: bool,
    /// Keys in the lines of its output.
    pub keys: Vec<String>,
}

impl Probe {
    /// Makes a folder with these files of the study's folder, given by names or patterns.
    ///
    /// # Errors
    /// [`DraftRefusal::NotHere`] for a pattern without a file.
    pub fn new(
        from: &Path,
        sources: &[String],
        lock: Option<&str>,
        interpreter: &str,
    ) -> Result<Self, DraftRefusal> {
        let named = |name: &str| NamedFile {
            file: DataFile::new(from.join(name)),
        };
        let mut files = Sources::default();
        for pattern in sources {
            let found = matching(&Reach::of(from), from, pattern)
                .map_err(|error| Error::config("sources", error.to_string()))?;
            if found.is_empty() {
                let what = "a source of the program".into();
                let file = pattern.clone();
                return Err(DraftRefusal::NotHere { file, what });
            }
            for path in found {
                let name = path
                    .strip_prefix(from)
                    .unwrap_or(&path)
                    .to_string_lossy()
                    .into_owned();
                let file = named(&name);
                files.0.insert(name, file);
            }
        }
        let config = ProgramConfig {
            sources: files,
            lock: Some(lock.map_or(Lock::Without(NoLock::None), |name| Lock::File(named(name)))),
            interpreter: interpreter.to_owned(),
            ..ProgramConfig::default()
        };
        let folder = tempfile::tempdir().map_err(Error::file("create", Path::new("a temporary folder")))?;
        Ok(Self { config, folder })
    }

    /// The probe with environment variables of the command.
    pub fn with_variables(mut self, variables: &BTreeMap<String, String>) -> Self {
        self.config.variables.clone_from(variables);
        self
    }

    pub fn files(&self) -> impl Iterator<Item = &str> {
        self.config.sources.0.keys().map(String::as_str)
    }

    /// The working folder of the program.
    pub fn place(&self) -> WorkingFolder {
        WorkingFolder::at(self.folder.path(), &self.config)
    }

    /// Output of the program when it is asked for its options, within `longest`; its exit status does not count.
    ///
    /// # Errors
    /// [`DraftRefusal::Engine`] where the program cannot be started.
    pub fn help(&self, words: Vec<String>, longest: Duration) -> Result<String, DraftRefusal> {
        let mut process = self.start(words)?;
        match process.ends_within(longest.min(LONGEST_HELP)) {
            None => process.stop(),
            Some(Err(error @ Error::Unavailable { .. })) => return Err(error.into()),
            Some(_) => {}
        }
        Ok(String::from_utf8_lossy(&process.output_reader().captured()).into_owned())
    }

    /// Runs the program for at most `longest`.
    ///
    /// # Errors
    /// [`DraftRefusal::Failed`] with the program's last words.
    pub fn run(&self, words: Vec<String>, longest: Duration) -> Result<ProbeRun, DraftRefusal> {
        let mut process = self.start(words)?;
        let ended = process.ends_within(longest);
        if ended.is_none() {
            process.stop();
        }
        let keys = process.output_reader().seen();
        match ended {
            Some(Err(error)) => Err(DraftRefusal::Failed {
                problem: error.to_string(),
                files: self.files().collect::<Vec<_>>().join(", "),
            }),
            ended => Ok(ProbeRun {
                has_ended: ended.is_some(),
                keys,
            }),
        }
    }

    fn start(&self, words: Vec<String>) -> Result<Process, DraftRefusal> {
        let place = self.place();
        place.empty()?;
        place.lay(&self.config)?;
        place.tell(&Assignment::default(), None)?;
        let words = agent::started(&self.config, words)?;
        let filters = STREAMS.map(|_| Filter {
            all: true,
            numbers: true,
            ..Filter::default()
        });
        let listening = OutputReader::to(&place.notes(), filters)?;
        Ok(Process::start(
            &self.config,
            words,
            (&place, &Share::default()),
            listening,
        )?)
    }
}
