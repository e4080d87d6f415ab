//! `run`, `worker`: compute missing trials; `run` then shows the results.

use super::{Common, ReportArgs, RunArgs, Studies, WorkerArgs, plan, report, submitted};
use contract::Registry;
use session::{Computed, Exit, Failure, RunOptions, WorkerOptions};

/// `run`: the missing trials of all studies together, then a report of each.
pub(super) fn run(
    registry: &Registry,
    studies: &Studies,
    options: &RunArgs,
    reporting: &ReportArgs,
    common: &Common,
) -> Result<Exit, Failure> {
    if options.dry_run {
        return plan::plan(registry, studies, common);
    }
    let session = studies.open(registry, common)?;
    let mut planned = session.load_with_looks()?;
    session.check_folders(&planned, &reporting.options())?;
    options.consent.ask(&session, &planned)?;
    let (computed, is_here) = match session.run(&mut planned, &options.options())? {
        Computed::Left(exit) => return Ok(exit),
        Computed::Ended { exit, is_here } => (exit, is_here),
    };
    let exit = report::write_all(&session, &planned, reporting, common)?;
    if computed == Exit::Ok && is_here {
        session.pack(&planned)?;
    }
    Ok(match computed {
        Exit::Ok => exit,
        computed => computed,
    })
}

impl RunArgs {
    fn options(&self) -> RunOptions {
        RunOptions {
            jobs: self.jobs,
            executor: self.executor.clone(),
            device: self.device.clone(),
            detach: self.detach,
            retry_failed: self.retry_failed,
            no_rehearsal: self.no_rehearsal,
            limits: self.limits.limits(),
            fail_fast: self.limits.fail_fast,
        }
    }
}

/// `worker`: the missing trials, or every Nth of them, without a report.
pub(super) fn worker(registry: &Registry, options: &WorkerArgs, common: &Common) -> Result<Exit, Failure> {
    let session = options.studies.open(registry, common)?;
    if !submitted::is_wanted(options.submission.as_deref(), &session.settings)? {
        return Ok(Exit::Ok);
    }
    let part = options.index.as_deref().map_or(Ok((0, 1)), parse_index)?;
    let mut planned = session.load_with_looks()?;
    options.consent.ask(&session, &planned)?;
    let how = WorkerOptions {
        part,
        jobs: options.jobs,
        limits: options.limits.limits(),
        fail_fast: options.limits.fail_fast,
    };
    session.work(&mut planned, &how)
}

fn parse_index(text: &str) -> Result<(usize, usize), Failure> {
    let wrong = || Failure::refusal(format!("--index {text}: write I/N with I below N, as in 0/4"));
    let (part, parts) = text.split_once('/').ok_or_else(wrong)?;
    let (part, parts) = (
        part.parse().map_err(|_| wrong())?,
        parts.parse().map_err(|_| wrong())?,
    );
    if part < parts {
        Ok((part, parts))
    } else {
        Err(wrong())
    }
}
