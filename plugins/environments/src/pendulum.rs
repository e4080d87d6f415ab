//! A rod on a pivot, to be swung up and held upright: `Pendulum-v1` of Gymnasium (Farama Foundation, MIT
//! licence).
//!
//! | symbol | here | range |
//! |---|---|---|
//! | theta | `angle` from upright, in rad; wrapped to [-pi, pi] in observations and costs | |
//! | theta' | `speed`, rad/s, cut to [-8, 8] after every step | [-8, 8] |
//! | u | torque, 2 N m times `unit_torque` | [-2, 2] |
//! | g, m, l | `gravity`, `mass`, `length` | above 0 |
//! | dt | `time_step` | |
//!
//! theta'' = 3 g / (2 l) sin(theta) + 3 / (m l^2) u, stepped as speed first, then the angle with the new
//! speed (semi-implicit Euler). The reward of a step is minus the cost theta^2 + 0.1 theta'^2 + 0.001 u^2 of
//! the state before it, so that it is 0 at most, and 0 only where the rod stands still upright. Every episode
//! is cut off after `episode_limit` steps; none terminates. It starts with theta uniform in [-pi, pi) and
//! theta' uniform in [-1, 1).
//!
//! Departure: the torque is given as a fraction of the largest one, since agents act within -1 and 1.

use crate::unit_box::{self, LimitExcess};
use arithmetic::trigonometry::{cos, sin};
use contract::{Channel, End, Environment, Error, Metric, PerEpisode, Rng, Seat, Space, Step};
use rand::Rng as _;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// The largest torque, in N m.
pub const LARGEST_TORQUE: f64 = 2.0;
/// The largest speed, in rad/s.
pub const LARGEST_SPEED: f64 = 8.0;

/// Settings of the `pendulum` environment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct PendulumConfig {
    /// Acceleration of gravity.
    #[schemars(range(min = 0.0, max = 100.0), extend("x-unit" = "m/s^2", "x-source" = "Gymnasium"))]
    pub gravity: f64,
    /// Mass of the rod.
    #[schemars(range(min = 0.001, max = 1000.0), extend("x-unit" = "kg", "x-source" = "Gymnasium"))]
    pub mass: f64,
    /// Length of the rod.
    #[schemars(range(min = 0.001, max = 1000.0), extend("x-unit" = "m", "x-source" = "Gymnasium"))]
    pub length: f64,
    /// Time between two decisions.
    #[schemars(range(min = 1e-6, max = 1.0), extend("x-unit" = "s", "x-source" = "Gymnasium"))]
    pub time_step: f64,
    /// Steps after which an episode is truncated.
    #[schemars(range(min = 1), extend("x-unit" = "steps", "x-source" = "Gymnasium"))]
    pub episode_limit: u64,
}

impl Default for PendulumConfig {
    fn default() -> Self {
        Self {
            gravity: 10.0,
            mass: 1.0,
            length: 1.0,
            time_step: 0.05,
            episode_limit: 200,
        }
    }
}

impl contract::Config for PendulumConfig {}

impl PendulumConfig {
    /// theta'' in rad/s^2 at an angle in rad under a torque in N m.
    fn acceleration(&self, angle: f64, torque: f64) -> f64 {
        let Self {
            gravity,
            mass,
            length,
            ..
        } = self;
        3.0 * gravity / (2.0 * length) * sin(angle) + 3.0 / (mass * length * length) * torque
    }
}

/// The `pendulum` environment.
#[derive(Debug)]
pub struct Pendulum {
    config: PendulumConfig,
    seats: Vec<Seat>,
    metrics: Vec<Metric>,
    motion: Motion,
}

/// State of an episode.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Motion {
    angle: f64,
    speed: f64,
    /// The last torque, N m; `None` before the first step.
    torque: Option<f64>,
    steps: u64,
}

/// Builds the environment; registered as `pendulum`.
///
/// # Errors
/// [`Error::Config`] for a quantity that is not a finite number above 0.
pub fn build(config: PendulumConfig) -> Result<Box<dyn Environment>, Error> {
    let PendulumConfig {
        gravity,
        mass,
        length,
        time_step,
        ..
    } = config;
    for (key, value) in [("mass", mass), ("length", length), ("time_step", time_step)] {
        if !value.is_finite() || value <= 0.0 {
            return Err(Error::config(
                key,
                format!("{value} is no quantity above 0; write one, as in 1.0"),
            ));
        }
    }
    if !gravity.is_finite() {
        return Err(Error::config("gravity", format!("{gravity} is not finite")));
    }
    Ok(Box::new(Pendulum::new(config)))
}

