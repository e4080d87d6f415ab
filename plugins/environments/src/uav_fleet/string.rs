//! A string of cells of a pack: its true health, its wear, and its known health.

use super::calibration::Estimate;
use super::config::UavFleetConfig;
use crate::battery::{AgeingRates, CellParameters};
use contract::Rng;
use rand::Rng as _;
use serde::{Deserialize, Serialize};

/// Strings of a pack, in parallel.
pub const STRINGS: usize = 4;

/// A string of equal cells, described by one of them.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct CellString {
    /// True health.
    pub parameters: CellParameters,
    /// Rate of wear relative to an average string.
    pub wear_factor: f64,
    /// Counted charge that the string has passed, C.
    pub passed_c: f64,
    /// Known health.
    pub known: Estimate,
}

impl CellString {
    /// A new string in a UAV that wears its strings by `uav_factor`.
    #[must_use]
    pub fn new(config: &UavFleetConfig, uav_factor: f64, rng: &mut Rng) -> Self {
        let mut draw = |half_width: f64| half_width * (2.0 * rng.random::<f64>() - 1.0);
        let fresh = CellParameters::FRESH;
        let parameters = CellParameters {
            q_mobile_c: fresh.q_mobile_c * (1.0 + draw(config.new_spread)),
            r_ohm: fresh.r_ohm * (1.0 + draw(config.new_spread)),
            ..fresh
        };
        Self {
            parameters,
            wear_factor: uav_factor * (1.0 + draw(config.wear_spread)),
            passed_c: 0.0,
            known: Estimate::of_new(config),
        }
    }

    /// A used string at the beginning of an episode.
    #[must_use]
    pub fn used(config: &UavFleetConfig, uav_factor: f64, rng: &mut Rng) -> Self {
        let mut string = Self::new(config, uav_factor, rng);
        let passed_c = config.first_charge_c * rng.random::<f64>();
        string.parameters = string
            .ageing(&config.ageing)
            .worn(&string.parameters, passed_c, 1.0);
        string.pass(config, passed_c);
        string
    }

    /// The rates of wear of this string.
    #[must_use]
    pub fn ageing(&self, mean: &AgeingRates) -> AgeingRates {
        AgeingRates {
            q_mobile_rate: self.wear_factor * mean.q_mobile_rate,
            r_rate: self.wear_factor * mean.r_rate,
            t_diffusion_rate: self.wear_factor * mean.t_diffusion_rate,
            ..*mean
        }
    }

    /// Counts a charge, and updates the known health by the wear of an average string.
    pub fn pass(&mut self, config: &UavFleetConfig, charge_c: f64) {
        self.passed_c += charge_c;
        self.known.wear(config, charge_c);
    }
}
