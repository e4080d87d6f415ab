//! Graphs: designs that trials found, as boxes and arrows.

use super::{
    Figure, FigureSpec,
    build::{Context, problem},
    chart::Chart,
    drawn::{DrawnTrials, panel},
    shape::Shape,
};
use crate::kinds::KindSpec;
use crate::names::{Names, Place};
use contract::{
    ArtifactKind, Error,
    drawing::{Drawings, Graph},
    trial_result::TrialResult,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The graph of a design that a trial left.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct GraphFigure {
    /// Agents to show, one drawing each, one below the other; all where empty.
    pub agents: Vec<String>,
    /// Environment to show; the first where absent.
    pub environment: Option<String>,
    /// Seed to show; the lowest where absent.
    pub seed: Option<u64>,
}

impl KindSpec for GraphFigure {
    fn name() -> &'static str {
        "graph"
    }

    fn about() -> &'static str {
        "The graph of a design that a trial left, as boxes and arrows, one drawing per agent."
    }

    fn example() -> &'static str {
        "{ agents: [learner], environment: short, seed: 1 }"
    }
}

impl Figure for GraphFigure {
    fn check(&self, names: &mut Names<'_>, at: &Place<'_>) {
        let picked = names.pick(at).of_one_environment();
        names.leaves(ArtifactKind::Graph, at, &picked);
        names.seed(self.seed, at);
    }

    fn shows(&self) -> Option<ArtifactKind> {
        Some(ArtifactKind::Graph)
    }

    fn build(&self, spec: &FigureSpec, context: Context<'_>) -> Result<Chart, Error> {
        let choice = DrawnTrials {
            agents: &self.agents,
            environment: self.environment.as_ref(),
            seed: self.seed,
        };
        let kind = ArtifactKind::Graph;
        let found = choice.find(kind, spec, context, |drawings| drawings.graph.is_some());
        if found.trials.is_empty() {
            return Err(problem(&format!(
                "no trial has left a graph: {}",
                found.missing.join(" ")
            )));
        }
        let titled = found.trials.len() > 1;
        let of_trial = |(name, _, drawings): &(String, &TrialResult, &Drawings)| {
            let title = if titled { name.clone() } else { String::new() };
            Some(panel(title, Shape::Graph(drawings.graph.clone()?)))
        };
        let dashed = if found
            .trials
            .iter()
            .any(|(.., drawings)| has_bypass(drawings.graph.as_ref()))
        {
            " Dashed arrows bypass what lies between their ends."
        } else {
            ""
        };
        let mut notes = vec![format!("The design of {}.{dashed}", found.place)];
        notes.extend(found.missing);
        Ok(Chart {
            columns: 1,
            panels: found.trials.iter().filter_map(of_trial).collect(),
            notes,
            ..Chart::default()
        })
    }
}

fn has_bypass(graph: Option<&Graph>) -> bool {
    graph.is_some_and(|graph| graph.edges.iter().any(|edge| edge.bypass))
}
