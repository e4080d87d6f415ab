//! `report --recorded`: reports from the records in folders of results, without a store. Trials are as they were;
//! tables, claims, published values, margins and texts are those of the study files now.

use super::{
    BAD_SPEC, Common, Failure, NOTHING_SELECTED, OK, ReportOptions, Selection, complain, confirmations,
    folders, looks, overview,
    planned::{self, Planned},
    provenance,
    reports::{self, Gathered, RESOLVED},
    run,
};
use analysis::results::Results;
use contract::{Error, Registry, trial_end::EndState, trial_result::TrialResult};
use document::diagnostic;
use execution::{store::Announcements, world::fs};
use report::{
    Contents, Manifest, Provenance, Round, StudyInfo,
    compare::{changed_keys, parse_study},
    record::{self, Record, Source, forget_success},
};
use std::{
    path::{Path, PathBuf},
    sync::Arc,
};

/// A study with the record of its results.
struct Found {
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

/// Writes every report again whose record can be read; what is wrong with others is said, and the code is theirs.
pub(super) fn report(
    registry: &Registry,
    selection: &Selection,
    reporting: &ReportOptions,
    common: &Common,
) -> Result<u8, Failure> {
    let (mut planned, mut found, mut code) = (Vec::new(), Vec::new(), OK);
    for path in &selection.specs {
        match find(registry, path, selection, reporting) {
            Ok(Some((one, it))) => {
                planned.push(one);
                found.push(it);
            }
            Ok(None) => {}
            Err(failure) => {
                complain(&failure.text);
                code = code.max(failure.code);
            }
        }
    }
    if planned.is_empty() && code == OK {
        let text = "error: none of these studies has a folder of results".into();
        return Err(Failure {
            code: NOTHING_SELECTED,
            text,
        });
    }
    folders::check(&planned, selection, reporting)?;
    for (one, it) in planned.iter().zip(found) {
        let written = gathered(registry, one, it, selection)
            .and_then(|gathered| reports::finish(one, selection, reporting, common, gathered));
        code = code.max(written.unwrap_or_else(|failure| {
            complain(&failure.text);
            failure.code
        }));
    }
    overview::index(&planned, selection, reporting, common)?;
    Ok(code)
}

/// The record of the study in a file, and the study with the trials that the record is of; `None` where it has no
/// results yet.
fn find(
    registry: &Registry,
    path: &Path,
    selection: &Selection,
    reporting: &ReportOptions,
) -> Result<Option<(Planned, Found)>, Failure> {
    let refused = |problems: Vec<_>| Failure {
        code: BAD_SPEC,
        text: diagnostic::render_first(&problems),
    };
    let mut options = planned::options(selection, None);
    let name = study::name_in(path, registry, &options).map_err(refused)?;
    let folder = folders::folder_of(path, &name, selection, reporting);
    if !fs::is_folder(&folder) {
        complain(&format!(
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
    let mut one = planned::load_one(registry, path, selection, options).map_err(refused)?;
    if one.study.design.is_some() {
        one.replan(registry, record.seeds());
    }
    let mut planned = confirmations::planned(vec![one], registry).into_iter();
    let Some(one) = planned.next() else {
        return Ok(None);
    };
    let confirming = planned.map(|one| {
        let (one, record) = confirming(registry, one, selection, reporting)?;
        Ok((one, record))
    });
    let found = Found {
        confirming: confirming.collect::<Result<_, Failure>>()?,
        record,
        manifest,
        folder,
    };
    Ok(Some((one, found)))
}

/// A confirmation with the trials that its record is of; `None` where it has no results yet.
fn confirming(
    registry: &Registry,
    mut one: Planned,
    selection: &Selection,
    reporting: &ReportOptions,
) -> Result<(Planned, Option<Confirming>), Failure> {
    let folder = confirmations::folder(&one, selection, reporting);
    if !fs::is_folder(&folder) {
        return Ok((one, None));
    }
    let manifest = Manifest::of_record(&folder)?;
    let record = Record::read(&folder, &manifest)?;
    if one.study.design.is_some() {
        one.replan(registry, record.seeds());
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
    let study = run::info(one, registry);
    let Some(found) = found else {
        let trials = one.plan.trials.iter().map(Arc::clone).map(TrialResult::missing);
        let results = run::assembled(&one.study, trials.collect());
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
    let fixed = looks::fixed_in_words(&one.study, &seen);
    looks::record_again(one, seen, &results, &mut contents);
    Ok(Round {
        results,
        contents,
        fixed,
    })
}

/// The material of a report, from a record.
fn gathered(
    registry: &Registry,
    one: &Planned,
    found: Found,
    selection: &Selection,
) -> Result<Gathered, Failure> {
    let Found {
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
        ..run::info(one, registry)
    };
    let study = reports::as_asked(study, selection);
    let mut contents = Contents::of(&study, &results);
    let seen = record.seen.take().unwrap_or_default();
    record.seen = Some(looks::record_again(one, seen, &results, &mut contents));
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
    let code = planned::code_of(states.collect::<Vec<Option<EndState>>>());
    Ok(Gathered {
        study,
        results,
        contents,
        provenance,
        record,
        code,
        is_recorded: true,
    })
}

fn results(one: &Planned, record: &Record, manifest: &Manifest, folder: &Path) -> Result<Results, Error> {
    let bytes = manifest.checked(folder, record::EVALUATIONS)?;
    let blocks = record::decode(bytes, &folder.join(record::EVALUATIONS))?;
    let mut trials = Source::of(record, blocks).results(&one.plan.trials);
    if one.study.success.is_some() {
        trials.iter_mut().for_each(forget_success);
    }
    if run::names_times_of(&one.study) {
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
        ..run::assembled(&one.study, trials)
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
