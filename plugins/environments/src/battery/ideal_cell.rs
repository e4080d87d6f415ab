//! A cell that survives every power that a real cell with the same charge survives: the yardstick of
//! [`LifeBound`](super::life_bound).
//!
//! It has the electrodes and the resistance of the real cell, begins a decision at rest and has no
//! overpotentials at its surfaces. Let x be the mean mole fraction of the negative electrode, d the amount by
//! which the surface lies below the mean, U the voltage at rest, R the resistance and i = p / V the current of
//! a power p. Then
//!
//! `V = U(x - d) - Vo`, `x' = x - i dt / q`, `d' = (1 - b dt) d + 9 i dt / q`, `Vo' = (1 - dt / t_o) Vo + (dt
//! / t_o) R i`,
//!
//! which are the equations of [`model`](super::model) in other coordinates: the positive electrode mirrors
//! the negative one, b is the sum of the diffusion rates of bulk and surface layer, and a surface layer of a
//! tenth of the volume loses mole fraction ten times as fast as the mean.
//!
//! **Why no real cell carries more.** Call a state better where x is larger, d and Vo are smaller. At equal
//! power one step keeps this order: U rises with x, so the better cell has the higher voltage and draws no
//! more current, and every update above rises with its own entry and falls (x) or rises (d, Vo) with the
//! current, as long as `b dt` and `dt / t_o` are at most 1. A real cell that was only discharged has d, Vo
//! and overpotentials of at least 0, so the ideal cell at rest with the same x is no worse at the start of a
//! decision, hence no worse at its end: a power that takes the ideal cell to its end of discharge takes the
//! real one there too. A cell that collapses within a decision is out: as its voltage falls its power draws
//! ever more current, and it does not come back before the end (a test checks it at random).

use super::cell::LOWEST_SUPPLY_V;
use super::model::{BULK_VOLUME, SURFACE_VOLUME, resting_voltage};
use super::parameters::{CellParameters, MOLE_FRACTION_N_MAX, SURFACE_FRACTION, TIME_OHMIC_S};

/// Rate at which the surface layer loses mole fraction, relative to the mean, less one.
const SURFACE_EXCESS: f64 = (1.0 - SURFACE_FRACTION) / SURFACE_FRACTION;
/// Most steps of a decision that are computed: the voltage falls from step to step, so that fewer steps only
/// make the ideal cell better.
const MOST_STEPS: usize = 256;
/// Relative width of the bracket at the end of the search for a power.
const BRACKET: f64 = 1e-3;

/// Duration of decisions, and the voltage that ends them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Decisions {
    /// Length of a step, s.
    pub step_s: f64,
    /// Steps of a decision.
    pub steps: usize,
    /// Voltage at or below which a cell is at its end, V.
    pub end_v: f64,
    /// Mole fraction at which the surface counts as empty.
    pub empty: f64,
}

/// The ideal cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IdealCell {
    decisions: Decisions,
    /// Change of the mean mole fraction per coulomb.
    fraction_per_c: f64,
    r_ohm: f64,
    /// Parts of the depletion and of the ohmic drop's distance to its target that go in one step.
    mixing: f64,
    settling: f64,
}

impl IdealCell {
    /// The ideal cell for a cell with `parameters`; `None` where the steps are too long for the argument in the
    /// header.
    #[must_use]
    pub fn new(parameters: &CellParameters, decisions: Decisions) -> Option<Self> {
        let mixing = decisions.step_s * (1.0 / BULK_VOLUME + 1.0 / SURFACE_VOLUME) / parameters.t_diffusion;
        let settling = decisions.step_s / TIME_OHMIC_S;
        let fraction_per_c = MOLE_FRACTION_N_MAX / parameters.q_mobile_c;
        (mixing <= 1.0 && settling <= 1.0).then_some(Self {
            decisions,
            fraction_per_c,
            r_ohm: parameters.r_ohm,
            mixing,
            settling,
        })
    }

