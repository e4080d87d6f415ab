//! `report --recorded`: reports from the records in folders of results, without a store. Trials come from the record.
//! Tables, claims, published values, margins and texts come from the current study files.

use crate::{
    Exit, Failure, Planned, ReportOptions, Session, confirmations, exit_of, folders, loading, provenance,
    reports::{self, Gathered, RESOLVED, Report},
    results as from_trials, seen,
};
use analysis::results::Results;
use contract::{Error, Registry, trial_end::EndState, trial_result::TrialResult};
use execution::{store::Announcements, world::fs};
use report::{
    Contents, Manifest, Provenance, Round, StudyInfo,
    compare::{changed_keys, parse_study},
    record::{self, Record, ResultIndex, forget_success},
};
use std::{
    path::{Path, PathBuf},
    sync::Arc,
};

/// A study with the record of its results.
struct StudyRecord {
    record: Record,
    manifest: Manifest,
    folder: PathBuf,
    confirming: Vec<(Planned, Option<Confirming>)>,
}

/// The record of a confirmation.
struct Confirming {
    record: Record,
    manifest: Manifest,
    folder: PathBuf,
}

impl Session<'_> {
    /// Writes every report with a readable record again. Problems of the others are reported and determine the exit.
    ///
    /// # Errors
    /// Fails if no study has a folder of results, and for folders that cannot be written.
    pub fn report_recorded(
        &self,
        reporting: &ReportOptions,
        shown: &mut dyn FnMut(&Report),
    ) -> Result<(Vec<Planned>, Exit), Failure> {
        let (mut planned, mut found, mut exit) = (Vec::new(), Vec::new(), Exit::Ok);
        for path in &self.selection.specs {
            match find(self, path, reporting) {
                Ok(Some((one, it))) => {
                    planned.push(one);
                    found.push(it);
                }
                Ok(None) => {}
                Err(failure) => {
                    self.notice(&failure.text);
                    exit = exit.max(failure.exit);
                }
            }
        }
        if planned.is_empty() && exit == Exit::Ok {
            return Err(Failure {
                exit: Exit::NothingSelected,
                text: "error: none of these studies has a folder of results".into(),
            });
        }
        self.check_folders(&planned, reporting)?;
        for (one, it) in planned.iter().zip(found) {
            let written =
                gathered(self, one, it).and_then(|gathered| reports::finish(self, one, reporting, gathered));
            exit = exit.max(match written {
                Ok(report) => {
                    shown(&report);
                    report.exit
                }
                Err(failure) => {
                    self.notice(&failure.text);
                    failure.exit
                }
            });
        }
        Ok((planned, exit))
    }
}

/// The record of the study in a file, and the study with the trials of that record; `None` if it has no results yet.
fn find(
    session: &Session<'_>,
    path: &Path,
    reporting: &ReportOptions,
) -> Result<Option<(Planned, StudyRecord)>, Failure> {
    let (registry, selection) = (session.registry, &session.selection);
    let refused = |problems: Vec<_>| Failure::study(&problems);
    let mut options = loading::options(selection, None);
    let name = study::name_in(path, registry, &options).map_err(refused)?;
    let folder = folders::folder_of(path, &name, selection, reporting);
    if !fs::is_folder(&folder) {
        session.notice(&format!(
            "{name}: passed over, as there is no folder `{}`",
            folder.display()
        ));
        return Ok(None);
    }
    let manifest = Manifest::of_record(&folder)?;
    if manifest.options != folders::options(selection) {
        let problem = format!("is of a study that was asked for with {:?}", manifest.options);
        return Err(Error::Record {
            path: folder,
            problem,
        }
        .into());
    }
    let record = Record::read(&folder, &manifest)?;
    options.searches = record.progress();
    let announced = tempfile::Builder::new().prefix("regimen-recorded-").tempdir();
    let announced = announced.map_err(Error::file("create a folder in", &std::env::temp_dir()))?;
    let recalled = Announcements::of(announced.path());
    record.announced.iter().for_each(|(id, it)| recalled.keep(id, it));
    options.announced = Some(recalled);
    let mut one = loading::load_one(registry, path, &selection.only, options).map_err(refused)?;
    if one.study.design.is_some() {
        one.replan(registry, record.seeds());
    }
    let mut planned = confirmations::planned(vec![one], registry).into_iter();
    let Some(one) = planned.next() else {
        return Ok(None);
    };
    let confirming = planned.map(|one| {
        let (one, record) = confirming(session, one, reporting)?;
        Ok((one, record))
    });
    let found = StudyRecord {
        confirming: confirming.collect::<Result<_, Failure>>()?,
        record,
        manifest,
        folder,
    };
    Ok(Some((one, found)))
}

