//! Builds a grid from results: rows and columns, and the value of each cell.

use super::{Axis, Comparison, Form, Statistic, TableAxis, along::Axes, measure};
use crate::axis::AS_GIVEN;
use crate::table::{
    Cell, FixedReason, Grid, Heading, MissingSeeds, NumberFormat, Quantity, Reduction, Scope, problem,
};
use analysis::results::Results;
use contract::{Error, standard_metrics::SUCCESS, trial_result::TrialResult};
use measure::{Measure, seed_value};
use statistics::{Bootstrap, Interval, Summary, estimators, verdict::share_of};
use std::collections::{BTreeMap, HashMap};

/// Computes the cells of a comparison, without published values.
///
/// # Errors
/// [`Error::Render`] if no trial fits, or if `relative_to` is missing or unknown.
pub fn compare(comparison: &Comparison, results: &Results) -> Result<Grid, Error> {
    let relation = Relation::of(comparison, results)?;
    let mut scope = Scope::of(results, &comparison.agents, &comparison.environments);
    if let Some(baseline) = relation.hidden_baseline(comparison) {
        scope.trials.retain(|trial| trial.trial.cell.agent != baseline);
    }
    if scope.trials.is_empty() {
        return Err(problem("no trial of the study belongs to it"));
    }
    let axes = Axes::of(comparison, &scope);
    let (rows, columns) = places(comparison, &axes);
    let cell = |of_row: &[usize], column: &GridLine| {
        make_cell(
            &axes.scope(&axes.at(of_row, &column.at)),
            &Measure {
                comparison,
                at_step: column.at_step,
            },
            &relation,
            results,
        )
    };
    let all = axes.all();
    let row = |row: &GridLine| {
        let of_row = axes.at(&all, &row.at);
        columns.iter().map(|column| cell(&of_row, column)).collect()
    };
    let cells: Vec<Vec<Cell>> = rows.iter().map(row).collect();
    let heading = |place: GridLine| place.heading_with_budget(comparison, &axes);
    Ok(Grid {
        quantity: relation.quantity(comparison, results),
        unit: relation.unit().into(),
        one_number: if is_share(comparison) {
            Reduction::Share
        } else {
            Reduction::Of(comparison.statistic)
        },
        row_axis: comparison.rows.title().into(),
        format: format(comparison, relation.form, &cells),
        rows: rows.into_iter().map(heading).collect(),
        columns: columns.into_iter().map(heading).collect(),
        cells,
        ..Grid::default()
    })
}

/// Relation of values to those of another agent.
pub(super) struct Relation<'a> {
    form: Form,
    to: Option<&'a str>,
    /// The other agent's trials by environment and seed; empty if values are not relative.
    others: HashMap<(&'a str, u64), Vec<&'a TrialResult>>,
}

impl<'a> Relation<'a> {
    fn of(comparison: &'a Comparison, results: &'a Results) -> Result<Self, Error> {
        let to = comparison.relative_to.as_deref();
        let form = comparison.resolved_form();
        match to {
            None if form != Form::Value => Err(problem(
                "`relative_to` must name the agent that the others are compared with",
            )),
            Some(agent) if !results.trials.iter().any(|trial| trial.trial.cell.agent == agent) => Err(
                problem(&format!("`relative_to`: no trial has the agent `{agent}`")),
            ),
            _ => Ok(Self {
                form,
                to,
                others: to
                    .filter(|_| form != Form::Value)
                    .map(|agent| of_agent(agent, results))
                    .unwrap_or_default(),
            }),
        }
    }