    /// Least power, to one part in a thousand, that takes the cell from rest at mean mole fraction `x` to its
    /// end within one decision, W. `near_w` is the beginning of the search.
    #[must_use]
    pub fn fatal_power_w(&self, x: f64, near_w: f64) -> f64 {
        let reserve = |power_w: f64| self.voltage_after(x, power_w) - self.decisions.end_v;
        let at_rest = resting_voltage(x) - self.decisions.end_v;
        if at_rest <= 0.0 {
            return 0.0;
        }
        let (mut low, mut high) = ((0.0, at_rest), (near_w.max(0.1), reserve(near_w.max(0.1))));
        while high.1 > 0.0 {
            // The fall of the voltage is convex in the power: a straight line through both points reaches the
            // end too late.
            let power_w = high.0 * (at_rest / (at_rest - high.1)).max(1.0 + BRACKET);
            (low, high) = (high, (power_w, reserve(power_w)));
        }
        // Regula falsi; halving the value of an end that stays (Illinois) speeds up its convergence.
        while high.0 - low.0 > BRACKET * high.0 {
            let power_w = low.0 + (high.0 - low.0) * low.1 / (low.1 - high.1);
            let found = reserve(power_w);
            if found > 0.0 {
                (low, high.1) = ((power_w, found), 0.5 * high.1);
            } else {
                (high, low.1) = ((power_w, found), 0.5 * low.1);
            }
            if found == 0.0 {
                break;
            }
        }
        high.0
    }

    /// Voltage after one decision at `power_w` from rest at mean mole fraction `x`, V; 0 for a cell that
    /// collapses.
    #[must_use]
    pub fn voltage_after(&self, x: f64, power_w: f64) -> f64 {
        let (mut mean, mut depletion, mut ohmic_v) = (x, 0.0, 0.0);
        let mut voltage_v = resting_voltage(x);
        for _ in 0..self.decisions.steps.min(MOST_STEPS) {
            let current_a = power_w / voltage_v;
            let moved = current_a * self.decisions.step_s * self.fraction_per_c;
            mean -= moved;
            depletion += SURFACE_EXCESS * moved - self.mixing * depletion;
            ohmic_v += self.settling * (self.r_ohm * current_a - ohmic_v);
            let surface = mean - depletion;
            if surface <= self.decisions.empty {
                return 0.0;
            }
            voltage_v = resting_voltage(surface) - ohmic_v;
            if voltage_v <= LOWEST_SUPPLY_V {
                return 0.0;
            }
        }
        voltage_v
    }

    /// Mole fraction per coulomb, the inverse of the charge of both electrodes.
    #[must_use]
    pub fn fraction_per_c(&self) -> f64 {
        self.fraction_per_c
    }

