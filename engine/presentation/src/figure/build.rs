//! Builds a chart from results: the choice of the kind, and helpers that all kinds share.

use super::{
    FigureSpec,
    chart::{Chart, Hue, Paper, Scale, Series, Style},
    shape::Shape,
};
use crate::table::{Axis, Cell, Scope, one_line};
use analysis::results::Results;
use contract::{Better, Error};
use std::collections::BTreeMap;

/// Results and names that every figure of a study shares.
#[derive(Debug, Clone, Copy)]
pub struct Context<'a> {
    /// Results of all trials.
    pub results: &'a Results,
    /// The study's agents in its order, which determines their colours.
    pub agents: &'a [String],
    /// Units by metric, for the labels of axes; a metric without one has no entry.
    pub units: &'a BTreeMap<String, String>,
    /// The better direction by metric; more is better for a metric without an entry.
    pub better: &'a BTreeMap<String, Better>,
}

/// Computes a figure.
///
/// # Errors
/// [`Error::Render`] if the results lack the values that the figure shows.
pub fn build(spec: &FigureSpec, context: Context<'_>) -> Result<Chart, Error> {
    let mut chart = spec.kind.build(spec, context)?;
    for panel in &mut chart.panels {
        panel.title = one_line(&panel.title);
        let names = panel.series.iter_mut().map(|series| &mut series.label);
        let names = names.chain(&mut panel.x.categories);
        for name in names.chain(&mut panel.y.categories) {
            *name = one_line(name);
        }
        let label = |own: &Option<String>, chosen: &str| one_line(own.as_deref().unwrap_or(chosen));
        panel.x.label = label(&spec.x_label, &panel.x.label);
        panel.y.label = label(&spec.y_label, &panel.y.label);
    }
    chart.notes.extend(beyond_the_axes(&chart));
    chart.notes.extend(spec.notes.iter().cloned());
    chart.paper = Paper {
        width_mm: spec.width_mm,
        font_pt: spec.font_pt,
    };
    Ok(chart)
}

/// A sentence on the points that have no place on a logarithmic axis; `None` if there are none.
fn beyond_the_axes(chart: &Chart) -> Option<String> {
    let (mut all, mut out) = (0, 0);
    for panel in chart.panels.iter().filter(|panel| panel.x.log || panel.y.log) {
        for shape in panel.series.iter().map(|series| &series.shape) {
            for point in shape.form().all_points() {
                all += 1;
                out += usize::from(panel.x.log && point.x <= 0.0 || panel.y.log && point.y <= 0.0);
            }
        }
    }
    (out > 0).then(|| {
        format!("{out} of {all} points are left out, as a logarithmic axis has no place for zero or less.")
    })
}

impl Context<'_> {
    /// The look of an agent, the same in all figures of the study.
    #[must_use]
    pub fn style(&self, agent: &str) -> Style {
        let position = self.agents.iter().position(|name| name == agent);
        let all = Scope {
            trials: self.results.trials.iter().collect(),
        };
        Style::of_agent(
            position
                .or_else(|| all.names(Axis::Agent, &[]).iter().position(|name| name == agent))
                .unwrap_or(0),
        )
    }

    /// The look of one of `count` settings of an agent. The settings have a scale of colours if the agent is `alone` in
    /// having several.
    pub(super) fn style_of_setting(&self, agent: &str, index: usize, (count, alone): (usize, bool)) -> Style {
        let own = self.style(agent);
        let hue = if alone { Hue::Ramp(index, count) } else { own.hue };
        match count {
            0 | 1 => own,
            _ => Style { variant: index, hue },
        }
    }

    /// The better direction of a metric.
    pub(super) fn better(&self, metric: &str) -> Better {
        self.better.get(metric).copied().unwrap_or(Better::Higher)
    }

    /// Label of an axis that shows a metric: its name with spaces, and its unit.
    #[must_use]
    pub fn scale(&self, spec: &FigureSpec, metric: &str, log: bool) -> Scale {
        let name = spec.labels.get(metric).cloned().unwrap_or_else(|| spaced(metric));
        // A word for numbered channels has the unit of the first of them.
        let unit = self
            .units
            .get(metric)
            .or_else(|| self.units.get(&format!("{metric}_1")))
            .filter(|unit| !unit.is_empty() && *unit != "1");
        Scale {
            label: unit.map_or(name.clone(), |unit| format!("{name} ({unit})")),
            log,
            ..Scale::default()
        }
    }
}

/// The printed name: the label from the study, or the name itself.
pub(super) fn label(spec: &FigureSpec, name: &str) -> String {
    spec.labels.get(name).cloned().unwrap_or_else(|| name.into())
}

