//! The tidy tables of a study: evaluations, values recorded during learning, and trials.

use super::{
    Subject, config,
    table::{Cells, Column, Table},
};
use contract::{recorder::Phase, trial::Purpose, trial_end::TrialEnd, trial_result::TrialResult};
use std::{borrow::Cow, collections::BTreeMap};

/// `evaluations`, `training` and `trials`, in this order.
#[must_use]
pub fn tables<'a>(subject: &Subject<'a>) -> Vec<Table<'a>> {
    let config = config::columns(subject);
    let mut all = vec![
        recorded(
            subject,
            "evaluations",
            "a row per trial, metric and step of a measurement: the mean over its episodes and seats",
            &[Phase::Evaluate, Phase::Final],
        ),
        recorded(
            subject,
            "training",
            "a row per trial, metric and step: the mean of what was recorded there while learning",
            &[Phase::Train],
        ),
        trials(subject),
    ];
    for table in &mut all {
        table.columns.extend(config.iter().cloned());
    }
    all
}

/// A row of the values that a trial recorded.
struct Row<'a> {
    trial: usize,
    phase: Phase,
    step: u64,
    metric: &'a str,
    mean: f64,
    count: u64,
}

fn recorded<'a>(
    subject: &Subject<'a>,
    name: &'static str,
    about: &'static str,
    phases: &[Phase],
) -> Table<'a> {
    let mut rows = Vec::new();
    for (trial, (result, _)) in subject.trials.iter().enumerate() {
        for phase in phases {
            rows.extend(means(trial, result, *phase));
        }
    }
    let text =
        |of: fn(&Row<'a>) -> &'a str| Cells::Text(rows.iter().map(|row| Some(of(row).into())).collect());
    let units = rows.iter().map(|row| {
        let unit = subject.units.get(row.metric).map_or("", String::as_str);
        Some(unit.into())
    });
    let mut columns = names(subject);
    columns.extend([
        Column::new(
            "phase",
            "evaluate (while learning), final (at the end) or train",
            text(|row| row.phase.name()),
        ),
        Column::new(
            "step",
            "steps of the environment, or examples, before it was recorded",
            Cells::Count(rows.iter().map(|row| Some(row.step)).collect()),
        ),
        Column::new(
            "metric",
            "what was recorded; see `metrics`",
            text(|row| row.metric),
        ),
        Column::new(
            "unit",
            "SI unit of the value, empty where there is none",
            Cells::Text(units.collect()),
        ),
        Column::new(
            "value",
            "the mean",
            Cells::Number(rows.iter().map(|row| Some(row.mean)).collect()),
        ),
        Column::new(
            "values",
            "how many values the mean is over",
            Cells::Count(rows.iter().map(|row| Some(row.count)).collect()),
        ),
    ]);
    Table {
        name,
        about,
        trials: rows.iter().map(|row| row.trial).collect(),
        columns,
    }
}

/// The means of all metrics of a trial in a phase, by step and then by metric.
fn means(trial: usize, result: &TrialResult, phase: Phase) -> Vec<Row<'_>> {
    let mut sums: BTreeMap<(u64, &str), (f64, u64)> = BTreeMap::new();
    for row in result.rows.iter().filter(|row| row.phase == phase) {
        let metric = result.names[usize::from(row.metric)].as_str();
        let sum = sums.entry((row.step, metric)).or_default();
        *sum = (sum.0 + row.value, sum.1 + 1);
    }
    let mut rows = Vec::with_capacity(sums.len());
    for ((step, metric), (sum, count)) in sums {
        #[expect(clippy::cast_precision_loss, reason = "a count of episodes is far below 2^52")]
        let mean = sum / count as f64;
        rows.push(Row {
            trial,
            phase,
            step,
            metric,
            mean,
            count,
        });
    }
    rows
}

