//! Discs in a plane that push each other away: cooperative navigation, and predator and prey (thesis, sections
//! 4.5.2 and 4.5.3).
//!
//! Each agent chooses a force; between two steps a world of unit masses is integrated with a time step of
//! 0.1:
//!
//! | symbol  | here                            | shape, range |
//! |---------|---------------------------------|--------------|
//! | u_i     | `agent_i.force_x`, `force_y`    | `[2]`, in [-1, 1] |
//! | p_i     | `agent_i.position_x`, `_y`      | `[2]`, unbounded |
//! | v_i     | `agent_i.velocity_x`, `_y`      | `[2]` |
//! | F_i     | gain u_i + contact forces       | `[2]`, see [`World`] |
//! | t       | steps since the start           | |
//!
//! v' = 0.75 v + 0.1 F, shortened to the top speed where the body has one; p' = p + 0.1 v'. Positions are
//! unbounded and no episode terminates: it is truncated after `episode_length` steps. The environment has no SI
//! units.
//!
//! # Variants
//! Published numbers come from three programs that share a name and differ in dynamics and rewards; [`Rules`]
//! lists the differences. `thesis` is the program behind the thesis' figures, a fork of the OpenAI environment;
//! `openai` that environment (Lowe et al. 2017); `mpe2` its successor in the PettingZoo family (version 1.1.1).
//!
//! Two traps of `thesis`:
//! * *Double acceleration.* Where an agent has an acceleration, the fork multiplies the action by it twice:
//!   the predators' 3 becomes 9 and the prey's 4 becomes 16, so that both are at their top speeds after a
//!   step or two.
//! * *Aliasing.* The fork scales the caller's own action array in place, so a caller that stores the array after
//!   the step stores scaled actions. Here actions are read, never written: what a replay keeps lies in
//!   [-1, 1].
//!
//! # Departures
//! * Actions are two-dimensional for every variant. `openai` and `mpe2` take five numbers of which only the
//!   differences (right - left, up - down) act; u is that difference, with the signs set so that u points
//!   where the force does. `mpe2` clips its actions, and so u is clipped to [-1, 1] there; elsewhere an
//!   action outside by more than rounding is an error.
//! * Bodies at the very same place exert no force on each other (the other programs divide 0 by 0): no
//!   direction is better than another, and they part as soon as anything else moves one of them.

mod config;
mod cooperative_navigation;
#[cfg(test)]
mod environment_tests;
#[cfg(test)]
mod oracle_tests;
mod predator_prey;
mod rules;
mod scenario;
mod world;

pub use crate::unit_box::LimitExcess;
pub use config::{ParticlesConfig, ScenarioName, Start};
pub use rules::{Integration, RewardSharing, Rules, Variant};
pub use world::{Body, Motion, Vector, World};

use crate::unit_box;
use contract::{Channel, End, Environment, Error, Metric, Rng, Seat, Space, Step};
use scenario::Scenario;
use serde::{Deserialize, Serialize};

/// Names of an action's entries.
const FORCE: [&str; 2] = ["force_x", "force_y"];

/// The `particles` environment.
pub struct Particles {
    config: ParticlesConfig,
    rules: Rules,
    scenario: Box<dyn Scenario>,
    world: World,
    seats: Vec<Seat>,
    metrics: Vec<Metric>,
    /// Number of entries of each agent's own observation.
    widths: Vec<usize>,
    /// Actions of the present step.
    controls: Vec<Vector>,
    steps: u64,
}

/// State of the environment in a checkpoint.
#[derive(Serialize, Deserialize)]
struct Snapshot {
    steps: u64,
    motions: Vec<Motion>,
}

/// Builds the environment; registered as `particles`.
///
/// # Errors
/// [`Error::Config`] where an explicit start does not fit the scenario.
pub fn build(config: ParticlesConfig) -> Result<Box<dyn Environment>, Error> {
    Ok(Box::new(Particles::new(config)?))
}

impl Particles {
    /// A world with all bodies at the origin; call `reset` before `step`.
    ///
    /// # Errors
    /// [`Error::Config`] where an explicit start does not fit the scenario.
    pub fn new(config: ParticlesConfig) -> Result<Self, Error> {
        let rules = config.variant.rules();
        let scenario = config.scenario.build(rules);
        let (bodies, agents) = (scenario.bodies(), scenario.agents());
        config.check(agents, bodies.len() - agents)?;
        let channels: Vec<Vec<Channel>> = (0..agents)
            .map(|agent| scenario.observation_channels(agent))
            .collect();
        Ok(Self {
            widths: channels.iter().map(Vec::len).collect(),
            seats: seats(&channels, config.joint_observation),
            metrics: scenario.metrics(),
            controls: vec![[0.0; 2]; agents],
            world: World::new(bodies, agents, rules),
            steps: 0,
            scenario,
            rules,
            config,
        })
    }

    /// The bodies and their motions.
    #[must_use]
    pub fn world(&self) -> &World {
        &self.world
    }

