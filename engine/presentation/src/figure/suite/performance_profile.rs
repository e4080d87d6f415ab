//! Performance profiles: the share of runs above each normalised score, a line per agent with a pointwise band.

use super::{EXAMPLE, Suite, asked, default_metric, default_resamples};
use crate::{
    figure::{
        Figure, FigureSpec,
        build::{Context, count},
        chart::{Chart, Panel, Point, Scale, Series},
        shape::{Curve, CurveSource, Shape},
    },
    kinds::KindSpec,
    names::{Names, Place},
    table::Normalisation,
};
use contract::Error;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use statistics::performance_profile;

/// The share of runs above a normalised score, a line per agent.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PerformanceProfile {
    /// The metric.
    #[serde(default = "default_metric")]
    pub metric: String,
    /// Meaning of the scores 0 and 1: the means of two agents (`low`, `high`), or floor and ceiling by environment,
    /// each a number or an agent.
    pub normalise: Normalisation,
    /// Agents to show, in this order; all where empty.
    #[serde(default)]
    pub agents: Vec<String>,
    /// Environments to pool; all where empty.
    #[serde(default)]
    pub environments: Vec<String>,
    /// The lowest score on the axis; 0 or the lowest score of a run where absent.
    #[serde(default)]
    pub from: Option<f64>,
    /// The highest score on the axis; 1 or the highest score of a run where absent.
    #[serde(default)]
    pub to: Option<f64>,
    /// Number of scores between them at which the profile is computed.
    #[serde(default = "default_points")]
    #[schemars(range(min = 2, max = 1001))]
    pub points: usize,
    /// Resamples of the bootstrap.
    #[serde(default = "default_resamples")]
    #[schemars(range(min = 2000, max = 50000))]
    pub resamples: u32,
}

fn default_points() -> usize {
    101
}

asked!(PerformanceProfile);

impl KindSpec for PerformanceProfile {
    fn name() -> &'static str {
        "performance_profile"
    }

    fn about() -> &'static str {
        "The share of runs above a normalised score, one line per agent over all environments."
    }

    fn example() -> &'static str {
        EXAMPLE
    }
}

impl Figure for PerformanceProfile {
    fn check(&self, names: &mut Names<'_>, at: &Place<'_>) {
        self.asked().check(names, at);
        let (from, to) = (self.from.unwrap_or(0.0), self.to.unwrap_or(1.0));
        if from >= to {
            let key = if self.to.is_some() { "to" } else { "from" };
            names.say(
                at.value(key),
                format!("scores rise from `from` to `to`, but {to} is not above {from}"),
                "",
            );
        }
    }

    fn build(&self, spec: &FigureSpec, context: Context<'_>) -> Result<Chart, Error> {
        let suite = Suite::of(self.asked(), spec, context)?;
        let mut notes = vec![
            "The share of runs whose score is above that on the axis, environments weighted alike; bands are \
             intervals point by point."
                .into(),
        ];
        notes.extend(suite.notes());
        Ok(Chart {
            panels: vec![panel(self, &suite)],
            columns: 1,
            notes,
            ..Chart::default()
        })
    }
}

fn panel(kind: &PerformanceProfile, suite: &Suite<'_>) -> Panel {
    let thresholds = thresholds(kind, suite);
    let series = suite.players.iter().map(|player| {
        let profile = performance_profile(&player.tasks, &thresholds, suite.bootstrap());
        let points = thresholds.iter().zip(profile).map(|(threshold, share)| Point {
            x: *threshold,
            y: share.value,
            interval: share.ends(),
        });
        let curve = Curve {
            of: CurveSource::Learner,
            points: points.collect(),
            runs: Vec::new(),
            undrawn: Vec::new(),
            at_the_ends: None,
        };
        Series {
            label: player.label.clone(),
            seeds: Some(player.seeds),
            style: player.style,
            shape: Shape::Curve(curve),
        }
    });
    Panel {
        title: String::new(),
        x: Scale {
            label: format!("{} τ", suite.score()),
            ..Scale::default()
        },
        y: Scale {
            label: "share of runs with score > τ".into(),
            includes: vec![0.0, 1.0],
            ..Scale::default()
        },
        series: series.collect(),
    }
}

/// Scores in equal steps over the whole axis.
fn thresholds(kind: &PerformanceProfile, suite: &Suite<'_>) -> Vec<f64> {
    let scores = || {
        suite
            .players
            .iter()
            .flat_map(|player| &player.tasks)
            .flatten()
            .copied()
    };
    let low = kind.from.unwrap_or_else(|| scores().fold(0.0, f64::min));
    let high = kind.to.unwrap_or_else(|| scores().fold(1.0, f64::max));
    let last = kind.points.max(2) - 1;
    (0..=last)
        .map(|index| low + (high - low) * count(index) / count(last))
        .collect()
}
