//! The known health of a string: counted wear, and the extended Kalman filter that corrects it after a flight.
//!
//! | symbol | here | unit |
//! |---|---|---|
//! | theta = (q, r) | `q_mobile_c`, `r_ohm`: capacity and resistance | C, ohm |
//! | P | `covariance`: variance of q, covariance, variance of r | |
//! | c | charge that has passed | C |
//! | kappa | wear per charge of an average string, `(q_mobile_rate, r_rate)` | |
//! | s | standard deviation of the factors of wear ([`UavFleetConfig::wear_variance`]) | |
//! | y, h(theta) | voltages read at the decisions of a flight, and computed from the currents of the flight | V
//! |
//!
//! *Counting*: theta' = theta + kappa c, P' = P + s^2 c^2 kappa kappa'. Without the module nothing else is
//! done: every string is treated as an average one, though its charge is known.
//!
//! *Calibration* after a flight: one measurement of all voltages,
//! `A = P^-1 + H' H / rho^2`, `theta = theta_0 + A^-1 H' (y - h(theta_k) + H (theta_k - theta_0)) / rho^2`, with the
//! Jacobian H by differences at theta_k; theta_k is theta_0 at first, and the result is taken as theta_1 once
//! more where it lies far away (the iterated filter). rho^2 is the variance of the sensors' noise and that of the
//! model: (2 mV)^2, for wear within the flight that is not average.
//!
//! The filter computes the cell of [`battery`](crate::battery) with the currents and steps of the flight, from
//! full, with the diffusion of a new cell, and with average wear. It knows neither the factor of a string nor
//! the differences of new strings, only their spreads. An estimate is of the time before the flight.

use super::config::UavFleetConfig;
use super::string::STRINGS;
use crate::battery::{AgeingRates, Cell, CellParameters, Physics, State};
use serde::{Deserialize, Serialize};

/// Standard deviation of the model error of a flight, V.
const MODEL_V: f64 = 2e-3;
/// Finite differences of capacity, C, and resistance, ohm, for the Jacobian.
const DIFFERENCES: [f64; 2] = [20.0, 1e-3];
/// Largest correction, C and ohm, that is not repeated from its result.
const FAR: [f64; 2] = [200.0, 5e-3];

/// The physics of all cells: those of the `battery` environment's defaults.
pub const PHYSICS: Physics = Physics {
    thermal: false,
    mole_fraction_margin: 1e-3,
};

/// Estimated health of a string.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// Capacity, C.
    pub q_mobile_c: f64,
    /// Resistance, ohm.
    pub r_ohm: f64,
    /// Variance of the capacity, covariance, variance of the resistance.
    covariance: [f64; 3],
}

/// Record of a pack in a flight.
#[derive(Debug, Clone, Default)]
pub struct FlightLog {
    /// Length of each step, s, and the currents in it, A.
    pub steps: Vec<(f64, [f64; STRINGS])>,
    /// Number of steps before each reading of the voltages, and these, V.
    pub readings: Vec<(usize, [f64; STRINGS])>,
}

/// The normal equations of a fit.
#[derive(Debug, Clone, Copy, Default)]
struct NormalEquations {
    /// H' H.
    square: [f64; 3],
    /// H' (y - h).
    residual: [f64; 2],
}

impl Estimate {
    /// The estimate of a new string: that of an average one.
    #[must_use]
    pub fn of_new(config: &UavFleetConfig) -> Self {
        let fresh = CellParameters::FRESH;
        // The variance of a uniform number; never zero, so that the covariance can be inverted.
        let variance = |value: f64| {
            let spread = value * config.new_spread.max(1e-6);
            spread * spread / 3.0
        };
        Self {
            q_mobile_c: fresh.q_mobile_c,
            r_ohm: fresh.r_ohm,
            covariance: [variance(fresh.q_mobile_c), 0.0, variance(fresh.r_ohm)],
        }
    }

    /// Counts the wear by a charge.
    pub fn wear(&mut self, config: &UavFleetConfig, charge_c: f64) {
        let (dq, dr) = (
            config.ageing.q_mobile_rate * charge_c,
            config.ageing.r_rate * charge_c,
        );
        let variance = config.wear_variance();
        // A capacity that is counted down past the range of the model is no longer that of a cell.
        self.q_mobile_c = (self.q_mobile_c + dq).max(500.0);
        self.r_ohm += dr;
        let [qq, qr, rr] = self.covariance;
        self.covariance = [
            qq + variance * dq * dq,
            qr + variance * dq * dr,
            rr + variance * dr * dr,
        ];
    }

