//! What the three programs called "multi-agent particle environment" do differently, as one table.

use crate::unit_box::Beyond;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Whose world it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Variant {
    /// The fork behind the thesis' figures: accelerations applied twice, shaped rewards of predators and
    /// prey.
    #[default]
    Thesis,
    /// The environment of Lowe et al. 2017: shared rewards in navigation, rewards for catches only in
    /// pursuit.
    Openai,
    /// mpe2 1.1.1, formerly of PettingZoo: positions move before velocities, half of the navigation reward is
    /// one's own.
    Mpe2,
}

/// What a variant does, as data.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rules {
    /// An agent's acceleration multiplies its action twice.
    pub accelerates_twice: bool,
    /// What moves first in a step.
    pub integration: Integration,
    /// What happens to actions beyond [-1, 1].
    pub beyond_limits: Beyond,
    /// Navigation: an agent counts as colliding with itself, a constant -1 for each at every step.
    pub collides_with_itself: bool,
    /// Navigation: whose reward an agent gets.
    pub sharing: Sharing,
    /// Pursuit: 0.1 times the distances to the predators is the prey's reward and the predators' loss.
    pub shaped_pursuit: bool,
}

/// What moves first in a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Integration {
    /// Positions move by the new velocities (semi-implicit Euler).
    VelocityFirst,
    /// Positions move by the old velocities, so a force shows one step later.
    PositionFirst,
}

/// Whose reward an agent gets in navigation. C is the landmarks' part, K_i the collisions of agent i.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Sharing {
    /// Its own: C - K_i.
    Own,
    /// The sum of everybody's.
    Sum,
    /// (1 - ratio) C - ratio K_i.
    Local {
        /// Weight of the agent's own collisions.
        ratio: f64,
    },
}

impl Variant {
    /// The table.
    #[must_use]
    pub const fn rules(self) -> Rules {
        match self {
            Variant::Thesis => Rules {
                accelerates_twice: true,
                integration: Integration::VelocityFirst,
                beyond_limits: Beyond::Refused,
                collides_with_itself: true,
                sharing: Sharing::Own,
                shaped_pursuit: true,
            },
            Variant::Openai => Rules {
                accelerates_twice: false,
                integration: Integration::VelocityFirst,
                beyond_limits: Beyond::Refused,
                collides_with_itself: true,
                sharing: Sharing::Sum,
                shaped_pursuit: false,
            },
            Variant::Mpe2 => Rules {
                accelerates_twice: false,
                integration: Integration::PositionFirst,
                beyond_limits: Beyond::Clipped,
                collides_with_itself: false,
                sharing: Sharing::Local { ratio: 0.5 },
                shaped_pursuit: false,
            },
        }
    }
}
