//! The trials of a study by cell, as `plan` and `status` print them.

use super::Format;
use contract::trial_end::{EndState, TrialEnd};
use document::count::{count, duration};
use serde_json::json;
use session::{DeviceEstimate, Planned, Session, StudyState};
use std::collections::BTreeMap;
use study::plan::{self, Estimate};

/// A study's trials by cell, with the reasons and the cost of the missing ones.
pub(super) fn overview(
    session: &Session<'_>,
    one: &Planned,
    state: &StudyState,
    explained: bool,
    format: Format,
) -> String {
    let cells = cells(one, state);
    if format == Format::Json {
        let mut overview = as_json(one, &cells);
        if explained {
            overview["why"] = plan::to_json(&state.novelties);
        }
        overview["waiting"] = state.waiting.to_json();
        overview["estimate"] = json!(state.estimate);
        overview["estimate_on_devices"] = json!(state.on_devices);
        return overview.to_string();
    }
    let mut lines = vec![format!(
        "{}: {}",
        one.study.name,
        count(one.plan.trials.len(), "trial")
    )];
    lines.extend(one.study.repeats.map(|repeats| format!("  {repeats}")));
    lines.extend(rows(&cells));
    lines.extend(session::looks_in_words(one));
    lines.extend(session::searches_in_words(one));
    lines.extend(session::stages_in_words(one));
    lines.extend(Some(plan::explain(&state.novelties)).filter(|text| !text.is_empty()));
    let sum = |of: fn(&CellCounts) -> usize| cells.iter().map(|(_, cell)| of(cell)).sum();
    let (blocked, failed) = (sum(|cell| cell.blocked), sum(|cell| cell.failed));
    lines.push(cost_line(
        &state.estimate,
        blocked,
        failed,
        session.settings.workers,
    ));
    let missing = |it: &&DeviceEstimate| it.estimate.missing > 0;
    lines.extend(state.on_devices.iter().filter(missing).map(device_line));
    lines.join("\n")
}

/// Trials of one environment, agent and setting.
#[derive(Default)]
struct CellCounts {
    ok: usize,
    failed: usize,
    missing: usize,
    /// Missing trials that will not run by themselves.
    blocked: usize,
}

/// Names of environment, agent and setting.
type Names<'a> = (&'a str, &'a str, &'a str);

