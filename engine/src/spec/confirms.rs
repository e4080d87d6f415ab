//! `confirms`: studies whose claims this one holds, word for word, against seeds that they have not seen.
//!
//! A claim that is open after all seeds of its study is no better for a few more of them, which were added because
//! of what was seen. It is for other seeds to say, and for a study that names them before the first trial.

use super::{ClaimSpec, Options, Study, include, load_alone};
use crate::{
    Registry,
    diagnostic::{Diagnostic, Sources, Span},
    document::{self, Node},
    input_file,
};
use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
};

/// A study that another one confirms.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Confirmed {
    /// Its name.
    pub study: String,
    /// Its file, from the folder of the study that confirms it.
    pub file: PathBuf,
}

/// The studies that a study names, read and held against it.
///
/// # Errors
/// Files that hold no study, seeds that have been seen, and claims that none of the studies makes.
pub fn read(
    root: &Node,
    study: &Study,
    registry: &Registry,
    sources: &Sources,
    options: &Options,
) -> Result<Vec<Confirmed>, Vec<Diagnostic>> {
    let confirmed = load_all(root, study, registry, sources)?;
    let others: Vec<&Study> = confirmed.iter().map(|(_, other)| other).collect();
    if others.is_empty() {
        return Ok(Vec::new());
    }
    let mut found = new_claims(root, study, &others, sources);
    if is_as_written(options) {
        found.extend(seen_seed(root, study, &others, sources));
    }
    if !found.is_empty() {
        return Err(found);
    }
    let named = confirmed.into_iter().map(|(file, other)| Confirmed {
        study: other.name,
        file,
    });
    Ok(named.filter(|_| is_as_written(options)).collect())
}

/// All studies that are named, with their files.
fn load_all(
    root: &Node,
    study: &Study,
    registry: &Registry,
    sources: &Sources,
) -> Result<Vec<(PathBuf, Study)>, Vec<Diagnostic>> {
    let (mut read, mut found) = (Vec::new(), Vec::new());
    for (name, span) in include::named(root, "confirms") {
        match load(&study.folder.join(&name), registry) {
            Ok(other) => read.push((PathBuf::from(name), other)),
            Err(problem) => {
                let message =
                    format!("the study `{name}`, which this one confirms, cannot be read: {problem}");
                let help =
                    "files are sought from the folder of this study; `regimen check` says more of them";
                found.push(sources.error(span, "confirms", message).help(help));
            }
        }
    }
    if found.is_empty() { Ok(read) } else { Err(found) }
}

/// Profiles and options make another study of it, which confirms nothing.
fn is_as_written(options: &Options) -> bool {
    options.profile.is_none() && options.sets.is_empty() && options.seeds.is_none()
}

/// A study without those that it confirms itself; what is wrong with it where it is none.
fn load(path: &Path, registry: &Registry) -> Result<Study, String> {
    let shown = path.display().to_string();
    let bytes = input_file::read(path, input_file::Use::Study).map_err(|error| error.to_string())?;
    let first = |found: Vec<Diagnostic>| {
        found.first().map_or_else(String::new, |it| {
            format!("{}:{}: {}", it.place.file, it.place.line, it.message)
        })
    };
    let text = document::decode(&shown, &bytes).map_err(first)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut sources = Sources::default();
    load_alone(&text, &shown, folder, registry, &Options::default(), &mut sources)
        .map(|(study, _)| study)
        .map_err(first)
}

/// A seed of the study that one of the others has seen.
fn seen_seed(root: &Node, study: &Study, others: &[&Study], sources: &Sources) -> Option<Diagnostic> {
    let of_study = |other: &&Study| {
        let seen: BTreeSet<&u64> = other.seeds.iter().collect();
        let again = study.seeds.iter().find(|seed| seen.contains(seed))?;
        Some((*again, other.name.clone(), **seen.last()?))
    };
    let (seed, name, last) = others.iter().find_map(of_study)?;
    let message = format!("seed {seed} is one of `{name}`, which this study confirms: what it says is known");
    let next = last.saturating_add(1);
    let help = format!(
        "use other seeds, as in `seeds: {next}-{}` or `first: {next}` of a design",
        next.saturating_add(9)
    );
    let span = root.entry("seeds").map_or(root.span, |entry| entry.key_span);
    Some(sources.error(span, "seeds", message).help(help))
}

/// Claims that none of the others makes.
fn new_claims(root: &Node, study: &Study, others: &[&Study], sources: &Sources) -> Vec<Diagnostic> {
    let spans: Vec<Span> = root
        .get("claims")
        .map_or(&[][..], Node::items)
        .iter()
        .map(|it| it.span)
        .collect();
    let is_known = |claim: &ClaimSpec| {
        others
            .iter()
            .flat_map(|other| &other.claims)
            .any(|it| is_same(it, claim))
    };
    let new = study
        .claims
        .iter()
        .enumerate()
        .filter(|(_, claim)| !claim.exploratory && !is_known(claim));
    let error = |(index, _): (usize, &ClaimSpec)| {
        let span = spans.get(index).copied().unwrap_or(root.span);
        let message = "no study that this one confirms makes this claim";
        let help = "write it as it stands there, or say `exploratory: true`";
        sources
            .error(span, &format!("claims[{index}]"), message)
            .help(help)
    };
    new.map(error).collect()
}

/// True where the words of both are the same, and so is the environment, or one of those of the first.
fn is_same(of_other: &ClaimSpec, claim: &ClaimSpec) -> bool {
    let words = |it: &ClaimSpec| it.claim.split_whitespace().collect::<Vec<_>>().join(" ");
    let place_fits = of_other.environment.is_none() || of_other.environment == claim.environment;
    words(of_other) == words(claim) && place_fits
}
