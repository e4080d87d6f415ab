//! `report --against`: two sets of results side by side.

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

/// Other results that a report is held against, and how the differences are shown.
#[derive(Debug, Clone, Args)]
pub(super) struct Against {
    /// Say what SPEC, a study or a folder of results, differs in from these results: which values moved beyond the
    /// interval of their difference, which verdicts changed, which settings differ. They are a study file, a folder of
    /// results, or such a folder in a commit as `REV:FOLDER`.
    #[arg(long, value_name = "RESULTS", conflicts_with_all = ["sets", "seeds", "only", "out", "verbose", "recorded"])]
    pub(super) against: Option<PathBuf>,
    /// Store of the trials of RESULTS, where that is a study; `--store` where absent.
    #[arg(long, value_name = "DIR", requires = "against")]
    against_store: Option<PathBuf>,
    /// Show cells that did not move, too.
    #[arg(long, requires = "against")]
    all: bool,
    /// Write the comparison into a file as well, as Markdown.
    #[arg(long, value_name = "FILE", requires = "against")]
    changes: Option<PathBuf>,
}

/// 4 where the two have nothing in common, 101 under `--strict` where something moved.
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
