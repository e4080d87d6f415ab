//! `merge`: merges the trials of several stores into one.

use super::{Common, Format, Person, say};
use clap::Args;
use contract::Registry;
use document::count::{count, either};
use execution::store::{Difference, Fate, Finding, Fingerprint, Merged, Side};
use serde_json::json;
use session::{Exit, Failure, MergedStore, Settings, exit_of_merge};
use std::path::PathBuf;

/// The source stores and the destination.
#[derive(Debug, Clone, Args)]
pub(super) struct MergeOptions {
    /// Stores to take from; they are not changed.
    #[arg(required = true, value_name = "STORE")]
    sources: Vec<PathBuf>,
    /// Store to take into; it is created if it does not exist.
    #[arg(long, value_name = "STORE")]
    into: PathBuf,
    /// Show what would happen, and write nothing.
    #[arg(long, short = 'n')]
    dry_run: bool,
}

/// Merges the stores, and prints the trials that were not simply copied and the number of trials of each outcome.
pub(super) fn merge(registry: &Registry, options: &MergeOptions, common: &Common) -> Result<Exit, Failure> {
    let settings = Settings::read(registry, &common.machine())?;
    let MergeOptions {
        sources,
        into,
        dry_run,
    } = options;
    let stores = session::merge(sources, into, *dry_run, &settings, &Person, &mut |merged| {
        if common.format == Format::Text {
            line(merged).iter().for_each(|line| say(line));
        }
    })?;
    match common.format {
        Format::Json => say(&as_json(&stores, options).to_string()),
        Format::Text => stores.iter().for_each(|store| say(&summary(store, *dry_run))),
    }
    Ok(exit_of_merge(&stores))
}

/// A line about a trial that was not simply copied.
fn line(merged: &Merged) -> Option<String> {
    let (word, text) = match &merged.fate {
        Fate::Taken | Fate::Same | Fate::Unfinished => return None,
        Fate::Conflict { source, destination } => ("conflict", conflict(source, destination)),
        Fate::Another { source, destination } => {
            let text = conflict(source, destination);
            (
                "another",
                format!("{text}; the program does not repeat to the bit, and what was stored first counts"),
            )
        }
        Fate::Damaged { side, findings } => ("damaged", format!("{}: {}", place(*side), faults(findings))),
        Fate::Running { side, owner } => {
            let (pid, host) = (owner.pid, &owner.host);
            ("running", format!("{}: process {pid} on {host}", place(*side)))
        }
    };
    let Merged { trial, title, .. } = merged;
    let title = if title.is_empty() {
        String::new()
    } else {
        format!(" ({title})")
    };
    Some(format!("{word:<8}  {trial}{title}: {text}"))
}

fn place(side: Side) -> &'static str {
    match side {
        Side::Source => "in the source",
        Side::Destination => "in the destination",
    }
}

fn conflict(source: &Fingerprint, destination: &Fingerprint) -> String {
    let differences: Vec<String> = source
        .differences(destination)
        .iter()
        .map(|Difference { what, first, second }| {
            format!("{what} {} there, {} here", or_none(first), or_none(second))
        })
        .collect();
    format!(
        "{}; computed by {} there, by {} here; the destination's stays",
        differences.join("; "),
        source.by(),
        destination.by()
    )
}

fn or_none(text: &str) -> &str {
    if text.is_empty() { "none" } else { text }
}

fn faults(findings: &[Finding]) -> String {
    let words = findings
        .iter()
        .map(|finding| format!("{}: {}", finding.path.display(), finding.problem));
    words.collect::<Vec<_>>().join("; ")
}

/// Number of trials of each outcome.
fn counts(store: &MergedStore) -> [(&'static str, usize); 7] {
    let number = |is: &dyn Fn(&Fate) -> bool| store.trials.iter().filter(|merged| is(&merged.fate)).count();
    [
        ("taken", number(&|fate| *fate == Fate::Taken)),
        ("same", number(&|fate| *fate == Fate::Same)),
        ("conflicts", number(&|fate| matches!(fate, Fate::Conflict { .. }))),
        ("other runs", number(&|fate| matches!(fate, Fate::Another { .. }))),
        ("damaged", number(&|fate| matches!(fate, Fate::Damaged { .. }))),
        ("running", number(&|fate| matches!(fate, Fate::Running { .. }))),
        ("unfinished", number(&|fate| *fate == Fate::Unfinished)),
    ]
}

fn summary(store: &MergedStore, dry_run: bool) -> String {
    let [(_, taken), (_, same), others @ ..] = counts(store);
    let were = |number: usize| either(&number, "was", "were");
    let verb = if dry_run { "would be" } else { were(taken) };
    let mut text = format!(
        "{}: {} {verb} taken, {same} {} there",
        store.from.display(),
        count(taken, "trial"),
        were(same)
    );
    for (word, count) in others.into_iter().filter(|(_, count)| *count > 0) {
        text.push_str(&format!(", {count} {word}"));
    }
    text
}

fn as_json(stores: &[MergedStore], options: &MergeOptions) -> serde_json::Value {
    let sources: Vec<_> = stores
        .iter()
        .map(|store| {
            let counts: serde_json::Map<_, _> = counts(store)
                .into_iter()
                .map(|(word, count)| (word.to_owned(), json!(count)))
                .collect();
            json!({"store": store.from, "counts": counts, "trials": store.trials})
        })
        .collect();
    json!({"into": options.into, "dry_run": options.dry_run, "sources": sources})
}