    /// Corrects the estimate of string `string` by the readings of a flight.
    pub fn correct(&mut self, config: &UavFleetConfig, log: &FlightLog, string: usize) {
        if log.readings.is_empty() {
            return;
        }
        let once = self.corrected(config, log, string, *self);
        let moved = [once.q_mobile_c - self.q_mobile_c, once.r_ohm - self.r_ohm];
        let is_far = moved.iter().zip(FAR).any(|(moved, far)| moved.abs() > far);
        *self = if is_far {
            self.corrected(config, log, string, once)
        } else {
            once
        };
    }

    /// The correction with the Jacobian at `at`.
    fn corrected(&self, config: &UavFleetConfig, log: &FlightLog, string: usize, at: Self) -> Self {
        let normal = NormalEquations::at(config, &at, log, string);
        let noise_v = config.sensor_noise_v;
        let weight = 1.0 / (noise_v * noise_v / 3.0 + MODEL_V * MODEL_V);
        let [qq, qr, rr] = self.covariance;
        let prior = 1.0 / (qq * rr - qr * qr);
        let [aqq, aqr, arr] = [
            rr * prior + weight * normal.square[0],
            -qr * prior + weight * normal.square[1],
            qq * prior + weight * normal.square[2],
        ];
        let step = [at.q_mobile_c - self.q_mobile_c, at.r_ohm - self.r_ohm];
        let [hqq, hqr, hrr] = normal.square;
        let b = [
            weight * (normal.residual[0] + hqq * step[0] + hqr * step[1]),
            weight * (normal.residual[1] + hqr * step[0] + hrr * step[1]),
        ];
        let determinant = aqq * arr - aqr * aqr;
        let new = within_limits(
            self.q_mobile_c + (arr * b[0] - aqr * b[1]) / determinant,
            self.r_ohm + (aqq * b[1] - aqr * b[0]) / determinant,
        );
        Self {
            q_mobile_c: new[0],
            r_ohm: new[1],
            covariance: [arr / determinant, -aqr / determinant, aqq / determinant],
        }
    }

    fn parameters(&self) -> CellParameters {
        CellParameters::aged(self.q_mobile_c, self.r_ohm)
    }
}

/// Clamps a correction to possible values of a cell.
fn within_limits(q_mobile_c: f64, r_ohm: f64) -> [f64; 2] {
    let fresh = CellParameters::FRESH;
    [
        q_mobile_c.clamp(500.0, 2.0 * fresh.q_mobile_c),
        r_ohm.clamp(0.1 * fresh.r_ohm, 20.0 * fresh.r_ohm),
    ]
}

impl NormalEquations {
    fn at(config: &UavFleetConfig, estimate: &Estimate, log: &FlightLog, string: usize) -> Self {
        let parameters = estimate.parameters();
        let of = |parameters| voltages(&config.ageing, parameters, log, string);
        let middle = of(parameters);
        let [dq, dr] = DIFFERENCES;
        let more_q = CellParameters {
            q_mobile_c: parameters.q_mobile_c + dq,
            ..parameters
        };
        let more_r = CellParameters {
            r_ohm: parameters.r_ohm + dr,
            ..parameters
        };
        let (by_q, by_r) = (of(more_q), of(more_r));
        let mut normal = Self::default();
        for (k, (_, read)) in log.readings.iter().enumerate() {
            let (hq, hr) = ((by_q[k] - middle[k]) / dq, (by_r[k] - middle[k]) / dr);
            let residual = read[string] - middle[k];
            normal.square[0] += hq * hq;
            normal.square[1] += hq * hr;
            normal.square[2] += hr * hr;
            normal.residual[0] += hq * residual;
            normal.residual[1] += hr * residual;
        }
        normal
    }
}

/// Voltages at the readings of a flight for a cell with these initial parameters, V.
fn voltages(ageing: &AgeingRates, parameters: CellParameters, log: &FlightLog, string: usize) -> Vec<f64> {
    let mut cell = Cell::new(parameters, PHYSICS);
    cell.place(State::rested(&parameters, 1.0), 0.0);
    let mut done = 0;
    let one = |(after, _): &(usize, [f64; STRINGS])| {
        for (step_s, currents) in &log.steps[done..*after] {
            cell.draw_current(currents[string], *step_s);
            cell.wear(ageing, *step_s);
        }
        done = *after;
        cell.voltage_v()
    };
    log.readings.iter().map(one).collect()
}
