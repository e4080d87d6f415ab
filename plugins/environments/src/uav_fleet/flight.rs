//! A flight: the four strings of a pack deliver the power of a plan, wear, and are measured.
//!
//! Every string is one cell of [`battery`](crate::battery), as in its environment: the current follows from the
//! voltage at the start of a step (explicit Euler), and the parameters wear with the charge. A flight begins
//! full and rested. The steps within a segment of the plan are equally long and no longer than `step_s`. An
//! allocation is held for `decision_interval_s`, and voltages are read, with noise, at the time of an
//! allocation.

use super::allocation::{Readings, SharingRule};
use super::calibration::{FlightLog, PHYSICS};
use super::config::UavFleetConfig;
use super::string::{CellString, STRINGS};
use crate::{
    battery::{Cell, State},
    flight_planning::mission::Segment,
};
use contract::Rng;
use rand::Rng as _;

/// Result of a flight.
#[derive(Debug, Clone)]
pub struct Flight {
    /// Whether the UAV finished the flight; false where it ran empty on the way.
    pub is_whole: bool,
    /// Lowest voltage of any cell at the end, V.
    pub lowest_v: f64,
    /// Energy that the pack delivered, J.
    pub energy_j: f64,
    /// Currents and readings for the calibration.
    pub log: FlightLog,
    /// Charge that each string passed, C.
    pub charge_c: [f64; STRINGS],
}

/// State of a flight between two steps.
struct FlightState<'a> {
    config: &'a UavFleetConfig,
    sharing: &'a SharingRule,
    strings: &'a mut [CellString; STRINGS],
    cells: [Cell; STRINGS],
    shares: [f64; STRINGS],
    since_decision_s: f64,
    flight: Flight,
}

/// Flies a plan with a pack and wears its strings.
pub fn fly(
    config: &UavFleetConfig,
    sharing: &SharingRule,
    strings: &mut [CellString; STRINGS],
    segments: &[Segment],
    rng: &mut Rng,
) -> Flight {
    let mut under_way = FlightState::new(config, sharing, strings);
    for segment in segments {
        under_way.fly(segment, rng);
        if !under_way.flight.is_whole {
            break;
        }
    }
    under_way.land(rng)
}

impl<'a> FlightState<'a> {
    fn new(
        config: &'a UavFleetConfig,
        sharing: &'a SharingRule,
        strings: &'a mut [CellString; STRINGS],
    ) -> Self {
        let cells = strings.each_ref().map(|string| {
            let mut cell = Cell::new(string.parameters, PHYSICS);
            cell.place(State::rested(&string.parameters, 1.0), 0.0);
            cell
        });
        Self {
            config,
            sharing,
            strings,
            cells,
            shares: [0.0; STRINGS],
            since_decision_s: f64::INFINITY,
            flight: Flight {
                is_whole: true,
                lowest_v: f64::INFINITY,
                energy_j: 0.0,
                log: FlightLog::default(),
                charge_c: [0.0; STRINGS],
            },
        }
    }

    fn fly(&mut self, segment: &Segment, rng: &mut Rng) {
        let steps = (segment.duration_s / self.config.step_s).ceil().max(1.0);
        let step_s = segment.duration_s / steps;
        // One cell of each string carries its part of the strings' power.
        let power_w = segment.power_w / self.config.cells_in_series as f64;
        for _ in 0..steps as usize {
            // Half a step of tolerance, so that rounding moves no decision.
            if self.since_decision_s >= self.config.decision_interval_s - 0.5 * step_s {
                self.decide(power_w, rng);
            }
            self.advance(power_w, step_s);
            if self.flight.lowest_v <= self.config.end_of_discharge_v {
                self.flight.is_whole = false;
                return;
            }
        }
    }

    fn read(&mut self, rng: &mut Rng) -> [f64; STRINGS] {
        let noise_v = self.config.sensor_noise_v;
        let read = self
            .cells
            .each_ref()
            .map(|cell| cell.voltage_v() + noise_v * (2.0 * rng.random::<f64>() - 1.0));
        self.flight.log.readings.push((self.flight.log.steps.len(), read));
        read
    }

    fn decide(&mut self, power_w: f64, rng: &mut Rng) {
        let readings = Readings {
            voltage_v: self.read(rng),
            current_a: self.cells.each_ref().map(Cell::current_a),
            power_w,
        };
        let known_ohm = self.strings.each_ref().map(|string| string.known.r_ohm);
        self.shares = self.sharing.shares(&readings, &known_ohm, &self.cells);
        self.since_decision_s = 0.0;
    }

    fn advance(&mut self, power_w: f64, step_s: f64) {
        let mut currents = [0.0; STRINGS];
        self.flight.lowest_v = f64::INFINITY;
        for (i, cell) in self.cells.iter_mut().enumerate() {
            let before_v = cell.voltage_v();
            cell.draw_power(self.shares[i] * power_w, step_s);
            currents[i] = cell.current_a();
            self.flight.energy_j += before_v * currents[i] * step_s * self.config.cells_in_series as f64;
            self.flight.charge_c[i] += currents[i].abs() * step_s;
            cell.wear(&self.strings[i].ageing(&self.config.ageing), step_s);
            self.flight.lowest_v = self.flight.lowest_v.min(cell.voltage_v());
        }
        self.flight.log.steps.push((step_s, currents));
        self.since_decision_s += step_s;
    }

    /// Reads the voltages once more, and wears the strings.
    fn land(mut self, rng: &mut Rng) -> Flight {
        self.read(rng);
        for (string, cell) in self.strings.iter_mut().zip(&self.cells) {
            string.parameters = *cell.parameters();
        }
        self.flight
    }
}
