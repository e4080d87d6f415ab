//! Wear of a cell's parameters with the charge that passes.
//!
//! M. Daigle and C. Kulkarni, "End-of-discharge and end-of-life prediction in lithium-ion batteries with
//! electrochemistry-based aging models", AIAA SciTech 2016-2132: each parameter changes in proportion to the
//! absolute current.

use super::parameters::CellParameters;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Rates at which a cell's parameters wear, and the end of its life.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct AgeingRates {
    /// Change of the mobile charge per ampere second.
    #[schemars(range(max = 0.0), extend("x-unit" = "C/(A s)", "x-source" = "Daigle and Kulkarni 2016"))]
    pub q_mobile_rate: f64,
    /// Change of the resistance per ampere second.
    #[schemars(range(min = 0.0), extend("x-unit" = "ohm/(A s)", "x-source" = "Daigle and Kulkarni 2016"))]
    pub r_rate: f64,
    /// Change of the resistance to diffusion per ampere second.
    #[schemars(range(min = 0.0), extend("x-unit" = "1/(m3 A)", "x-source" = "Daigle and Kulkarni 2016"))]
    pub t_diffusion_rate: f64,
    /// A cell whose mobile charge is below this at the start of an episode is replaced by a cell with its
    /// initial parameters.
    #[schemars(range(min = 0.0), extend("x-unit" = "C", "x-source" = "70 % of a new cell's 7600 C"))]
    pub end_of_life_c: f64,
}

impl Default for AgeingRates {
    fn default() -> Self {
        Self {
            q_mobile_rate: -1e-2,
            r_rate: 1e-6,
            t_diffusion_rate: 1e-2,
            end_of_life_c: 5320.0,
        }
    }
}

impl AgeingRates {
    /// The parameters after `current_a` has flowed for `step_s`.
    #[must_use]
    pub fn worn(&self, parameters: &CellParameters, current_a: f64, step_s: f64) -> CellParameters {
        let charge = current_a.abs() * step_s;
        CellParameters {
            q_mobile_c: parameters.q_mobile_c + self.q_mobile_rate * charge,
            r_ohm: parameters.r_ohm + self.r_rate * charge,
            t_diffusion: parameters.t_diffusion + self.t_diffusion_rate * charge,
        }
    }

    /// Whether the capacity is below the end of life.
    #[must_use]
    pub fn has_ended(&self, parameters: &CellParameters) -> bool {
        parameters.q_mobile_c < self.end_of_life_c
    }
}
