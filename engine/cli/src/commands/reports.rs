//! `report`: tables, figures and the page from the store; and the writing of a report, wherever its results come from.

use super::{
    Common, DIFFERS, Failure, Format, NOT_MADE, OK, ReportOptions, Selection, complain, confirmations,
    folders, looks, overview,
    planned::{self, Planned},
    profiles, provenance, run, say, say_summary, searches, settings,
};
use analysis::results::Results;
use contract::{Build, Error, Registry, trial_end::EndState};
use execution::{
    store::{SeenVerdicts, Store, write_durably},
    world::fs,
};
use report::{
    Contents, Counts, FigureFacts, Manifest, Period, Provenance, ReportPaths, Round, StudyInfo,
    record::{self, Asks, Cell, Record, Searched},
};
use serde_json::{Value, json};
use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

/// The file of a folder of results with the study and every default.
pub(super) const RESOLVED: &str = "resolved.yaml";

/// `report`: tables, figures and the page from the store.
pub(super) fn report(
    registry: &Registry,
    selection: &Selection,
    reporting: &ReportOptions,
    common: &Common,
) -> Result<u8, Failure> {
    let store = settings::read(common)?.open()?;
    let mut code = OK;
    let planned = planned::load_with_looks(registry, selection, &store)?;
    folders::check(&planned, selection, reporting)?;
    searches::told(&planned, &run::again(selection, common));
    for study in confirmations::by_study(&planned) {
        code = code.max(write(registry, study, &store, selection, reporting, common)?);
    }
    overview::index(&planned, selection, reporting, common)?;
    Ok(code)
}

/// The material of a report.
pub(super) struct Gathered {
    /// The study.
    pub(super) study: StudyInfo,
    /// Its results.
    pub(super) results: Results,
    /// The part of them that is shown.
    pub(super) contents: Contents,
    /// The programs that made them.
    pub(super) provenance: Provenance,
    /// Their numbers that the folder keeps, but for figures.
    pub(super) record: Record,
    /// The code of the command where the report is as it should be.
    pub(super) code: u8,
    /// True where the results come from the folder itself.
    pub(super) is_recorded: bool,
}

/// Writes the report of a study and its confirmations from the store.
pub(super) fn write(
    registry: &Registry,
    (one, confirming): (&Planned, &[Planned]),
    store: &Store,
    selection: &Selection,
    reporting: &ReportOptions,
    common: &Common,
) -> Result<u8, Failure> {
    let mend = selection.command("run", common, &[]);
    let (results, dir) = (
        run::collect(one, store, Some(&mend)),
        folders::folder(one, selection, reporting),
    );
    let stored = Stored::of(one, store);
    let code = code_of_report(one, &stored.states, &results);
    let earlier = Manifest::read(&dir).filter(|earlier| !earlier.files.is_empty());
    if earlier.is_some() && stored.is_empty() && one.study.imported.is_empty() {
        return Ok(kept(one, store, &dir, code, common));
    }
    let study = StudyInfo {
        profiles: profiles::of(registry, one, &stored.states, selection, store),
        ended: stored.ended.clone(),
        ..run::info(one, registry)
    };
    let study = as_asked(study, selection);
    let mut contents = Contents::of(&study, &results);
    let seen = looks::record(one, store, &results, &mut contents)?;
    let confirmed = |one: &Planned| confirmed(registry, one, store, (selection, reporting), &mend);
    let confirmed = confirming.iter().map(confirmed).collect::<Result<Vec<_>, _>>()?;
    let (rounds, codes): (Vec<Round>, Vec<u8>) = confirmed.into_iter().unzip();
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
        code: codes.into_iter().fold(code, u8::max),
        is_recorded: false,
    };
    finish(one, selection, reporting, common, gathered)
}

/// The trials of a study as the store has them, without their numbers.
struct Stored {
    /// How each ended; `None` for one that has not.
    states: Vec<Option<EndState>>,
    /// How many each build computed.
    builds: BTreeMap<Option<Build>, usize>,
    /// When they ended, where the store knows.
    ended: Option<Period>,
}

impl Stored {
    /// Damaged trials count as missing; they were complained of while the results were collected.
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
            cells: Cell::all(results),
            told: report::told(study, results),
            provenance: provenance::of(registry, one, self.builds),
            ended: self.ended,
            seen: Some(seen),
            announced: one.study.announced.clone(),
            ..Record::of(&study.name)
        }
    }
}

/// The results of a confirmation with the code of the command. Its record is kept beside the report of its study.
fn confirmed(
    registry: &Registry,
    one: &Planned,
    store: &Store,
    (selection, reporting): (&Selection, &ReportOptions),
    mend: &str,
) -> Result<(Round, u8), Failure> {
    let results = run::collect(one, store, Some(mend));
    let stored = Stored::of(one, store);
    let code = code_of_report(one, &stored.states, &results);
    let study = as_asked(run::info(one, registry), selection);
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
            code,
        ));
    }
    let seen = looks::record(one, store, &results, &mut contents)?;
    let fixed = looks::fixed_in_words(&one.study, &seen);
    let record = stored.record(registry, one, (&study, &results), seen);
    let dir = confirmations::folder(one, selection, reporting);
    fs::create_dir_all(&dir).map_err(Error::file("create", &dir))?;
    let evaluations = dir.join(record::EVALUATIONS);
    write_durably(&evaluations, &record::encode(&evaluations, &results, &asks(one))?)?;
    record.write(&dir)?;
    let files = [evaluations, dir.join(record::FILE)];
    folders::settle(&dir, one, selection, &files, &BTreeSet::new())?;
    Ok((
        Round {
            results,
            contents,
            fixed,
        },
        code,
    ))
}

