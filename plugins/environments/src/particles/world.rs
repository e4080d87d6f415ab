//! Bodies of unit mass, the forces between them, and one step in time.
//!
//! Two bodies that both collide push each other apart along the line between their centres, with
//! F = 100 k ln(1 + exp((d_min - d) / k)), k = 0.001, where d is the distance of the centres and d_min the
//! sum of the radii: a soft threshold, nearly zero outside contact and 100 (d_min - d) inside. Forces come
//! from the positions before the step.

use super::rules::{Integration, Rules};
use arithmetic::double::{exp, ln_1p};
use serde::{Deserialize, Serialize};

/// Length of a step.
const TIME_STEP: f64 = 0.1;
/// Fraction of a velocity that is lost in a step.
const DAMPING: f64 = 0.25;
/// Force per unit of penetration.
const CONTACT_FORCE: f64 = 100.0;
/// Width k of the soft threshold.
const CONTACT_MARGIN: f64 = 1e-3;
/// Exponent below which `exp` gives zero.
const SMALLEST_EXPONENT: f64 = -746.0;

/// A vector with the entries x and y.
pub type Vector = [f64; 2];

/// Constants of a body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Body {
    /// Radius of the disc.
    pub radius: f64,
    /// Whether the body takes part in contacts.
    pub collides: bool,
    /// Acceleration per unit of action; agents without one of their own have 5, applied once.
    pub acceleration: Option<f64>,
    /// Top speed; `None` for an unlimited one.
    pub top_speed: Option<f64>,
}

/// Position and velocity of a body.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Motion {
    /// Position of the centre.
    pub position: Vector,
    /// Change of the centre per unit of time.
    pub velocity: Vector,
}

/// Agents, which move, and landmarks, which do not.
#[derive(Debug, Clone)]
pub struct World {
    bodies: Vec<Body>,
    motions: Vec<Motion>,
    agents: usize,
    gains: Vec<[f64; 2]>,
    /// Pairs that may touch, the first an agent, and the sum of their radii.
    pairs: Vec<(usize, usize, f64)>,
    forces: Vec<Vector>,
    integration: Integration,
}

impl World {
    /// Bodies at rest at the origin, of which the first `agents` move.
    #[must_use]
    pub fn new(bodies: Vec<Body>, agents: usize, rules: Rules) -> Self {
        let touch = |a: usize, b: usize| bodies[a].collides && bodies[b].collides;
        let others = |a: usize| {
            (a + 1..bodies.len())
                .filter(move |b| touch(a, *b))
                .map(move |b| (a, b))
        };
        let pairs = (0..agents).flat_map(others);
        Self {
            pairs: pairs
                .map(|(a, b)| (a, b, bodies[a].radius + bodies[b].radius))
                .collect(),
            gains: bodies[..agents].iter().map(|body| gains(body, rules)).collect(),
            forces: vec![[0.0; 2]; agents],
            motions: vec![Motion::default(); bodies.len()],
            integration: rules.integration,
            agents,
            bodies,
        }
    }

    /// Motions of all bodies, agents first.
    #[must_use]
    pub fn motions(&self) -> &[Motion] {
        &self.motions
    }

    /// Motions of all bodies, to be set.
    pub fn motions_mut(&mut self) -> &mut [Motion] {
        &mut self.motions
    }

    /// Motions of the agents.
    #[must_use]
    pub fn agents(&self) -> &[Motion] {
        &self.motions[..self.agents]
    }

    /// Motions of the landmarks, which never move.
    #[must_use]
    pub fn landmarks(&self) -> &[Motion] {
        &self.motions[self.agents..]
    }

    /// Distance between the centres of two bodies.
    #[must_use]
    pub fn distance(&self, a: usize, b: usize) -> f64 {
        length(difference(self.motions[a].position, self.motions[b].position))
    }

    /// Whether two bodies overlap; a body overlaps itself.
    #[must_use]
    pub fn touching(&self, a: usize, b: usize) -> bool {
        self.distance(a, b) < self.bodies[a].radius + self.bodies[b].radius
    }

