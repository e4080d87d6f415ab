//! One metric against another: a point per seed.

use super::{
    Figure, FigureSpec,
    build::{Context, by_environment, by_setting, left_out},
    chart::{Chart, Point, Series, Style},
    shape::Shape,
};
use crate::{
    kinds::KindSpec,
    names::{Names, Place},
    table::Scope,
};
use contract::{Error, Phase, trial_result::TrialResult};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// One metric against another.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Scatter {
    /// The metric on the horizontal axis.
    pub x: String,
    /// The metric on the vertical axis.
    pub y: String,
    /// Agents to show; all where empty.
    pub agents: Vec<String>,
    /// Environments to show, one panel each; all where empty.
    pub environments: Vec<String>,
}

impl KindSpec for Scatter {
    fn name() -> &'static str {
        "scatter"
    }

    fn about() -> &'static str {
        "One metric against another, a point per seed."
    }

    fn example() -> &'static str {
        "{ x: return, y: length, agents: [learner, rule] }"
    }
}

impl Figure for Scatter {
    fn check(&self, names: &mut Names<'_>, at: &Place<'_>) {
        let picked = names.pick(at);
        names.metric(&self.x, at, "x", &picked);
        names.metric(&self.y, at, "y", &picked);
    }

    fn build(&self, spec: &FigureSpec, context: Context<'_>) -> Result<Chart, Error> {
        build(self, spec, context)
    }
}

fn build(kind: &Scatter, spec: &FigureSpec, context: Context<'_>) -> Result<Chart, Error> {
    let scope = Scope::of(context.results, &kind.agents, &kind.environments);
    let scales = (
        context.scale(spec, &kind.x, false),
        context.scale(spec, &kind.y, false),
    );
    let mut chart = by_environment(spec, &scope, &kind.environments, scales, |scope| {
        let cloud = |scope: &Scope<'_>, label, style| cloud(kind, scope, label, style);
        let clouds = by_setting(spec, context, (scope, &kind.agents), cloud);
        clouds.into_iter().flatten().collect()
    })?;
    chart.notes.push("One point per seed.".into());
    let lack = |_: &Scope<'_>| format!("no seed has both `{}` and `{}`", kind.x, kind.y);
    let picked = (&kind.agents[..], &kind.environments[..]);
    chart.notes.extend(left_out(spec, context, picked, &chart, lack));
    Ok(chart)
}

fn cloud(kind: &Scatter, scope: &Scope<'_>, label: String, style: Style) -> Option<Series> {
    let point = |trial: &&TrialResult| {
        let mean = |metric: &str| trial.mean(Phase::Final, metric);
        Some(Point {
            x: mean(&kind.x)?,
            y: mean(&kind.y)?,
            interval: None,
        })
    };
    let points: Vec<Point> = scope
        .trials
        .iter()
        .filter(|trial| trial.is_ok())
        .filter_map(point)
        .collect();
    let seeds = Some((scope.finals(&kind.y).len(), scope.planned()));
    (!points.is_empty()).then_some(Series {
        label,
        seeds,
        style,
        shape: Shape::Points(points),
    })
}
