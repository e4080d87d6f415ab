//! A program that is started once, to see its help and what it writes: in a folder of its own, in which its sources
//! lie as in that of a trial, under the guard.

use super::error::NoStudy;
use crate::{
    ProgramConfig, agent,
    config::{Lock, NamedFile, NoLock, Sources},
    lines::Filter,
    output::{Listening, STREAMS},
    process::Process,
    workplace::Workplace,
};
use contract::{DataFile, Error, resources::Share};
use document::reach::Reach;
use imported::matching;
use std::{path::Path, time::Duration};

/// How long a program may take to say its options.
const LONGEST_HELP: Duration = Duration::from_secs(60);

/// A place for a program to be looked at.
#[derive(Debug)]
pub struct Probe {
    config: ProgramConfig,
    folder: tempfile::TempDir,
}

/// How a program ran.
#[derive(Debug, Default)]
pub struct Ran {
    /// True where it ended by itself, and was not stopped.
    pub has_ended: bool,
    /// Keys that lines of its output had.
    pub keys: Vec<String>,
}

impl Probe {
    /// A folder for a program with these files of the study's folder, names or patterns.
    ///
    /// # Errors
    /// [`NoStudy::NotHere`] for a pattern without a file.
    pub fn new(
        from: &Path,
        sources: &[String],
        lock: Option<&str>,
        interpreter: &str,
    ) -> Result<Self, NoStudy> {
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
                return Err(NoStudy::NotHere { file, what });
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

    /// The names of the program's files.
    pub fn files(&self) -> impl Iterator<Item = &str> {
        self.config.sources.0.keys().map(String::as_str)
    }

    /// The folder in which it runs.
    pub fn place(&self) -> Workplace {
        Workplace::at(self.folder.path(), &self.config)
    }

    /// The program's answer to a question for its options; how it ends says nothing.
    ///
    /// # Errors
    /// Where it cannot be started.
    pub fn help(&self, words: Vec<String>) -> Result<String, NoStudy> {
        let mut process = self.start(words)?;
        match process.ends_within(LONGEST_HELP) {
            None => process.stop(),
            Some(Err(error @ Error::Unavailable { .. })) => return Err(error.into()),
            Some(_) => {}
        }
        Ok(String::from_utf8_lossy(&process.listening().said()).into_owned())
    }

    /// Runs it, not longer than `longest`.
    ///
    /// # Errors
    /// [`NoStudy::Failed`] with its last words.
    pub fn run(&self, words: Vec<String>, longest: Duration) -> Result<Ran, NoStudy> {
        let mut process = self.start(words)?;
        let ended = process.ends_within(longest);
        if ended.is_none() {
            process.stop();
        }
        let keys = process.listening().seen();
        match ended {
            Some(Err(error)) => Err(NoStudy::Failed {
                problem: error.to_string(),
                files: self.files().collect::<Vec<_>>().join(", "),
            }),
            ended => Ok(Ran {
                has_ended: ended.is_some(),
                keys,
            }),
        }
    }

    fn start(&self, words: Vec<String>) -> Result<Process, NoStudy> {
        let place = self.place();
        place.empty()?;
        place.lay(&self.config)?;
        let words = agent::started(&self.config, words)?;
        let filters = STREAMS.map(|_| Filter {
            all: true,
            numbers: true,
            ..Filter::default()
        });
        let listening = Listening::to(&place.notes(), filters)?;
        Ok(Process::start(
            &self.config,
            words,
            (&place, &Share::default()),
            listening,
        )?)
    }
}
