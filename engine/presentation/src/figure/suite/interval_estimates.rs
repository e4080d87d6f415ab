//! Median, interquartile mean, mean and optimality gap of normalised scores, a panel each, as bars from one end
//! of the interval to the other with a line at the estimate.

use super::{EXAMPLE, Player, Suite, asked, default_metric, default_resamples};
use crate::{
    figure::{
        Figure, FigureSpec,
        build::{Context, count},
        chart::{Chart, Panel, Point, Scale, Series},
        shape::Shape,
    },
    kinds::KindSpec,
    names::{Names, Place},
    table::Normalisation,
};
use contract::Error;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use statistics::SuiteStatistic;

/// Aggregates of normalised scores over environments, a panel each.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct IntervalEstimates {
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
    /// Resamples of the bootstrap.
    #[serde(default = "default_resamples")]
    #[schemars(range(min = 2000, max = 50000))]
    pub resamples: u32,
}

asked!(IntervalEstimates);

impl KindSpec for IntervalEstimates {
    fn name() -> &'static str {
        "interval_estimates"
    }

    fn about() -> &'static str {
        "Median, interquartile mean, mean and optimality gap of normalised scores over several environments, \
             with intervals, a row per agent."
    }

    fn example() -> &'static str {
        EXAMPLE
    }
}

impl Figure for IntervalEstimates {
    fn check(&self, names: &mut Names<'_>, at: &Place<'_>) {
        self.asked().check(names, at);
    }

    fn build(&self, spec: &FigureSpec, context: Context<'_>) -> Result<Chart, Error> {
        let suite = Suite::of(self.asked(), spec, context)?;
        Ok(Chart {
            panels: SuiteStatistic::ALL
                .map(|statistic| panel(&suite, statistic))
                .into(),
            columns: SuiteStatistic::ALL.len(),
            shared_y: true,
            notes: notes(&suite),
            ..Chart::default()
        })
    }
}

fn panel(suite: &Suite<'_>, statistic: SuiteStatistic) -> Panel {
    let series = |(row, player): (usize, &Player<'_>)| Series {
        label: String::new(),
        seeds: Some(player.seeds),
        style: player.style,
        shape: Shape::Across(vec![point(suite, statistic, row, player)]),
    };
    Panel {
        title: statistic.name().into(),
        x: Scale {
            label: suite.score(),
            ..Scale::default()
        },
        y: Scale {
            categories: suite.players.iter().map(Player::name_with_seeds).collect(),
            ..Scale::default()
        },
        series: suite.players.iter().enumerate().map(series).collect(),
    }
}

fn point(suite: &Suite<'_>, statistic: SuiteStatistic, row: usize, player: &Player<'_>) -> Point {
    let is_mean = matches!(statistic, SuiteStatistic::Mean | SuiteStatistic::Median);
    // A score that is 0 or 1 by construction has no interval.
    let (y, interval) = match suite.fixed(player).filter(|_| is_mean) {
        Some(score) => (f64::from(score), None),
        None => {
            let estimate = statistic.estimate(&player.tasks, suite.bootstrap());
            (estimate.value, estimate.ends())
        }
    };
    Point {
        x: count(row),
        y,
        interval,
    }
}

fn notes(suite: &Suite<'_>) -> Vec<String> {
    let mut notes = vec![
        "Lines are estimates and bars their intervals: median and mean over environments of the means over \
         seeds, interquartile mean over all runs, and the optimality gap, how much scores lie below 1 on \
         average, of which less is better."
            .into(),
    ];
    notes.extend(suite.notes());
    for player in suite
        .players
        .iter()
        .filter(|player| suite.fixed(player).is_some())
    {
        notes.push(format!(
            "Median and mean of {} are fixed by construction.",
            player.label
        ));
    }
    notes
}
