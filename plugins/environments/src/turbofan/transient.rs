//! The shafts' motion: surplus power accelerates them.
//!
//! `J omega domega/dt = P`, with J the moment of inertia of a shaft, omega its speed and P the power of its
//! turbine less that of its loads. Within a step the gas is in equilibrium with the speeds, since it follows
//! them a hundred times faster.

use super::cycle::{Engine, N, Point, SPEEDS};
use super::solver::{ConvergenceFailure, Operation};
use std::f64::consts::PI;

impl Engine {
    /// Lets the shafts accelerate for a time from the speeds in `unknowns`, by Heun's method in steps of at
    /// most `step_s`. `from` is the operation that `unknowns` solve. Returns the final point.
    ///
    /// # Errors
    /// [`ConvergenceFailure`] where the gas finds no equilibrium on the way.
    pub(super) fn accelerate(
        &self,
        from: &Operation,
        to: &Operation,
        unknowns: &mut [f64; N],
        (time_s, step_s): (f64, f64),
    ) -> Result<Point<f64>, ConvergenceFailure> {
        let n_steps = (time_s / step_s).ceil().max(1.0);
        let step = time_s / n_steps;
        let mut speeds = SPEEDS.map(|place| unknowns[place]);
        let mut operation = Operation {
            speeds: Some(speeds),
            ..*from
        };
        let mut rates = |speeds: [f64; 2], unknowns: &mut [f64; N]| {
            let next = Operation {
                speeds: Some(speeds),
                ..*to
            };
            let point = self.solve_from(&operation, &next, unknowns)?;
            operation = next;
            Ok((self.relative_acceleration(&point, unknowns), point))
        };
        let mut last = rates(speeds, unknowns)?;
        for _ in 0..n_steps as usize {
            let there = |by: [f64; 2]| [0, 1].map(|shaft| speeds[shaft] + step * by[shaft]);
            let (ahead, _) = rates(there(last.0), unknowns)?;
            speeds = there([0, 1].map(|shaft| (last.0[shaft] + ahead[shaft]) / 2.0));
            last = rates(speeds, unknowns)?;
        }
        Ok(last.1)
    }

    /// Acceleration of the shafts, rpm/s.
    pub(super) fn acceleration_rpm_s(&self, point: &Point<f64>, unknowns: &[f64; N]) -> [f64; 2] {
        let [n1, n2] = self.relative_acceleration(point, unknowns);
        [n1 * self.design.n1_rpm, n2 * self.design.n2_rpm]
    }

    /// Acceleration of the shafts relative to their design speeds, 1/s.
    fn relative_acceleration(&self, point: &Point<f64>, unknowns: &[f64; N]) -> [f64; 2] {
        let design = &self.design;
        let inertia = [design.inertia.0, design.inertia.1];
        let design_rpm = [design.n1_rpm, design.n2_rpm];
        [0, 1].map(|shaft| {
            let per_relative = design_rpm[shaft] * 2.0 * PI / 60.0;
            let omega = unknowns[SPEEDS[shaft]] * per_relative;
            point.surplus_power[shaft] / (inertia[shaft] * omega * per_relative)
        })
    }
}
