//! Shared parts of figures without axes: the choice of trials, the sentences on trials that left nothing, and the
//! data as lines of a CSV file.

use super::{
    FigureSpec,
    build::{Context, label, label_with_setting},
    chart::{Chart, Panel, Series, Shape, Style, Tiles},
};
use crate::table::{Axis, Scope};
use contract::{
    ArtifactKind,
    drawing::{Drawings, Edge, Graph, Image, Node},
    trial_result::TrialResult,
};

/// Choice of trials: one per agent and setting, all of one environment and seed.
pub(super) struct Choice<'k> {
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

impl Choice<'_> {
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
        let (header, fields) = match shape {
            Shape::Images(tiles) => (IMAGES.as_slice(), of_images(tiles)),
            Shape::Graph(graph) => (GRAPH.as_slice(), of_graph(graph)),
            _ => continue,
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

const IMAGES: [&str; 9] = [
    "panel",
    "trial",
    "image",
    "row",
    "column",
    "side",
    "mean_red",
    "mean_green",
    "mean_blue",
];

fn of_images(tiles: &Tiles) -> Vec<Vec<String>> {
    let columns = tiles.columns.max(1);
    let line = |(index, image): (usize, &Image)| {
        let place = [index, index / columns, index % columns].map(|number| number.to_string());
        let colors = image.mean_color().map(|mean| format!("{mean:.3}"));
        std::iter::once(tiles.trial.clone())
            .chain(place)
            .chain([image.width.to_string()])
            .chain(colors)
            .collect()
    };
    tiles.images.iter().enumerate().map(line).collect()
}

const GRAPH: [&str; 10] = [
    "panel", "part", "number", "label", "column", "lane", "group", "from", "to", "bypass",
];

fn of_graph(graph: &Graph) -> Vec<Vec<String>> {
    let none = String::new;
    let node = |(number, node): (usize, &Node)| {
        let place = [node.column.to_string(), node.lane.to_string(), node.group.clone()];
        let head = ["node".into(), number.to_string(), node.label.clone()];
        head.into_iter()
            .chain(place)
            .chain([none(), none(), none()])
            .collect()
    };
    let edge = |(number, edge): (usize, &Edge)| {
        let head = ["edge".into(), number.to_string(), edge.label.clone()];
        let ends = [
            edge.from.to_string(),
            edge.to.to_string(),
            edge.bypass.to_string(),
        ];
        head.into_iter()
            .chain([none(), none(), none()])
            .chain(ends)
            .collect()
    };
    let nodes = graph.nodes.iter().enumerate().map(node);
    nodes.chain(graph.edges.iter().enumerate().map(edge)).collect()
}
