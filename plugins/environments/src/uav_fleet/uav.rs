//! A UAV between flights.

use super::config::UavFleetConfig;
use super::string::{CellString, STRINGS};
use contract::Rng;
use rand::Rng as _;
use serde::{Deserialize, Serialize};

/// A UAV between two flights; its pack is full and rested, so that the strings are its whole state.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Uav {
    /// The strings of its pack.
    pub strings: [CellString; STRINGS],
    /// Rate at which it wears its strings, relative to an average UAV.
    pub wear_factor: f64,
    /// Whether it is repaired on this day, after it ran empty on the day before.
    pub grounded: bool,
}

impl Uav {
    /// A UAV at the beginning of an episode.
    #[must_use]
    pub fn used(config: &UavFleetConfig, rng: &mut Rng) -> Self {
        let wear_factor = 1.0 + config.uav_spread * (2.0 * rng.random::<f64>() - 1.0);
        Self {
            strings: std::array::from_fn(|_| CellString::used(config, wear_factor, rng)),
            wear_factor,
            grounded: false,
        }
    }

    /// Positions of the strings by falling known resistance, the first of equals first.
    #[must_use]
    pub fn by_resistance(&self) -> [usize; STRINGS] {
        let mut order: [usize; STRINGS] = std::array::from_fn(|string| string);
        let known = |string: &usize| self.strings[*string].known.r_ohm;
        order.sort_by(|a, b| known(b).total_cmp(&known(a)));
        order
    }

    /// The largest known resistance, ohm.
    #[must_use]
    pub fn worst_resistance_ohm(&self) -> f64 {
        self.strings[self.by_resistance()[0]].known.r_ohm
    }

    /// The mean of the known resistances, ohm.
    #[must_use]
    pub fn mean_resistance_ohm(&self) -> f64 {
        self.strings.iter().map(|string| string.known.r_ohm).sum::<f64>() / STRINGS as f64
    }

    /// The largest charge that a string has passed, C.
    #[must_use]
    pub fn most_charge_c(&self) -> f64 {
        self.strings
            .iter()
            .map(|string| string.passed_c)
            .fold(0.0, f64::max)
    }

    /// Replaces these strings by new ones.
    pub fn replace(&mut self, which: &[usize], new: &[CellString; STRINGS]) {
        for string in which {
            self.strings[*string] = new[*string];
        }
    }

    /// The sum of the squared errors of the known resistances, ohm2.
    #[must_use]
    pub fn squared_error(&self) -> f64 {
        let error = |string: &CellString| string.known.r_ohm - string.parameters.r_ohm;
        self.strings.iter().map(error).map(|error| error * error).sum()
    }
}