/// The study's information under the options of a command line.
pub(super) fn as_asked(mut study: StudyInfo, selection: &Selection) -> StudyInfo {
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

/// Writes a report and what lies beside it, says what came of it, and answers the exit code.
pub(super) fn finish(
    one: &Planned,
    selection: &Selection,
    reporting: &ReportOptions,
    common: &Common,
    mut gathered: Gathered,
) -> Result<u8, Failure> {
    let dir = folders::folder(one, selection, reporting);
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
        complain(&format!("warning: {}: {warning}", study.name));
    }
    let unmade = contents.unmade();
    write_beside(&dir, one, selection, &gathered, &paths, &unmade)?;
    let Gathered {
        study,
        results,
        contents,
        code,
        ..
    } = &gathered;
    match common.format {
        Format::Json => say(&as_json(study, results, contents, &paths).to_string()),
        Format::Text => {
            let (width, everything) = (run::terminal_width(), reporting.verbose);
            let text = report::summary(study, results, contents, &paths.page, width, everything);
            say_summary(&text);
        }
    }
    Ok(match *code {
        // A drawing was refused. That nothing is recorded of a figure may be so with the smaller budget of a
        // profile, and where a part of the study was selected.
        OK if unmade != lacking || !contents.is_whole() && selection.is_whole() => NOT_MADE,
        OK if reporting.strict && contents.contradicts() => DIFFERS,
        code => code,
    })
}

/// The code that `status` gives. Tried and prepared trials count as missing just as the trials do that the report
/// shows.
fn code_of_report(one: &Planned, states: &[Option<EndState>], results: &Results) -> u8 {
    let ends = results
        .trials
        .iter()
        .map(|result| Some(result.end.as_ref()?.state));
    planned::code_of(states.iter().copied().chain(ends)).max(searches::code(one))
}

/// Says that nothing of a study is there, so that its earlier report stays as it was.
fn kept(one: &Planned, store: &Store, dir: &Path, code: u8, common: &Common) -> u8 {
    let (name, root, dir) = (&one.study.name, store.root().display(), dir.display());
    complain(&format!(
        "{name}: no trial of it has ended in the store `{root}`, so the earlier report in `{dir}` stays as it was"
    ));
    if common.format == Format::Json {
        say(&json!({ "study": name, "page": null, "files": [] }).to_string());
    }
    code
}

/// Writes the complete study and the record beside a report, and clears away what an earlier one left. The measurements
/// of a record stay as they are, and so does the study where its trials are not those of now.
fn write_beside(
    dir: &Path,
    one: &Planned,
    selection: &Selection,
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
    folders::settle(dir, one, selection, &files, unmade)?;
    Ok(())
}

/// The parts of a study that name metrics.
fn asks(one: &Planned) -> Asks {
    let study = &one.study;
    let searched: Vec<&String> = study.searches.iter().map(|(search, _)| &search.by).collect();
    Asks::of(&(
        &study.tables,
        &study.figures,
        &study.claims,
        &study.success,
        searched,
    ))
}

/// Facts on the figures that cannot be drawn from the record: of those that are drawn now, and as they were known
/// before.
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

fn as_json(study: &StudyInfo, results: &Results, contents: &Contents, paths: &ReportPaths) -> Value {
    let counts = |counts: Counts| -> serde_json::Map<String, serde_json::Value> {
        counts
            .into_iter()
            .map(|(word, count)| (word.to_owned(), json!(count)))
            .collect()
    };
    json!({
        "study": study.name, "basis": report::basis(study, results, contents),
        "summary": report::sentence(study, contents), "published": counts(contents.verdicts(false)),
        "claims": counts(contents.outcomes(false)),
        "published_holm": counts(contents.verdicts_together()),
        "claims_holm": counts(contents.outcomes_together()),
        "published_exploratory": counts(contents.verdicts(true)),
        "claims_exploratory": counts(contents.outcomes(true)),
        "not_made": not_made(contents), "warnings": contents.warnings,
        "earlier_versions": study.earlier_versions, "changed_settings": study.changed_settings,
        "page": paths.page, "files": paths.files,
    })
}

/// Names of the tables and figures that could not be made, with the reasons.
fn not_made(contents: &Contents) -> Value {
    let tables = contents
        .tables
        .iter()
        .filter_map(|(name, grid)| Some((name, grid.as_ref().err()?)));
    let figures = contents
        .figures
        .iter()
        .filter(|(name, _)| !contents.kept.contains_key(name))
        .filter_map(|(name, chart)| Some((name, chart.as_ref().err()?)));
    let all = tables.chain(figures);
    all.map(|(name, reason)| (name.clone(), json!(reason)))
        .collect::<serde_json::Map<_, _>>()
        .into()
}
