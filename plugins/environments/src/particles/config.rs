//! Config of the `particles` environment.

use super::{
    cooperative_navigation::CooperativeNavigation,
    predator_prey::PredatorPrey,
    rules::{Rules, Variant},
    scenario::Scenario,
    world::{Motion, Vector, World},
};
use contract::{Error, Rng};
use rand::Rng as _;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The task.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ScenarioName {
    /// Three agents cover three landmarks.
    #[default]
    CooperativeNavigation,
    /// Three predators, agents 0 to 2, chase one prey, agent 3, around two obstacles.
    PredatorPrey,
}

impl ScenarioName {
    pub(super) fn build(self, rules: Rules) -> Box<dyn Scenario> {
        match self {
            ScenarioName::CooperativeNavigation => Box::new(CooperativeNavigation { rules }),
            ScenarioName::PredatorPrey => Box::new(PredatorPrey { rules }),
        }
    }
}

/// Settings of the `particles` environment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ParticlesConfig {
    /// The task.
    pub scenario: ScenarioName,
    /// Source of the dynamics and rewards: the thesis, the OpenAI environment from which it was forked, or
    /// mpe2.
    pub variant: Variant,
    /// Steps after which an episode is truncated.
    #[schemars(range(min = 1), extend("x-unit" = "steps", "x-source" = "authors' public code"))]
    pub episode_length: u64,
    /// Initial positions of bodies; positions that are left out are drawn anew for each episode.
    pub start: Start,
    /// Whether every agent observes the observations of all agents, one after the other, as in the authors'
    /// program.
    pub joint_observation: bool,
}

impl Default for ParticlesConfig {
    fn default() -> Self {
        Self {
            scenario: ScenarioName::default(),
            variant: Variant::default(),
            episode_length: 25,
            start: Start::default(),
            joint_observation: false,
        }
    }
}

impl contract::Config for ParticlesConfig {}

/// Initial positions of bodies; all are at rest.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Start {
    /// Positions of the agents, such as [[0.1, 0.2], [-0.3, 0.4], [0.5, -0.6]]; if left out, each is drawn
    /// uniformly from [-1, 1]^2.
    pub agents: Option<Vec<Vector>>,
    /// Positions of the landmarks; if left out, each is drawn uniformly from [-1, 1]^2, the obstacles of
    /// predator_prey from [-0.9, 0.9]^2.
    pub landmarks: Option<Vec<Vector>>,
}

impl ParticlesConfig {
    /// Checks the start against the scenario's numbers of agents and landmarks.
    pub(super) fn check(&self, agents: usize, landmarks: usize) -> Result<(), Error> {
        if self.episode_length == 0 {
            return Err(Error::config(
                "episode_length",
                "an episode needs at least one step",
            ));
        }
        check_places("start.agents", self.start.agents.as_deref(), agents, "agents")?;
        check_places(
            "start.landmarks",
            self.start.landmarks.as_deref(),
            landmarks,
            "landmarks",
        )
    }
}

fn check_places(key: &str, places: Option<&[Vector]>, count: usize, what: &str) -> Result<(), Error> {
    let Some(places) = places else { return Ok(()) };
    if places.len() != count {
        let wanted = vec!["[x, y]"; count].join(", ");
        return Err(Error::config(
            key,
            format!(
                "has {} entries for {count} {what}; write [{wanted}]",
                places.len()
            ),
        ));
    }
    match places
        .iter()
        .position(|place| !place.iter().all(|entry| entry.is_finite()))
    {
        Some(index) => Err(Error::config(
            format!("{key}[{index}]"),
            "coordinates must be finite numbers",
        )),
        None => Ok(()),
    }
}

impl Start {
    /// Places all bodies at rest. Draws agents in order, x before y, then landmarks.
    pub(super) fn place(&self, world: &mut World, landmark_range: f64, rng: &mut Rng) {
        let agents = world.agents().len();
        let (moving, fixed) = world.motions_mut().split_at_mut(agents);
        place_all(moving, self.agents.as_deref(), 1.0, rng);
        place_all(fixed, self.landmarks.as_deref(), landmark_range, rng);
    }
}

fn place_all(motions: &mut [Motion], given: Option<&[Vector]>, range: f64, rng: &mut Rng) {
    for (index, motion) in motions.iter_mut().enumerate() {
        let mut draw = || rng.random_range(-range..range);
        let position = given.map_or_else(|| [draw(), draw()], |places| places[index]);
        *motion = Motion {
            position,
            velocity: [0.0; 2],
        };
    }
}
