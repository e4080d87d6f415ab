//! A study's numbers in a folder, in a form that other programs read.

use crate::{
    Exit, Failure, Planned, ReportOptions, Session, confirmations::joined, exit_of, exit_of_searches,
    export_policy, folders, whole::Whole,
};
use contract::{Error, trial_end::EndState, trial_result::TrialResult};
use execution::{
    store::{self, Store, write_durably},
    world::fs,
};
use report::{
    Manifest,
    export::{Crate, ExportFormat, Piece, Subject, write_event_files, write_tables, write_trace},
};
use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
    sync::Arc,
};

/// An export that was written.
pub struct Exported {
    /// Name of the study.
    pub study: String,
    /// Number of its trials.
    pub trials: usize,
    /// Number of those that ended `ok`.
    pub ok: usize,
    /// The exit of the command.
    pub exit: Exit,
}

impl Session<'_> {
    /// Writes the numbers of the one selected study into a new folder. Only a crate names the `license`.
    ///
    /// # Errors
    /// Fails for more than one study, for a study without numbers, and for a folder that exists or cannot be written.
    pub fn export(&self, form: ExportFormat, to: &Path, license: &str) -> Result<Exported, Failure> {
        let store = self.store()?;
        let planned = self.load_with_looks()?;
        let [one] = &*joined(planned) else {
            return Err(Failure::refusal(
                "name one study: a folder holds the numbers of one",
            ));
        };
        self.say_imported(one, "are not exported");
        let results = load(self, one, store);
        if !results.iter().any(TrialResult::is_ok) {
            return Err(Failure {
                exit: Exit::NothingSelected,
                text: format!("no trial of `{}` has numbers; `run` it first", one.study.name),
            });
        }
        let mut stored = store.stored_of(&one.plan.trials, |it| it).all;
        stored.resize_with(results.len(), || None);
        let subject = Subject {
            name: &one.study.name,
            title: &one.study.title,
            source: &one.study.source,
            metrics: &one.study.metrics,
            units: &one.study.units,
            registry: self.registry,
            trials: results.iter().zip(stored.iter().map(Option::as_ref)).collect(),
        };
        let whole = Whole::begin(to)?;
        match form {
            ExportFormat::Parquet | ExportFormat::Csv => {
                write_tables(&subject, form == ExportFormat::Csv, whole.folder())?;
            }
            ExportFormat::Tensorboard => write_event_files(&subject, whole.folder())?,
            ExportFormat::Trace => write_trace(&subject, whole.folder())?,
            ExportFormat::RoCrate => pack(self, &subject, one, license, whole.folder())?,
            ExportFormat::Onnx => export_policy::of_study(self, &subject, whole.folder())?,
        }
        whole.end()?;
        let ok = results.iter().filter(|result| result.is_ok()).count();
        let states = results.iter().map(|result| Some(result.end.as_ref()?.state));
        // A trial at its pause has run as far as its study asks.
        let exit = exit_of(states.filter(|state| *state != Some(EndState::Paused)));
        Ok(Exported {
            study: one.study.name.clone(),
            trials: results.len(),
            ok,
            exit: exit.max(exit_of_searches(one)),
        })
    }
}

/// Every trial of the plan with its numbers, including trials at the pause of a search. Damaged trials are reported and
/// count as missing.
fn load(session: &Session<'_>, one: &Planned, store: &Store) -> Vec<TrialResult> {
    let trials: Vec<_> = one.plan.trials.iter().collect();
    let is_missing =
        |error: &Error| session.notice(&format!("warning: {error}; the trial counts as missing"));
    let (mut results, unreadable) = store.load_all(&trials);
    unreadable.iter().for_each(|(_, error)| is_missing(error));
    for trial in &one.paused {
        match store.partial(&trial.id) {
            Ok(Some(partial)) => results.push(TrialResult {
                trial: Arc::clone(trial),
                end: Some(Box::new(partial.file.end)),
                names: partial.table.names.into(),
                rows: partial.table.rows,
            }),
            Ok(None) => results.push(TrialResult::missing(Arc::clone(trial))),
            Err(error) => is_missing(&error),
        }
    }
    results
}

/// Fills a crate with the study, tables, report, metrics and their description.
fn pack(
    session: &Session<'_>,
    subject: &Subject<'_>,
    one: &Planned,
    license: &str,
    folder: &Path,
) -> Result<(), Failure> {
    let name = one.path.file_name().unwrap_or_default().to_string_lossy();
    let mut packing = Packing {
        folder,
        pieces: Vec::new(),
    };
    packing.study(one, &name)?;
    for table in write_tables(subject, false, &folder.join("tables"))? {
        packing.note(
            &format!("tables/{table}"),
            "what trials recorded, as a tidy table",
            None,
        );
    }
    packing.report(session, one)?;
    packing.trials(subject, session.store()?)?;
    let described = Crate {
        folder: folder.to_owned(),
        pieces: packing.pieces,
        study: name.into_owned(),
        license: license.to_owned(),
        date: date(),
    };
    described.describe(subject)?;
    Ok(())
}

