//! A metric against a swept key: a line per agent and remaining setting, and agents without the key as levels.

use super::{
    Figure, FigureSpec,
    build::{Context, by_environment, count, label_with_setting, level},
    chart::{Chart, Point, Scale, Series},
    shape::Shape,
};
use crate::{
    axis::{Axis, TableAxis, check_key},
    kinds::KindSpec,
    names::{Names, Place},
    table::Scope,
    vocabulary::Vocabulary,
};
use contract::{
    Error,
    sweep_point::{last_word, split_words, word},
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use statistics::Summary;
use std::{collections::BTreeMap, sync::Arc};

/// A metric against a swept key.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct GroupedLines {
    /// The metric on the vertical axis.
    pub metric: String,
    /// The swept key on the horizontal axis, as its last word (`learning_rate`).
    pub x: String,
    /// Agents to show, one line each; all where empty.
    pub agents: Vec<String>,
    /// Environments to show, one panel each; all where empty.
    pub environments: Vec<String>,
    /// Horizontal axis on a logarithmic scale.
    pub log_x: bool,
    /// Vertical axis on a logarithmic scale.
    pub log_y: bool,
}

impl KindSpec for GroupedLines {
    fn name() -> &'static str {
        "grouped_lines"
    }

    fn about() -> &'static str {
        "A metric against a swept key, one line per group."
    }

    fn example() -> &'static str {
        "{ metric: return, x: discount, agents: [learner, rule] }"
    }
}

impl Figure for GroupedLines {
    fn check(&self, names: &mut Names<'_>, at: &Place<'_>) {
        let picked = names.pick(at);
        names.metric(&self.metric, at, "metric", &picked);
        check_swept(&self.x, names, at);
    }

    fn further_names(&self, vocabulary: &Vocabulary) -> Vec<String> {
        let names = [&self.x, last_word(&self.x)];
        let is_apart = |word: &&str| word.split_once('=').is_some_and(|(key, _)| names.contains(&key));
        let rest = |setting: &Arc<str>| {
            let words: Vec<&str> = split_words(setting).filter(|word| !is_apart(word)).collect();
            words.join(" ")
        };
        let rests = vocabulary.settings.iter().map(rest);
        rests.chain([self.x.clone()]).collect()
    }

    fn build(&self, spec: &FigureSpec, context: Context<'_>) -> Result<Chart, Error> {
        build(self, spec, context)
    }
}

impl GroupedLines {
    fn axis(&self) -> TableAxis {
        TableAxis::Key(self.x.clone())
    }
}

/// Reports a key that no sweep of the study varies.
fn check_swept(key: &str, names: &mut Names<'_>, at: &Place<'_>) {
    if names.vocabulary.swept.is_empty() {
        let message = format!("`x` is `{key}`, but the study has no `sweep`");
        names.say(at.value("x"), message, "");
    } else {
        check_key(key, format!("no sweep varies `{key}`"), &[], names, at.value("x"));
    }
}

fn build(kind: &GroupedLines, spec: &FigureSpec, context: Context<'_>) -> Result<Chart, Error> {
    let scope = Scope::of(context.results, &kind.agents, &kind.environments);
    let categories = categories(&scope, &kind.axis());
    let x = context.scale(spec, &kind.x, kind.log_x && categories.is_empty());
    let scales = (
        Scale {
            categories: categories.clone(),
            ..x
        },
        context.scale(spec, &kind.metric, kind.log_y),
    );
    let mut chart = by_environment(spec, &scope, &kind.environments, scales, |scope| {
        let agents = scope.names(Axis::Agent, &kind.agents);
        let is_swept = |agent: &&String| scope.at(Axis::Agent, agent).varies(Axis::Setting);
        let alone = agents.iter().filter(is_swept).count() == 1;
        agents
            .iter()
            .flat_map(|agent| {
                swept(
                    kind,
                    spec,
                    context,
                    &scope.at(Axis::Agent, agent),
                    (agent, alone),
                    &categories,
                )
            })
            .collect()
    })?;
    chart.notes.push(
        "Means over seeds with 95 % intervals; dashed lines across are agents that the key does not concern."
            .into(),
    );
    Ok(chart)
}

