//! Config of the `uav_fleet` environment.

use crate::{battery::AgeingRates, flight_planning::mission::Mission};
use contract::{Artifact, Error, Preset, artifact};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::json;

/// Largest factor of a day's wind relative to the mean wind; the smallest is two less this.
pub const STRONGEST_WIND: f64 = 1.5;

/// The active modules of a UAV; inactive ones are replaced by their simple counterparts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Modules {
    /// Calibration, allocation and flight planning.
    #[default]
    Full,
    /// Cells are assumed to wear like an average cell with the counted charge.
    WithoutCalibration,
    /// The load is split equally.
    WithoutAllocation,
    /// Every leg is flown at 15 m/s over ground, 20 m above it.
    WithoutPlanning,
    /// None of the three.
    Without,
    /// Full information instead of all three: the true health is known, the load is shared by the true states
    /// of the cells, and the plan is the best one. This is the upper reference.
    Informed,
}

/// Method by which the allocation module shares the load.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Allocator {
    /// Water filling: equal terminal voltages, from voltages, currents and the known resistances.
    #[default]
    WaterFilling,
    /// A policy that a trial learned in `battery` with four cells; it observes voltages, currents and the
    /// demand.
    Policy(Artifact<artifact::Policy>),
}

/// The plan of the planning module.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Planner {
    /// The best plan for the mean wind, computed.
    #[default]
    Optimum,
    /// The plan that a search in `flight_planning` chose for the same mission.
    Found(Artifact<artifact::Choice>),
}

/// Settings of the `uav_fleet` environment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct UavFleetConfig {
    /// UAVs of the fleet; each has a seat.
    #[schemars(range(min = 1, max = 20))]
    pub uavs: usize,
    /// Number of UAVs that can fly all missions of a day; a larger number shares the way evenly.
    #[schemars(range(min = 1, max = 20))]
    pub required: usize,
    /// Days of an episode.
    #[schemars(range(min = 1, max = 1000), extend("x-unit" = "d"))]
    pub horizon: usize,
    /// The mission of one UAV on a day on which `required` fly, and the mean wind.
    pub mission: Mission,
    /// The active modules of the UAVs. Random draws do not depend on it, so that all of them get the same cells
    /// and the same winds.
    #[schemars(extend("x-looks" = true))]
    pub modules: Modules,
    /// Method by which the allocation module shares the load.
    #[schemars(extend("x-looks" = true))]
    pub allocation: Allocator,
    /// The plan of the planning module.
    #[schemars(extend("x-looks" = true))]
    pub planning: Planner,
    /// Number of cells in series in each of the four strings of a pack; they are alike, so that one cell stands
    /// for all of them.
    #[schemars(range(min = 1, max = 20))]
    pub cells_in_series: usize,
    /// Mean wear of the cells; its end of life has no effect, since cells are replaced by choice.
    pub ageing: AgeingRates,
    /// Every UAV wears its strings by a factor of its own, uniform within 1 plus or minus this.
    #[schemars(range(min = 0.0, max = 0.95), extend("x-source" = "own choice"))]
    pub uav_spread: f64,
    /// Every string wears by a further factor, uniform within 1 plus or minus this.
    #[schemars(range(min = 0.0, max = 0.95), extend("x-source" = "own choice"))]
    pub wear_spread: f64,
    /// Relative differences of new strings in capacity and resistance, uniform within plus or minus this.
    #[schemars(range(min = 0.0, max = 0.5), extend("x-source" = "own choice"))]
    pub new_spread: f64,
    /// The first strings have passed a charge that is uniform between 0 and this.
    #[schemars(range(min = 0.0, max = 2e5), extend("x-unit" = "C", "x-source" = "own choice, about 15 flights"))]
    pub first_charge_c: f64,
    /// Largest error of a voltage reading.
    #[schemars(range(min = 0.0, max = 0.5), extend("x-unit" = "V", "x-source" = "own choice"))]
    pub sensor_noise_v: f64,
    /// A UAV is empty when any cell's voltage is at or below this.
    #[schemars(range(min = 2.0, max = 4.0), extend("x-unit" = "V", "x-source" = "thesis, section 3.4"))]
    pub end_of_discharge_v: f64,
    /// Duration of an allocation.
    #[schemars(range(min = 1.0, max = 1000.0), extend("x-unit" = "s"))]
    pub decision_interval_s: f64,
    /// Largest step of the simulation of the cells. Compared with 1 s, 5 s move the voltages of a flight by
    /// less than 5 mV.
    #[schemars(range(min = 0.1, max = 6.0), extend("x-unit" = "s"))]
    pub step_s: f64,
    /// Cost of a new string of cells, where all missions of a day earn 1.
    #[schemars(range(min = 0.0, max = 1e3), extend("x-source" = "own choice"))]
    pub string_cost: f64,
    /// Cost of a day with any replacement by choice.
    #[schemars(range(min = 0.0, max = 1e3), extend("x-source" = "own choice"))]
    pub call_out_cost: f64,
    /// Cost of a UAV that runs empty in flight, without its new strings.
    #[schemars(range(min = 0.0, max = 1e3), extend("x-source" = "own choice"))]
    pub failure_cost: f64,
}

