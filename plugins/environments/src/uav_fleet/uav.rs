//! A UAV between flights.

use super::config::UavFleetConfig;
use super::string::{CellString, STRINGS};
use contract::Rng;
use rand::Rng as _;
use serde::{Deserialize, Serialize};

/// A UAV; between two flights its pack is full and rested, so that its strings say all.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Uav {
    /// The strings of its pack.
    pub strings: [CellString; STRINGS],
    /// How much faster it wears its strings than an average UAV.
    pub wear_factor: f64,
    /// True on the day after it ran empty: it is repaired.
    pub grounded: bool,
}

impl Uav {
    /// A UAV when an episode begins.
    #[must_use]
    pub fn used(config: &UavFleetConfig, rng: &mut Rng) -> Self {
        let wear_factor = 1.0 + config.uav_spread * (2.0 * rng.random::<f64>() - 1.0);
        Self {
            strings: std::array::from_fn(|_| CellString::used(config, wear_factor, rng)),
            wear_factor,
            grounded: false,
        }
    }

    /// Strings by falling known resistance, the first of equals first.
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

    /// Puts new strings in the place of these.
    pub fn replace(&mut self, which: &[usize], new: &[CellString; STRINGS]) {
        for string in which {
            self.strings[*string] = new[*string];
        }
    }

    /// The sum of the squared errors of the known resistances, ohm2.
    #[must_use]
    pub fn squared_error(&self) -> f64 {
        let error = |string: &CellString| (string.known.r_ohm - string.parameters.r_ohm).powi(2);
        self.strings.iter().map(error).sum()
    }
}
