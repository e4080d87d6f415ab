//! `check --rehearse`: starts each program of a study twice, with one seed and for a short time, and says whether it
//! comes to the same values again.

use super::{
    BAD_SPEC, Common, Failure, Format, LimitOptions, OK, Selection, TRIALS_FAILED, compute::Compute, consent,
    say, settings, study, study::Planned,
};
use crate::{
    Error, Phase, Registry,
    count::count,
    limits::Limits,
    recorder::Row,
    results::EndState,
    scheduler::Task,
    store::{MetricsTable, Store},
    trial::Trial,
};
use clap::Args;
use std::{collections::BTreeSet, sync::Arc};

/// The options of `check`.
#[derive(Debug, Clone, Args)]
pub(super) struct CheckOptions {
    #[command(flatten)]
    pub(super) selection: Selection,
    /// Start each program twice, with one seed, up to its first measurement, and say whether it repeats.
    #[arg(long)]
    pub(super) rehearse: bool,
    /// Longest time of each of the two runs.
    #[arg(long, value_name = "SECONDS", requires = "rehearse", default_value_t = 60)]
    rehearse_for: u32,
    #[command(flatten)]
    consent: consent::Consent,
}

/// How the values of two runs with one seed compare.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Repeats {
    /// Every bit is the same.
    ToTheBit,
    /// They differ by less than this power of ten, relative to the larger value.
    Within(i32),
    /// They differ by more, or stand at other steps.
    Not,
}

/// A larger relative difference comes from more than the order of sums.
const LARGEST_POWER: i32 = -3;

impl Repeats {
    fn of(one: &MetricsTable, other: &MetricsTable) -> Self {
        if one.rows.len() != other.rows.len() {
            return Self::Not;
        }
        let mut largest: f64 = 0.0;
        let mut same_bits = true;
        for (first, second) in one.rows.iter().zip(&other.rows) {
            let place = |table: &MetricsTable, row: &Row| {
                (
                    row.phase,
                    row.step,
                    table.names.get(usize::from(row.metric)).cloned(),
                )
            };
            if place(one, first) != place(other, second) {
                return Self::Not;
            }
            let (first, second) = (first.value, second.value);
            same_bits &= first.to_bits() == second.to_bits();
            let scale = first.abs().max(second.abs());
            largest = largest.max(if scale > 0.0 {
                (first - second).abs() / scale
            } else {
                0.0
            });
        }
        match power_above(largest) {
            _ if same_bits => Self::ToTheBit,
            power if power <= LARGEST_POWER => Self::Within(power),
            _ => Self::Not,
        }
    }

    fn in_words(self) -> String {
        match self {
            Self::ToTheBit => "repeats to the bit".into(),
            Self::Within(power) => format!("repeats to 1e{power}"),
            Self::Not => "does not repeat".into(),
        }
    }
}

/// The smallest power of ten that is no less than a difference, and no smaller than numbers can differ by.
#[allow(
    clippy::cast_possible_truncation,
    reason = "a logarithm of a number between 1e-15 and 2"
)]
fn power_above(difference: f64) -> i32 {
    difference.max(1e-15).log10().ceil() as i32
}

/// `check`, with its rehearsal where that is asked for and every study holds.
pub(super) fn check(registry: &Registry, options: &CheckOptions, common: &Common) -> Result<u8, Failure> {
    if options.rehearse && common.format == Format::Json {
        let text = "error: `--rehearse` prints text: leave out `--format json`".into();
        return Err(Failure { code: BAD_SPEC, text });
    }
    match study::check(registry, &options.selection, common)? {
        OK if options.rehearse => rehearse(registry, options, common),
        code => Ok(code),
    }
}

/// Rehearses the programs of studies that hold; 100 where one of them does not come to its first measurement.
fn rehearse(registry: &Registry, options: &CheckOptions, common: &Common) -> Result<u8, Failure> {
    let settings = settings::read(common)?;
    let planned = study::load(registry, &options.selection, None)?;
    let trials = planned.iter().flat_map(|one| first_of_each(registry, one));
    let programs = consent::of_trials(
        registry,
        trials.map(|(trial, _)| &**trial),
        options.selection.specs.first(),
    )?;
    options.consent.ask_for(programs)?;
    let no_limits = LimitOptions::default();
    let how = Compute {
        registry,
        asked: (&options.selection, common),
        settings: &settings,
        limits: &no_limits,
        workers: settings.workers,
        hosts: Default::default(),
        retry_failed: false,
        whole: true,
    };
    let mut code = OK;
    for one in &planned {
        let limits = Arc::new(Limits {
            wall_time_s: Some(f64::from(options.rehearse_for)),
            retries: Some(0),
            ..how.limits_of(&one.study.limits)
        });
        for line in rehearsed(&how, one, &limits)? {
            say(&line.unwrap_or_else(|problem| {
                code = TRIALS_FAILED;
                problem
            }));
        }
    }
    Ok(code)
}

