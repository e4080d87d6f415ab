//! Reports: the tables, figures and page of a study with its confirmations, from a store or a record.

use crate::{
    Exit, Failure, Planned, ReportOptions, Selection, Session, by_study, confirmations, exit_of,
    exit_of_searches, folders, profiles, provenance, results, searches, seen,
};
use analysis::results::Results;
use contract::{Build, Error, Registry, trial_end::EndState};
use execution::{
    store::{SeenVerdicts, Store, write_durably},
    world::fs,
};
use report::{
    Contents, FigureFacts, Manifest, Period, Provenance, ReportPaths, Round, StudyInfo,
    record::{self, Asks, Record, RecordedCell, Searched},
};
use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

/// Name of the file, in a folder of results, with the study and every default.
pub(crate) const RESOLVED: &str = "resolved.yaml";

/// A report that was written.
pub struct Report {
    /// The study.
    pub study: StudyInfo,
    /// Its results.
    pub results: Results,
    /// The tables, figures and claims that are shown.
    pub contents: Contents,
    /// The files.
    pub paths: ReportPaths,
    /// The exit of the command.
    pub exit: Exit,
}

/// The outcome of the report of a study.
pub enum Reported {
    /// The report was written.
    Written(Box<Report>),
    /// No trial of the study of this name has ended, so its earlier report was kept.
    Kept(String, Exit),
}

impl Reported {
    /// The exit of the command.
    #[must_use]
    pub fn exit(&self) -> Exit {
        match self {
            Self::Written(report) => report.exit,
            Self::Kept(_, exit) => *exit,
        }
    }
}

impl Session<'_> {
    /// Refuses to write the results of different study files into one folder, and refuses folders that cannot be
    /// written.
    ///
    /// # Errors
    /// The first folder that is refused.
    pub fn check_folders(&self, planned: &[Planned], reporting: &ReportOptions) -> Result<(), Failure> {
        folders::check(planned, &self.selection, reporting)
    }

    /// Writes the report of every study from the store.
    ///
    /// # Errors
    /// A folder that cannot be written, and a store that cannot be read.
    pub fn report(&self, planned: &[Planned], reporting: &ReportOptions) -> Result<Vec<Reported>, Failure> {
        let studies = by_study(planned).into_iter();
        studies.map(|study| self.report_of(study, reporting)).collect()
    }

    /// Reports why searches cannot choose a setting, or which settings they could not compare with their choice.
    pub fn tell_searches(&self, planned: &[Planned]) {
        searches::tell(self, planned);
    }

    /// Writes the report of a study and its confirmations from the store.
    ///
    /// # Errors
    /// As [`report`](Self::report).
    pub fn report_of(
        &self,
        (one, confirming): (&Planned, &[Planned]),
        reporting: &ReportOptions,
    ) -> Result<Reported, Failure> {
        let (registry, selection, store) = (self.registry, &self.selection, self.store()?);
        let results = self.collect(one)?;
        let dir = folders::folder(one, selection, reporting);
        let stored = Stored::of(one, store);
        let exit = exit_of_report(one, &stored.states, &results);
        let earlier = Manifest::read(&dir).filter(|earlier| !earlier.files.is_empty());
        if earlier.is_some() && stored.is_empty() && one.study.imported.is_empty() {
            return Ok(kept(self, one, &dir, exit));
        }
        let study = StudyInfo {
            profiles: profiles::of(registry, one, &stored.states, selection, store),
            ended: stored.ended.clone(),
            ..results::info(one, registry)
        };
        let study = as_asked(study, selection);
        let mut contents = Contents::of(&study, &results);
        let seen = seen::record(self, one, store, &results, &mut contents)?;
        let confirmed = confirming.iter().map(|one| confirmed(self, one, reporting));
        let (rounds, exits): (Vec<Round>, Vec<Exit>) =
            confirmed.collect::<Result<Vec<_>, _>>()?.into_iter().unzip();
        contents.confirm(&study, &results, &rounds);
        contents.leave_to(&earlier.unwrap_or_default());
        let record = Record {
            profiles: study.profiles.clone(),
            searches: searched(one, &results),
            ..stored.record(registry, one, (&study, &results), seen)
        };
        let gathered = Gathered {
            study,
            results,
            contents,
            provenance: record.provenance.clone(),
            record,
            exit: exits.into_iter().fold(exit, Exit::max),
            is_recorded: false,
        };
        let report = finish(self, one, reporting, gathered)?;
        Ok(Reported::Written(Box::new(report)))
    }
}

