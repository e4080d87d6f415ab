//! The standard atmosphere of 1976 up to 20 km, and the air in front of an engine in flight.
//!
//! U.S. Standard Atmosphere, 1976 (NOAA, NASA, USAF), sections 1.2 and 1.3. The altitude is taken as the
//! geopotential one, as in engine programs. A warmer or colder day changes only the temperature.

use super::gas::{GAS_CONSTANT, enthalpy, entropy_function, heat_capacity, temperature_of_enthalpy};
use arithmetic::{double::exp, power::pow};
use serde::{Deserialize, Serialize};

/// Temperature (K) and pressure (Pa) at sea level on a standard day.
pub(super) const SEA_LEVEL: (f64, f64) = (288.15, 101_325.0);
/// Altitude above which the temperature stops falling, m.
const TROPOPAUSE_M: f64 = 11_000.0;
const LAPSE_K_PER_M: f64 = 0.0065;
const GRAVITY: f64 = 9.806_65;
/// The gas constant in the standard's definition of pressures, J/(kg K).
const STANDARD_GAS_CONSTANT: f64 = 287.0529;

/// The air around and in front of an engine.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct Air {
    /// Static pressure, Pa.
    pub pressure: f64,
    /// Total temperature, K.
    pub total_temperature: f64,
    /// Total pressure, Pa.
    pub total_pressure: f64,
    /// Flight speed, m/s.
    pub speed: f64,
    /// Flight Mach number.
    pub mach: f64,
    /// Altitude, m.
    pub altitude_m: f64,
    /// Excess of the temperature over that of a standard day, K.
    pub delta_t_k: f64,
}

impl Air {
    /// The air at an altitude (m) and a Mach number on a day that is `delta_t_k` warmer than the standard.
    pub(super) fn at(altitude_m: f64, mach: f64, delta_t_k: f64) -> Self {
        let (standard, pressure) = standard(altitude_m);
        let temperature = standard + delta_t_k;
        let cp = heat_capacity(temperature, 0.0);
        let speed = mach * (cp / (cp - GAS_CONSTANT) * GAS_CONSTANT * temperature).sqrt();
        let total = enthalpy(temperature, 0.0) + speed * speed / 2.0;
        let total_temperature: f64 = temperature_of_enthalpy(total, 0.0);
        let rise = entropy_function(total_temperature, 0.0) - entropy_function(temperature, 0.0);
        Self {
            pressure,
            total_temperature,
            total_pressure: pressure * exp(rise / GAS_CONSTANT),
            speed,
            mach,
            altitude_m,
            delta_t_k,
        }
    }

    /// Excess over the standard day at which the air has this total temperature, K.
    pub(super) fn delta_t_k(altitude_m: f64, mach: f64, total_temperature: f64) -> f64 {
        let (standard, _) = standard(altitude_m);
        let mut delta_t_k = 0.0;
        // The ratio of total and static temperature hardly depends on the day.
        for _ in 0..8 {
            let found = Self::at(altitude_m, mach, delta_t_k).total_temperature;
            delta_t_k -= (found - total_temperature) * (standard + delta_t_k) / found;
        }
        delta_t_k
    }

    /// Interpolates between this air and `other`.
    pub(super) fn towards(&self, other: &Self, part: f64) -> Self {
        let between = |from: f64, to: f64| from + part * (to - from);
        Self::at(
            between(self.altitude_m, other.altitude_m),
            between(self.mach, other.mach),
            between(self.delta_t_k, other.delta_t_k),
        )
    }
}

/// Temperature (K) and pressure (Pa) of a standard day.
fn standard(altitude_m: f64) -> (f64, f64) {
    let gradient = GRAVITY / STANDARD_GAS_CONSTANT;
    let below = altitude_m.min(TROPOPAUSE_M);
    let temperature = SEA_LEVEL.0 - LAPSE_K_PER_M * below;
    let pressure = SEA_LEVEL.1 * pow(temperature / SEA_LEVEL.0, gradient / LAPSE_K_PER_M);
    let above = (altitude_m - TROPOPAUSE_M).max(0.0);
    (temperature, pressure * exp(-gradient * above / temperature))
}