/// The pieces of a crate that are in its folder.
struct Packing<'a> {
    folder: &'a Path,
    pieces: Vec<Piece>,
}

impl Packing<'_> {
    /// Adds the study as it was written, the files that it includes, and the study with every default.
    fn study(&mut self, one: &Planned, name: &str) -> Result<(), Error> {
        let read = |path: &Path| fs::read(path).map_err(Error::file("read", path));
        self.add(name, &read(&one.path)?, "the study, as it was written", None)?;
        // Files of two folders may have one name, and one file may be included twice.
        let included: BTreeSet<&PathBuf> = one.study.included.iter().collect();
        for (number, path) in (1..).zip(included) {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            let about = "what the study includes, as it was written";
            self.add(&format!("included/{number}/{name}"), &read(path)?, about, None)?;
        }
        let resolved = study::resolved_yaml(&one.study, self.folder)?;
        self.add(
            "resolved.yaml",
            resolved.as_bytes(),
            "the study with every default",
            None,
        )
    }

    /// Adds the record and the acknowledgement of every trial that ended `ok`.
    fn trials(&mut self, subject: &Subject<'_>, store: &Store) -> Result<(), Error> {
        const ACKNOWLEDGEMENT: &str =
            "what determined the numbers, how the trial ended, and a hash of its metrics";
        let ok = subject.trials.iter().filter(|(result, _)| result.is_ok());
        let ids: BTreeSet<&str> = ok.map(|(result, _)| result.trial.id.as_str()).collect();
        for id in ids {
            let [acknowledgement, metrics] = store.files(id)?;
            let path = |file: &str| format!("trials/{id}/{file}");
            self.add(
                &path("metrics.parquet"),
                &metrics,
                "what the trial recorded",
                Some(id),
            )?;
            self.add(&path("trial.json"), &acknowledgement, ACKNOWLEDGEMENT, Some(id))?;
        }
        let has_paused = |it: &&TrialResult| it.end.as_ref().is_some_and(|end| end.state == EndState::Paused);
        let paused = subject
            .trials
            .iter()
            .map(|(result, _)| *result)
            .filter(has_paused);
        for id in paused.map(|result| result.trial.id.as_str()) {
            for (file, bytes) in store.files_at_pause(id)? {
                let about = "what the trial had recorded at a pause of a search, and what acknowledges it";
                self.add(&format!("trials/{id}/{file}"), &bytes, about, Some(id))?;
            }
        }
        Ok(())
    }

    fn note(&mut self, path: &str, about: &str, trial: Option<&str>) {
        self.pieces.push(Piece {
            path: path.into(),
            about: about.into(),
            trial: trial.map(Into::into),
        });
    }

    fn add(&mut self, path: &str, bytes: &[u8], about: &str, trial: Option<&str>) -> Result<(), Error> {
        let file = self.folder.join(path);
        let folder = file.parent().unwrap_or(self.folder);
        fs::create_dir_all(folder).map_err(Error::file("create", folder))?;
        write_durably(&file, bytes)?;
        self.note(path, about, trial);
        Ok(())
    }

    /// Adds the files of the study's report that have not changed since the report wrote them.
    fn report(&mut self, session: &Session<'_>, one: &Planned) -> Result<(), Error> {
        let from = folders::folder(one, &session.selection, &ReportOptions::default());
        let Some(manifest) = Manifest::read(&from).filter(|manifest| manifest.study == one.study.name) else {
            session.notice(&format!(
                "no report lies in `{}`, so none is in the crate; `regimen report` writes one",
                from.display()
            ));
            return Ok(());
        };
        for (name, digest) in &manifest.files {
            match fs::read(from.join(name)) {
                Ok(bytes) if contract::digest::of_bytes(&bytes) == *digest => {
                    self.add(
                        &format!("results/{name}"),
                        &bytes,
                        "a file of the study's report",
                        None,
                    )?;
                }
                _ => session.notice(&format!(
                    "`{}` is not as the report wrote it, so it is not in the crate",
                    from.join(name).display()
                )),
            }
        }
        Ok(())
    }
}

/// The date of publication: today, or the date of the environment variable, which makes a crate reproducible.
#[expect(
    clippy::disallowed_methods,
    reason = "a date that the crate shall carry is given by the environment; no result holds it"
)]
fn date() -> String {
    let given = std::env::var("SOURCE_DATE_EPOCH").ok();
    let given = given.and_then(|text| text.parse().ok()).map(store::rfc_3339_of);
    let moment = given.unwrap_or_else(store::now);
    moment.split('T').next().unwrap_or_default().to_owned()
}