    /// Number of pairs of agents that overlap.
    #[must_use]
    pub fn touching_agents(&self) -> usize {
        let later = |a: usize| (a + 1..self.agents).filter(move |b| self.touching(a, *b)).count();
        (0..self.agents).map(later).sum()
    }

    /// Takes one step with one action per agent.
    pub fn step(&mut self, controls: &[Vector]) {
        self.press(controls);
        self.collide();
        for (agent, body) in self.bodies[..self.agents].iter().enumerate() {
            move_body(
                &mut self.motions[agent],
                self.forces[agent],
                body.top_speed,
                self.integration,
            );
        }
    }

    /// Sets the forces to those of the actions.
    fn press(&mut self, controls: &[Vector]) {
        for ((force, control), gains) in self.forces.iter_mut().zip(controls).zip(&self.gains) {
            *force = control.map(|entry| gains[1] * (entry * gains[0]));
        }
    }

    /// Adds the contact forces.
    fn collide(&mut self) {
        for &(a, b, reach) in &self.pairs {
            let force = contact(
                difference(self.motions[a].position, self.motions[b].position),
                reach,
            );
            self.forces[a] = sum(self.forces[a], force);
            if b < self.agents {
                self.forces[b] = difference(self.forces[b], force);
            }
        }
    }
}

/// Factors of an action: two of them, since multiplying by a product rounds once more.
fn gains(body: &Body, rules: Rules) -> [f64; 2] {
    const WITHOUT_ONE: f64 = 5.0;
    match body.acceleration {
        None => [WITHOUT_ONE, 1.0],
        Some(acceleration) => [
            acceleration,
            if rules.accelerates_twice {
                acceleration
            } else {
                1.0
            },
        ],
    }
}

/// Force on the first of two bodies, at the offset `apart` from the second; zero where they are at the same
/// place.
fn contact(apart: Vector, reach: f64) -> Vector {
    let distance = length(apart);
    let exponent = -(distance - reach) / CONTACT_MARGIN;
    if distance == 0.0 || exponent < SMALLEST_EXPONENT {
        return [0.0; 2];
    }
    let penetration = softplus(exponent) * CONTACT_MARGIN;
    apart.map(|entry| CONTACT_FORCE * entry / distance * penetration)
}

/// ln(1 + exp(x)) for any x.
fn softplus(x: f64) -> f64 {
    x.max(0.0) + ln_1p(exp(-x.abs()))
}

fn move_body(motion: &mut Motion, force: Vector, top_speed: Option<f64>, integration: Integration) {
    let before = motion.velocity;
    motion.velocity = sum(
        before.map(|entry| entry * (1.0 - DAMPING)),
        force.map(|entry| entry * TIME_STEP),
    );
    let speed = length(motion.velocity);
    if let Some(top_speed) = top_speed.filter(|top_speed| speed > *top_speed) {
        motion.velocity = motion.velocity.map(|entry| entry / speed * top_speed);
    }
    let moved_by = match integration {
        Integration::VelocityFirst => motion.velocity,
        Integration::PositionFirst => before,
    };
    motion.position = sum(motion.position, moved_by.map(|entry| entry * TIME_STEP));
}

fn sum(a: Vector, b: Vector) -> Vector {
    [a[0] + b[0], a[1] + b[1]]
}

pub(super) fn difference(a: Vector, b: Vector) -> Vector {
    [a[0] - b[0], a[1] - b[1]]
}

pub(super) fn length(vector: Vector) -> f64 {
    (vector[0] * vector[0] + vector[1] * vector[1]).sqrt()
}

#[cfg(test)]
mod tests {
    use super::super::rules::Variant;
    use super::*;
    use proptest::prelude::*;

    const DISC: Body = Body {
        radius: 0.15,
        collides: true,
        acceleration: None,
        top_speed: None,
    };