    /// The agent that would only be compared with itself, unless the study lists it.
    fn hidden_baseline(&self, comparison: &Comparison) -> Option<&'a str> {
        self.to.filter(|agent| {
            self.form != Form::Value && !comparison.agents.iter().any(|listed| listed == agent)
        })
    }

    fn quantity(&self, comparison: &Comparison, results: &Results) -> Quantity {
        let value = comparison
            .labels
            .get(&comparison.value)
            .cloned()
            .unwrap_or_else(|| comparison.value.replace('_', " "));
        let value = match &results.success {
            Some(success) if is_share(comparison) => format!("{value} (share of seeds with {success})"),
            Some(success) if comparison.given_success => format!("{value} of seeds with success ({success})"),
            _ => value,
        };
        let relative = self.other().map(|agent| (self.form, label(comparison, agent)));
        Quantity {
            value: comparison.taken().phrase(&value),
            relative,
        }
    }

    /// The agent that each seed is compared with; `None` if values are not relative.
    pub(super) fn other(&self) -> Option<&'a str> {
        self.to.filter(|_| self.form != Form::Value)
    }

    /// Whether a cell has a fixed value because it compares an agent with itself.
    fn fixes(&self, scope: &Scope<'_>) -> bool {
        let related = self.form != Form::Value && !scope.trials.is_empty();
        related
            && scope
                .trials
                .iter()
                .all(|trial| Some(trial.trial.cell.agent.as_str()) == self.to)
    }

    /// The trials of a cell and those that they are compared with.
    fn trials_behind<'r>(&self, scope: &Scope<'r>) -> Vec<&'r TrialResult>
    where
        'a: 'r,
    {
        let others = scope.trials.iter().filter_map(|trial| self.counterpart(trial));
        scope.trials.iter().copied().chain(others).collect()
    }

    /// The other agent's trial in the same environment with the same seed: the trial of the same setting, or its only
    /// one.
    pub(super) fn counterpart(&self, trial: &TrialResult) -> Option<&'a TrialResult> {
        let own = &trial.trial;
        let place = (own.cell.environment.as_str(), own.key.seed);
        let candidates = self.others.get(&place)?;
        let same = candidates
            .iter()
            .copied()
            .find(|other| other.trial.cell.point == own.cell.point);
        same.or(match candidates[..] {
            [only] => Some(only),
            _ => None,
        })
    }

    fn unit(&self) -> &'static str {
        if self.form == Form::PercentChange { "%" } else { "" }
    }

    pub(super) fn apply(&self, value: f64, other: f64) -> f64 {
        match self.form {
            Form::Value => value,
            Form::Difference => value - other,
            Form::Ratio => value / other,
            // The same as 100 (value - other) / |other|: a larger value is a positive change from a negative one too.
            Form::PercentChange => 100.0 * (value / other - 1.0) * other.signum(),
        }
    }
}

/// A row or column: its heading, its place on each of its axes, and the step of the learning, unless it is the end.
struct GridLine {
    heading: Heading,
    at: Vec<(TableAxis, String)>,
    at_step: Option<u64>,
}

impl GridLine {
    /// The heading, with steps and updates of the agent if the study asks for them.
    fn heading_with_budget(self, comparison: &Comparison, axes: &Axes<'_, '_>) -> Heading {
        let names_agent = self.at.iter().any(|(along, _)| *along == Axis::Agent.into());
        let budget = if comparison.budgets && names_agent {
            axes.scope(&axes.at(&axes.all(), &self.at)).budget()
        } else {
            None
        };
        let Heading { label, .. } = &self.heading;
        let label = budget.map_or(label.clone(), |budget| format!("{label} ({budget})"));
        Heading {
            label,
            ..self.heading
        }
    }
}

fn places(comparison: &Comparison, axes: &Axes<'_, '_>) -> (Vec<GridLine>, Vec<GridLine>) {
    let free = |along: &TableAxis| *along != comparison.rows && axes.vary(along);
    let cells = axes.all();
    let all = || Axis::ALL.into_iter().map(TableAxis::from);
    let over_steps = !comparison.at_steps.is_empty();
    let column_axis = comparison
        .columns
        .clone()
        .or_else(|| all().find(free))
        .filter(|_| !over_steps);
    let columns = match &column_axis {
        _ if over_steps => comparison
            .at_steps
            .iter()
            .map(|step| step_column(comparison, *step))
            .collect(),
        Some(axis) => axes
            .names(&cells, axis)
            .iter()
            .map(|name| place(comparison, axes, &[(axis.clone(), name.clone())]))
            .collect(),
        None => vec![GridLine {
            heading: only_column(comparison),
            at: Vec::new(),
            at_step: None,
        }],
    };
    // An axis that varies and is neither row nor column splits the rows: different settings are never averaged as if
    // they were seeds.
    let splitting: Vec<TableAxis> = all()
        .filter(|along| free(along) && Some(along) != column_axis.as_ref())
        .collect();
    let rows = axes.names(&cells, &comparison.rows).into_iter().flat_map(|name| {
        let first = vec![(comparison.rows.clone(), name)];
        splitting
            .iter()
            .fold(vec![first], |rows, along| split(axes, rows, along))
    });
    (rows.map(|at| place(comparison, axes, &at)).collect(), columns)
}

fn split(
    axes: &Axes<'_, '_>,
    rows: Vec<Vec<(TableAxis, String)>>,
    along: &TableAxis,
) -> Vec<Vec<(TableAxis, String)>> {
    let parts = |row: Vec<(TableAxis, String)>| {
        axes.names(&axes.at(&axes.all(), &row), along)
            .into_iter()
            .map(move |name| [row.clone(), vec![(along.clone(), name)]].concat())
            .collect::<Vec<_>>()
    };
    rows.into_iter().flat_map(parts).collect()
}

fn place(comparison: &Comparison, axes: &Axes<'_, '_>, at: &[(TableAxis, String)]) -> GridLine {
    let words = |write: &dyn Fn(&str) -> String| {
        let words: Vec<String> = at
            .iter()
            .map(|(_, name)| write(name))
            .filter(|word| !word.is_empty())
            .collect();
        words.join(", ")
    };
    let name = words(&str::to_owned);
    let labels = words(&|name| label(comparison, name));
    let or_as_given = |text: String| {
        if text.is_empty() {
            label(comparison, AS_GIVEN)
        } else {
            text
        }
    };
    GridLine {
        heading: Heading {
            label: or_as_given(labels),
            name: if name.is_empty() { AS_GIVEN.into() } else { name },
            number: axes.number(at),
        },
        at: at.to_vec(),
        at_step: None,
    }
}

