//! Differences between the three programs called "multi-agent particle environment", as one table.

use crate::unit_box::LimitExcess;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The program whose dynamics and rewards hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Variant {
    /// The fork behind the thesis' figures: accelerations applied twice, shaped rewards of predators and prey.
    #[default]
    Thesis,
    /// The environment of Lowe et al. 2017: shared rewards in navigation, rewards only for catches in pursuit.
    Openai,
    /// mpe2 1.1.1, formerly of PettingZoo: positions move before velocities, half of the navigation reward is
    /// the agent's own.
    Mpe2,
}

/// Dynamics and rewards of a variant, as data.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rules {
    /// An agent's acceleration multiplies its action twice.
    pub accelerates_twice: bool,
    /// Order of the updates in a step.
    pub integration: Integration,
    /// Treatment of actions beyond [-1, 1].
    pub beyond_limits: LimitExcess,
    /// Navigation: whether an agent counts as colliding with itself, a constant -1 for each at every step.
    pub collides_with_itself: bool,
    /// Navigation: composition of an agent's reward.
    pub sharing: RewardSharing,
    /// Pursuit: whether 0.1 times the distances to the predators is added to the prey's reward and subtracted
    /// from the predators'.
    pub shaped_pursuit: bool,
}

/// Order of the updates in a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Integration {
    /// Positions move by the new velocities (semi-implicit Euler).
    VelocityFirst,
    /// Positions move by the old velocities, so a force shows one step later.
    PositionFirst,
}

/// Composition of an agent's reward in navigation. C is the landmarks' part, K_i the collisions of agent i.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum RewardSharing {
    /// The agent's own: C - K_i.
    Own,
    /// The sum over all agents.
    Sum,
    /// (1 - ratio) C - ratio K_i.
    Local {
        /// Weight of the agent's own collisions.
        ratio: f64,
    },
}

impl Variant {
    /// The rules of this variant.
    #[must_use]
    pub const fn rules(self) -> Rules {
        match self {
            Variant::Thesis => Rules {
                accelerates_twice: true,
                integration: Integration::VelocityFirst,
                beyond_limits: LimitExcess::Refused,
                collides_with_itself: true,
                sharing: RewardSharing::Own,
                shaped_pursuit: true,
            },
            Variant::Openai => Rules {
                accelerates_twice: false,
                integration: Integration::VelocityFirst,
                beyond_limits: LimitExcess::Refused,
                collides_with_itself: true,
                sharing: RewardSharing::Sum,
                shaped_pursuit: false,
            },
            Variant::Mpe2 => Rules {
                accelerates_twice: false,
                integration: Integration::PositionFirst,
                beyond_limits: LimitExcess::Clipped,
                collides_with_itself: false,
                sharing: RewardSharing::Local { ratio: 0.5 },
                shaped_pursuit: false,
            },
        }
    }
}