    fn world(positions: &[Vector], velocities: &[Vector], variant: Variant) -> World {
        let mut world = World::new(vec![DISC; positions.len()], positions.len(), variant.rules());
        for (motion, (position, velocity)) in world
            .motions_mut()
            .iter_mut()
            .zip(positions.iter().zip(velocities))
        {
            *motion = Motion {
                position: *position,
                velocity: *velocity,
            };
        }
        world
    }

    fn momentum(world: &World, axis: usize) -> f64 {
        world.agents().iter().map(|agent| agent.velocity[axis]).sum()
    }

    #[test]
    fn softplus_holds_far_from_zero() {
        assert_eq!(softplus(0.0), std::f64::consts::LN_2);
        assert_eq!((softplus(1e3), softplus(-1e3)), (1e3, 0.0));
        assert!((softplus(2.0) - (1.0 + 2f64.exp()).ln()).abs() < 1e-15);
    }

    /// Overlap by 0.1, far more than the width of the threshold: the force is 100 times 0.1.
    #[test]
    fn overlapping_discs_part() {
        let force = contact([0.2, 0.0], 0.3);
        assert!((force[0] - 10.0).abs() < 1e-12 && force[1] == 0.0);
        assert!((contact([0.3, 0.0], 0.3)[0] - 0.1 * std::f64::consts::LN_2).abs() < 1e-12);
        assert_eq!(contact([2.0, 1.0], 0.3), [0.0; 2]);
        assert_eq!(contact([1e300, 1e300], 0.3), [0.0; 2]);
    }

    #[test]
    fn bodies_at_the_same_place_exert_no_force() {
        let mut world = world(&[[0.3, 0.3]; 3], &[[0.0; 2]; 3], Variant::Thesis);
        world.step(&[[0.0; 2]; 3]);
        assert_eq!(
            world.motions(),
            [Motion {
                position: [0.3, 0.3],
                velocity: [0.0; 2]
            }; 3]
        );
        world.step(&[[1.0, 0.0], [0.0; 2], [0.0; 2]]);
        world.step(&[[0.0; 2]; 3]);
        assert!(
            world
                .motions()
                .iter()
                .all(|motion| motion.position.iter().all(|entry| entry.is_finite()))
        );
        assert!(
            world.agents()[0].velocity[0] > 0.5 && world.agents()[1].velocity[0] < 0.0,
            "{:?}",
            world.motions()
        );
    }

    /// A constant force F leads to the speed 0.1 F / 0.25.
    #[test]
    fn speeds_become_steady() {
        let fast = Body {
            acceleration: Some(4.0),
            ..DISC
        };
        for (body, variant, speed) in [
            (DISC, Variant::Thesis, 2.0),
            (fast, Variant::Openai, 1.6),
            (fast, Variant::Thesis, 6.4),
            (
                Body {
                    top_speed: Some(1.3),
                    ..fast
                },
                Variant::Mpe2,
                1.3,
            ),
        ] {
            let mut world = World::new(vec![body], 1, variant.rules());
            (0..200).for_each(|_| world.step(&[[0.0, -1.0]]));
            assert!(
                (world.agents()[0].velocity[1] + speed).abs() < 1e-12,
                "{variant:?}"
            );
        }
    }

    proptest! {
        #[test]
        fn contacts_conserve_momentum(
            positions in prop::collection::vec([-0.4_f64..0.4, -0.4_f64..0.4], 4),
            velocities in prop::collection::vec([-1.0_f64..1.0, -1.0_f64..1.0], 4),
            variant in prop::sample::select(vec![Variant::Thesis, Variant::Openai, Variant::Mpe2]),
        ) {
            let mut world = world(&positions, &velocities, variant);
            let before = [momentum(&world, 0), momentum(&world, 1)];
            world.step(&[[0.0; 2]; 4]);
            for (axis, before) in before.into_iter().enumerate() {
                prop_assert!((momentum(&world, axis) - (1.0 - DAMPING) * before).abs() < 1e-12);
            }
        }
    }
}
