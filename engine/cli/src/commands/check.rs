//! `check`, `resolve`: read studies without running a trial.

use super::{Common, Format, Studies, complain, consent::Consent, say};
use analysis::claim;
use clap::Args;
use contract::Registry;
use document::{
    count::count,
    diagnostic::{self, Severity},
};
use presentation::claim_spec::ClaimSpec;
use serde_json::json;
use session::{Check, Checked, Exit, Failure, Refused, Session, by_study};
use std::{collections::BTreeSet, path::Path};
use study::Study;

/// The options of `check`.
#[derive(Debug, Clone, Args)]
pub(super) struct CheckOptions {
    #[command(flatten)]
    studies: Studies,
    /// Start each program twice with the same seed, up to its first measurement, and report whether its values are
    /// equal.
    #[arg(long)]
    rehearse: bool,
    /// Longest time of each of the two runs.
    #[arg(long, value_name = "SECONDS", requires = "rehearse", default_value_t = 60)]
    rehearse_for: u32,
    #[command(flatten)]
    consent: Consent,
}

/// `check`, followed by the rehearsal of programs if it was requested and every study is valid.
pub(super) fn check(registry: &Registry, options: &CheckOptions, common: &Common) -> Result<Exit, Failure> {
    if options.rehearse && common.format == Format::Json {
        return Err(Failure::refusal(
            "`--rehearse` prints text: leave out `--format json`",
        ));
    }
    let session = options.studies.open(registry, common)?;
    let check = session.check();
    if common.format == Format::Json {
        let exit = say_as_json(&session, &check);
        return check.unselected.map_or(Ok(exit), Err);
    }
    match say_checked(&session, check)? {
        Exit::Ok if options.rehearse => rehearse(&session, options),
        exit => Ok(exit),
    }
}

/// Prints a line for each valid study, and one for each study that this machine cannot check.
fn say_checked(session: &Session<'_>, check: Check) -> Result<Exit, Failure> {
    let Check {
        good,
        refused,
        unselected,
    } = check;
    if let Some(failure) = unselected {
        return Err(failure);
    }
    let is_unavailable = |(_, problems): &&Refused| diagnostic::are_unavailable(problems);
    let unchecked: Vec<&Refused> = refused.iter().filter(is_unavailable).collect();
    unchecked.iter().for_each(|it| say_unchecked(it));
    let wrong = refused.iter().filter(|it| !is_unavailable(it));
    if let Some(failure) = Failure::studies(wrong.map(|(_, problems)| problems)) {
        return Err(failure);
    }
    let is_empty = |(trials, study): &Checked| *trials == 0 && study.searches.is_empty();
    if unchecked.is_empty() && good.iter().all(is_empty) {
        return Err(Failure::nothing_selected());
    }
    session.warn(good.iter().map(|(_, study)| study));
    session.check_fit(&good)?;
    for (trials, study) in &good {
        say(&format!(
            "{}: ok, {}, {}, {}, {}{}",
            study.name,
            count(*trials, "trial"),
            count(study.tables.len(), "table"),
            count(study.figures.len(), "figure"),
            count(study.claims.len(), "claim"),
            any_difference(study)
        ));
        for program in session.programs_of(study.built_agents().iter().map(|it| &**it)) {
            say(&format!("  `run` starts `{program}`"));
        }
    }
    Ok(match unchecked.is_empty() {
        true => Exit::Ok,
        false => Exit::Unchecked,
    })
}

/// A note on claims that any difference decides because the study states no difference that matters.
fn any_difference(study: &Study) -> String {
    let lacks = |spec: &&ClaimSpec| {
        let is_direction = claim::parse(&spec.claim).is_ok_and(|claim| claim.relation.is_direction());
        is_direction && spec.min_effect.is_none()
    };
    match study.claims.iter().filter(lacks).count() {
        n if n == 0 || study.relevance.is_some() => String::new(),
        n => format!(" ({n} decided by any difference: `relevance` says which one matters)"),
    }
}

/// Prints what this machine lacks for a study, in one line.
fn say_unchecked((path, problems): &Refused) {
    let lacking = problems.iter().filter(|it| it.severity == Severity::Unavailable);
    // The first line names the cause; messages of Python follow it.
    let lacking: BTreeSet<&str> = lacking.filter_map(|it| it.message.lines().next()).collect();
    let lacking = lacking.into_iter().collect::<Vec<_>>().join("; ");
    complain(&format!("{}: not checked: {lacking}", path.display()));
}

/// The problems of every study, in the order of the command line.
fn say_as_json(session: &Session<'_>, check: &Check) -> Exit {
    let is_refused = |path: &Path| check.refused.iter().find(|(it, _)| it == path);
    let (mut good, mut exit, mut reports) = (check.good.iter(), Exit::Ok, Vec::new());
    for path in &session.selection.specs {
        let problems = match is_refused(path) {
            Some((_, problems)) => {
                let is_unchecked = diagnostic::are_unavailable(problems) && exit != Exit::BadStudy;
                exit = match is_unchecked {
                    true => Exit::Unchecked,
                    false => Exit::BadStudy,
                };
                problems.as_slice()
            }
            None => good.next().map_or(&[][..], |(_, study)| &study.warnings),
        };
        reports.push(json!({"spec": path, "problems": diagnostic::to_json(problems)}));
    }
    say(&serde_json::Value::Array(reports).to_string());
    exit
}

/// Rehearses the programs of valid studies; exit code 100 if a program does not reach its first measurement.
fn rehearse(session: &Session<'_>, options: &CheckOptions) -> Result<Exit, Failure> {
    let planned = session.load()?;
    options.consent.ask_for(session.programs_to_rehearse(&planned)?)?;
    let mut exit = Exit::Ok;
    for line in session.rehearse(&planned, f64::from(options.rehearse_for))? {
        say(&line.unwrap_or_else(|problem| {
            exit = Exit::TrialsFailed;
            problem
        }));
    }
    Ok(exit)
}

/// `resolve`: the study with every default.
pub(super) fn resolve(registry: &Registry, studies: &Studies, common: &Common) -> Result<Exit, Failure> {
    let planned = studies.open(registry, common)?.load()?;
    for (one, _) in by_study(&planned) {
        say(&study::resolved_yaml(&one.study, Path::new(""))?);
    }
    Ok(Exit::Ok)
}
