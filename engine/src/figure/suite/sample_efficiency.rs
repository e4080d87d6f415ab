//! Sample efficiency: the interquartile mean of normalised scores against environment steps, a line per agent
//! with a pointwise band.

use super::{EXAMPLE, Player, Suite, asked, default_metric, default_resamples};
use crate::{
    Error, Phase,
    figure::{
        Figure, FigureSpec,
        build::{Context, level, problem},
        chart::{Chart, Curve, CurveOf, Panel, Point, Scale, Series, Shape},
    },
    results::TrialResult,
    spec::names::{Names, Place},
    statistics::{SuiteStatistic, sample_efficiency, sample_efficiency::Run},
    table::{Axis, Normalise, ScoreScale},
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The interquartile mean of normalised scores against environment steps, a line per agent.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SampleEfficiency {
    /// The metric.
    #[serde(default = "default_metric")]
    pub metric: String,
    /// What the scores 0 and 1 stand for: the means of two agents (`low`, `high`) at the end, or floor and
    /// ceiling by environment, each a number or an agent.
    pub normalise: Normalise,
    /// Which agents, in this order; all where empty. Agents that do not learn have short dashes.
    #[serde(default)]
    pub agents: Vec<String>,
    /// Which environments; all where empty.
    #[serde(default)]
    pub environments: Vec<String>,
    /// Resamples of the bootstrap.
    #[serde(default = "default_resamples")]
    #[schemars(range(min = 2000, max = 50000))]
    pub resamples: u32,
}

asked!(SampleEfficiency);

impl Figure for SampleEfficiency {
    fn example() -> &'static str {
        EXAMPLE
    }

    fn check(&self, names: &mut Names<'_>, at: &Place<'_>) {
        self.asked().check(names, at);
    }

    fn build(&self, spec: &FigureSpec, context: Context<'_>) -> Result<Chart, Error> {
        let suite = Suite::of(self.asked(), spec, context)?;
        let mut notes = vec![
            "The interquartile mean over the runs of all environments that are shown, at steps at which all of them were \
             measured; bands are intervals point by point."
                .to_owned(),
        ];
        let mut series = Vec::new();
        for player in &suite.players {
            match line(&suite, player) {
                Some(line) => series.push(line),
                None => notes.push(format!(
                    "{} is left out: its runs were measured at no common step.",
                    player.label
                )),
            }
        }
        if series.is_empty() {
            return Err(problem("no agent was measured at a step that all its runs share"));
        }
        if series
            .iter()
            .any(|series| matches!(series.shape, Shape::Level(_)))
        {
            notes.push("Lines across are agents that were measured at the end alone.".into());
        }
        notes.extend(suite.notes());
        Ok(Chart {
            panels: vec![panel(&suite, series)],
            columns: 1,
            notes,
            ..Chart::default()
        })
    }
}

fn panel(suite: &Suite<'_>, series: Vec<Series>) -> Panel {
    let scale = |label: &str| Scale {
        label: label.into(),
        ..Scale::default()
    };
    Panel {
        title: String::new(),
        x: scale("environment steps"),
        y: scale(&suite.score()),
        series,
    }
}

/// The line of an agent; `None` where its runs share no step.
fn line(suite: &Suite<'_>, player: &Player<'_>) -> Option<Series> {
    let learns = player.scope.learns() || player.scope.is_imported();
    let tasks: Vec<Vec<Run>> = suite
        .scales
        .iter()
        .map(|scale| runs(suite, player, scale))
        .collect();
    if !learns && tasks.iter().flatten().all(|run| run.len() <= 1) {
        let value = SuiteStatistic::InterquartileMean.of(&player.tasks);
        return Some(level(player.label.clone(), player.style, player.seeds, value));
    }
    #[allow(clippy::cast_precision_loss, reason = "steps are far below 2^52")]
    let points: Vec<Point> = sample_efficiency(&tasks, suite.bootstrap())
        .into_iter()
        .map(|(step, estimate)| Point {
            x: step as f64,
            y: estimate.value,
            interval: estimate.ends(),
        })
        .collect();
    let curve = Curve {
        of: if learns {
            CurveOf::Learner
        } else {
            CurveOf::NonLearner
        },
        runs: Vec::new(),
        undrawn: Vec::new(),
        points,
    };
    (!curve.points.is_empty()).then(|| Series {
        label: player.label.clone(),
        seeds: Some((tasks.iter().map(Vec::len).min().unwrap_or(0), player.seeds.1)),
        style: player.style,
        shape: Shape::Curve(curve),
    })
}

/// The scores of an agent in an environment during learning, run by run.
fn runs(suite: &Suite<'_>, player: &Player<'_>, scale: &ScoreScale) -> Vec<Run> {
    let run = |trial: &&TrialResult| -> Run {
        let curve = trial.curve(Phase::Evaluate, suite.asked.metric).into_iter();
        curve
            .filter_map(|(step, value)| Some((step, scale.score(value)?)))
            .collect()
    };
    let here = player.scope.at(Axis::Environment, &scale.environment);
    let runs = here.trials.iter().filter(|trial| trial.is_ok()).map(run);
    runs.filter(|run| !run.is_empty()).collect()
}
