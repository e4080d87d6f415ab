//! `submit`, `cancel`, and the lines of `status` about submissions.

use super::{Common, Format, Studies, complain, consent::Consent, say};
use clap::{
    Args,
    builder::{PossibleValue, PossibleValuesParser},
};
use contract::Registry;
use execution::{
    executor::{self, ExecutorKind, describe},
    store::write_durably,
};
use serde_json::json;
use session::{Exit, Failure, Session};
use std::path::PathBuf;

/// The names of executors, as values of an option.
pub(super) fn values(kinds: &[ExecutorKind], which: fn(&ExecutorKind) -> bool) -> PossibleValuesParser {
    let kinds = kinds.iter().filter(|kind| which(kind));
    kinds
        .map(|kind| PossibleValue::new(kind.name).help(kind.about))
        .collect::<Vec<_>>()
        .into()
}

#[derive(Debug, Clone, Args)]
pub(super) struct SubmitOptions {
    /// Executor that receives the missing trials.
    #[arg(long, value_name = "NAME")]
    executor: String,
    /// Print the script or manifest and submit nothing.
    #[arg(long, short = 'n')]
    dry_run: bool,
    /// With --dry-run: write the script or manifest into this file instead.
    #[arg(long, short = 'o', value_name = "FILE", requires = "dry_run")]
    out: Option<PathBuf>,
    #[command(flatten)]
    consent: Consent,
}

/// `submit`: submits the missing trials, or prints the script or manifest.
pub(super) fn submit(
    registry: &Registry,
    studies: &Studies,
    options: &SubmitOptions,
    common: &Common,
) -> Result<Exit, Failure> {
    let session = studies.open(registry, common)?;
    let planned = session.load_with_looks()?;
    if !options.dry_run {
        options.consent.ask(&session, &planned)?;
    }
    // The command line accepts only names of this list.
    let Some(kind) = executor::find(registry, &options.executor) else {
        return Ok(Exit::BadStudy);
    };
    if !options.dry_run {
        return session.submit(&planned, &kind);
    }
    let text = session.written(&planned, &kind)?;
    match &options.out {
        Some(path) => write_durably(path, text.as_bytes())?,
        None => say(&text),
    }
    Ok(Exit::Ok)
}

/// `cancel`: cancels the submissions for the trials of these studies.
pub(super) fn cancel(registry: &Registry, studies: &Studies, common: &Common) -> Result<Exit, Failure> {
    let session = studies.open_here(registry, common)?;
    let cancelled = session.cancel(&session.load_with_looks()?)?;
    cancelled
        .iter()
        .for_each(|submission| say(&format!("cancelled {}", describe(submission))));
    if cancelled.is_empty() {
        complain("nothing is submitted for these studies");
        return Ok(Exit::NothingSelected);
    }
    Ok(Exit::Ok)
}

/// Prints the submissions of this store that are still in a queue.
pub(super) fn show(session: &Session<'_>, format: Format) {
    let holdings = match session.holdings() {
        Ok(holdings) => holdings,
        Err(failure) => return complain(&failure.text),
    };
    let live: Vec<_> = holdings.iter().filter(|holding| holding.alive() > 0).collect();
    if live.is_empty() {
        return;
    }
    if format == Format::Json {
        let rows = live.iter().map(|holding| {
            let jobs: Vec<_> = holding.submission.arrays.iter().map(|array| &array.job).collect();
            json!({"id": holding.submission.id, "jobs": jobs, "tasks": executor::counts(&holding.tasks)})
        });
        return say(&json!({"submissions": rows.collect::<Vec<_>>()}).to_string());
    }
    for holding in live {
        let title =
            executor::find(session.registry, &holding.submission.executor).map_or("", |kind| kind.title);
        say(&format!(
            "  {title}: {}: {}",
            describe(&holding.submission),
            executor::summary(&holding.tasks)
        ));
    }
}