/// Columns of every table on the trial: its id, its names in the study, its seed.
fn names<'a>(subject: &Subject<'a>) -> Vec<Column<'a>> {
    let text = |of: fn(&'a TrialResult) -> &'a str| {
        Cells::Text(
            subject
                .trials
                .iter()
                .map(|(result, _)| Some(of(result).into()))
                .collect(),
        )
    };
    let seeds = subject
        .trials
        .iter()
        .map(|(result, _)| Some(result.trial.key.seed));
    [
        Column::new(
            "trial",
            "id: a hash of everything that determines the numbers",
            text(|it| &it.trial.id),
        ),
        Column::new(
            "environment",
            "name in the study",
            text(|it| &it.trial.cell.environment),
        ),
        Column::new("agent", "name in the study", text(|it| &it.trial.cell.agent)),
        Column::new(
            "setting",
            "the point of the sweep, empty without one",
            text(|it| it.trial.cell.point.words()),
        ),
        Column::new("seed", "the replicate", Cells::Count(seeds.collect())),
    ]
    .map(Column::of_trials)
    .into()
}

fn trials<'a>(subject: &Subject<'a>) -> Table<'a> {
    let columns = [names(subject), ends(subject), origins(subject)];
    Table {
        name: "trials",
        about: "a row per trial",
        trials: (0..subject.trials.len()).collect(),
        columns: columns.into_iter().flatten().collect(),
    }
}

/// Columns on the purpose of trials and on their ends.
fn ends<'a>(subject: &Subject<'a>) -> Vec<Column<'a>> {
    let purposes = subject
        .trials
        .iter()
        .map(|(result, _)| Some(purpose(&result.trial.cell.purpose).into()));
    let state = |end: &'a TrialEnd| Some(end.state.name().into());
    let reason = |end: &'a TrialEnd| Some(end.reason.as_str().into()).filter(|_| !end.reason.is_empty());
    vec![
        Column::new(
            "purpose",
            "cell, prepared, tried or play",
            Cells::Text(purposes.collect()),
        ),
        Column::new(
            "state",
            "how it ended, empty where it has not run",
            texts(subject, state),
        ),
        Column::new("reason", "why it did not end ok", texts(subject, reason)),
        Column::new(
            "wall_time",
            "wall-clock time of the trial: a measurement of the machine",
            seconds(subject, |end| Some(end.wall_s)),
        )
        .in_unit("s"),
        Column::new(
            "time_per_decision",
            "wall-clock time of a decision of the final measurement",
            seconds(subject, |end| end.decision_s),
        )
        .in_unit("s"),
    ]
}

/// Columns on the times and programs of trials, and on the digest of their recorded values.
fn origins<'a>(subject: &Subject<'a>) -> Vec<Column<'a>> {
    let stored = || subject.trials.iter().map(|(_, stored)| stored.as_ref());
    let ended_at = stored().map(|it| Some(it?.ended_at.as_deref()?.into()));
    let builds = stored().map(|it| Some(it?.build.as_ref()?.to_string().into()));
    let digest = |end: &'a TrialEnd| Some(end.digest.as_str().into()).filter(|_| !end.digest.is_empty());
    vec![
        Column::new(
            "ended_at",
            "when it ended, in UTC",
            Cells::Text(ended_at.collect()),
        ),
        Column::new(
            "build",
            "commit of the program that computed it",
            Cells::Text(builds.collect()),
        ),
        Column::new(
            "metrics_digest",
            "first 32 digits of the BLAKE3 hash of its metrics file in the store",
            texts(subject, digest),
        ),
    ]
}

/// A text from the end of each trial; empty for trials that have not run.
fn texts<'a>(subject: &Subject<'a>, of: impl Fn(&'a TrialEnd) -> Option<Cow<'a, str>>) -> Cells<'a> {
    let ends = subject.trials.iter().map(|(result, _)| result.end.as_ref());
    Cells::Text(ends.map(|end| of(end?)).collect())
}

/// A time from the end of each trial.
fn seconds<'a>(subject: &Subject<'a>, of: fn(&TrialEnd) -> Option<f64>) -> Cells<'a> {
    let ends = subject.trials.iter().map(|(result, _)| result.end.as_ref());
    Cells::Number(ends.map(|end| of(end?)).collect())
}

fn purpose(purpose: &Purpose) -> &'static str {
    match purpose {
        Purpose::Cell => "cell",
        Purpose::Prepared => "prepared",
        Purpose::Tried(_) => "tried",
        Purpose::Play(_) => "play",
        Purpose::Imported => "imported",
    }
}
