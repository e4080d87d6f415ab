//! `report`: tables, figures and the page, from the store or from the files of an earlier report.

use super::{
    Common, Format, ReportArgs, Studies,
    console::{say, say_summary, terminal_width},
};
use contract::Registry;
use report::{Contents, Counts};
use serde_json::{Value, json};
use session::{Exit, Failure, Planned, Report, Reported, Session, by_study};

/// Writes reports from the store.
pub(super) fn report(
    registry: &Registry,
    studies: &Studies,
    reporting: &ReportArgs,
    common: &Common,
) -> Result<Exit, Failure> {
    let session = studies.open(registry, common)?;
    let planned = session.load_with_looks()?;
    session.check_folders(&planned, &reporting.options())?;
    session.tell_searches(&planned);
    write_all(&session, &planned, reporting, common)
}

/// Writes the report of every study and the page over several; prints the outcome of each as soon as it is written.
pub(super) fn write_all(
    session: &Session<'_>,
    planned: &[Planned],
    reporting: &ReportArgs,
    common: &Common,
) -> Result<Exit, Failure> {
    let mut exit = Exit::Ok;
    for study in by_study(planned) {
        let reported = session.report_of(study, &reporting.options())?;
        say_reported(&reported, reporting, common);
        exit = exit.max(reported.exit());
    }
    write_index(session, planned, reporting, common)?;
    Ok(exit)
}

/// `--recorded`: from the records in folders of results, without a store.
pub(super) fn recorded(
    registry: &Registry,
    studies: &Studies,
    reporting: &ReportArgs,
    common: &Common,
) -> Result<Exit, Failure> {
    let session = studies.open(registry, common)?;
    let mut say = |report: &Report| say_report(report, reporting, common);
    let (planned, exit) = session.report_recorded(&reporting.options(), &mut say)?;
    write_index(&session, &planned, reporting, common)?;
    Ok(exit)
}

/// Prints the outcome of a report.
fn say_reported(reported: &Reported, reporting: &ReportArgs, common: &Common) {
    match reported {
        Reported::Written(report) => say_report(report, reporting, common),
        Reported::Kept(name, _) if common.format == Format::Json => {
            say(&json!({ "study": name, "page": null, "files": [] }).to_string());
        }
        Reported::Kept(..) => {}
    }
}

fn say_report(report: &Report, reporting: &ReportArgs, common: &Common) {
    match common.format {
        Format::Json => say(&as_json(report).to_string()),
        Format::Text => say_summary(&report::summary(
            &report.study,
            &report.results,
            &report.contents,
            &report.paths.page,
            terminal_width(),
            reporting.verbose,
        )),
    }
}

/// Writes the page over several studies.
fn write_index(
    session: &Session<'_>,
    planned: &[Planned],
    reporting: &ReportArgs,
    common: &Common,
) -> Result<(), Failure> {
    let path = session.write_index(planned, &reporting.options())?;
    if let Some(path) = path.filter(|_| common.format == Format::Text) {
        say(&format!("All studies: {}", path.display()));
    }
    Ok(())
}

fn as_json(report: &Report) -> Value {
    let Report {
        study,
        results,
        contents,
        paths,
        ..
    } = report;
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