/// The first trial of each program in each environment, with its cost.
fn first_of_each<'a>(registry: &Registry, one: &'a Planned) -> Vec<(&'a Arc<Trial>, u64)> {
    let mut known = BTreeSet::new();
    let trials = one.plan.trials.iter().zip(one.costs.iter().copied());
    let trains_itself = |trial: &Trial| {
        let part = trial.key.agent.agent();
        part.and_then(|part| registry.agents.get(part.plugin.as_str()))
            .is_some_and(|entry| entry.trains_itself)
    };
    trials
        .filter(|(trial, _)| trains_itself(trial))
        .filter(|(trial, _)| known.insert((trial.cell.environment.clone(), trial.cell.agent.clone())))
        .collect()
}

/// A line for each program of a study; an error for one that did not come to its first measurement.
fn rehearsed(
    how: &Compute<'_>,
    one: &Planned,
    limits: &Arc<Limits>,
) -> Result<Vec<Result<String, String>>, Failure> {
    let trials = first_of_each(how.registry, one);
    let tasks: Vec<Task<'_>> = trials
        .iter()
        .map(|(trial, cost)| Task {
            trial,
            cost: *cost,
            pace_s: None,
            limits: Arc::clone(limits),
            before: None,
            after: trial.key.sources(),
            until: first_measurement(trial),
        })
        .collect();
    if tasks.is_empty() {
        return Ok(Vec::new());
    }
    let temporary = |_| {
        let made = tempfile::Builder::new().prefix("regimen-rehearsal-").tempdir();
        made.map_err(Error::file("create a folder in", &std::env::temp_dir()))
    };
    let folders = [temporary(0)?, temporary(1)?];
    let stores = [&folders[0], &folders[1]].map(|folder| Store::at(folder.path()));
    for store in &stores {
        how.work(&tasks, store)?;
    }
    let line = |(trial, _): &(&Arc<Trial>, u64)| {
        let name = format!("`{}` in `{}`", trial.cell.agent, trial.cell.environment);
        Ok(
            match (recorded(trial, &stores[0])?, recorded(trial, &stores[1])?) {
                (Ok(first), Ok(second)) => {
                    let repeats = Repeats::of(&first, &second).in_words();
                    Ok(format!(
                        "  {name} {repeats} ({})",
                        count(first.rows.len(), "value")
                    ))
                }
                (Err(problem), _) | (_, Err(problem)) => {
                    Err(format!("  {name} was not rehearsed: {problem}"))
                }
            },
        )
    };
    trials.iter().map(line).collect()
}

/// The step of the first measurement; `None` where there is none but the last.
fn first_measurement(trial: &Trial) -> Option<u64> {
    let config = &trial.key.protocol.config;
    let every = config["evaluate_every"].as_u64().filter(|every| *every > 0)?;
    config["steps"]
        .as_u64()
        .is_none_or(|steps| every < steps)
        .then_some(every)
}

/// The record of a rehearsed trial up to its first measurement, or why there is none. A quick program ends before
/// it is stopped there.
fn recorded(trial: &Arc<Trial>, store: &Store) -> Result<Result<MetricsTable, String>, Failure> {
    if let Some(partial) = store.partial(&trial.id)? {
        return Ok(Ok(partial.table));
    }
    let result = store.load(trial)?;
    let until = first_measurement(trial);
    let counts = |row: &Row| until.is_none_or(|until| row.step <= until && row.phase != Phase::Final);
    Ok(match result.end.as_deref() {
        Some(end) if end.state == EndState::Ok => Ok(MetricsTable {
            names: result.names.to_vec(),
            rows: result.rows.into_iter().filter(counts).collect(),
        }),
        Some(end) if end.state == EndState::Timeout => Err(format!(
            "{}; `--rehearse-for` gives it longer, and a smaller `evaluate_every` measures earlier",
            end.reason
        )),
        Some(end) => Err(format!("it ended as {}: {}", end.state.name(), end.reason)),
        None => Err("it was stopped".into()),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(values: &[f64]) -> MetricsTable {
        let row = |(step, value): (u64, &f64)| Row {
            phase: Phase::Evaluate,
            step,
            episode: 0,
            seat: 0,
            metric: 0,
            value: *value,
        };
        MetricsTable {
            names: vec!["return".into()],
            rows: (1..).zip(values).map(row).collect(),
        }
    }

    #[test]
    fn the_words_are_those_of_the_largest_difference() {
        let words = |other: &[f64]| Repeats::of(&table(&[1.0, -200.0]), &table(other)).in_words();
        assert_eq!(words(&[1.0, -200.0]), "repeats to the bit");
        assert_eq!(words(&[1.0, -200.000_1]), "repeats to 1e-6");
        assert_eq!(words(&[1.000_000_01, -200.000_1]), "repeats to 1e-6");
        assert_eq!(words(&[1.000_5, -200.0]), "repeats to 1e-3");
        assert_eq!(words(&[1.01, -200.0]), "does not repeat");
        assert_eq!(words(&[1.0]), "does not repeat");
        assert_eq!(Repeats::of(&table(&[0.0]), &table(&[-0.0])), Repeats::Within(-15));
    }

    #[test]
    fn other_steps_and_metrics_do_not_repeat() {
        let (one, mut other) = (table(&[1.0]), table(&[1.0]));
        other.rows[0].step = 7;
        assert_eq!(Repeats::of(&one, &other), Repeats::Not);
        other.rows[0].step = 1;
        other.names[0] = "cost".into();
        assert_eq!(Repeats::of(&one, &other), Repeats::Not);
    }
}
