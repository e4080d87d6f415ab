//! The tidy tables of a study: evaluations, values recorded during learning, and trials.

use super::{
    Subject, config,
    table::{ExportCells, ExportColumn, ExportTable},
};
use contract::{recorder::Phase, trial::Purpose, trial_end::TrialEnd, trial_result::TrialResult};
use std::{borrow::Cow, collections::BTreeMap};

/// `evaluations`, `training` and `trials`, in this order.
#[must_use]
pub fn tables<'a>(subject: &Subject<'a>) -> Vec<ExportTable<'a>> {
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
struct MetricRow<'a> {
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
) -> ExportTable<'a> {
    let mut rows = Vec::new();
    for (trial, (result, _)) in subject.trials.iter().enumerate() {
        for phase in phases {
            rows.extend(means(trial, result, *phase));
        }
    }
    let text = |of: fn(&MetricRow<'a>) -> &'a str| {
        ExportCells::Text(rows.iter().map(|row| Some(of(row).into())).collect())
    };
    let units = rows.iter().map(|row| {
        let unit = subject.units.get(row.metric).map_or("", String::as_str);
        Some(unit.into())
    });
    let mut columns = names(subject);
    columns.extend([
        ExportColumn::new(
            "phase",
            "evaluate (while learning), final (at the end) or train",
            text(|row| row.phase.name()),
        ),
        ExportColumn::new(
            "step",
            "steps of the environment, or examples, before it was recorded",
            ExportCells::Count(rows.iter().map(|row| Some(row.step)).collect()),
        ),
        ExportColumn::new(
            "metric",
            "what was recorded; see `metrics`",
            text(|row| row.metric),
        ),
        ExportColumn::new(
            "unit",
            "SI unit of the value, empty where there is none",
            ExportCells::Text(units.collect()),
        ),
        ExportColumn::new(
            "value",
            "the mean",
            ExportCells::Number(rows.iter().map(|row| Some(row.mean)).collect()),
        ),
        ExportColumn::new(
            "values",
            "how many values the mean is over",
            ExportCells::Count(rows.iter().map(|row| Some(row.count)).collect()),
        ),
    ]);
    ExportTable {
        name,
        about,
        trials: rows.iter().map(|row| row.trial).collect(),
        columns,
    }
}

/// The means of all metrics of a trial in a phase, by step and then by metric.
fn means(trial: usize, result: &TrialResult, phase: Phase) -> Vec<MetricRow<'_>> {
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
        rows.push(MetricRow {
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
fn names<'a>(subject: &Subject<'a>) -> Vec<ExportColumn<'a>> {
    let text = |of: fn(&'a TrialResult) -> &'a str| {
        ExportCells::Text(
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
        ExportColumn::new(
            "trial",
            "id: a hash of everything that determines the numbers",
            text(|it| &it.trial.id),
        ),
        ExportColumn::new(
            "environment",
            "name in the study",
            text(|it| &it.trial.cell.environment),
        ),
        ExportColumn::new("agent", "name in the study", text(|it| &it.trial.cell.agent)),
        ExportColumn::new(
            "setting",
            "the point of the sweep, empty without one",
            text(|it| it.trial.cell.point.words()),
        ),
        ExportColumn::new("seed", "the replicate", ExportCells::Count(seeds.collect())),
    ]
    .map(ExportColumn::of_trials)
    .into()
}

fn trials<'a>(subject: &Subject<'a>) -> ExportTable<'a> {
    let columns = [names(subject), ends(subject), origins(subject)];
    ExportTable {
        name: "trials",
        about: "a row per trial",
        trials: (0..subject.trials.len()).collect(),
        columns: columns.into_iter().flatten().collect(),
    }
}

/// Columns on the purpose of trials and on their ends.
fn ends<'a>(subject: &Subject<'a>) -> Vec<ExportColumn<'a>> {
    let purposes = subject
        .trials
        .iter()
        .map(|(result, _)| Some(purpose(&result.trial.cell.purpose).into()));
    let state = |end: &'a TrialEnd| Some(end.state.name().into());
    let reason = |end: &'a TrialEnd| Some(end.reason.as_str().into()).filter(|_| !end.reason.is_empty());
    vec![
        ExportColumn::new(
            "purpose",
            "cell, prepared, tried or play",
            ExportCells::Text(purposes.collect()),
        ),
        ExportColumn::new(
            "state",
            "how it ended, empty where it has not run",
            texts(subject, state),
        ),
        ExportColumn::new("reason", "why it did not end ok", texts(subject, reason)),
        ExportColumn::new(
            "wall_time",
            "wall-clock time of the trial: a measurement of the machine",
            seconds(subject, |end| Some(end.wall_s)),
        )
        .in_unit("s"),
        ExportColumn::new(
            "time_per_decision",
            "wall-clock time of a decision of the final measurement",
            seconds(subject, |end| end.decision_s),
        )
        .in_unit("s"),
    ]
}

/// Columns on the times and programs of trials, and on the digest of their recorded values.
fn origins<'a>(subject: &Subject<'a>) -> Vec<ExportColumn<'a>> {
    let stored = || subject.trials.iter().map(|(_, stored)| stored.as_ref());
    let ended_at = stored().map(|it| Some(it?.ended_at.as_deref()?.into()));
    let builds = stored().map(|it| Some(it?.build.as_ref()?.to_string().into()));
    let digest = |end: &'a TrialEnd| Some(end.digest.as_str().into()).filter(|_| !end.digest.is_empty());
    vec![
        ExportColumn::new(
            "ended_at",
            "when it ended, in UTC",
            ExportCells::Text(ended_at.collect()),
        ),
        ExportColumn::new(
            "build",
            "commit of the program that computed it",
            ExportCells::Text(builds.collect()),
        ),
        ExportColumn::new(
            "metrics_digest",
            "first 32 digits of the BLAKE3 hash of its metrics file in the store",
            texts(subject, digest),
        ),
    ]
}

/// A text from the end of each trial; empty for trials that have not run.
fn texts<'a>(subject: &Subject<'a>, of: impl Fn(&'a TrialEnd) -> Option<Cow<'a, str>>) -> ExportCells<'a> {
    let ends = subject.trials.iter().map(|(result, _)| result.end.as_ref());
    ExportCells::Text(ends.map(|end| of(end?)).collect())
}

/// A time from the end of each trial.
fn seconds<'a>(subject: &Subject<'a>, of: fn(&TrialEnd) -> Option<f64>) -> ExportCells<'a> {
    let ends = subject.trials.iter().map(|(result, _)| result.end.as_ref());
    ExportCells::Number(ends.map(|end| of(end?)).collect())
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