impl Default for UavFleetConfig {
    fn default() -> Self {
        Self {
            uavs: 3,
            required: 2,
            horizon: 60,
            mission: Mission::default(),
            modules: Modules::default(),
            allocation: Allocator::default(),
            planning: Planner::default(),
            cells_in_series: 4,
            ageing: AgeingRates::default(),
            uav_spread: 0.5,
            wear_spread: 0.5,
            new_spread: 0.03,
            first_charge_c: 60_000.0,
            sensor_noise_v: 0.01,
            end_of_discharge_v: 3.0,
            decision_interval_s: 30.0,
            step_s: 5.0,
            string_cost: 0.2,
            call_out_cost: 0.5,
            failure_cost: 5.0,
        }
    }
}

impl contract::Config for UavFleetConfig {
    fn presets() -> Vec<Preset> {
        vec![
            Preset {
                name: "fleet",
                about: "three UAVs of which two must fly, for 60 days (the defaults)",
                values: json!({}),
            },
            Preset {
                name: "short",
                about: "ten days of two UAVs of which one must fly, for short runs",
                values: json!({ "uavs": 2, "required": 1, "horizon": 10 }),
            },
        ]
    }
}

impl UavFleetConfig {
    /// Checks the numbers and the mission.
    ///
    /// # Errors
    /// [`Error::Config`] for a number outside its range and for a wind in which a leg cannot be flown.
    pub fn check(&self) -> Result<(), Error> {
        self.check_counts()?;
        let outside = |value: f64, low: f64, high: f64| !(low..=high).contains(&value);
        for (key, value, low, high) in [
            ("uav_spread", self.uav_spread, 0.0, 0.95),
            ("wear_spread", self.wear_spread, 0.0, 0.95),
            ("new_spread", self.new_spread, 0.0, 0.5),
            ("first_charge_c", self.first_charge_c, 0.0, 2e5),
            ("sensor_noise_v", self.sensor_noise_v, 0.0, 0.5),
            ("end_of_discharge_v", self.end_of_discharge_v, 2.0, 4.0),
            ("decision_interval_s", self.decision_interval_s, 1.0, 1000.0),
            ("step_s", self.step_s, 0.1, 6.0),
            ("string_cost", self.string_cost, 0.0, 1e3),
            ("call_out_cost", self.call_out_cost, 0.0, 1e3),
            ("failure_cost", self.failure_cost, 0.0, 1e3),
        ] {
            if outside(value, low, high) {
                return Err(Error::config(key, format!("{value} is not in {low} to {high}")));
            }
        }
        self.mission.check("mission.", STRONGEST_WIND)
    }

    /// Variance of the factor by which a string wears: a product of two uniform factors.
    #[must_use]
    pub fn wear_variance(&self) -> f64 {
        let square = |half_width: f64| 1.0 + half_width * half_width / 3.0;
        square(self.uav_spread) * square(self.wear_spread) - 1.0
    }

    fn check_counts(&self) -> Result<(), Error> {
        for (key, value, most) in [
            ("uavs", self.uavs, 20),
            ("required", self.required, self.uavs),
            ("horizon", self.horizon, 1000),
            ("cells_in_series", self.cells_in_series, 20),
        ] {
            if !(1..=most).contains(&value) {
                return Err(Error::config(key, format!("{value} is not in 1 to {most}")));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Half-widths of 0.6 and 0.3: (1 + 0.12) (1 + 0.03) - 1.
    #[test]
    fn the_variance_of_wear_by_hand() {
        let config = UavFleetConfig {
            uav_spread: 0.6,
            wear_spread: 0.3,
            ..UavFleetConfig::default()
        };
        assert!((config.wear_variance() - 0.1536).abs() < 1e-12);
    }

    #[test]
    fn impossible_configs_are_refused() {
        for (values, text) in [
            (json!({ "uavs": 0 }), "`uavs`: 0 is not in 1 to 20"),
            (json!({ "required": 4 }), "`required`: 4 is not in 1 to 3"),
            (json!({ "horizon": 0 }), "`horizon`: 0 is not in 1 to 1000"),
            (json!({ "cells_in_series": 0 }), "`cells_in_series`"),
            (
                json!({ "wear_spread": 1.0 }),
                "`wear_spread`: 1 is not in 0 to 0.95",
            ),
            (json!({ "step_s": 10.0 }), "`step_s`: 10 is not in 0.1 to 6"),
            (json!({ "failure_cost": -1.0 }), "`failure_cost`"),
            (
                json!({ "mission": { "wind_m_per_s": 9.0 } }),
                "`mission.wind_m_per_s`",
            ),
        ] {
            let config: UavFleetConfig = serde_json::from_value(values).unwrap();
            let refusal = config.check().unwrap_err().to_string();
            assert!(refusal.contains(text), "{refusal}");
        }
        assert!(UavFleetConfig::default().check().is_ok());
    }
}