/// The values of the key in the order of the plan if some are no numbers; otherwise empty.
fn categories(scope: &Scope<'_>, axis: &TableAxis) -> Vec<String> {
    let trials = scope.trials.iter();
    let values: Vec<&Value> = trials.filter_map(|trial| axis.value(trial)).collect();
    let mut names: Vec<String> = Vec::new();
    for name in values
        .iter()
        .map(|value| word(value))
        .filter(|_| !values.iter().all(|value| value.is_number()))
    {
        if !names.contains(&name) {
            names.push(name);
        }
    }
    names
}

/// Points of a line, the fewest seeds of a point, and the seeds planned.
type Group = (Vec<Point>, usize, usize);

fn swept(
    kind: &GroupedLines,
    spec: &FigureSpec,
    context: Context<'_>,
    scope: &Scope<'_>,
    (agent, alone): (&str, bool),
    categories: &[String],
) -> Vec<Series> {
    // Settings without the key come first, each as its own level.
    let mut groups: BTreeMap<(bool, String), Group> = BTreeMap::new();
    let axis = kind.axis();
    for setting in scope.names(Axis::Setting, &[]) {
        let scope = scope.at(Axis::Setting, &setting);
        let values: Vec<f64> = scope.finals(&kind.metric).into_values().collect();
        let Some(summary) = Summary::of(&values) else {
            continue;
        };
        // All trials of a setting have the same point of the sweep.
        let trial = scope.trials[0];
        let value = axis.value(trial);
        let x = value.map_or(0.0, |value| position(value, categories));
        let rest = TableAxis::from(Axis::Setting).place(trial, &[&kind.x]);
        let group = groups
            .entry((value.is_some(), rest.into_owned()))
            .or_insert((Vec::new(), usize::MAX, 0));
        group.0.push(Point {
            x,
            y: summary.mean,
            interval: summary.interval.map(|interval| (interval.low, interval.high)),
        });
        (group.1, group.2) = (group.1.min(summary.n), group.2.max(scope.planned()));
    }
    let count = groups.len();
    let series = |(index, ((has_key, rest), group)): (usize, ((bool, String), Group))| {
        let (mut points, n, planned) = group;
        points.sort_by(|a, b| a.x.total_cmp(&b.x));
        let style = context.style_of_setting(agent, index, (count, alone));
        let label = label_with_setting(spec, agent, &rest);
        if !has_key {
            return level(label, style, (n, planned), points[0].y);
        }
        Series {
            label,
            seeds: Some((n, planned)),
            style,
            shape: Shape::MarkedLine(points),
        }
    };
    groups.into_iter().enumerate().map(series).collect()
}

fn position(value: &Value, categories: &[String]) -> f64 {
    let place = categories.iter().position(|name| *name == word(value));
    place.map_or_else(|| value.as_f64().unwrap_or(0.0), count)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::figure::tests::chart;
    use analysis::results::Results;
    use contract::Phase;
    use testing::synthetic::trial;

    #[test]
    fn settings_without_the_key_are_levels_of_their_own() {
        let with = |agent, setting: &str, value| {
            let rows = vec![(Phase::Final, 1, 0, "return", value)];
            trial("e", agent, setting, 0, &rows)
        };
        let results = Results::of(vec![
            with("dsac", "dsac.rate=1 plant.load=3", 1.0),
            with("dsac", "dsac.rate=2 plant.load=3", 2.0),
            with("ddpg", "ddpg.rate=1 plant.load=3", 3.0),
            with("ddpg", "ddpg.rate=2 plant.load=3", 4.0),
            with("equal", "", 5.0),
        ]);
        let kind = GroupedLines {
            metric: "return".into(),
            x: "dsac.rate".into(),
            ..GroupedLines::default()
        };
        let chart = chart(&FigureSpec::of(kind), &results);
        let drawn = |it: &Series| match &it.shape {
            Shape::MarkedLine(points) => (it.label.clone(), points.iter().map(|it| it.y).collect()),
            Shape::Level(value) => (it.label.clone(), vec![*value]),
            _ => unreachable!("it draws lines and levels"),
        };
        let drawn: Vec<(String, Vec<f64>)> = chart.panels[0].series.iter().map(drawn).collect();
        let expected = [
            ("dsac, load=3", vec![1.0, 2.0]),
            ("ddpg, rate=1 load=3", vec![3.0]),
            ("ddpg, rate=2 load=3", vec![4.0]),
            ("equal", vec![5.0]),
        ];
        assert_eq!(drawn, expected.map(|(label, values)| (label.to_owned(), values)));
    }
}
