//! Toy plugins for tests: a corridor, an agent that always walks the same way, one that learns, a protocol.

use contract::{
    Action, Agent, ArtifactKind, Channel, DataFile, Environment, Error, Feed, Interface, Metric, Mode,
    Observation, Protocol, Registry, Rng, Seat, Space, Step, Updates,
    part::Part,
    plugin::{Config, Preset},
    registry::AgentTraits,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

/// A walk between two walls.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
struct CorridorConfig {
    /// Number of cells. The walk starts in the first.
    #[schemars(range(min = 2, max = 100))]
    cells: u32,
    /// Time that a step takes.
    #[schemars(range(min = 0.01, max = 60.0), extend("x-unit" = "s", "x-source" = "table 1"))]
    step_s: f64,
    /// Probability that a step goes astray.
    #[schemars(range(min = 0.0, max = 1.0))]
    slip: f64,
    /// Whether walls are seen.
    sees_walls: bool,
    /// Number of walkers.
    #[schemars(range(min = 1))]
    walkers: usize,
    /// Where a walk starts.
    start: Start,
    /// Heights of the cells.
    terrain: Option<Terrain>,
    /// Reward by cell, by the name of the cell.
    prizes: std::collections::BTreeMap<String, f64>,
}

impl Default for CorridorConfig {
    fn default() -> Self {
        Self {
            cells: 10,
            step_s: 1.0,
            slip: 0.0,
            sees_walls: false,
            walkers: 1,
            start: Start::Fixed { cell: 0 },
            terrain: None,
            prizes: Default::default(),
        }
    }
}

#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
enum Start {
    /// Anywhere.
    Random,
    /// Always in the same cell.
    Fixed {
        /// The cell, from 0.
        cell: u32,
    },
    /// Around a cell.
    Around {
        /// The cell, from 0.
        cell: u32,
        /// Cells to each side.
        width: u32,
    },
}

#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
struct Terrain {
    /// CSV file with one height per line.
    file: DataFile,
}

impl Config for CorridorConfig {
    fn presets() -> Vec<Preset> {
        let values = json!({ "cells": 50, "slip": 0.1 });
        vec![
            Preset {
                name: "thesis",
                about: "as printed",
                values,
            },
            Preset {
                name: "released_code",
                about: "as in the code",
                values: json!({ "cells": 51 }),
            },
        ]
    }
}

struct Corridor {
    seats: Vec<Seat>,
    metrics: Vec<Metric>,
}

impl Environment for Corridor {
    fn seats(&self) -> &[Seat] {
        &self.seats
    }
    fn metrics(&self) -> &[Metric] {
        &self.metrics
    }
    fn reset(&mut self, _: &mut Rng) -> Result<Vec<Vec<f64>>, Error> {
        Ok(vec![vec![0.0]])
    }
    fn step(&mut self, _: &[Vec<f64>], _: &mut Rng) -> Result<Step, Error> {
        Ok(Step::new(vec![vec![0.0]], vec![0.0], None).record("distance", 0.0))
    }
    fn trace_channels(&self) -> Vec<Channel> {
        vec![Channel::new("height_1", "m"), Channel::new("height_2", "m")]
    }
    fn trace(&self) -> Vec<f64> {
        vec![0.0, 0.0]
    }
    fn snapshot(&self) -> Value {
        Value::Null
    }
    fn restore(&mut self, _: &Value) -> Result<(), Error> {
        Ok(())
    }
}

fn corridor(config: CorridorConfig) -> Result<Box<dyn Environment>, Error> {
    if let Start::Fixed { cell } | Start::Around { cell, .. } = config.start
        && cell >= config.cells
    {
        return Err(Error::config(
            "start.fixed.cell",
            format!("is {cell}, but the cells are 0 to {}", config.cells - 1),
        ));
    }
    let seat = |index: usize| Seat {
        name: format!("walker_{index}"),
        observation: Space::Box(vec![Channel::new("position", "")]),
        action: Space::Discrete(vec!["left".into(), "right".into()]),
    };
    let metrics = vec![Metric::new("distance", "m", "way that was walked")];
    Ok(Box::new(Corridor {
        seats: (0..config.walkers).map(seat).collect(),
        metrics,
    }))
}

/// Always the same way.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
struct WalkerConfig {
    /// Which way.
    direction: Direction,
}

#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
enum Direction {
    /// Towards the first cell.
    #[default]
    Left,
    /// Towards the last cell.
    Right,
}

impl Config for WalkerConfig {}

#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
struct LearnerConfig {
    /// Step size of the update.
    #[schemars(range(max = 1.0), extend("exclusiveMinimum" = 0.0, "x-source" = "table 2"))]
    learning_rate: f64,
    /// Weight of later rewards.
    #[schemars(range(min = 0.0, max = 1.0))]
    discount: f64,
    /// Units of each hidden layer.
    #[schemars(length(min = 1))]
    layers: Vec<u32>,
    /// The network.
    network: Network,
}

#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
struct Network {
    /// Units.
    #[schemars(range(min = 1))]
    width: u32,
    /// Layers.
    #[schemars(range(min = 1))]
    depth: u32,
}

impl Default for Network {
    fn default() -> Self {
        Self { width: 64, depth: 2 }
    }
}

impl Default for LearnerConfig {
    fn default() -> Self {
        Self {
            learning_rate: 0.1,
            discount: 0.99,
            layers: vec![64],
            network: Network { width: 256, depth: 2 },
        }
    }
}

impl Config for LearnerConfig {}

struct Idle;

impl Agent for Idle {
    fn act(&mut self, rows: &[Observation], _: Mode, _: &mut Rng) -> Result<Vec<Action>, Error> {
        Ok(vec![vec![vec![0.0]]; rows.len()])
    }
}

/// Takes fifty steps before it learns from them.
struct Learner(Idle);

impl Agent for Learner {
    fn act(&mut self, rows: &[Observation], mode: Mode, rng: &mut Rng) -> Result<Vec<Action>, Error> {
        self.0.act(rows, mode, rng)
    }
    fn updates(&self) -> Option<Updates> {
        Some(Updates {
            made: 0,
            first_after: 50,
        })
    }
}

fn learner(_: LearnerConfig, interface: &Interface, _: &mut Rng) -> Result<Box<dyn Agent>, Error> {
    if interface.seats.len() != 1 {
        let problem = format!("it plays one seat, but there are {}", interface.seats.len());
        return Err(Error::Mismatch {
            agent: "learner",
            problem,
        });
    }
    Ok(Box::new(Learner(Idle)))
}

#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
struct TrainConfig {
    /// Number of training steps.
    #[schemars(range(min = 0))]
    steps: u64,
    /// Steps between two measurements.
    #[schemars(range(min = 1))]
    evaluate_every: u64,
    /// Episodes of each measurement.
    #[schemars(range(min = 1))]
    episodes: u64,
}

impl Default for TrainConfig {
    fn default() -> Self {
        Self {
            steps: 1000,
            evaluate_every: 100,
            episodes: 10,
        }
    }
}

impl Config for TrainConfig {}

struct Train(u64);

impl Protocol for Train {
    fn metrics(&self) -> Vec<Metric> {
        vec![
            Metric::new("return", "", "sum of rewards"),
            Metric::new("length", "", "steps of an episode"),
        ]
    }
    fn leaves(&self) -> Vec<ArtifactKind> {
        // Agents that do not learn are given no steps, and leave nothing.
        if self.0 > 0 {
            vec![ArtifactKind::Graph, ArtifactKind::Images]
        } else {
            Vec::new()
        }
    }
    fn total_steps(&self) -> u64 {
        self.0
    }
    fn measures_at(&self, step: u64) -> bool {
        step.is_multiple_of(100)
    }

    fn experience(&self) -> u64 {
        self.0
    }
    fn run(&self, _: &mut contract::protocol::Run<'_>) -> Result<(), Error> {
        Ok(())
    }
}

fn train(config: TrainConfig) -> Result<Box<dyn Protocol>, Error> {
    if config.steps > 0 && !config.steps.is_multiple_of(config.evaluate_every) {
        let problem = format!(
            "is {}, which does not divide the {} steps",
            config.evaluate_every, config.steps
        );
        return Err(Error::config("evaluate_every", problem));
    }
    Ok(Box::new(Train(config.steps)))
}

/// A registry of the toys.
pub fn toys() -> Registry {
    let mut registry = Registry {
        numerics_version: 1,
        ..Registry::default()
    };
    registry.environment("corridor", 1, "A walk between two walls.", corridor);
    registry.agent(
        "walker",
        1,
        "Always the same way.",
        AgentTraits::default(),
        |_: WalkerConfig, _, _| Ok(Box::new(Idle)),
    );
    let traits = AgentTraits::learner(
        [Feed::Decisions],
        vec![Metric::new("loss", "", "squared error").lower_is_better()],
    );
    registry.agent("q_learning", 3, "Learns the value of each step.", traits, learner);
    let without_training = |config| TrainConfig { steps: 0, ..config };
    registry.protocol(
        "train_evaluate",
        1,
        "Trains and measures.",
        without_training,
        train,
    );
    registry.measuring = Some(|_| Part::new("train_evaluate", 1, json!({ "steps": 0 })));
    registry
}
