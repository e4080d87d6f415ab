//! `export`: a study's numbers in a folder, in a form that other programs read.

use super::{
    BAD_SPEC, Common, Failure, NOTHING_SELECTED, ReportOptions, Selection, complain, confirmations,
    export_dataset, export_policy, folders,
    planned::{self, Planned},
    run, say, searches, settings,
};
use clap::Args;
use contract::{Error, Registry, trial_end::EndState, trial_result::TrialResult};
use document::count::count;
use execution::{
    store::{self, Store, write_durably},
    world::{fs, process},
};
use report::{
    Manifest,
    export::{Crate, Form, Piece, Subject, write_event_files, write_tables, write_trace},
};
use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
    sync::Arc,
};

/// Options that say what of a study is taken away; one trial has none of them.
const OF_A_STUDY: [&str; 7] = ["specs", "profile", "sets", "seeds", "only", "form", "license"];

/// What is taken away, where to, and how.
#[derive(Debug, Clone, Args)]
#[command(mut_arg("specs", |specs| specs.required(false).required_unless_present_any(["onnx", "minari"])))]
pub(super) struct ExportOptions {
    #[command(flatten)]
    selection: Selection,
    /// Folder to write; it must not hold anything yet.
    #[arg(long, short = 'o', value_name = "FOLDER")]
    to: PathBuf,
    /// Form to write.
    #[arg(long = "as", value_enum, value_name = "FORM", required_unless_present_any = ["onnx", "minari"])]
    form: Option<Form>,
    /// In place of a study, the policy of one trial of the store, by the first digits of its id: `policy.onnx`, or
    /// `<seat>.onnx` for every seat that has its own.
    #[arg(long, value_name = "TRIAL", conflicts_with_all = OF_A_STUDY, conflicts_with = "minari")]
    onnx: Option<String>,
    /// In place of a study, the episodes of one trial of the store as a Minari dataset: what it gathered, or what its
    /// policy plays (`--episodes`).
    #[arg(long, value_name = "TRIAL", conflicts_with_all = OF_A_STUDY)]
    minari: Option<String>,
    #[command(flatten)]
    play: export_dataset::Play,
    /// Licence of the results, which a crate must name: an id of SPDX such as CC-BY-4.0, or an address.
    #[arg(long, value_name = "LICENCE", required_if_eq("form", "ro-crate"))]
    license: Option<String>,
}

/// A study: 106 where trials are missing, 100 where some failed: what is there is written all the same.
pub(super) fn export(registry: &Registry, options: &ExportOptions, common: &Common) -> Result<u8, Failure> {
    match (&options.onnx, &options.minari, options.form) {
        (Some(trial), ..) => export_policy::of_trial(registry, trial, &options.to, common),
        (None, Some(trial), _) => {
            export_dataset::of_trial(registry, trial, &options.play, &options.to, common)
        }
        (None, None, Some(form)) => of_study(registry, form, options, common),
        (None, None, None) => Err(refused("say with `--as` in which form".into())),
    }
}

