//! Files for continuous integration, written after a command: the ends of all trials as JUnit XML and as JSON.

use super::{Common, Studies};
use clap::Args;
use contract::Registry;
use execution::{
    store::write_durably,
    world::{clock, fs},
};
use report::{Outcome, junit, outcomes_as_json};
use session::{Exit, Failure, Planned, Session};
use std::{path::PathBuf, time::Instant};

/// Files to write.
#[derive(Debug, Clone, Args)]
pub(super) struct Summaries {
    /// Write the end of every trial as JUnit XML, one test case per trial.
    #[arg(long, value_name = "FILE")]
    junit: Option<PathBuf>,
    /// Write counts by end state, and every trial that did not end `ok`, as JSON.
    #[arg(long, value_name = "FILE")]
    summary: Option<PathBuf>,
}

impl Summaries {
    /// Carries out a command, then writes the files, even if the command failed.
    ///
    /// They contain all trials of the selection, including those that other programs ran. Nothing is written if the
    /// studies themselves are refused.
    pub(super) fn after(
        &self,
        registry: &Registry,
        studies: &Studies,
        common: &Common,
        command: impl FnOnce() -> Result<Exit, Failure>,
    ) -> Result<Exit, Failure> {
        let started = clock::now();
        let answer = command();
        let exit = answer.as_ref().map_or_else(|failure| failure.exit, |exit| *exit);
        let written = self.write(registry, studies, common, started, exit.code());
        // The first failure is reported.
        answer.and_then(|exit| written.map(|()| exit))
    }

    fn write(
        &self,
        registry: &Registry,
        studies: &Studies,
        common: &Common,
        started: Instant,
        code: u8,
    ) -> Result<(), Failure> {
        if self.junit.is_none() && self.summary.is_none() {
            return Ok(());
        }
        let wall_s = clock::since(started).as_secs_f64();
        let session = studies.open(registry, common)?;
        let planned = session.load_with_looks()?.into_iter();
        let outcomes: Vec<Outcome> = planned
            .map(|one| outcome(&session, one))
            .collect::<Result<_, Failure>>()?;
        if let Some(path) = &self.junit {
            write(path, junit(&outcomes, wall_s, code)?)?;
        }
        if let Some(path) = &self.summary {
            write(path, format!("{:#}\n", outcomes_as_json(&outcomes, wall_s, code)))?;
        }
        Ok(())
    }
}

fn outcome(session: &Session<'_>, one: Planned) -> Result<Outcome, Failure> {
    let ends = session.ends(session.store()?, &one);
    Ok(Outcome {
        study: one.plan.study,
        trials: one.plan.trials.into_iter().zip(ends).collect(),
    })
}

fn write(path: &std::path::Path, text: String) -> Result<(), Failure> {
    // A bare file name has the empty path as its folder, which means the current one.
    if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        fs::create_dir_all(folder).map_err(contract::Error::file("create", folder))?;
    }
    Ok(write_durably(path, text.as_bytes())?)
}