/// The material of a report.
pub(crate) struct Gathered {
    /// The study.
    pub(crate) study: StudyInfo,
    /// Its results.
    pub(crate) results: Results,
    /// The tables, figures and claims that are shown.
    pub(crate) contents: Contents,
    /// The programs that made them.
    pub(crate) provenance: Provenance,
    /// The numbers that the folder keeps, without those of figures.
    pub(crate) record: Record,
    /// The exit of the command if the report itself has no problem.
    pub(crate) exit: Exit,
    /// Whether the results come from the folder itself.
    pub(crate) is_recorded: bool,
}

/// The trials of a study in the store, without their numbers.
struct Stored {
    /// Their end states; `None` for a trial that has not ended.
    states: Vec<Option<EndState>>,
    /// Number of trials that each build computed; `None` where the build is unknown.
    builds: BTreeMap<Option<Build>, usize>,
    /// The period in which they ended, if the store knows it.
    ended: Option<Period>,
}

impl Stored {
    /// Damaged trials count as missing; they were reported when the results were collected.
    fn of(one: &Planned, store: &Store) -> Self {
        let (mut builds, mut ended) = (BTreeMap::new(), None);
        let trials = &one.plan.trials;
        let states = store.stored_of(trials, |it| {
            *builds.entry(it.build).or_default() += 1;
            if let Some(date) = it.ended_at {
                ended = Some(Period::with(ended.take(), date, trials.len()));
            }
            it.end.state
        });
        Self {
            states: states.all,
            builds,
            ended,
        }
    }

    /// True where no trial has ended.
    fn is_empty(&self) -> bool {
        self.states.iter().all(Option::is_none)
    }

    /// The record of a report on these trials.
    fn record(
        self,
        registry: &Registry,
        one: &Planned,
        (study, results): (&StudyInfo, &Results),
        seen: SeenVerdicts,
    ) -> Record {
        Record {
            cells: RecordedCell::all(results),
            told: report::told(study, results),
            provenance: provenance::of(registry, one, self.builds),
            ended: self.ended,
            seen: Some(seen),
            announced: one.study.announced.clone(),
            ..Record::of(&study.name)
        }
    }
}

/// The results of a confirmation and its exit. Its record is written beside the report of its study.
fn confirmed(
    session: &Session<'_>,
    one: &Planned,
    reporting: &ReportOptions,
) -> Result<(Round, Exit), Failure> {
    let (registry, selection, store) = (session.registry, &session.selection, session.store()?);
    let results = session.collect(one)?;
    let stored = Stored::of(one, store);
    let exit = exit_of_report(one, &stored.states, &results);
    let study = as_asked(results::info(one, registry), selection);
    let mut contents = Contents::judged(&study, &results);
    if stored.is_empty() {
        // The record of an earlier report stays.
        let fixed = None;
        return Ok((
            Round {
                results,
                contents,
                fixed,
            },
            exit,
        ));
    }
    let seen = seen::record(session, one, store, &results, &mut contents)?;
    let fixed = seen::fixed_in_words(&one.study, &seen);
    let record = stored.record(registry, one, (&study, &results), seen);
    let dir = confirmations::folder(one, selection, reporting);
    fs::create_dir_all(&dir).map_err(Error::file("create", &dir))?;
    let evaluations = dir.join(record::EVALUATIONS);
    write_durably(&evaluations, &record::encode(&evaluations, &results, &asks(one))?)?;
    record.write(&dir)?;
    let files = [evaluations, dir.join(record::FILE)];
    folders::settle(session, &dir, one, &files, &BTreeSet::new())?;
    Ok((
        Round {
            results,
            contents,
            fixed,
        },
        exit,
    ))
}

/// The study's information under the options of a command line.
pub(crate) fn as_asked(mut study: StudyInfo, selection: &Selection) -> StudyInfo {
    study.options = folders::options(selection);
    study
}

/// The results of searches, for the record.
fn searched(one: &Planned, results: &Results) -> BTreeMap<String, Searched> {
    let progress = one.study.searches.iter().zip(&results.searches);
    let of_search = |((search, progress), result): (
        &(_, analysis::search::Progress),
        &analysis::results::SearchResult,
    )| {
        let search: &analysis::search::Search = search;
        let searched = Searched {
            progress: progress.clone(),
            tried: result.tried.clone(),
        };
        (search.name.clone(), searched)
    };
    progress.map(of_search).collect()
}