fn step_column(comparison: &Comparison, step: u64) -> GridLine {
    let name = step.to_string();
    GridLine {
        heading: Heading::of(&name, label(comparison, &name)),
        at: Vec::new(),
        at_step: Some(step),
    }
}

fn only_column(comparison: &Comparison) -> Heading {
    let counts_steps = comparison.steps_until_above.is_some();
    let label = if counts_steps {
        "steps".into()
    } else {
        label(comparison, &comparison.value)
    };
    Heading::of(&comparison.value, label)
}

fn label(comparison: &Comparison, name: &str) -> String {
    comparison
        .labels
        .get(name)
        .cloned()
        .unwrap_or_else(|| name.into())
}

fn make_cell(scope: &Scope<'_>, measure: &Measure<'_>, relation: &Relation<'_>, results: &Results) -> Cell {
    let mut scope = measure.trained_for(scope);
    // A seed without success has ended too, so looks do not wait for it.
    let behind = relation.trials_behind(&scope);
    if measure.comparison.given_success {
        scope.trials.retain(|trial| trial.succeeded() != Some(false));
    }
    let (mut seeds, mut missing) = (BTreeMap::new(), scope.absences());
    for trial in scope.trials.iter().filter(|trial| trial.is_ok()) {
        match seed_value(trial, measure, relation) {
            Ok(value) => {
                seeds.insert(trial.trial.key.seed, value);
            }
            Err(why) => missing.push(MissingSeeds::of(why)),
        }
    }
    let cell = Cell {
        planned: scope.planned(),
        failed: scope.failed(),
        missing,
        fixed: relation.fixes(&scope).then_some(FixedReason::Itself),
        is_share: is_share(measure.comparison),
        ..Cell::resting_on(&behind, results)
    };
    summarise(seeds.into_iter().collect(), measure.comparison.statistic, cell)
}

/// Whether the value is the share of seeds with success.
pub(super) fn is_share(comparison: &Comparison) -> bool {
    comparison.value == SUCCESS && comparison.resolved_form() == Form::Value
}

/// A cell with its seeds and their reduction to one number with its interval.
pub(crate) fn summarise(seeds: Vec<(u64, f64)>, statistic: Statistic, cell: Cell) -> Cell {
    let values: Vec<f64> = seeds.iter().map(|(_, value)| *value).collect();
    let Some(summary) = Summary::of(&values) else {
        return cell;
    };
    let resampled = |estimator: fn(&[f64]) -> f64| {
        Bootstrap::TABLE.stratified(std::slice::from_ref(&values), |tasks| estimator(&tasks[0]))
    };
    let (estimate, interval) = match statistic {
        // The exact 95 % interval of a share.
        _ if cell.is_share => (summary.mean, share_of(&values).interval(0.025)),
        Statistic::Mean => (summary.mean, summary.interval),
        Statistic::Median => (summary.median, resampled(estimators::median)),
        Statistic::Iqm => (summary.iqm, resampled(estimators::iqm)),
    };
    let interval = interval.map(|Interval { low, high, .. }| (low, high));
    Cell {
        seeds,
        estimate: Some(estimate),
        sd: summary.sd,
        interval,
        ..cell
    }
}

fn of_agent<'a>(agent: &str, results: &'a Results) -> HashMap<(&'a str, u64), Vec<&'a TrialResult>> {
    let mut trials: HashMap<_, Vec<&TrialResult>> = HashMap::new();
    for it in results.trials.iter().filter(|it| it.trial.cell.agent == agent) {
        let place = (it.trial.cell.environment.as_str(), it.trial.key.seed);
        trials.entry(place).or_default().push(it);
    }
    trials
}

fn format(comparison: &Comparison, form: Form, cells: &[Vec<Cell>]) -> NumberFormat {
    match (comparison.format(), form) {
        (Some(format), _) => format,
        (None, Form::PercentChange) => NumberFormat::Fixed(1),
        _ => NumberFormat::fitting(cells.iter().flatten().filter_map(|cell| cell.estimate)),
    }
}

/// Agents to which a row's single published value does not apply: the one compared with, and rules beside learners.
pub(super) fn baselines(comparison: &Comparison, results: &Results) -> Vec<String> {
    let scope = Scope::of(results, &comparison.agents, &comparison.environments);
    let agents = scope.names(Axis::Agent, &comparison.agents);
    let learns = |agent: &String| scope.at(Axis::Agent, agent).learns();
    let any_learns = agents.iter().any(learns);
    let is_baseline =
        |agent: &String| comparison.relative_to.as_ref() == Some(agent) || (any_learns && !learns(agent));
    agents.into_iter().filter(is_baseline).collect()
}