impl Pendulum {
    fn new(config: PendulumConfig) -> Self {
        let seat = Seat {
            name: String::new(),
            observation: Space::Box(vec![
                Channel::new("cosine", "").within(-1.0, 1.0).typical(0.0, 0.7),
                Channel::new("sine", "").within(-1.0, 1.0).typical(0.0, 0.7),
                speed_channel(),
            ]),
            action: Space::Box(vec![
                Channel::new("unit_torque", "")
                    .within(-1.0, 1.0)
                    .typical(0.0, 0.6),
            ]),
        };
        let mean = |name, unit, about| {
            Metric::new(name, unit, about)
                .lower_is_better()
                .per_episode(PerEpisode::Mean)
        };
        Self {
            config,
            seats: vec![seat],
            metrics: vec![
                mean("tilt", "rad", "size of the angle from upright after each step"),
                mean(
                    "torque_change",
                    "N m",
                    "size of the difference to the torque before; 0 at the first step",
                ),
            ],
            motion: Motion {
                angle: 0.0,
                speed: 0.0,
                torque: None,
                steps: 0,
            },
        }
    }

    fn observe(&self) -> Vec<Vec<f64>> {
        let Motion { angle, speed, .. } = self.motion;
        vec![vec![cos(angle), sin(angle), speed]]
    }

    /// Cost of the present state and a torque.
    fn cost(&self, torque: f64) -> f64 {
        let Motion { angle, speed, .. } = self.motion;
        let tilt = wrapped(angle);
        tilt * tilt + 0.1 * speed * speed + 0.001 * torque * torque
    }

    /// Takes a step of the semi-implicit Euler scheme: the angle follows the new speed.
    fn advance(&mut self, torque: f64) {
        let Self { config, motion, .. } = self;
        let speed = motion.speed + config.acceleration(motion.angle, torque) * config.time_step;
        motion.speed = speed.clamp(-LARGEST_SPEED, LARGEST_SPEED);
        motion.angle += motion.speed * config.time_step;
        motion.torque = Some(torque);
        motion.steps += 1;
    }
}

fn speed_channel() -> Channel {
    Channel::new("speed", "rad/s")
        .within(-LARGEST_SPEED, LARGEST_SPEED)
        .typical(0.0, 3.0)
}

/// The same direction, in [-pi, pi].
fn wrapped(angle: f64) -> f64 {
    (angle + PI).rem_euclid(2.0 * PI) - PI
}

impl Environment for Pendulum {
    fn seats(&self) -> &[Seat] {
        &self.seats
    }

    fn metrics(&self) -> &[Metric] {
        &self.metrics
    }

    fn reset(&mut self, rng: &mut Rng) -> Result<Vec<Vec<f64>>, Error> {
        let angle = rng.random_range(-PI..PI);
        let speed = rng.random_range(-1.0..1.0);
        self.motion = Motion {
            angle,
            speed,
            torque: None,
            steps: 0,
        };
        Ok(self.observe())
    }

    fn step(&mut self, actions: &[Vec<f64>], _rng: &mut Rng) -> Result<Step, Error> {
        unit_box::check_seats(actions, 1)?;
        let [part] = unit_box::checked(&actions[0], 0, ["unit_torque"], LimitExcess::Refused)?;
        let torque = LARGEST_TORQUE * part;
        let cost = self.cost(torque);
        let change = self.motion.torque.map_or(0.0, |before| (torque - before).abs());
        self.advance(torque);
        let end = (self.motion.steps >= self.config.episode_limit).then_some(End::Truncated);
        Ok(Step::new(self.observe(), vec![-cost], end)
            .record("tilt", wrapped(self.motion.angle).abs())
            .record("torque_change", change))
    }

    fn state_channels(&self) -> Vec<Channel> {
        let angle = Channel::new("angle", "rad").within(-PI, PI).typical(0.0, 1.8);
        vec![angle, speed_channel()]
    }

    fn state(&self) -> Vec<f64> {
        vec![wrapped(self.motion.angle), self.motion.speed]
    }