/// Writes a report and the files beside it.
pub(crate) fn finish(
    session: &Session<'_>,
    one: &Planned,
    reporting: &ReportOptions,
    mut gathered: Gathered,
) -> Result<Report, Failure> {
    let dir = folders::folder(one, &session.selection, reporting);
    let lacking = gathered.contents.unmade();
    let Gathered {
        study,
        results,
        contents,
        provenance,
        ..
    } = &mut gathered;
    let paths = report::write(&dir, study, results, contents, provenance)?;
    for warning in &contents.warnings {
        session.notice(&format!("warning: {}: {warning}", study.name));
    }
    let unmade = contents.unmade();
    write_beside(session, &dir, one, &gathered, &paths, &unmade)?;
    let Gathered {
        study,
        results,
        contents,
        exit,
        ..
    } = gathered;
    let exit = match exit {
        // A figure could not be made. A figure without recorded values is no error under the smaller budget of a
        // profile, or if only a part of the study was selected.
        Exit::Ok if unmade != lacking || !contents.is_whole() && session.selection.is_whole() => {
            Exit::NotMade
        }
        Exit::Ok if reporting.strict && contents.contradicts() => Exit::Differs,
        exit => exit,
    };
    Ok(Report {
        study,
        results,
        contents,
        paths,
        exit,
    })
}

/// The exit that `status` gives. Missing trials of searches and prepared artifacts count like the missing trials that
/// the report shows.
fn exit_of_report(one: &Planned, states: &[Option<EndState>], results: &Results) -> Exit {
    let ends = results
        .trials
        .iter()
        .map(|result| Some(result.end.as_ref()?.state));
    exit_of(states.iter().copied().chain(ends)).max(exit_of_searches(one))
}

/// Reports that no trial of a study has ended, so its earlier report is kept.
fn kept(session: &Session<'_>, one: &Planned, dir: &Path, exit: Exit) -> Reported {
    let (name, root, dir) = (&one.study.name, session.settings.store.display(), dir.display());
    session.notice(&format!(
        "{name}: no trial of it has ended in the store `{root}`, so the earlier report in `{dir}` stays as it was"
    ));
    Reported::Kept(name.clone(), exit)
}

/// Writes the complete study and the record beside a report, and removes files of an earlier report. With a record, its
/// measurements stay unchanged, and so does the study if its trials differ from the current ones.
fn write_beside(
    session: &Session<'_>,
    dir: &Path,
    one: &Planned,
    gathered: &Gathered,
    paths: &ReportPaths,
    unmade: &BTreeSet<String>,
) -> Result<(), Failure> {
    let (resolved, evaluations) = (dir.join(RESOLVED), dir.join(record::EVALUATIONS));
    if gathered.study.changed_settings.is_empty() {
        write_durably(&resolved, study::resolved_yaml(&one.study, dir)?.as_bytes())?;
    }
    if !gathered.is_recorded {
        let bytes = record::encode(&evaluations, &gathered.results, &asks(one))?;
        write_durably(&evaluations, &bytes)?;
    }
    let record = Record {
        figures: facts(&gathered.study, &gathered.contents, &gathered.record),
        ..gathered.record.clone()
    };
    record.write(dir)?;
    let own = [
        paths.page.clone(),
        paths.markdown.clone(),
        resolved,
        evaluations,
        dir.join(record::FILE),
    ];
    let files = [&paths.files[..], &own].concat();
    folders::settle(session, dir, one, &files, unmade)?;
    Ok(())
}

/// The parts of a study that name metrics.
fn asks(one: &Planned) -> Asks {
    let study = &one.study;
    let searched: Vec<&String> = study.searches.iter().map(|(search, _)| &search.metric).collect();
    Asks::of(&(
        &study.tables,
        &study.figures,
        &study.claims,
        &study.success,
        searched,
    ))
}

/// Facts on the figures that cannot be drawn from the record: new facts for figures drawn now, earlier facts for the
/// others.
fn facts(study: &StudyInfo, contents: &Contents, before: &Record) -> BTreeMap<String, FigureFacts> {
    let figures = study.figures.iter().zip(&contents.figures);
    let of_figure =
        |((name, spec), (_, chart)): (&(String, presentation::figure::FigureSpec), &(String, _))| {
            let chart: &Result<presentation::figure::Chart, String> = chart;
            let drawn = chart.as_ref().ok().filter(|_| !spec.kind.is_recorded());
            let facts = drawn
                .map(FigureFacts::of)
                .or_else(|| before.figures.get(name).cloned())?;
            Some((name.clone(), facts))
        };
    figures.filter_map(of_figure).collect()
}