    fn observe(&self) -> Vec<Vec<f64>> {
        if self.config.joint_observation {
            let mut joint = Vec::with_capacity(self.widths.iter().sum());
            (0..self.widths.len()).for_each(|agent| self.scenario.observe(&self.world, agent, &mut joint));
            return vec![joint; self.widths.len()];
        }
        let seen = |(agent, width): (usize, &usize)| {
            let mut own = Vec::with_capacity(*width);
            self.scenario.observe(&self.world, agent, &mut own);
            own
        };
        self.widths.iter().enumerate().map(seen).collect()
    }

    /// Copies the actions into `controls`.
    fn read(&mut self, actions: &[Vec<f64>]) -> Result<(), Error> {
        unit_box::check_seats(actions, self.controls.len())?;
        for (agent, (action, control)) in actions.iter().zip(&mut self.controls).enumerate() {
            *control = unit_box::checked(action, agent, FORCE, self.rules.beyond_limits)?;
        }
        Ok(())
    }
}

fn seats(channels: &[Vec<Channel>], joint: bool) -> Vec<Seat> {
    let of = |agent: usize| {
        channels[agent]
            .iter()
            .map(move |channel| (agent, channel.clone()))
    };
    let named = |(agent, channel): (usize, Channel)| Channel {
        name: format!("agent_{agent}.{}", channel.name),
        ..channel
    };
    let all: Vec<Channel> = (0..channels.len()).flat_map(of).map(named).collect();
    let force = FORCE.map(|name| Channel::new(name, "").within(-1.0, 1.0).typical(0.0, 0.6));
    let seat = |agent: usize| Seat {
        name: format!("agent_{agent}"),
        observation: Space::Box(if joint {
            all.clone()
        } else {
            channels[agent].clone()
        }),
        action: Space::Box(force.to_vec()),
    };
    (0..channels.len()).map(seat).collect()
}

impl Environment for Particles {
    fn seats(&self) -> &[Seat] {
        &self.seats
    }

    fn metrics(&self) -> &[Metric] {
        &self.metrics
    }

    fn reset(&mut self, rng: &mut Rng) -> Result<Vec<Vec<f64>>, Error> {
        self.config
            .start
            .place(&mut self.world, self.scenario.landmark_range(), rng);
        self.steps = 0;
        Ok(self.observe())
    }

    fn step(&mut self, actions: &[Vec<f64>], _rng: &mut Rng) -> Result<Step, Error> {
        self.read(actions)?;
        self.world.step(&self.controls);
        self.steps += 1;
        let (rewards, metrics) = self.scenario.assess(&self.world);
        let end = (self.steps >= self.config.episode_length).then_some(End::Truncated);
        Ok(Step::new(self.observe(), rewards, end).record_all(metrics))
    }

    fn state_channels(&self) -> Vec<Channel> {
        let position = |name: String| {
            ["x", "y"].map(|axis| Channel::new(format!("{name}.position_{axis}"), "").typical(0.0, 0.6))
        };
        let velocity = |name: String| {
            ["x", "y"].map(|axis| Channel::new(format!("{name}.velocity_{axis}"), "").typical(0.0, 0.5))
        };
        let agents = self.widths.len();
        let of_agents = (0..agents).map(|agent| format!("agent_{agent}"));
        let of_landmarks =
            (0..self.world.motions().len() - agents).map(|landmark| format!("landmark_{landmark}"));
        of_agents
            .flat_map(|name| position(name.clone()).into_iter().chain(velocity(name)))
            .chain(of_landmarks.flat_map(position))
            .collect()
    }

    fn state(&self) -> Vec<f64> {
        let (agents, landmarks) = self.world.motions().split_at(self.widths.len());
        let moving = agents
            .iter()
            .flat_map(|agent| agent.position.into_iter().chain(agent.velocity));
        moving
            .chain(landmarks.iter().flat_map(|landmark| landmark.position))
            .collect()
    }

    fn trace_channels(&self) -> Vec<Channel> {
        [Channel::new("t", "")]
            .into_iter()
            .chain(self.state_channels())
            .collect()
    }

    fn trace(&self) -> Vec<f64> {
        #[allow(
            clippy::cast_precision_loss,
            reason = "an episode has far fewer than 2^52 steps"
        )]
        let t = self.steps as f64;
        [t].into_iter().chain(self.state()).collect()
    }

    fn snapshot(&self) -> serde_json::Value {
        let snapshot = Snapshot {
            steps: self.steps,
            motions: self.world.motions().to_vec(),
        };
        // Plain structs of numbers: serde_json refuses only maps whose keys are no strings.
        serde_json::to_value(snapshot).expect("a snapshot serialises")
    }

    fn restore(&mut self, snapshot: &serde_json::Value) -> Result<(), Error> {
        let misfit = |problem: String| Error::Checkpoint {
            what: "particles",
            problem,
        };
        let Snapshot { steps, motions } =
            Snapshot::deserialize(snapshot).map_err(|source| misfit(source.to_string()))?;
        if motions.len() != self.world.motions().len() {
            return Err(misfit(format!(
                "{} bodies stored, {} configured",
                motions.len(),
                self.world.motions().len()
            )));
        }
        self.world.motions_mut().copy_from_slice(&motions);
        self.steps = steps;
        Ok(())
    }
}
