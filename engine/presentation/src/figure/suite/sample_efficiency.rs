//! Sample efficiency: the interquartile mean of normalised scores against environment steps, a line per agent
//! with a pointwise band.

use super::{EXAMPLE, Player, Suite, asked, default_metric, default_resamples};
use crate::{
    figure::{
        Figure, FigureSpec,
        build::{Context, level, problem},
        chart::{Chart, Panel, Point, Scale, Series},
        shape::{Curve, CurveSource, Shape},
    },
    kinds::KindSpec,
    names::{Names, Place},
    table::{Axis, Normalisation, ScoreScale},
};
use contract::{Error, Phase, trial_result::TrialResult};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use statistics::{SuiteStatistic, sample_efficiency};

/// The interquartile mean of normalised scores against environment steps, a line per agent.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SampleEfficiency {
    /// The metric.
    #[serde(default = "default_metric")]
    pub metric: String,
    /// Meaning of the scores 0 and 1: the means of two agents (`low`, `high`) at the end, or floor and ceiling by
    /// environment, each a number or an agent.
    pub normalise: Normalisation,
    /// Agents to show, in this order; all where empty. Agents that do not learn have short dashes.
    #[serde(default)]
    pub agents: Vec<String>,
    /// Environments to pool; all where empty.
    #[serde(default)]
    pub environments: Vec<String>,
    /// Resamples of the bootstrap.
    #[serde(default = "default_resamples")]
    #[schemars(range(min = 2000, max = 50000))]
    pub resamples: u32,
}

asked!(SampleEfficiency);

impl KindSpec for SampleEfficiency {
    fn name() -> &'static str {
        "sample_efficiency"
    }

    fn about() -> &'static str {
        "The interquartile mean of normalised scores over several environments against environment steps, \
             one line per agent."
    }

    fn example() -> &'static str {
        EXAMPLE
    }
}

impl Figure for SampleEfficiency {
    fn check(&self, names: &mut Names<'_>, at: &Place<'_>) {
        self.asked().check(names, at);
    }

    fn build(&self, spec: &FigureSpec, context: Context<'_>) -> Result<Chart, Error> {
        let suite = Suite::of(self.asked(), spec, context)?;
        let (mut series, mut missing, mut carried) = (Vec::new(), Vec::new(), false);
        for player in &suite.players {
            let tasks: Vec<Vec<sample_efficiency::StepSeries>> = suite
                .scales
                .iter()
                .map(|scale| runs(&suite, player, scale))
                .collect();
            match line(&suite, player, &tasks) {
                Some(line) => {
                    carried |= !have_same_steps(&tasks);
                    series.push(line);
                }
                None => missing.push(format!(
                    "{} is left out: there is no step at which all its runs have begun and none has ended.",
                    player.label
                )),
            }
        }
        let steps = if carried {
            "from the one at which the last of them begins to the one at which the first ends; a run counts at each with \
             its last value up to it"
        } else {
            "at which all of them were measured"
        };
        let mut notes = vec![format!(
            "The interquartile mean over the runs of all environments that are shown, at steps {steps}; bands are \
             intervals point by point."
        )];
        notes.extend(missing);
        if series.is_empty() {
            return Err(problem(
                "no agent has a step at which all its runs have begun and none has ended",
            ));
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

/// Whether the runs of all tasks were measured at the same steps.
fn have_same_steps(tasks: &[Vec<sample_efficiency::StepSeries>]) -> bool {
    let steps =
        |run: &sample_efficiency::StepSeries| -> Vec<u64> { run.iter().map(|(step, _)| *step).collect() };
    let mut all = tasks.iter().flatten().map(steps);
    let first = all.next();
    all.all(|steps| Some(&steps) == first.as_ref())
}

/// The line of an agent; `None` if its runs have no step in common.
fn line(
    suite: &Suite<'_>,
    player: &Player<'_>,
    tasks: &[Vec<sample_efficiency::StepSeries>],
) -> Option<Series> {
    let learns = player.scope.learns() || player.scope.is_imported();
    if !learns && tasks.iter().flatten().all(|run| run.len() <= 1) {
        let value = SuiteStatistic::InterquartileMean.of(&player.tasks);
        return Some(level(player.label.clone(), player.style, player.seeds, value));
    }
    #[allow(clippy::cast_precision_loss, reason = "steps are far below 2^52")]
    let points: Vec<Point> = sample_efficiency(tasks, suite.bootstrap())
        .into_iter()
        .map(|(step, estimate)| Point {
            x: step as f64,
            y: estimate.value,
            interval: estimate.ends(),
        })
        .collect();
    let curve = Curve {
        of: if learns {
            CurveSource::Learner
        } else {
            CurveSource::NonLearner
        },
        runs: Vec::new(),
        undrawn: Vec::new(),
        at_the_ends: None,
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
fn runs(suite: &Suite<'_>, player: &Player<'_>, scale: &ScoreScale) -> Vec<sample_efficiency::StepSeries> {
    let run = |trial: &&TrialResult| -> sample_efficiency::StepSeries {
        let curve = trial.curve(Phase::Evaluate, suite.asked.metric).into_iter();
        curve
            .filter_map(|(step, value)| Some((step, scale.score(value)?)))
            .collect()
    };
    let here = player.scope.at(Axis::Environment, &scale.environment);
    let runs = here.trials.iter().filter(|trial| trial.is_ok()).map(run);
    runs.filter(|run| !run.is_empty()).collect()
}
