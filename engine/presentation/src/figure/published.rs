//! Published curves beside those of a study.

use super::{
    Band, LearningCurve, Line, SeedLines,
    build::Context,
    chart::{Hue, Series, Style},
    over_runs::{over, points, smoothed},
    shape::{Curve, CurveSource, RunLine, Shape},
};
use analysis::published_curve::{self, PublishedCurve};
use contract::Error;
use statistics::common_steps::StepSeries;

/// The published curves of an environment up to `end`. Logs may continue long after the study ended, and would squeeze
/// its own curves into a strip at the edge.
pub(super) fn series(
    kind: &LearningCurve,
    context: Context<'_>,
    environment: &str,
    end: Option<u64>,
) -> Result<Vec<Series>, Error> {
    let mut all = Vec::new();
    for (index, curve) in kind.published.iter().enumerate() {
        if curve.environment.as_ref().is_none_or(|name| name == environment) {
            let runs = curve.runs().map_err(|error| refused(curve, &error))?;
            all.extend(one(
                kind,
                curve,
                style(kind, index, context),
                &runs,
                end.unwrap_or(u64::MAX),
            ));
        }
    }
    Ok(all)
}

fn refused(curve: &PublishedCurve, error: &impl std::fmt::Display) -> Error {
    Error::Render {
        what: format!("published curve `{}`", curve.label),
        problem: error.to_string(),
    }
}

/// The colour of the agent; curves of one agent differ in their dots.
fn style(kind: &LearningCurve, index: usize, context: Context<'_>) -> Style {
    let agent = &kind.published[index].agent;
    let variant = kind.published[..index]
        .iter()
        .filter(|other| other.agent == *agent)
        .count();
    let hue = agent.as_ref().map_or(Hue::Grey, |agent| context.style(agent).hue);
    Style { hue, variant }
}

/// A curve with its runs; `None` if it begins after the end.
fn one(
    kind: &LearningCurve,
    curve: &PublishedCurve,
    style: Style,
    runs: &[published_curve::CurveRun],
    end: u64,
) -> Option<Series> {
    let values: Vec<StepSeries> = runs
        .iter()
        .map(|run| until(end, smoothed(kind, &run.points)))
        .collect();
    if values.iter().all(Vec::is_empty) {
        return None;
    }
    let thin = runs.len() > 1 && kind.seeds != SeedLines::Said(false);
    let line = |(run, values): (&published_curve::CurveRun, &StepSeries)| RunLine {
        name: run.name.clone(),
        trial: String::new(),
        points: points(values),
    };
    // The line of a single run is that run.
    let lines = runs
        .iter()
        .zip(&values)
        .filter(|_| runs.len() > 1)
        .map(line)
        .collect();
    let (drawn, undrawn) = if thin {
        (lines, Vec::new())
    } else {
        (Vec::new(), lines)
    };
    let seeds = curve.by.is_some().then_some((runs.len(), runs.len()));
    let shape = Shape::Curve(Curve {
        of: CurveSource::Publication,
        points: over(&values, Line::Mean, Band::None),
        runs: drawn,
        undrawn,
        at_the_ends: None,
    });
    Some(Series {
        label: curve.label.clone(),
        seeds,
        style,
        shape,
    })
}

fn until(end: u64, mut values: StepSeries) -> StepSeries {
    values.retain(|(step, _)| *step <= end);
    values
}