fn of_study(
    registry: &Registry,
    form: Form,
    options: &ExportOptions,
    common: &Common,
) -> Result<u8, Failure> {
    let store = settings::read(common)?.open()?;
    let planned = planned::load_with_looks(registry, &options.selection, &store)?;
    let [one] = &*confirmations::joined(planned) else {
        return Err(refused(
            "name one study: a folder holds the numbers of one".into(),
        ));
    };
    planned::say_imported(one, "are not exported");
    let results = load(one, &store);
    if !results.iter().any(TrialResult::is_ok) {
        return Err(Failure {
            code: NOTHING_SELECTED,
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
        registry,
        trials: results.iter().zip(stored.iter().map(Option::as_ref)).collect(),
    };
    let whole = Whole::begin(&options.to)?;
    match form {
        Form::Parquet | Form::Csv => {
            write_tables(&subject, form == Form::Csv, &whole.folder)?;
        }
        Form::Tensorboard => write_event_files(&subject, &whole.folder)?,
        Form::Trace => write_trace(&subject, &whole.folder)?,
        Form::RoCrate => pack(&subject, one, &store, options, &whole.folder)?,
        Form::Onnx => export_policy::of_study(&subject, &store, &whole.folder)?,
    }
    whole.end()?;
    let ok = results.iter().filter(|result| result.is_ok()).count();
    say(&format!(
        "{}: {ok} of {} in `{}`",
        one.study.name,
        count(results.len(), "trial"),
        options.to.display()
    ));
    let states = results.iter().map(|result| Some(result.end.as_ref()?.state));
    // A trial at its pause is as far as its study asks for.
    let code = planned::code_of(states.filter(|state| *state != Some(EndState::Paused)));
    Ok(code.max(searches::code(one)))
}

pub(super) fn refused(problem: String) -> Failure {
    Failure {
        code: BAD_SPEC,
        text: format!("error: {problem}"),
    }
}

/// Every trial of the plan with all it recorded, and those that have come to the pause of a search; what is
/// damaged is said and counts as missing.
fn load(one: &Planned, store: &Store) -> Vec<TrialResult> {
    let trials: Vec<_> = one.plan.trials.iter().collect();
    let is_missing = |error: &Error| complain(&format!("warning: {error}; the trial counts as missing"));
    let mut results = run::load(&trials, store, is_missing);
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

/// A folder that appears whole or not at all: it is filled beside its place and renamed.
pub(super) struct Whole {
    folder: PathBuf,
    to: PathBuf,
}

impl Whole {
    /// Begins one; `to` must hold nothing yet.
    pub(super) fn begin(to: &Path) -> Result<Self, Failure> {
        if !store::names(to)?.is_empty() {
            return Err(refused(format!(
                "`{}` is not empty; name a new folder",
                to.display()
            )));
        }
        let name = to.file_name().ok_or_else(|| {
            refused(format!(
                "`{}` is no name of a folder that could be made",
                to.display()
            ))
        })?;
        let beside = format!(".{}.{}.tmp", name.to_string_lossy(), process::id());
        let folder = to.with_file_name(beside);
        fs::create_dir_all(&folder).map_err(Error::file("create", &folder))?;
        let to = to.to_owned();
        Ok(Self { folder, to })
    }

    /// Where it is filled.
    pub(super) fn folder(&self) -> &Path {
        &self.folder
    }

    /// Lets it appear.
    pub(super) fn end(self) -> Result<(), Error> {
        // An empty folder of the name is in the way of none.
        fs::rename(&self.folder, &self.to).map_err(Error::file("rename to", &self.to))
    }
}

impl Drop for Whole {
    fn drop(&mut self) {
        // Where it was renamed there is nothing; where something went wrong, half a folder helps nobody.
        let _ = fs::remove_dir_all(&self.folder);
    }
}

/// Fills a crate: study, tables, report, metrics, and what describes them.
fn pack(
    subject: &Subject<'_>,
    one: &Planned,
    store: &Store,
    options: &ExportOptions,
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
    packing.report(one, &options.selection)?;
    packing.trials(subject, store)?;
    let described = Crate {
        folder: folder.to_owned(),
        pieces: packing.pieces,
        study: name.into_owned(),
        license: options.license.clone().unwrap_or_default(),
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
    /// The study as it was written, with what it includes, and with every default.
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

    /// What every trial that ended well recorded, and what acknowledges it.
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

    /// Adds the files of the study's report that are as the report wrote them.
    fn report(&mut self, one: &Planned, selection: &Selection) -> Result<(), Error> {
        let (out, strict) = (None, false);
        let from = folders::folder(
            one,
            selection,
            &ReportOptions {
                out,
                strict,
                verbose: false,
            },
        );
        let Some(manifest) = Manifest::read(&from).filter(|manifest| manifest.study == one.study.name) else {
            complain(&format!(
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
                _ => complain(&format!(
                    "`{}` is not as the report wrote it, so it is not in the crate",
                    from.join(name).display()
                )),
            }
        }
        Ok(())
    }
}

/// The date of publication: today, or what the environment says, so that a crate can be made again.
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