    fn trace_channels(&self) -> Vec<Channel> {
        let torque = Channel::new("torque", "N m").within(-LARGEST_TORQUE, LARGEST_TORQUE);
        [Channel::new("t", "s")]
            .into_iter()
            .chain(self.state_channels())
            .chain([torque])
            .collect()
    }

    fn trace(&self) -> Vec<f64> {
        #[allow(
            clippy::cast_precision_loss,
            reason = "an episode has far fewer than 2^52 steps"
        )]
        let t = self.motion.steps as f64 * self.config.time_step;
        [t].into_iter()
            .chain(self.state())
            .chain([self.motion.torque.unwrap_or(f64::NAN)])
            .collect()
    }

    fn snapshot(&self) -> serde_json::Value {
        // A plain struct of finite numbers: serde_json refuses only maps whose keys are no strings.
        serde_json::to_value(self.motion).expect("a motion serialises")
    }

    fn restore(&mut self, snapshot: &serde_json::Value) -> Result<(), Error> {
        self.motion = Motion::deserialize(snapshot).map_err(|source| Error::Checkpoint {
            what: "pendulum",
            problem: source.to_string(),
        })?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn at(config: PendulumConfig, angle: f64, speed: f64) -> Pendulum {
        let mut pendulum = Pendulum::new(config);
        pendulum.motion.angle = angle;
        pendulum.motion.speed = speed;
        pendulum
    }

    fn step(pendulum: &mut Pendulum, part: f64) -> Step {
        pendulum
            .step(&[vec![part]], &mut contract::random::stream(&[]))
            .unwrap()
    }

    fn close(found: &[f64], expected: &[f64]) {
        let near = |(a, b): (&f64, &f64)| (a - b).abs() < 1e-12;
        assert!(
            found.len() == expected.len() && found.iter().zip(expected).all(near),
            "{found:?} {expected:?}"
        );
    }

    /// From theta = pi / 6 and theta' = 0.5 with u = 2: theta'' = 15 / 2 + 6 = 13.5, theta' = 0.5 + 0.675,
    /// theta = pi / 6 + 1.175 / 20. Then without torque.
    #[test]
    fn two_steps_by_hand() {
        let mut pendulum = at(PendulumConfig::default(), PI / 6.0, 0.5);
        let first = step(&mut pendulum, 1.0);
        let angle = PI / 6.0 + 0.05875;
        close(&first.rewards, &[-((PI / 6.0).powi(2) + 0.025 + 0.004)]);
        close(&first.observations[0], &[angle.cos(), angle.sin(), 1.175]);
        let metrics = ["tilt", "torque_change"].map(|metric| first.metric(metric).unwrap());
        close(&metrics, &[angle, 0.0]);
        let second = step(&mut pendulum, 0.0);
        close(&second.rewards, &[-(angle * angle + 0.1 * 1.175 * 1.175)]);
        close(
            &pendulum.state(),
            &[
                angle + 0.05 * (1.175 + 0.75 * angle.sin()),
                1.175 + 0.75 * angle.sin(),
            ],
        );
        let metrics = ["tilt", "torque_change"].map(|metric| second.metric(metric).unwrap());
        close(&metrics, &[pendulum.state()[0], 2.0]);
        close(&[pendulum.trace()[0], pendulum.trace()[3]], &[0.1, 0.0]);
    }

    /// m = 2, l = 0.5 and g = 4 from rest at pi / 2 with u = -1: theta'' = 12 - 6.
    #[test]
    fn mass_length_and_gravity_by_hand() {
        let config = PendulumConfig {
            gravity: 4.0,
            mass: 2.0,
            length: 0.5,
            ..PendulumConfig::default()
        };
        let mut pendulum = at(config, PI / 2.0, 0.0);
        step(&mut pendulum, -0.5);
        close(&pendulum.state(), &[PI / 2.0 + 0.05 * 0.3, 0.3]);
    }

    /// Beyond half a turn the cost is that of the shorter way, and speed is cut before the angle moves.
    #[test]
    fn the_angle_is_wrapped_and_the_speed_is_cut() {
        let mut pendulum = at(PendulumConfig::default(), 3.0 + 2.0 * PI, 7.9);
        let taken = step(&mut pendulum, 1.0);
        close(&taken.rewards, &[-(9.0 + 0.1 * 7.9 * 7.9 + 0.004)]);
        close(&pendulum.state(), &[3.4 - 2.0 * PI, 8.0]);
        assert_eq!(wrapped(PI), -PI);
    }

    /// Kinetic and potential energy per moment of inertia: theta'^2 / 2 + 3 g / (2 l) cos(theta).
    fn energy(pendulum: &Pendulum) -> f64 {
        let Motion { angle, speed, .. } = pendulum.motion;
        speed * speed / 2.0 + 15.0 * angle.cos()
    }

    /// The largest deviation from the first energy over 20 s without torque, and the mean over the second
    /// half.
    fn drift(time_step: f64) -> (f64, f64) {
        let config = PendulumConfig {
            time_step,
            ..PendulumConfig::default()
        };
        let mut pendulum = at(config, 2.0, 0.0);
        let start = energy(&pendulum);
        let n = (20.0 / time_step).round() as usize;
        let deviations: Vec<f64> = (0..n)
            .map(|_| {
                pendulum.advance(0.0);
                energy(&pendulum) - start
            })
            .collect();
        let largest = deviations.iter().fold(0.0_f64, |most, d| most.max(d.abs()));
        let late = &deviations[n / 2..];
        (largest, late.iter().sum::<f64>() / late.len() as f64)
    }

    /// Semi-implicit Euler keeps a nearby energy: its deviation swings, shrinks with the step, and does not
    /// grow with time. The explicit method gains energy without end.
    #[test]
    fn without_torque_energy_swings_and_does_not_drift() {
        let [(coarse, late), (fine, _)] = [0.004, 0.002].map(drift);
        assert!(
            (coarse / fine - 2.0).abs() < 0.05,
            "of first order: {coarse} {fine}"
        );
        assert!(late.abs() < 0.1 * coarse, "{late} of {coarse}");
    }

    #[test]
    fn an_episode_is_cut_off_and_starts_anywhere() {
        let config = PendulumConfig {
            episode_limit: 3,
            ..PendulumConfig::default()
        };
        let mut pendulum = Pendulum::new(config);
        let mut rng = contract::random::stream(&["pendulum"]);
        let mut starts = Vec::new();
        for _ in 0..200 {
            pendulum.reset(&mut rng).unwrap();
            starts.push(pendulum.state());
            let ends: Vec<_> = (0..3).map(|_| step(&mut pendulum, 0.3).end).collect();
            assert_eq!(ends, [None, None, Some(End::Truncated)]);
        }
        let spread = |of: usize, limit: f64| {
            let seen = starts.iter().map(|start| start[of] / limit);
            seen.clone().all(|part| (-1.0..1.0).contains(&part))
                && seen.clone().any(|part| part < -0.8)
                && seen.clone().any(|part| part > 0.8)
        };
        assert!(spread(0, PI) && spread(1, 1.0));
    }

    #[test]
    fn an_invalid_torque_or_rod_is_refused() {
        let mut pendulum = at(PendulumConfig::default(), 0.0, 0.0);
        let mut rng = contract::random::stream(&[]);
        for actions in [
            vec![],
            vec![vec![1.1]],
            vec![vec![f64::NAN]],
            vec![vec![0.0, 0.0]],
        ] {
            assert!(matches!(
                pendulum.step(&actions, &mut rng),
                Err(Error::Action { .. })
            ));
        }
        let refusal = build(PendulumConfig {
            length: 0.0,
            ..PendulumConfig::default()
        });
        let text = refusal.err().unwrap().to_string();
        assert!(text.contains("`length`: 0 is no quantity above 0"), "{text}");
        assert!(matches!(
            pendulum.restore(&serde_json::json!({ "angle": 1.0 })),
            Err(Error::Checkpoint { what: "pendulum", .. })
        ));
    }

    proptest! {
        #[test]
        fn costs_are_never_negative(angle in -50.0_f64..50.0, speed in -8.0_f64..8.0, part in -1.0_f64..1.0) {
            let mut pendulum = at(PendulumConfig::default(), angle, speed);
            let taken = step(&mut pendulum, part);
            prop_assert!(taken.rewards[0] <= 0.0 && taken.rewards[0] >= -(PI * PI + 6.4 + 0.004));
        }
    }
}