/// An agent's name with its setting, if the agent has more than one.
pub(super) fn label_with_setting(spec: &FigureSpec, agent: &str, setting: &str) -> String {
    if setting.is_empty() {
        label(spec, agent)
    } else {
        format!("{}, {}", label(spec, agent), label(spec, setting))
    }
}

/// An item for each agent among the trials of a panel, or for each setting of an agent with several, made of their
/// trials, their label and their look. Settings of a single swept agent lie on a scale of colours. Settings of several
/// agents differ in dashes and markers, so that agents keep their colours.
pub(super) fn by_setting<'a, T>(
    spec: &FigureSpec,
    context: Context<'_>,
    (scope, listed): (&Scope<'a>, &[String]),
    item: impl Fn(&Scope<'a>, String, Style) -> T,
) -> Vec<T> {
    let agents = scope.names(Axis::Agent, listed);
    let is_swept = |agent: &&String| scope.at(Axis::Agent, agent).varies(Axis::Setting);
    let alone = agents.iter().filter(is_swept).count() == 1;
    let mut items = Vec::new();
    for agent in &agents {
        let scope = scope.at(Axis::Agent, agent);
        let settings = scope.names(Axis::Setting, &[]);
        for (index, setting) in settings.iter().enumerate() {
            let style = context.style_of_setting(agent, index, (settings.len(), alone));
            let label = label_with_setting(spec, agent, if settings.len() > 1 { setting } else { "" });
            items.push(item(&scope.at(Axis::Setting, setting), label, style));
        }
    }
    items
}

/// A chart with one panel per environment; panels have titles if there are several.
pub(super) fn by_environment(
    spec: &FigureSpec,
    scope: &Scope<'_>,
    listed: &[String],
    scales: (Scale, Scale),
    series: impl Fn(&Scope<'_>) -> Vec<Series>,
) -> Result<Chart, Error> {
    let environments = scope.names(Axis::Environment, listed);
    let titled = environments.len() > 1;
    let panel = |name: &String| super::chart::Panel {
        title: if titled { label(spec, name) } else { String::new() },
        x: scales.0.clone(),
        y: scales.1.clone(),
        series: series(&scope.at(Axis::Environment, name)),
    };
    let panels: Vec<_> = environments.iter().map(panel).collect();
    if panels.iter().all(|panel| panel.series.is_empty()) {
        return Err(problem("no trial has recorded what it shows"));
    }
    let columns = if panels.len() == 4 {
        2
    } else {
        panels.len().clamp(1, 3)
    };
    Ok(Chart {
        columns,
        panels,
        ..Chart::default()
    })
}

/// A sentence on each agent or setting that has trials in the environment of a panel and no series there: its number of
/// seeds, and why they have no value. `lack` names what the trials lack that ended successfully.
pub(super) fn left_out(
    spec: &FigureSpec,
    context: Context<'_>,
    (agents, environments): (&[String], &[String]),
    chart: &Chart,
    lack: impl Fn(&Scope<'_>) -> String,
) -> Vec<String> {
    let scope = Scope::of(context.results, agents, environments);
    let names = scope.names(Axis::Environment, environments);
    let mut sentences = Vec::new();
    for (name, panel) in names.iter().zip(&chart.panels) {
        let is_drawn = |label: &str| {
            let mut own = panel.series.iter().filter(|it| !it.shape.form().is_published());
            own.any(|series| series.label == label)
        };
        let absent = |scope: &Scope<'_>, agent: String, _| {
            let cell = Cell {
                planned: scope.planned(),
                missing: scope.absences(),
                ..Cell::default()
            };
            let place = if names.len() > 1 {
                format!(" in {}", label(spec, name))
            } else {
                String::new()
            };
            let lacks = if scope.trials.iter().any(|trial| trial.is_ok()) {
                format!("; {}", lack(scope))
            } else {
                String::new()
            };
            let why = cell.incompleteness();
            (!is_drawn(&agent)).then(|| format!("{agent}{place} is left out: {why}{lacks}."))
        };
        let here = scope.at(Axis::Environment, name);
        sentences.extend(
            by_setting(spec, context, (&here, agents), absent)
                .into_iter()
                .flatten(),
        );
    }
    sentences
}

/// A line across the panel at the mean of agents that do not learn.
pub(super) fn level(label: String, style: Style, seeds: (usize, usize), value: f64) -> Series {
    Series {
        label,
        seeds: Some(seeds),
        style,
        shape: Shape::Level(value),
    }
}

#[allow(clippy::cast_precision_loss, reason = "a count of rows or columns")]
pub(super) fn count(number: usize) -> f64 {
    number as f64
}

/// A name as the axes of figures show it.
pub(super) fn spaced(name: &str) -> String {
    name.replace('_', " ")
}

pub(super) fn problem(problem: &str) -> Error {
    Error::Render {
        what: "figure".into(),
        problem: problem.into(),
    }
}
