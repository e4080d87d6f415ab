//! Learning curves: a line over seeds at each measurement, with the seeds themselves or a band.

use super::{
    Figure, FigureSpec,
    build::{Context, by_environment, by_setting, left_out, level},
    chart::{Chart, Scale, Series, Style},
    crowd::name_the_best,
    curve_notes,
    over_runs::{FEW, RunDisplay, are_uneven, at_the_ends, over, points, smoothed},
    published,
    shape::{Curve, CurveSource, RunLine, Shape},
};
use crate::{
    kinds::KindSpec,
    names::{Names, Picked, Place},
    table::{Axis, Scope},
};
use analysis::published_curve::{CurveRun, PublishedCurve};
use contract::{Error, trial_result::TrialResult};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use statistics::{Summary, common_steps};
use std::path::Path;

/// A metric against training steps, either measured while agents learned or recorded by the agents themselves, such as
/// a loss.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LearningCurve {
    /// The metric.
    pub metric: String,
    /// Statistic over its seeds that the line of an agent shows.
    pub line: Line,
    /// Spread of the seeds that the band around the line shows.
    pub band: Band,
    /// Whether each seed is drawn as a thin line: `true`, `false`, or `auto` for panels in which an agent has
    /// at most five.
    pub seeds: SeedLines,
    /// Agents to show, in this order; all where empty. Agents that do not learn have short dashes.
    pub agents: Vec<String>,
    /// Environments to show, one panel each; all where empty.
    pub environments: Vec<String>,
    /// Curves of publications, which are dotted.
    pub published: Vec<PublishedCurve>,
    /// Vertical axis on a logarithmic scale.
    pub log_y: bool,
    /// Weight of the past in a moving average y' = smooth y' + (1 - smooth) y along the curve of each seed, for drawing
    /// only; line and band are computed from the averages.
    #[schemars(range(min = 0.0, max = 0.999))]
    pub smooth: f64,
    /// Measurements before this step are left out, also from the moving average: the values of an untrained agent may
    /// dwarf the rest.
    pub from_step: u64,
}

impl Default for LearningCurve {
    fn default() -> Self {
        Self {
            metric: "return".into(),
            line: Line::Mean,
            band: Band::Auto,
            seeds: SeedLines::Chosen(Automatic::Auto),
            agents: Vec::new(),
            environments: Vec::new(),
            published: Vec::new(),
            log_y: false,
            smooth: 0.0,
            from_step: 0,
        }
    }
}

/// Statistic over seeds that a line shows at each step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Line {
    /// Arithmetic mean.
    Mean,
    /// Median.
    Median,
    /// Interquartile mean: the mean without the smallest and the largest quarter.
    Iqm,
}

/// Spread of the seeds that a band around a line shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Band {
    /// The interval, or no band in panels where seeds are drawn because they are few.
    Auto,
    /// 95 % interval of the statistic of the line: Student-t of a mean, percentile bootstrap of a median or
    /// interquartile mean.
    Interval,
    /// One standard deviation to each side, which may leave the range of possible values.
    Sd,
    /// Smallest to largest seed.
    Range,
    /// No band.
    None,
}

/// Whether each seed is drawn as a thin line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum SeedLines {
    /// As the study states.
    Said(bool),
    /// As the number of seeds suggests.
    Chosen(Automatic),
}

/// The word for a choice that is left to the program.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Automatic {
    /// Seeds are drawn in panels in which an agent has at most five.
    Auto,
}

impl KindSpec for LearningCurve {
    fn name() -> &'static str {
        "learning_curve"
    }

    fn about() -> &'static str {
        "A metric against training steps, one line per agent with its seeds or a band over them."
    }

    fn example() -> &'static str {
        "{ metric: return, agents: [learner] }"
    }
}

impl Figure for LearningCurve {
    fn seek_from(&mut self, folder: &Path) {
        self.published
            .iter_mut()
            .for_each(|curve| curve.seek_from(folder));
    }

    fn followed_metric(&self) -> Option<&str> {
        Some(&self.metric)
    }

    fn check(&self, names: &mut Names<'_>, at: &Place<'_>) {
        let picked = names.pick(at);
        names.metric(&self.metric, at, "metric", &picked);
        published_curves(self, names, at, &picked);
    }

    fn build(&self, spec: &FigureSpec, context: Context<'_>) -> Result<Chart, Error> {
        build(self, spec, context)
    }
}

fn published_curves(kind: &LearningCurve, names: &mut Names<'_>, at: &Place<'_>, picked: &Picked) {
    let Some(list) = at.below("published") else { return };
    for (curve, place) in kind.published.iter().zip(list.items()) {
        names.curve(curve, &place, picked);
    }
}

