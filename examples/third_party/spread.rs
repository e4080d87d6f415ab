//! A kind of tables and a kind of figures of its own: how far the seeds of an agent lie apart.

use engine::{
    Error,
    analysis::results::Results,
    presentation::{
        figure::{Chart, Context, Figure, FigureSpec, Panel, Point, Scale, Series, Shape},
        kinds::KindSpec,
        names::{Names, Place},
        request::RegisterKinds as _,
        table::{Axis, Cell, Grid, Heading, NumberFormat, Quantity, Reduction, Scope, Table},
    },
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub fn register(registry: &mut engine::Registry) {
    registry.table::<Spread>();
    registry.figure::<SortedSeeds>();
}

/// The lowest and the highest seed of each agent.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Spread {
    /// The metric.
    metric: String,
}

/// The seeds of each agent, from the lowest value to the highest.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct SortedSeeds {
    /// The metric.
    metric: String,
}

const COLUMNS: [&str; 2] = ["lowest", "highest"];

impl KindSpec for Spread {
    fn name() -> &'static str {
        "spread"
    }

    fn about() -> &'static str {
        "The lowest and the highest seed of each agent."
    }

    fn example() -> &'static str {
        "{ metric: return }"
    }
}

impl Table for Spread {
    fn check(
        &self,
        names: &mut Names<'_>,
        at: &Place<'_>,
        _published: Option<&Place<'_>>,
    ) -> (Vec<String>, Vec<String>) {
        let all = names.all();
        names.metric(&self.metric, at, "metric", &all);
        (names.vocabulary.agents.clone(), COLUMNS.map(String::from).into())
    }

    fn build(&self, results: &Results) -> Result<Grid, Error> {
        let all = Scope::of(results, &[], &[]);
        let agents = all.names(Axis::Agent, &[]);
        let row = |agent: &String| {
            let scope = all.at(Axis::Agent, agent);
            let values = sorted(&scope, &self.metric);
            let cell = |value: Option<&f64>| Cell {
                planned: scope.planned(),
                failed: scope.failed(),
                seeds: scope.finals(&self.metric).into_iter().collect(),
                estimate: value.copied(),
                ..Cell::resting_on(&scope.trials, results)
            };
            vec![cell(values.first()), cell(values.last())]
        };
        let heading = |name: &str| Heading::of(name, name);
        Ok(Grid {
            quantity: Quantity::plain(self.metric.clone()),
            one_number: Reduction::Aggregates,
            row_axis: "agent".into(),
            cells: agents.iter().map(row).collect(),
            rows: agents.iter().map(|agent| heading(agent)).collect(),
            columns: COLUMNS.map(heading).into(),
            format: NumberFormat::Fixed(1),
            ..Grid::default()
        })
    }

    fn metric_of_unit(&self) -> Option<&str> {
        Some(&self.metric)
    }

    fn no_means(&self) -> Option<&'static str> {
        Some("lowest and the highest seed")
    }
}

impl KindSpec for SortedSeeds {
    fn name() -> &'static str {
        "sorted_seeds"
    }

    fn about() -> &'static str {
        "The seeds of each agent, from the lowest value to the highest."
    }

    fn example() -> &'static str {
        "{ metric: return }"
    }
}

impl Figure for SortedSeeds {
    fn check(&self, names: &mut Names<'_>, at: &Place<'_>) {
        let all = names.all();
        names.metric(&self.metric, at, "metric", &all);
    }

    fn build(&self, spec: &FigureSpec, context: Context<'_>) -> Result<Chart, Error> {
        let all = Scope::of(context.results, &[], &[]);
        let series = |agent: &String| {
            let scope = all.at(Axis::Agent, agent);
            let values = sorted(&scope, &self.metric);
            let points = (1_u32..).zip(&values).map(|(place, value)| Point {
                x: f64::from(place),
                y: *value,
                interval: None,
            });
            Series {
                label: agent.clone(),
                seeds: Some((values.len(), scope.planned())),
                style: context.style(agent),
                shape: Shape::MarkedLine(points.collect()),
            }
        };
        let panel = Panel {
            x: Scale {
                label: "place of the seed".into(),
                ..Scale::default()
            },
            y: context.scale(spec, &self.metric, false),
            series: all.names(Axis::Agent, &[]).iter().map(series).collect(),
            ..Panel::default()
        };
        Ok(Chart {
            panels: vec![panel],
            columns: 1,
            ..Chart::default()
        })
    }
}

/// The final values of the seeds, from the lowest to the highest.
fn sorted(scope: &Scope<'_>, metric: &str) -> Vec<f64> {
    let mut values: Vec<f64> = scope.finals(metric).into_values().collect();
    values.sort_by(f64::total_cmp);
    values
}