    /// Resistance, ohm.
    #[must_use]
    pub fn r_ohm(&self) -> f64 {
        self.r_ohm
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::battery::{Cell, Physics, State, model::resting_energy};
    use proptest::prelude::*;

    const PHYSICS: Physics = Physics {
        thermal: false,
        mole_fraction_margin: 1e-3,
    };
    const DECISIONS: Decisions = Decisions {
        step_s: 1.0,
        steps: 10,
        end_v: 3.0,
        empty: 1e-3,
    };

    fn ideal() -> IdealCell {
        IdealCell::new(&CellParameters::FRESH, DECISIONS).unwrap()
    }

    /// A cell at rest.
    fn rested(x: f64) -> Cell {
        let mut cell = Cell::new(CellParameters::FRESH, PHYSICS);
        cell.place(
            State::rested(&CellParameters::FRESH, x / MOLE_FRACTION_N_MAX),
            0.0,
        );
        cell
    }

    #[test]
    fn voltage_and_energy_at_rest_are_those_of_the_model() {
        for x in [0.001, 0.01, 0.1, 0.3, 0.5, 0.6] {
            assert!((rested(x).voltage_v() - resting_voltage(x)).abs() < 1e-12, "{x}");
        }
        // Simpson's rule over small pieces.
        let piece = |k: i32| {
            let (left, right) = (
                0.01 + 0.59 * f64::from(k) / 2000.0,
                0.01 + 0.59 * f64::from(k + 1) / 2000.0,
            );
            (right - left) / 6.0
                * (resting_voltage(left)
                    + 4.0 * resting_voltage(0.5 * (left + right))
                    + resting_voltage(right))
        };
        let integral: f64 = (0..2000).map(piece).sum();
        assert!(
            (resting_energy(0.6) - resting_energy(0.01) - integral).abs() < 1e-9,
            "{integral}"
        );
    }

    #[test]
    fn the_voltage_at_rest_rises_with_the_charge() {
        let voltages: Vec<f64> = (1..=6000).map(|k| resting_voltage(f64::from(k) * 1e-4)).collect();
        assert!(voltages.is_sorted_by(|a, b| a < b));
    }

    /// Without the overpotentials of the surfaces (about 2 mV ten seconds after rest), the ideal cell is the
    /// real one.
    #[test]
    fn a_rested_cell_behaves_nearly_as_the_ideal_one() {
        for (x, power_w) in [(0.1, 8.0), (0.3, 15.0), (0.5, 20.0)] {
            let mut cell = rested(x);
            (0..10).for_each(|_| cell.draw_power(power_w, 1.0));
            let lost = ideal().voltage_after(x, power_w) - cell.voltage_v();
            assert!((0.0..0.004).contains(&lost), "{x} {power_w}: {lost}");
        }
    }

    #[test]
    fn the_fatal_power_is_found_and_rises_with_the_charge() {
        let mut before_w = 0.0;
        for k in 1..60 {
            let x = f64::from(k) * 0.01;
            let fatal_w = ideal().fatal_power_w(x, before_w);
            assert!(ideal().voltage_after(x, fatal_w) <= 3.0, "{x}");
            assert!(ideal().voltage_after(x, 0.998 * fatal_w) > 3.0, "{x}");
            assert!(
                (ideal().fatal_power_w(x, 100.0) / fatal_w - 1.0).abs() < 2e-3,
                "{x}: where the search begins"
            );
            assert!(fatal_w >= before_w, "{x}");
            before_w = fatal_w;
        }
        assert_eq!(
            ideal().fatal_power_w(0.002, 0.0),
            0.0,
            "3 V at rest need a mole fraction of 0.0078"
        );
    }

    #[test]
    fn long_steps_have_no_ideal_cell() {
        assert!(
            IdealCell::new(
                &CellParameters::FRESH,
                Decisions {
                    step_s: 7.0,
                    ..DECISIONS
                }
            )
            .is_none()
        );
    }

    proptest! {
        /// Whatever the history of a cell, a power that is fatal to the ideal cell with its charge is fatal to
        /// it, and a decision that it survives has no collapse.
        #[test]
        fn no_real_cell_carries_more(
            charge in 0.03_f64..1.0,
            past in prop::collection::vec((0.0_f64..30.0, 1_usize..20), 0..12),
            part in 0.0_f64..1.3,
        ) {
            let mut cell = rested(MOLE_FRACTION_N_MAX * charge);
            for (power_w, steps) in past {
                let mut copy = cell.clone();
                (0..steps).for_each(|_| copy.draw_power(power_w, 1.0));
                if copy.voltage_v() > DECISIONS.end_v {
                    cell = copy;
                }
            }
            let x = cell.state().charge_c() * ideal().fraction_per_c();
            let fatal_w = ideal().fatal_power_w(x, 10.0);
            let mut lowest_v = f64::INFINITY;
            for _ in 0..DECISIONS.steps {
                cell.draw_power(part * fatal_w, 1.0);
                lowest_v = lowest_v.min(cell.voltage_v());
            }
            let survived = cell.voltage_v() > DECISIONS.end_v;
            prop_assert!(!survived || part < 1.0, "{part} of {fatal_w} W at {x}");
            prop_assert!(!survived || lowest_v > 0.9 * DECISIONS.end_v, "{lowest_v} V within a decision \
                                                                         that was survived");
        }
    }
}
