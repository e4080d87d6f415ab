//! `plan`, `status`: facts about studies, without running a trial.

use super::{
    Common, Format, Studies, cells,
    running::{begun, tried_again},
    say, submit,
};
use contract::{
    Registry,
    trial::Trial,
    trial_end::{EndState, TrialEnd},
};
use session::{Exit, Failure, Planned, Session, StudyState, exit_of, exit_of_searches, failed_in_words};
use std::sync::Arc;

/// `plan`: trials by cell, their ends, the reasons why others are missing, and the cost of these.
pub(super) fn plan(registry: &Registry, studies: &Studies, common: &Common) -> Result<Exit, Failure> {
    let session = studies.open(registry, common)?;
    let planned = session.load_with_looks()?;
    session.warn(planned.iter().map(|one| &one.study));
    for mut one in planned {
        let state = session.state(&mut one, true)?;
        say(&cells::overview(&session, &one, &state, true, common.format));
        if common.format == Format::Text {
            say_open(&session, &one, &state);
        }
    }
    Ok(Exit::Ok)
}

/// `status`: end states by cell and reasons of failures. Exit code 106 if trials are missing, 100 if some failed.
pub(super) fn status(registry: &Registry, studies: &Studies, common: &Common) -> Result<Exit, Failure> {
    let session = studies.open(registry, common)?;
    let mut exit = Exit::Ok;
    for mut one in session.load_with_looks()? {
        let state = session.state(&mut one, false)?;
        say(&cells::overview(&session, &one, &state, false, common.format));
        if common.format == Format::Text {
            let (store, trials, ends) = (session.store()?, &one.plan.trials, &state.ends);
            let texts = [
                begun(store, trials, ends),
                tried_again(store, trials, ends),
                failures(trials, ends),
            ];
            let texts = texts.iter().filter(|text| !text.is_empty());
            texts.for_each(|text| say(text));
            say_open(&session, &one, &state);
        }
        let states = state.ends.iter().map(|end| Some(end.as_ref()?.state));
        exit = exit.max(exit_of(states)).max(exit_of_searches(&one));
    }
    submit::show(&session, common.format);
    Ok(exit)
}

/// Prints why missing trials wait, and the command that runs failed ones again.
fn say_open(session: &Session<'_>, one: &Planned, state: &StudyState) {
    let lines = state.waiting.lines();
    if !lines.is_empty() {
        say(&lines.join("\n"));
    }
    let ends = one.plan.trials.iter().zip(&state.ends);
    let ends = ends.map(|(trial, end)| (trial.id.as_str(), end.as_ref()));
    if let Some(words) = failed_in_words(ends, &session.again()) {
        say(&format!("  {words}"));
    }
}

fn failures(trials: &[Arc<Trial>], ends: &[Option<TrialEnd>]) -> String {
    let failed = trials
        .iter()
        .zip(ends)
        .filter_map(|(trial, end)| Some((trial, end.as_ref().filter(|end| end.state != EndState::Ok)?)));
    let lines =
        failed.map(|(trial, end)| format!("  {:<8} {}: {}", end.state.name(), trial.title(), end.reason));
    lines.collect::<Vec<_>>().join("\n")
}
