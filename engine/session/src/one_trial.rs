//! One trial of a store, found by the first digits of its id.

use crate::Failure;
use contract::{
    Environment, Registry,
    artifact::FindArtifact,
    trial::{Trial, TrialCell, TrialKey},
    trial_end::EndState,
};
use document::diagnostic;
use execution::store::{Store, TrialFile};

/// The only trial of the store whose id begins with `prefix`, and the file that acknowledges it. It ended `ok`.
///
/// # Errors
/// Fails if there is none, or more than one.
pub fn that_ended_well(store: &Store, prefix: &str) -> Result<(String, TrialFile), Failure> {
    let id = only(store, prefix)?;
    let file = store
        .file(&id)?
        .ok_or_else(|| Failure::refusal(format!("trial {id} has not ended")))?;
    if file.end.state != EndState::Ok {
        return Err(Failure::refusal(format!(
            "trial {id} ended as {}: {}",
            file.end.state.name(),
            file.end.reason
        )));
    }
    Ok((id, file))
}

fn only(store: &Store, prefix: &str) -> Result<String, Failure> {
    let mut ids = store.ids_beginning_with(prefix);
    match ids.as_slice() {
        [_] => Ok(ids.remove(0)),
        [] => Err(Failure::refusal(format!(
            "no trial in `{}` has an id that begins with `{prefix}`",
            store.root().display()
        ))),
        [first, second, ..] => Err(Failure::refusal(format!(
            "`{prefix}` begins the ids of {} trials, {first} and {second} among them; give more digits",
            ids.len()
        ))),
    }
}

/// A trial that belongs to no study, with the names of its plugins.
#[must_use]
pub fn named(id: &str, key: TrialKey) -> Trial {
    Trial {
        id: id.to_owned(),
        cell: TrialCell::of(&key.environment.plugin, key.agents_by_plugin()).into(),
        key,
    }
}

/// The environment of a trial, with what it takes from other trials.
///
/// # Errors
/// An environment that is not known or cannot be built.
pub fn environment(
    registry: &Registry,
    key: &TrialKey,
    find: FindArtifact<'_>,
) -> Result<Box<dyn Environment>, Failure> {
    let name = key.environment.plugin.as_str();
    let entry = registry.environments.get(name).ok_or_else(|| {
        let nearest = diagnostic::suggest(name, registry.environments.keys().copied());
        Failure::refusal(format!("unknown environment `{name}`; {nearest}"))
    })?;
    Ok((entry.build)(&key.environment.loaded(find)?)?)
}
