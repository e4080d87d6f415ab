//! `fsck`: checks every file of a store, and sets damaged files aside.

use super::{Common, Format, say};
use contract::Registry;
use document::count::{count, either};
use execution::{
    executor,
    store::{self, Fault, Findings, Store},
};
use session::{Exit, Failure, Settings};
use std::{collections::BTreeSet, path::PathBuf};

/// Exit code 106 if a trial has to run again or a record of verdicts is lost, otherwise 0.
pub(super) fn fsck(
    registry: &Registry,
    folder: Option<PathBuf>,
    dry_run: bool,
    common: &Common,
) -> Result<Exit, Failure> {
    let root = match folder {
        Some(folder) => folder,
        None => Settings::read(registry, &common.machine())?.store,
    };
    if let Some(problem) = store::no_store(&root)? {
        return Err(Failure::refusal(problem));
    }
    let found = Store::at(&root).check(!dry_run, executor::damaged(&root)?)?;
    if common.format == Format::Json {
        say(&serde_json::to_string(&found).unwrap_or_default());
    } else {
        say(&as_text(&found));
    }
    let unread = found
        .findings
        .iter()
        .any(|finding| finding.fault == Fault::Unreadable);
    let records = found.findings.iter().any(store::is_record);
    Ok(if lost(&found).is_empty() && !unread && !records {
        Exit::Ok
    } else {
        Exit::Incomplete
    })
}

/// Trials that have to run again.
fn lost(found: &Findings) -> BTreeSet<&String> {
    found
        .findings
        .iter()
        .filter_map(|finding| finding.trial.as_ref())
        .collect()
}

fn as_text(found: &Findings) -> String {
    let mut lines: Vec<String> = found
        .findings
        .iter()
        .map(|finding| {
            format!(
                "{:<8}  {}: {}",
                finding.fault.name(),
                finding.path.display(),
                finding.problem
            )
        })
        .collect();
    let wrong = found
        .findings
        .iter()
        .filter(|it| it.fault != Fault::Newer)
        .count();
    let paused = match found.paused {
        0 => String::new(),
        n => format!("{n} {} paused, ", either(&n, "has", "have")),
    };
    lines.push(format!(
        "{} {} whole, {paused}{} {} being computed, {} {} wrong",
        count(found.whole, "trial"),
        either(&found.whole, "is", "are"),
        found.running,
        either(&found.running, "is", "are"),
        count(wrong, "file"),
        either(&wrong, "is", "are")
    ));
    if let Some(aside) = &found.aside {
        lines.push(format!(
            "what is wrong was set aside in `{}` of the store",
            aside.display()
        ));
    }
    let lost = lost(found).len();
    if lost > 0 {
        let has = either(&lost, "has", "have");
        lines.push(format!(
            "{} {has} to run again: `run` their studies",
            count(lost, "trial")
        ));
    }
    lines.join("\n")
}
