//! Learning curves: a line over seeds at each measurement, with the seeds themselves or a band.

use super::{
    FigureSpec, LearningCurve,
    build::{Context, by_environment, label_with_setting, level},
    chart::{Chart, Curve, CurveOf, RunLine, Scale, Series, Shape, Style},
    curve_notes,
    over_runs::{FEW, Shown, Values, over, points, smoothed},
    published,
};
use crate::{
    Error, Phase,
    published_curve::Run,
    results::TrialResult,
    statistics::Summary,
    table::{Axis, Scope},
};

/// One panel per environment, one line per agent and setting, and what others published.
pub(super) fn build(kind: &LearningCurve, spec: &FigureSpec, context: Context<'_>) -> Result<Chart, Error> {
    let scope = Scope::of(context.results, &kind.agents, &kind.environments);
    let x = Scale { label: "environment steps".into(), ..Scale::default() };
    let y = context.scale(spec, &kind.metric, kind.log_y);
    let mut chart = by_environment(spec, &scope, &kind.environments, (x, y), |scope| panel(kind, spec, context, scope))?;
    for (panel, environment) in chart.panels.iter_mut().zip(scope.names(Axis::Environment, &kind.environments)) {
        let end = last_step(&scope.at(Axis::Environment, &environment), &kind.metric);
        panel.series.extend(published::series(kind, context, &environment, end)?);
    }
    chart.notes.extend(curve_notes::sentences(kind, &chart));
    Ok(chart)
}

fn panel(kind: &LearningCurve, spec: &FigureSpec, context: Context<'_>, scope: &Scope<'_>) -> Vec<Series> {
    let agents = scope.names(Axis::Agent, &kind.agents);
    let of_agent = |agent: &String| {
        let scope = scope.at(Axis::Agent, agent);
        let settings = scope.names(Axis::Setting, &[]);
        let several = settings.len() > 1;
        let measured = move |(index, setting): (usize, &String)| {
            let variant = if several { index } else { context.style(agent).variant };
            let style = Style { variant, ..context.style(agent) };
            let label = label_with_setting(spec, agent, if several { setting } else { "" });
            Measured::of(kind, &scope.at(Axis::Setting, setting), label, style)
        };
        settings.iter().enumerate().filter_map(measured).collect::<Vec<_>>()
    };
    let measured: Vec<Measured> = agents.iter().flat_map(of_agent).collect();
    let few = measured.iter().any(|it| it.level.is_none() && it.seeds.0 <= FEW);
    measured.into_iter().map(|it| it.series(kind, Shown::of(kind, few))).collect()
}

/// What the seeds of an agent measured while it learned, or while others did.
struct Measured {
    label: String,
    style: Style,
    learns: bool,
    runs: Vec<Run>,
    /// Seeds that there are and seeds that are planned.
    seeds: (usize, usize),
    /// The final mean, where an agent that does not learn was measured at the end only.
    level: Option<f64>,
}

impl Measured {
    fn of(kind: &LearningCurve, scope: &Scope<'_>, label: String, style: Style) -> Option<Self> {
        let (learns, runs) = (scope.learns(), runs(scope, &kind.metric));
        let measured = Self { label, style, learns, seeds: (runs.len(), scope.planned()), runs, level: None };
        if learns || measured.runs.iter().any(|run| run.points.len() > 1) {
            return (!measured.runs.is_empty()).then_some(measured);
        }
        let finals: Vec<f64> = scope.finals(&kind.metric).into_values().collect();
        let summary = Summary::of(&finals)?;
        Some(Self { level: Some(summary.mean), seeds: (summary.n, scope.planned()), ..measured })
    }

    fn series(self, kind: &LearningCurve, shown: Shown) -> Series {
        if let Some(value) = self.level {
            return level(self.label, self.style, self.seeds, value);
        }
        let values: Vec<Values> = self.runs.iter().map(|run| smoothed(kind, &run.points)).collect();
        // The line of a single seed is that seed.
        let thin = shown.runs && values.len() > 1;
        let line = |(run, values): (Run, &Values)| RunLine { name: run.name, points: points(values) };
        let curve = Curve {
            of: if self.learns { CurveOf::Learner } else { CurveOf::NonLearner },
            points: over(&values, kind.line, shown.band),
            runs: if thin { self.runs.into_iter().zip(&values).map(line).collect() } else { Vec::new() },
        };
        Series { label: self.label, seeds: Some(self.seeds), style: self.style, shape: Shape::Curve(curve) }
    }
}

/// What each seed measured, at each measurement but the final one.
fn runs(scope: &Scope<'_>, metric: &str) -> Vec<Run> {
    let run = |trial: &&TrialResult| {
        let points = trial.curve(Phase::Evaluate, metric);
        (!points.is_empty()).then(|| Run { name: format!("seed {}", trial.trial.key.seed), points })
    };
    scope.trials.iter().filter(|trial| trial.is_ok()).filter_map(run).collect()
}

/// The last step at which a trial of the panel was measured, but for the final measurement.
fn last_step(scope: &Scope<'_>, metric: &str) -> Option<u64> {
    let last = |trial: &&TrialResult| trial.select(Phase::Evaluate, metric).map(|row| row.step).max();
    scope.trials.iter().filter(|trial| trial.is_ok()).filter_map(last).max()
}