fn cells<'a>(one: &'a Planned, state: &StudyState) -> Vec<(Names<'a>, CellCounts)> {
    let (mut cells, mut places): (Vec<(Names<'a>, CellCounts)>, BTreeMap<Names<'a>, usize>) =
        (Vec::new(), BTreeMap::new());
    for (index, (trial, end)) in one.plan.trials.iter().zip(&state.ends).enumerate() {
        let names = (
            trial.cell.environment.as_str(),
            trial.cell.agent.as_str(),
            trial.cell.point.words(),
        );
        // The trials of a cell are neighbours in a plan, except for those of later looks.
        let place = *places.entry(names).or_insert(cells.len());
        if place == cells.len() {
            cells.push((names, CellCounts::default()));
        }
        if state.waiting.is_blocked(index) {
            cells[place].1.blocked += 1;
        } else {
            cells[place].1.add(end.as_ref());
        }
    }
    cells
}

impl CellCounts {
    fn add(&mut self, end: Option<&TrialEnd>) {
        match end {
            Some(end) if end.state == EndState::Ok => self.ok += 1,
            Some(end) if end.state != EndState::Killed => self.failed += 1,
            _ => self.missing += 1,
        }
    }
}

/// A heading and a line for each cell. The columns for settings and blocked trials appear only if there are any.
fn rows(cells: &[(Names<'_>, CellCounts)]) -> Vec<String> {
    let width = |of: fn(&Names<'_>) -> usize, least: usize| {
        cells.iter().map(|(key, _)| of(key)).max().unwrap_or(0).max(least)
    };
    let (first, second, third) = (
        width(|key| key.0.len(), 11),
        width(|key| key.1.len(), 5),
        width(|key| key.2.len(), 0),
    );
    let is_blocked = cells.iter().any(|(_, cell)| cell.blocked > 0);
    let row = |(environment, agent, setting): Names<'_>, [ok, failed, missing, blocked]: [&str; 4]| {
        let setting = match third {
            0 => String::new(),
            _ => format!("{setting:<width$}  ", width = third.max("setting".len())),
        };
        let blocked = if is_blocked {
            format!(" {blocked:>7}")
        } else {
            String::new()
        };
        format!(
            "  {environment:<first$}  {agent:<second$}  {setting}{ok:>6} {failed:>6} {missing:>7}{blocked}"
        )
    };
    let head = row(
        ("environment", "agent", "setting"),
        ["ok", "failed", "missing", "blocked"],
    );
    let of_cell = |(names, cell): &(Names<'_>, CellCounts)| {
        let counts = [cell.ok, cell.failed, cell.missing, cell.blocked].map(|count| count.to_string());
        row(*names, counts.each_ref().map(String::as_str))
    };
    std::iter::once(head).chain(cells.iter().map(of_cell)).collect()
}

fn as_json(one: &Planned, cells: &[(Names<'_>, CellCounts)]) -> serde_json::Value {
    let row = |((environment, agent, setting), cell): &(Names<'_>, CellCounts)| {
        json!({"environment": environment,
        "agent": agent, "setting": setting, "ok": cell.ok, "failed": cell.failed, "missing": cell.missing,
        "blocked": cell.blocked})
    };
    let rows: Vec<_> = cells.iter().map(row).collect();
    let stages: Vec<_> = session::stages(one).iter().map(|stage| json!(stage)).collect();
    json!({"study": one.study.name, "trials": one.plan.trials.len(), "cells": rows, "stages": stages})
}

/// The last line of an overview.
fn cost_line(estimate: &Estimate, blocked: usize, failed: usize, workers: usize) -> String {
    match (estimate.missing, blocked, failed) {
        (0, 1.., _) => format!("  {blocked} blocked, and nothing else is missing"),
        (0, 0, 0) => "  nothing is missing".into(),
        (0, 0, _) => format!("  nothing is missing, but {failed} did not end ok"),
        _ => format!("  {}", in_words(estimate, workers)),
    }
}

/// A line such as `with --device cuda: about 20 s on 16 workers`.
fn device_line(on_device: &DeviceEstimate) -> String {
    let DeviceEstimate {
        device,
        workers,
        estimate,
    } = on_device;
    format!("  with --device {device}: {}", time(estimate, *workers))
}

/// A line such as `60 missing: about 3 min on 2 workers, and 20 trials unlike any that is stored`.
fn in_words(estimate: &Estimate, workers: usize) -> String {
    format!("{} missing: {}", estimate.missing, time(estimate, workers))
}

fn time(estimate: &Estimate, workers: usize) -> String {
    let Estimate { missing, unknown, .. } = *estimate;
    if unknown == missing {
        return "no stored trial tells how long".into();
    }
    #[allow(clippy::cast_precision_loss, reason = "an estimate")]
    let about = duration(estimate.worker_s / workers.max(1) as f64);
    let rest = match unknown {
        0 => String::new(),
        _ => format!(", and {} unlike any that is stored", count(unknown, "trial")),
    };
    format!("about {about} on {}{rest}", count(workers, "worker"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_known_is_said_beside_the_estimate() {
        let said = |missing, unknown, blocked, failed| {
            let estimate = Estimate {
                missing,
                unknown,
                worker_s: 360.0,
            };
            cost_line(&estimate, blocked, failed, 2)
        };
        assert_eq!(said(60, 0, 0, 0), "  60 missing: about 3 min on 2 workers");
        assert_eq!(
            said(60, 20, 0, 1),
            "  60 missing: about 3 min on 2 workers, and 20 trials unlike any that is stored"
        );
        assert_eq!(said(60, 60, 3, 0), "  60 missing: no stored trial tells how long");
        assert_eq!(said(0, 0, 3, 0), "  3 blocked, and nothing else is missing");
        assert_eq!(said(0, 0, 0, 2), "  nothing is missing, but 2 did not end ok");
        assert_eq!(said(0, 0, 0, 0), "  nothing is missing");
    }
}