/// One panel per environment, one line per agent and setting, and the published curves.
fn build(kind: &LearningCurve, spec: &FigureSpec, context: Context<'_>) -> Result<Chart, Error> {
    let scope = Scope::of(context.results, &kind.agents, &kind.environments);
    let x = Scale {
        label: "environment steps".into(),
        ..Scale::default()
    };
    let y = context.scale(spec, &kind.metric, kind.log_y);
    let mut chart = by_environment(spec, &scope, &kind.environments, (x, y), |scope| {
        panel(kind, spec, context, scope)
    })?;
    for (panel, environment) in chart
        .panels
        .iter_mut()
        .zip(scope.names(Axis::Environment, &kind.environments))
    {
        let end = last_step(&scope.at(Axis::Environment, &environment), &kind.metric);
        panel
            .series
            .extend(published::series(kind, context, &environment, end)?);
    }
    let crowded = name_the_best(&mut chart, context.better(&kind.metric));
    chart.notes.extend(curve_notes::sentences(kind, &chart));
    chart.notes.extend(crowded);
    let lack = |scope: &Scope<'_>| {
        let when = if scope.learns() { " while it learned" } else { "" };
        format!("no `{}` recorded{when}", kind.metric)
    };
    let picked = (&kind.agents[..], &kind.environments[..]);
    chart.notes.extend(left_out(spec, context, picked, &chart, lack));
    Ok(chart)
}

fn panel(kind: &LearningCurve, spec: &FigureSpec, context: Context<'_>, scope: &Scope<'_>) -> Vec<Series> {
    let of_setting =
        |scope: &Scope<'_>, label: String, style: Style| SeedCurves::of(kind, scope, label, style);
    let measured = by_setting(spec, context, (scope, &kind.agents), of_setting);
    let measured: Vec<SeedCurves> = measured.into_iter().flatten().collect();
    let few = measured.iter().any(|it| it.level.is_none() && it.seeds.0 <= FEW);
    measured
        .into_iter()
        .map(|it| it.series(kind, RunDisplay::of(kind, few)))
        .collect()
}

/// Measurements of the seeds of an agent, at steps of the learning or at the end only.
struct SeedCurves {
    label: String,
    style: Style,
    learns: bool,
    runs: Vec<CurveRun>,
    /// Ids of the trials, in the order of `runs`.
    trials: Vec<String>,
    /// Number of seeds with results, and number of seeds planned.
    seeds: (usize, usize),
    /// The final mean of an agent that does not learn and was measured at the end only.
    level: Option<f64>,
}

impl SeedCurves {
    fn of(kind: &LearningCurve, scope: &Scope<'_>, label: String, style: Style) -> Option<Self> {
        let learns = scope.learns() || scope.is_imported();
        let (trials, runs): (Vec<String>, Vec<CurveRun>) = runs(scope, &kind.metric).into_iter().unzip();
        let measured = Self {
            label,
            style,
            learns,
            seeds: (runs.len(), scope.planned()),
            runs,
            trials,
            level: None,
        };
        if learns || measured.runs.iter().any(|run| run.points.len() > 1) {
            return (!measured.runs.is_empty()).then_some(measured);
        }
        let finals: Vec<f64> = scope.finals(&kind.metric).into_values().collect();
        let summary = Summary::of(&finals)?;
        Some(Self {
            level: Some(summary.mean),
            seeds: (summary.n, scope.planned()),
            ..measured
        })
    }

    fn series(self, kind: &LearningCurve, shown: RunDisplay) -> Series {
        if let Some(value) = self.level {
            return level(self.label, self.style, self.seeds, value);
        }
        let with_values = |((run, trial), values): ((CurveRun, String), common_steps::StepSeries)| {
            let points = points(&values);
            let name = run.name;
            (!values.is_empty()).then_some((values, RunLine { name, trial, points }))
        };
        let smoothed: Vec<common_steps::StepSeries> =
            self.runs.iter().map(|run| smoothed(kind, &run.points)).collect();
        let runs = self.runs.into_iter().zip(self.trials).zip(smoothed);
        let (values, lines): (Vec<common_steps::StepSeries>, Vec<RunLine>) =
            runs.filter_map(with_values).unzip();
        let seeds = (values.len(), self.seeds.1);
        // The line of a single seed is that seed. Runs are kept if they continue after their line ends.
        let asked = shown.runs || kind.seeds == SeedLines::Chosen(Automatic::Auto) && are_uneven(&values);
        let thin = asked && values.len() > 1;
        let (drawn, undrawn) = if thin {
            (lines, Vec::new())
        } else {
            (Vec::new(), lines)
        };
        let curve = Curve {
            of: if self.learns {
                CurveSource::Learner
            } else {
                CurveSource::NonLearner
            },
            points: over(&values, kind.line, shown.band),
            runs: drawn,
            undrawn,
            at_the_ends: at_the_ends(&values, kind.line),
        };
        Series {
            label: self.label,
            seeds: Some(seeds),
            style: self.style,
            shape: Shape::Curve(curve),
        }
    }
}

/// The measurements of each seed except the final one, with the id of its trial.
fn runs(scope: &Scope<'_>, metric: &str) -> Vec<(String, CurveRun)> {
    let run = |trial: &&TrialResult| {
        let points = trial.while_learning(metric);
        let name = format!("seed {}", trial.trial.key.seed);
        (!points.is_empty()).then(|| (trial.trial.id.clone(), CurveRun { name, points }))
    };
    scope
        .trials
        .iter()
        .filter(|trial| trial.is_ok())
        .filter_map(run)
        .collect()
}

/// The last step at which a trial of the panel was measured, apart from the final measurement.
fn last_step(scope: &Scope<'_>, metric: &str) -> Option<u64> {
    let last = |trial: &&TrialResult| trial.while_learning(metric).last().map(|(step, _)| *step);
    scope
        .trials
        .iter()
        .filter(|trial| trial.is_ok())
        .filter_map(last)
        .max()
}
