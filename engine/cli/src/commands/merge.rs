//! `merge`: the trials of several stores in one.

use super::{Common, Format, Person, say};
use clap::Args;
use document::count::{count, either};
use execution::{
    store::{self, Difference, Fate, Finding, Imprint, Leases, Merge, Merged, Side, Store},
    world::fs,
};
use serde_json::json;
use session::{Exit, Failure, Settings};
use std::path::{Path, PathBuf};

/// The stores that are taken, and the destination.
#[derive(Debug, Clone, Args)]
pub(super) struct MergeOptions {
    /// Stores to take from; nothing in them is changed.
    #[arg(required = true, value_name = "STORE")]
    sources: Vec<PathBuf>,
    /// Store to take into; it is made where it does not exist.
    #[arg(long, value_name = "STORE")]
    into: PathBuf,
    /// Say what would happen, and write nothing.
    #[arg(long, short = 'n')]
    dry_run: bool,
}

/// The fate of the trials of one source.
struct Taking<'a> {
    from: &'a Path,
    trials: Vec<Merged>,
    /// Whether every record of verdicts that were seen could be read.
    has_records: bool,
}

/// 101 where two stores hold other bytes of one trial, 106 where a trial was left because it is damaged or
/// runs, or a record of verdicts because it is damaged, otherwise 0.
pub(super) fn merge(options: &MergeOptions, common: &Common) -> Result<Exit, Failure> {
    options
        .sources
        .iter()
        .try_for_each(|from| check(from, &options.into))?;
    let into = Store::at(&options.into);
    let expiry = Settings::read(&common.machine())?.lease_expiry;
    let leases = (!options.dry_run)
        .then(|| Leases::open(&into, expiry))
        .transpose()?;
    let mut merge = Merge::new(&into, leases.as_ref())?;
    let mut takings = Vec::new();
    for from in &options.sources {
        let source = Store::at(from);
        let mut trials = Vec::new();
        merge.take(&source, &mut |merged| {
            if common.format == Format::Text {
                line(&merged).iter().for_each(|line| say(line));
            }
            trials.push(merged);
        })?;
        let has_records = session::unite(&Person, &into, &source, options.dry_run)?;
        takings.push(Taking {
            from,
            trials,
            has_records,
        });
    }
    match common.format {
        Format::Json => say(&as_json(&takings, options).to_string()),
        Format::Text => takings
            .iter()
            .for_each(|taking| say(&taking.summary(options.dry_run))),
    }
    Ok(code(&takings))
}

/// Refuses a source that is not there, and one that is the destination.
fn check(from: &Path, into: &Path) -> Result<(), Failure> {
    if let Some(problem) = store::no_store(from)? {
        return Err(Failure::refusal(problem));
    }
    if fs::is_same(from, into) {
        return Err(Failure::refusal(format!(
            "`{}` is the store that is taken into; name another one",
            from.display()
        )));
    }
    Ok(())
}

fn code(takings: &[Taking<'_>]) -> Exit {
    let fates = || {
        takings
            .iter()
            .flat_map(|taking| &taking.trials)
            .map(|it| &it.fate)
    };
    if fates().any(|fate| matches!(fate, Fate::Conflict { .. })) {
        Exit::Differs
    } else if fates().any(|fate| matches!(fate, Fate::Damaged { .. } | Fate::Running { .. }))
        || takings.iter().any(|taking| !taking.has_records)
    {
        Exit::Incomplete
    } else {
        Exit::Ok
    }
}

/// A line about a trial that was not simply taken.
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

fn conflict(source: &Imprint, destination: &Imprint) -> String {
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

impl Taking<'_> {
    fn count(&self, is: impl Fn(&Fate) -> bool) -> usize {
        self.trials.iter().filter(|merged| is(&merged.fate)).count()
    }

    /// Numbers of trials by their fates.
    fn counts(&self) -> [(&'static str, usize); 7] {
        [
            ("taken", self.count(|fate| *fate == Fate::Taken)),
            ("same", self.count(|fate| *fate == Fate::Same)),
            (
                "conflicts",
                self.count(|fate| matches!(fate, Fate::Conflict { .. })),
            ),
            (
                "other runs",
                self.count(|fate| matches!(fate, Fate::Another { .. })),
            ),
            ("damaged", self.count(|fate| matches!(fate, Fate::Damaged { .. }))),
            ("running", self.count(|fate| matches!(fate, Fate::Running { .. }))),
            ("unfinished", self.count(|fate| *fate == Fate::Unfinished)),
        ]
    }

    fn summary(&self, dry_run: bool) -> String {
        let [(_, taken), (_, same), others @ ..] = self.counts();
        let were = |number: usize| either(&number, "was", "were");
        let verb = if dry_run { "would be" } else { were(taken) };
        let mut text = format!(
            "{}: {} {verb} taken, {same} {} there",
            self.from.display(),
            count(taken, "trial"),
            were(same)
        );
        for (word, count) in others.into_iter().filter(|(_, count)| *count > 0) {
            text.push_str(&format!(", {count} {word}"));
        }
        text
    }
}

fn as_json(takings: &[Taking<'_>], options: &MergeOptions) -> serde_json::Value {
    let sources: Vec<_> = takings
        .iter()
        .map(|taking| {
            let counts: serde_json::Map<_, _> = taking
                .counts()
                .into_iter()
                .map(|(word, count)| (word.to_owned(), json!(count)))
                .collect();
            json!({"store": taking.from, "counts": counts, "trials": taking.trials})
        })
        .collect();
    json!({"into": options.into, "dry_run": options.dry_run, "sources": sources})
}