/// A confirmation with the trials of its record; `None` if it has no results yet.
fn confirming(
    session: &Session<'_>,
    mut one: Planned,
    reporting: &ReportOptions,
) -> Result<(Planned, Option<Confirming>), Failure> {
    let folder = confirmations::folder(&one, &session.selection, reporting);
    if !fs::is_folder(&folder) {
        return Ok((one, None));
    }
    let manifest = Manifest::of_record(&folder)?;
    let record = Record::read(&folder, &manifest)?;
    if one.study.design.is_some() {
        one.replan(session.registry, record.seeds());
    }
    let found = Confirming {
        record,
        manifest,
        folder,
    };
    Ok((one, Some(found)))
}

/// The results of a confirmation, by its record.
fn round(registry: &Registry, one: &Planned, found: Option<Confirming>) -> Result<Round, Failure> {
    let study = from_trials::info(one, registry);
    let Some(found) = found else {
        let trials = one.plan.trials.iter().map(Arc::clone).map(TrialResult::missing);
        let results = from_trials::assembled(&one.study, trials.collect());
        let contents = Contents::judged(&study, &results);
        let fixed = None;
        return Ok(Round {
            results,
            contents,
            fixed,
        });
    };
    let results = results(one, &found.record, &found.manifest, &found.folder)?;
    let mut contents = Contents::judged(&study, &results);
    let seen = found.record.seen.unwrap_or_default();
    let fixed = seen::fixed_in_words(&one.study, &seen);
    seen::record_again(one, seen, &results, &mut contents);
    Ok(Round {
        results,
        contents,
        fixed,
    })
}

/// The material of a report, from a record.
fn gathered(session: &Session<'_>, one: &Planned, found: StudyRecord) -> Result<Gathered, Failure> {
    let registry = session.registry;
    let StudyRecord {
        mut record,
        manifest,
        folder,
        confirming,
    } = found;
    let results = results(one, &record, &manifest, &folder)?;
    let now = provenance::of(registry, one, Default::default());
    let mut earlier = record.earlier_versions(&now.plugins);
    for (_, confirming) in &confirming {
        let records = confirming
            .iter()
            .flat_map(|it| it.record.earlier_versions(&now.plugins));
        earlier.extend(records);
    }
    earlier.sort();
    earlier.dedup();
    let study = StudyInfo {
        profiles: record.profiles.clone(),
        ended: record.ended.clone(),
        earlier_versions: earlier,
        changed_settings: changed_settings(one, &manifest, &folder)?,
        ..from_trials::info(one, registry)
    };
    let study = reports::as_asked(study, &session.selection);
    let mut contents = Contents::of(&study, &results);
    let seen = record.seen.take().unwrap_or_default();
    record.seen = Some(seen::record_again(one, seen, &results, &mut contents));
    let rounds = confirming
        .into_iter()
        .map(|(one, found)| round(registry, &one, found));
    contents.confirm(&study, &results, &rounds.collect::<Result<Vec<_>, _>>()?);
    contents.leave_to(&manifest);
    contents.keep(&folder, &manifest, &record.figures)?;
    let provenance = Provenance {
        program: now.program,
        build: now.build,
        date: now.date,
        ..record.provenance.clone()
    };
    record.provenance = provenance.clone();
    record.announced.extend(one.study.announced.clone());
    let states = results.trials.iter().map(|it| Some(it.end.as_ref()?.state));
    let exit = exit_of(states.collect::<Vec<Option<EndState>>>());
    Ok(Gathered {
        study,
        results,
        contents,
        provenance,
        record,
        exit,
        is_recorded: true,
    })
}

fn results(one: &Planned, record: &Record, manifest: &Manifest, folder: &Path) -> Result<Results, Error> {
    let bytes = manifest.checked(folder, record::EVALUATIONS)?;
    let blocks = record::decode(bytes, &folder.join(record::EVALUATIONS))?;
    let mut trials = ResultIndex::of(record, blocks).results(&one.plan.trials);
    if one.study.success.is_some() {
        trials.iter_mut().for_each(forget_success);
    }
    if from_trials::names_times_of(&one.study) {
        let has_times = |it: &&mut TrialResult| record.has_times(it.trial.as_ref());
        trials
            .iter_mut()
            .filter(has_times)
            .for_each(TrialResult::add_times);
    }
    let searches = one.study.searches.iter().filter_map(|(search, _)| {
        let searched = record.searches.get(&search.name)?;
        Some(searched.result(search))
    });
    Ok(Results {
        searches: searches.collect(),
        repeated: record.told.repeated.clone(),
        told: Some(record.told.clone()),
        ..from_trials::assembled(&one.study, trials)
    })
}

/// The keys of the study that had other values when its trials ran.
fn changed_settings(one: &Planned, manifest: &Manifest, folder: &Path) -> Result<Vec<String>, Error> {
    let path = folder.join(RESOLVED);
    let bytes = manifest.checked(folder, RESOLVED)?;
    let text = String::from_utf8(bytes).map_err(|_| Error::Record {
        path: path.clone(),
        problem: "holds no text".into(),
    })?;
    let now = study::resolved_yaml(&one.study, folder)?;
    Ok(changed_keys(
        &parse_study(&path, &text)?,
        &parse_study(&path, &now)?,
    ))
}
