//! An environment with something to draw, and a protocol that leaves it: for figures of what trials leave.

use contract::{
    ArtifactKind, Channel, End, Environment, Error, Metric, Protocol, Registry, Rng, Seat, Space, Step,
    drawing::{Edge, Graph, Image, Node},
    protocol::{Measurement, Run, leave_drawings, measure_alone, measurement_metrics},
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// Drawings to leave.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
struct Paper {
    /// How many images; without any there is no graph either.
    images: u8,
}

impl Default for Paper {
    fn default() -> Self {
        Self { images: 5 }
    }
}

impl contract::Config for Paper {}

struct Painter(Paper, Vec<Seat>);

/// One episode, whose drawings are left.
#[derive(Debug, Clone, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
struct Paint {}

impl contract::Config for Paint {}

/// Registers both.
pub(crate) fn register(registry: &mut Registry) {
    registry.environment("painter", 1, "Has something to draw.", |config: Paper| {
        let seat = Seat {
            name: String::new(),
            observation: Space::Box(vec![Channel::new("nothing", "")]),
            action: Space::Simplex(vec!["red".into(), "green".into()]),
        };
        Ok(Box::new(Painter(config, vec![seat])))
    });
    registry.protocol(
        "paint",
        1,
        "Leaves drawings.",
        |config: Paint| config,
        |config| Ok(Box::new(config)),
    );
}

impl Environment for Painter {
    fn seats(&self) -> &[Seat] {
        &self.1
    }

    fn reset(&mut self, _: &mut Rng) -> Result<Vec<Vec<f64>>, Error> {
        Ok(vec![vec![0.0]])
    }

    fn step(&mut self, _: &[Vec<f64>], _: &mut Rng) -> Result<Step, Error> {
        Ok(Step::new(vec![vec![0.0]], vec![1.0], Some(End::Terminated)))
    }

    fn trace_channels(&self) -> Vec<Channel> {
        Vec::new()
    }

    fn trace(&self) -> Vec<f64> {
        Vec::new()
    }

    fn graph(&self) -> Option<Graph> {
        let node = |(column, label): (u32, &str)| Node {
            label: label.into(),
            column,
            ..Node::default()
        };
        let edge = |from| Edge {
            from,
            to: from + 1,
            ..Edge::default()
        };
        (self.0.images > 0).then(|| Graph {
            nodes: (0..).zip(["brush", "paint", "paper"]).map(node).collect(),
            edges: (0..2).map(edge).collect(),
            ..Graph::default()
        })
    }

    fn images(&mut self) -> Result<Vec<Image>, Error> {
        let image = |number: u8| Image {
            width: 4,
            height: 4,
            pixels: [200, number, 0].repeat(16),
        };
        Ok((0..self.0.images).map(image).collect())
    }

    fn snapshot(&self) -> Value {
        Value::Null
    }

    fn restore(&mut self, _: &Value) -> Result<(), Error> {
        Ok(())
    }
}

impl Protocol for Paint {
    fn metrics(&self) -> Vec<Metric> {
        measurement_metrics()
    }

    fn leaves(&self) -> Vec<ArtifactKind> {
        vec![ArtifactKind::Graph, ArtifactKind::Images]
    }

    fn total_steps(&self) -> u64 {
        1
    }

    fn experience(&self) -> u64 {
        0
    }

    fn run(&self, run: &mut Run<'_>) -> Result<(), Error> {
        measure_alone(run, std::iter::once(Measurement::at_the_end(1, 1, 0)), 1)?;
        let mut environment = (run.make_environment)()?;
        let folder = run.folder;
        folder.map_or(Ok(()), |folder| {
            leave_drawings(&mut *environment, folder).map(drop)
        })
    }
}
