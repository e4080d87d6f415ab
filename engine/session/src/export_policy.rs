//! `export --onnx TRIAL` and `export STUDY --as onnx`: policies of stored trials as files for other runtimes.

use crate::{Exit, Failure, Session, one_trial, whole::Whole};
use contract::{
    ArtifactKind, Error, Registry,
    artifact::{SAVED_FILE, Taken},
};
use document::count::{count, either};
use execution::{
    store::{Store, TrialFile, write_durably},
    world::fs,
};
use report::export::{PolicySubject, Subject, describe_run, folder_of_run, onnx_files};
use serde_json::{Value, json};
use std::{collections::BTreeMap, path::Path};

/// ONNX files by name.
type Files = BTreeMap<String, Vec<u8>>;

/// Exports the policy of the trial that `prefix` names; returns its id and the names of the files.
///
/// # Errors
/// Fails if there is no such trial, if it left no policy, and if the folder exists or cannot be written.
pub fn of_trial(
    registry: &Registry,
    store: &Store,
    prefix: &str,
    to: &Path,
) -> Result<(String, Vec<String>), Failure> {
    let (id, file) = one_trial::that_ended_well(store, prefix)?;
    let none = || Failure::refusal(no_policy(&id, &file));
    let files = files_of(registry, store, &id, &file)?.ok_or_else(none)?;
    let whole = Whole::begin(to)?;
    write(&files, whole.folder())?;
    whole.end()?;
    Ok((id, files.into_keys().collect()))
}

fn no_policy(id: &str, file: &TrialFile) -> String {
    format!(
        "trial {id} left no policy: `{}` learns none, or its protocol keeps none",
        file.key.agents_by_plugin()
    )
}

/// The files of a trial; `None` if it left no policy.
fn files_of(
    registry: &Registry,
    store: &Store,
    id: &str,
    file: &TrialFile,
) -> Result<Option<Files>, Failure> {
    let taken = Taken {
        trial: id.to_owned(),
        kind: ArtifactKind::Policy,
    };
    let Some(folder) = store.artifact_if_left(&taken)? else {
        return Ok(None);
    };
    let find = |taken: &Taken| store.artifact(taken);
    let environment = one_trial::environment(registry, &file.key, &find)?;
    let files = onnx_files(&PolicySubject {
        trial: id,
        file,
        folder: &folder,
        interface: &environment.interface(),
        registry,
    })?;
    Ok(Some(files))
}

/// Exports the policies of all trials of a study that ended `ok` and left one, each to its own folder. `policies.json`
/// maps folders to trials.
pub(crate) fn of_study(session: &Session<'_>, subject: &Subject<'_>, folder: &Path) -> Result<(), Failure> {
    let store = session.store()?;
    let mut described: Vec<Value> = Vec::new();
    let mut without = 0;
    for (result, _) in subject.trials.iter().filter(|(result, _)| result.is_ok()) {
        let id = &result.trial.id;
        let file = store
            .file(id)?
            .ok_or_else(|| Failure::refusal(format!("trial {id} is gone")))?;
        // No other runtime reads the saved bytes of a learner in Python.
        let files = if file.files.contains_key(SAVED_FILE) {
            None
        } else {
            files_of(subject.registry, store, id, &file)?
        };
        match files {
            None => without += 1,
            Some(files) => {
                let run = folder_of_run(result);
                write(&files, &folder.join(&run))?;
                let mut entry = describe_run(&run, result);
                entry["files"] = json!(files.keys().collect::<Vec<_>>());
                described.push(entry);
            }
        }
    }
    if described.is_empty() {
        return Err(Failure {
            exit: Exit::NothingSelected,
            text: format!("no trial of `{}` left a policy", subject.name),
        });
    }
    if without > 0 {
        session.notice(&format!(
            "{} left no policy and {} left out",
            count(without, "trial"),
            either(&without, "is", "are")
        ));
    }
    let described =
        json!({"schema": 1, "study": subject.name, "title": subject.title, "policies": described});
    let text = serde_json::to_string_pretty(&described).unwrap_or_default() + "\n";
    Ok(write_durably(&folder.join("policies.json"), text.as_bytes())?)
}

fn write(files: &Files, folder: &Path) -> Result<(), Error> {
    fs::create_dir_all(folder).map_err(Error::file("create", folder))?;
    files
        .iter()
        .try_for_each(|(name, bytes)| write_durably(&folder.join(name), bytes))
}
