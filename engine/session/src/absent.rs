//! Unknown names after `--only`, and stores that do not exist.

use crate::Planned;
use document::diagnostic;
use execution::world::fs;
use std::{collections::BTreeSet, path::Path};

/// The message about names after `--only` that no study has; `None` if every name is known.
pub(crate) fn unknown_names(planned: &[Planned], only: &[String]) -> Option<String> {
    let studies = || planned.iter().map(|one| &one.study);
    let of_trials = planned.iter().flat_map(|one| &one.plan.trials);
    let known: BTreeSet<&str> = studies()
        .flat_map(|study| {
            study
                .environments
                .iter()
                .chain(&study.agents)
                .chain(&study.prepared)
        })
        .map(String::as_str)
        .chain(of_trials.flat_map(|trial| [trial.cell.environment.as_str(), trial.cell.agent.as_str()]))
        .collect();
    let unknown = only.iter().filter(|name| !known.contains(name.as_str()));
    let lines: Vec<String> = unknown
        .map(|name| {
            let help = diagnostic::suggest(name, known.iter().copied());
            format!("error: --only {name}: no environment or agent is named `{name}`: {help}")
        })
        .collect();
    (!lines.is_empty()).then(|| lines.join("\n"))
}

/// A warning if the store does not exist yet but a folder of a similar name lies beside it.
pub(crate) fn if_new(store: &Path) -> Option<String> {
    if fs::exists(store) {
        return None;
    }
    let folder = store.parent().filter(|folder| !folder.as_os_str().is_empty());
    let entries = fs::read_dir(folder.unwrap_or(Path::new(".")))
        .into_iter()
        .flatten()
        .flatten();
    let stores = entries.filter(|entry| fs::is_folder(&entry.path().join("trials")));
    let mut names: Vec<String> = stores
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let wanted = store.file_name().unwrap_or_default().to_string_lossy();
    let near = store.with_file_name(diagnostic::nearest(&wanted, &names)?);
    let (store, near) = (store.display(), near.display());
    Some(format!(
        "warning: there is no store `{store}` yet; did you mean `{near}`?"
    ))
}
