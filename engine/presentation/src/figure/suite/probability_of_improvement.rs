//! Probabilities of improvement: the probability that a run of one agent scores above a run of another in the same
//! environment, a row per pair of agents.

use super::{Player, Suite, asked, default_metric, default_resamples};
use crate::{
    figure::{
        Figure, FigureSpec,
        build::{Context, count, problem},
        chart::{Chart, Hue, Panel, Point, Scale, Series, Style},
        shape::Shape,
    },
    kinds::{Contradiction, KindSpec},
    names::{Names, Place},
    table::Normalisation,
};
use contract::Error;
use document::diagnostic::suggest;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use statistics::comparison::{probability_of_improvement, probability_of_improvement_interval};

/// Probability that a run of one agent scores above a run of another, a row per pair.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ProbabilityOfImprovement {
    /// The metric.
    #[serde(default = "default_metric")]
    pub metric: String,
    /// Meaning of the scores 0 and 1: the means of two agents (`low`, `high`), or floor and ceiling by environment,
    /// each a number or an agent. Here they only show which of two values is better: a floor above its ceiling means
    /// that less is better.
    pub normalise: Normalisation,
    /// Agents to compare, in this order; all where empty.
    #[serde(default)]
    pub agents: Vec<String>,
    /// Environments to pool; all where empty.
    #[serde(default)]
    pub environments: Vec<String>,
    /// The pairs, each beginning with the agent that may be better than the other; where empty, every pair once, in the
    /// order of the list.
    #[serde(default)]
    pub pairs: Vec<[String; 2]>,
    /// Compare each of the other agents with this one instead of `pairs`.
    #[serde(default)]
    pub relative_to: Option<String>,
    /// Resamples of the bootstrap.
    #[serde(default = "default_resamples")]
    #[schemars(range(min = 2000, max = 50000))]
    pub resamples: u32,
}

asked!(ProbabilityOfImprovement);

impl ProbabilityOfImprovement {
    /// Agents of the suite in pairs.
    fn paired<'p>(&self, players: &'p [Player<'p>]) -> Vec<[&'p Player<'p>; 2]> {
        let find = |name: &String| players.iter().find(|player| player.name == *name);
        if !self.pairs.is_empty() {
            let pair = |[left, right]: &[String; 2]| Some([find(left)?, find(right)?]);
            return self.pairs.iter().filter_map(pair).collect();
        }
        if let Some(to) = &self.relative_to {
            let others = players.iter().filter(|player| player.name != *to);
            return others.filter_map(|player| Some([player, find(to)?])).collect();
        }
        let after = |(index, left): (usize, &'p Player<'p>)| {
            players[index + 1..].iter().map(move |right| [left, right])
        };
        players.iter().enumerate().flat_map(after).collect()
    }
}

impl KindSpec for ProbabilityOfImprovement {
    fn name() -> &'static str {
        "probability_of_improvement"
    }

    fn about() -> &'static str {
        "How often a run of one agent scores above one of another, averaged over environments, a row per \
             pair."
    }

    fn example() -> &'static str {
        "{ metric: return, normalise: { short: [0, 5], long: [0, 20] }, agents: [learner, rule], \
         environments: [short, long] }"
    }

    fn contradiction(value: &Value) -> Option<Contradiction> {
        let pairs = value.get("pairs").and_then(Value::as_array);
        let both = pairs.is_some_and(|pairs| !pairs.is_empty()) && value.get("relative_to")?.is_string();
        both.then(|| Contradiction {
            at: vec!["relative_to"],
            message: "`relative_to` and `pairs` are two ways to say who is compared".into(),
            help: "remove one of the two",
        })
    }
}

impl Figure for ProbabilityOfImprovement {
    fn check(&self, names: &mut Names<'_>, at: &Place<'_>) {
        let picked = self.asked().check(names, at);
        let shown: Vec<String> = picked
            .agents
            .iter()
            .map(|index| names.vocabulary.agents[*index].clone())
            .collect();
        if let Some(to) = self.relative_to.as_ref().filter(|to| !shown.contains(to)) {
            let help = suggest(to, shown.iter().map(String::as_str));
            names.say(
                at.value("relative_to"),
                format!("this figure has no agent `{to}`"),
                help,
            );
        }
        for pair in at.below("pairs").iter().flat_map(Place::items) {
            check_pair(&pair, &shown, names);
        }
        if shown.len() < 2 {
            names.say(
                at.value("agents"),
                "one agent makes no pair",
                "name at least two agents",
            );
        }
    }

    fn build(&self, spec: &FigureSpec, context: Context<'_>) -> Result<Chart, Error> {
        let suite = Suite::of(self.asked(), spec, context)?;
        let pairs = self.paired(&suite.players);
        if pairs.is_empty() {
            return Err(problem("no two of its agents have scores in every environment"));
        }
        let mut notes = vec![
            "How often a run of the first agent scores above one of the second in the same environment, ties \
             counted half, averaged over environments."
                .into(),
        ];
        notes.extend(suite.notes());
        Ok(Chart {
            panels: vec![panel(&suite, &pairs)],
            columns: 1,
            notes,
            ..Chart::default()
        })
    }
}

/// Reports a pair whose agents are not in the figure or are the same agent.
fn check_pair(pair: &Place<'_>, shown: &[String], names: &mut Names<'_>) {
    let items = pair.node.items();
    for (item, name) in items.iter().filter_map(|item| Some((item, item.as_str()?))) {
        if !shown.iter().any(|known| known == name) {
            let help = suggest(name, shown.iter().map(String::as_str));
            names.say(
                (item.span, pair.at.clone()),
                format!("this figure has no agent `{name}`"),
                help,
            );
        }
    }
    if let [left, right] = items
        && let Some(name) = left.as_str().filter(|name| right.as_str() == Some(*name))
    {
        let message = format!("`{name}` is no better than itself");
        names.say((right.span, pair.at.clone()), message, "name two agents");
    }
}

fn panel(suite: &Suite<'_>, pairs: &[[&Player<'_>; 2]]) -> Panel {
    let row = |(row, [left, right]): (usize, &[&Player<'_>; 2])| Series {
        label: String::new(),
        seeds: Some((left.seeds.0.min(right.seeds.0), left.seeds.1.max(right.seeds.1))),
        style: left.style,
        shape: Shape::Across(vec![point(suite, row, left, right)]),
    };
    let mut series = vec![no_difference(pairs.len())];
    series.extend(pairs.iter().enumerate().map(row));
    Panel {
        title: String::new(),
        x: Scale {
            label: "probability of improvement, P(X > Y)".into(),
            includes: vec![0.0, 1.0],
            ..Scale::default()
        },
        y: Scale {
            categories: pairs
                .iter()
                .map(|[left, right]| format!("{} > {}", left.label, right.label))
                .collect(),
            ..Scale::default()
        },
        series,
    }
}

fn point(suite: &Suite<'_>, row: usize, left: &Player<'_>, right: &Player<'_>) -> Point {
    let interval = probability_of_improvement_interval(&left.tasks, &right.tasks, suite.bootstrap());
    Point {
        x: count(row),
        y: probability_of_improvement(&left.tasks, &right.tasks),
        interval: interval.map(|interval| (interval.low, interval.high)),
    }
}

/// A line at one half.
fn no_difference(rows: usize) -> Series {
    let end = |y| Point {
        x: 0.5,
        y,
        interval: None,
    };
    Series {
        label: "no difference".into(),
        seeds: None,
        style: Style {
            hue: Hue::Grey,
            variant: 1,
        },
        shape: Shape::Line(vec![end(-0.5), end(count(rows) - 0.5)]),
    }
}
