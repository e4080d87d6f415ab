//! `report --against`: compares two sets of results.

use super::{
    Common, Format, Studies,
    console::{say, terminal_width},
};
use clap::Args;
use contract::Registry;
use execution::store::write_durably;
use report::compare::{markdown, text};
use session::{Exit, Failure, Other};
use std::path::{Path, PathBuf};

/// Other results to compare a report with, and the display of the differences.
#[derive(Debug, Clone, Args)]
pub(super) struct Against {
    /// Compare SPEC, a study or a folder of results, with these results: show values that moved beyond the interval of
    /// their difference, changed verdicts and different settings. RESULTS is a study file, a folder of results, or such
    /// a folder in a commit as `REV:FOLDER`.
    #[arg(long, value_name = "RESULTS", conflicts_with_all = ["sets", "seeds", "only", "out", "verbose", "recorded"])]
    pub(super) against: Option<PathBuf>,
    /// Store of the trials of RESULTS if it is a study; `--store` where absent.
    #[arg(long, value_name = "DIR", requires = "against")]
    against_store: Option<PathBuf>,
    /// Also show cells that did not move.
    #[arg(long, requires = "against")]
    all: bool,
    /// Also write the comparison into a file, as Markdown.
    #[arg(long, value_name = "FILE", requires = "against")]
    changes: Option<PathBuf>,
}

/// Exit code 4 if the two have nothing in common, 101 under `--strict` if something moved.
pub(super) fn report(
    registry: &Registry,
    (studies, strict): (&Studies, bool),
    (earlier, options): (&Path, &Against),
    common: &Common,
) -> Result<Exit, Failure> {
    let other = Other {
        path: earlier.to_owned(),
        store: options.against_store.clone(),
    };
    let compared = studies.open(registry, common)?.compare(&other)?;
    if let Some(path) = &options.changes {
        write_durably(path, markdown(&compared, options.all).as_bytes())?;
    }
    say(&match common.format {
        Format::Json => serde_json::to_string(&compared).map_err(Failure::refusal)?,
        Format::Text => text(&compared, options.all, terminal_width()),
    });
    Ok(if strict && compared.differs() {
        Exit::Differs
    } else {
        Exit::Ok
    })
}
