//! Shared parts of figures without axes: the choice of trials, the sentences on trials without the artifact, and the
//! data as lines of a CSV file.

use super::{
    FigureSpec,
    build::{Context, label, label_with_setting},
    chart::{Chart, Panel, Series, Style},
    shape::Shape,
};
use crate::table::{Axis, Scope};
use contract::{ArtifactKind, drawing::Drawings, trial_result::TrialResult};

/// Trials that are drawn: one per agent and setting, all of one environment and seed.
pub(super) struct DrawnTrials<'k> {
    pub(super) agents: &'k [String],
    pub(super) environment: Option<&'k String>,
    pub(super) seed: Option<u64>,
}

/// The trials that left an artifact, each with its name, and the sentences under the figure.
pub(super) struct ArtifactTrials<'a> {
    pub(super) trials: Vec<(String, &'a TrialResult, &'a Drawings)>,
    /// The seed and the environment, as in `seed 0 in short`.
    pub(super) place: String,
    /// A sentence for each trial that left no such artifact.
    pub(super) missing: Vec<String>,
}

impl DrawnTrials<'_> {
    /// Finds the trials that left an artifact of a kind.
    pub(super) fn find<'a>(
        &self,
        kind: ArtifactKind,
        spec: &FigureSpec,
        context: Context<'a>,
        is_there: impl Fn(&Drawings) -> bool,
    ) -> ArtifactTrials<'a> {
        let environments: Vec<String> = self.environment.into_iter().cloned().collect();
        let scope = Scope::of(context.results, self.agents, &environments);
        let environment = scope.names(Axis::Environment, &[]).into_iter().next();
        let environment = environment.unwrap_or_default();
        let scope = scope.at(Axis::Environment, &environment);
        let seeds = scope.trials.iter().map(|trial| trial.trial.key.seed);
        let seed = self.seed.or_else(|| seeds.min()).unwrap_or(0);
        let agents = scope.names(Axis::Agent, self.agents);
        let of_agent = |agent: &String| scope.at(Axis::Agent, agent).trials;
        let chosen = agents.iter().flat_map(of_agent);
        let mut found = ArtifactTrials {
            trials: Vec::new(),
            place: format!("seed {seed} in {}", label(spec, &environment)),
            missing: Vec::new(),
        };
        for trial in chosen.filter(|trial| trial.trial.key.seed == seed) {
            let name = label_with_setting(spec, &trial.trial.cell.agent, trial.trial.cell.point.words());
            match context.results.drawings.get(&trial.trial.id) {
                Some(drawings) if is_there(drawings) => found.trials.push((name, trial, drawings)),
                other => found.missing.push(missing(&name, kind, trial, other)),
            }
        }
        found
    }
}

/// Reason for the missing panel of a trial.
fn missing(name: &str, kind: ArtifactKind, trial: &TrialResult, drawings: Option<&Drawings>) -> String {
    let problem = drawings.and_then(|drawings| drawings.problem.as_ref());
    match (&trial.end, problem) {
        (None, _) => format!("{name} is missing: its trial has not run."),
        (Some(end), _) if !trial.is_ok() => {
            format!("{name} is missing: its trial ended as {}.", end.state.name())
        }
        (_, Some(problem)) => format!("{name} is missing: {problem}."),
        _ => format!("{name} is missing: its trial left no {kind}."),
    }
}

/// A panel without axes.
pub(super) fn panel(title: String, shape: Shape) -> Panel {
    let series = Series {
        label: String::new(),
        seeds: None,
        style: Style::default(),
        shape,
    };
    Panel {
        title,
        series: vec![series],
        ..Panel::default()
    }
}

/// The first shape of each panel: figures without axes have one.
pub(super) fn shapes(chart: &Chart) -> impl Iterator<Item = (usize, &Panel, &Shape)> {
    let panels = chart.panels.iter().enumerate();
    panels.filter_map(|(index, panel)| Some((index, panel, &panel.series.first()?.shape)))
}

/// The data of a chart without axes, with a header; `None` for a chart with axes.
pub(super) fn lines(chart: &Chart) -> Option<Vec<Vec<String>>> {
    let mut lines: Vec<Vec<String>> = Vec::new();
    for (index, panel, shape) in shapes(chart) {
        let Some((header, fields)) = shape.form().sheet() else {
            continue;
        };
        if lines.is_empty() {
            lines.push(header.iter().map(ToString::to_string).collect());
        }
        let name = panel.name(index);
        lines.extend(
            fields
                .into_iter()
                .map(|fields| std::iter::once(name.clone()).chain(fields).collect()),
        );
    }
    (!lines.is_empty()).then_some(lines)
}
