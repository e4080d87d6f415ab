//! Config of the `battery` environment.

use super::ageing::AgeingRates;
use super::load::Load;
use super::parameters::{CellParameters, END_OF_DISCHARGE_V, SECOND_LIFE};
use super::start::Start;
use contract::{Error, Preset};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::json;

/// The cells of a pack.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(
    untagged,
    expecting = "a number of fresh cells, `fresh`, `second_life`, or a list such as [{q_mobile_c: 7000, \
                 r_ohm: 0.125, t_diffusion: 7e6}]"
)]
pub enum Cells {
    /// This number of new cells.
    Count(#[schemars(range(min = 1, max = 1000))] usize),
    /// A named pack.
    Named(NamedPack),
    /// Each cell by its parameters; keys left out are those of a new cell.
    Each(#[schemars(length(min = 1))] Vec<CellParameters>),
}

/// Packs with a name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum NamedPack {
    /// Four new cells.
    Fresh,
    /// Four aged cells: (7000 C, 0.125 ohm), (6600, 0.135), (6200, 0.15), (5800, 0.165).
    SecondLife,
}

impl Cells {
    /// Parameters of each cell.
    #[must_use]
    pub fn parameters(&self) -> Vec<CellParameters> {
        match self {
            Cells::Count(count) => vec![CellParameters::FRESH; *count],
            Cells::Named(NamedPack::Fresh) => vec![CellParameters::FRESH; 4],
            Cells::Named(NamedPack::SecondLife) => SECOND_LIFE.to_vec(),
            Cells::Each(parameters) => parameters.clone(),
        }
    }
}

/// Settings of the `battery` environment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct BatteryConfig {
    /// The cells: the number of new ones, a named pack (`fresh`, `second_life`), or a list of parameters.
    pub cells: Cells,
    /// Whether each cell's temperature follows its losses; otherwise it stays constant, as in the authors'
    /// public code.
    pub thermal: bool,
    /// Duration of an allocation; a whole number of steps.
    #[schemars(
        range(min = 1e-6),
        extend("x-unit" = "s", "x-source" = "inferred: reproduces the thesis' results without learning")
    )]
    pub decision_interval_s: f64,
    /// The load of the whole pack.
    pub load: Load,
    /// Initial states of episodes.
    pub start: Start,
    /// An episode terminates when, at the end of a decision, the voltage of any cell is at or below this.
    #[schemars(range(min = 0.0, max = 5.0), extend("x-unit" = "V", "x-source" = "thesis, section 3.4"))]
    pub end_of_discharge_v: f64,
    /// Whether uniform noise is added to the states at each step: at most 1e-10 V on the three voltage drops,
    /// 1e-3 C on the bulk charges, 1e-5 C on the surface charges.
    pub process_noise: bool,
    /// Whether uniform noise of at most 1 mV is added to observed voltages; the end of discharge is decided by
    /// the true ones.
    pub sensor_noise: bool,
    /// Wear of the cells from episode to episode: `{}` for the published rates; if left out, cells do not wear.
    /// A worn cell is replaced at the start of an episode when it has reached its end of life, or when a state
    /// from which `start` may let it begin lies past its discharge.
    pub ageing: Option<AgeingRates>,
    /// Step of the explicit Euler scheme.
    #[schemars(range(min = 1e-6, max = 10.0), extend("x-unit" = "s", "x-source" = "progpy 1.9.0"))]
    pub step_s: f64,
    /// Number of decisions after which an episode is truncated; if left out, it lasts until the end of
    /// discharge.
    #[schemars(range(min = 1))]
    pub episode_limit: Option<u64>,
    /// Distance that surface mole fractions keep from 0 and 1 in logarithms and roots; it matters only for a
    /// cell driven past empty. The authors' public code has 0.01, which also changes the voltage of a cell
    /// below 1.7 % charge.
    #[schemars(range(min = 1e-9, max = 0.1))]
    pub mole_fraction_margin: f64,
    /// Largest excess of the sum of the weights over 1; below 1, where the pack would deliver less than the
    /// demand, only a rounding error is allowed. Rule IV of thesis table 3.3 sums to 1.05 as printed, and it
    /// gives the published life only when it is applied in this form, with the pack delivering 5 % more than
    /// the demand.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub weight_sum_tolerance: f64,
}

impl Default for BatteryConfig {
    fn default() -> Self {
        Self {
            cells: Cells::Count(4),
            thermal: false,
            decision_interval_s: 10.0,
            load: Load::default(),
            start: Start::default(),
            end_of_discharge_v: END_OF_DISCHARGE_V,
            process_noise: false,
            sensor_noise: false,
            ageing: None,
            step_s: 1.0,
            episode_limit: None,
            mole_fraction_margin: 1e-3,
            weight_sum_tolerance: 0.051,
        }
    }
}

impl contract::Config for BatteryConfig {
    fn presets() -> Vec<Preset> {
        vec![
            Preset {
                name: "thesis",
                about: "four fresh cells as in thesis, section 3.4 (the defaults)",
                values: json!({}),
            },
            Preset {
                name: "second_life",
                about: "four aged cells as in thesis, section 3.4.4; their parameters are inferred",
                values: json!({ "cells": "second_life" }),
            },
            Preset {
                name: "released_code",
                about: "numerical guards of the authors' public code",
                values: json!({ "mole_fraction_margin": 0.01 }),
            },
            Preset {
                name: "progpy",
                about: "one full cell with the thermal state, as NASA's progpy simulates it",
                values: json!({ "cells": 1, "thermal": true, "start": "full", "decision_interval_s": 1.0 }),
            },
        ]
    }
}

impl BatteryConfig {
    /// Number of steps in a decision.
    ///
    /// # Errors
    /// [`Error::Config`] where the interval is not a whole number of steps.
    pub fn steps_per_decision(&self) -> Result<usize, Error> {
        let ratio = self.decision_interval_s / self.step_s;
        let steps = ratio.round();
        if steps >= 1.0 && (ratio - steps).abs() <= 1e-9 * steps {
            return Ok(steps as usize);
        }
        let problem = format!(
            "{} s is not a whole number of steps of {} s (`step_s`)",
            self.decision_interval_s, self.step_s
        );
        Err(Error::config("decision_interval_s", problem))
    }

    /// Parameters of every cell at the start of its life.
    ///
    /// # Errors
    /// [`Error::Config`] where there is no cell, a parameter is not above zero, or a cell starts beyond its
    /// end of life.
    pub fn parameters(&self) -> Result<Vec<CellParameters>, Error> {
        let parameters = self.cells.parameters();
        if parameters.is_empty() {
            return Err(Error::config("cells", "a pack needs at least one cell"));
        }
        for (index, one) in parameters.iter().enumerate() {
            let positive = [one.q_mobile_c, one.r_ohm, one.t_diffusion]
                .iter()
                .all(|value| value.is_finite() && *value > 0.0);
            if !positive {
                return Err(Error::config(
                    format!("cells[{index}]"),
                    "every parameter must be above zero",
                ));
            }
            if self.ageing.is_some_and(|ageing| ageing.has_ended(one)) {
                let problem = format!(
                    "cell {} starts with {} C, beyond its end of life",
                    index + 1,
                    one.q_mobile_c
                );
                return Err(Error::config("ageing.end_of_life_c", problem));
            }
        }
        Ok(parameters)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::Value;

    fn parse(config: Value) -> Result<BatteryConfig, serde_json::Error> {
        serde_json::from_value(config)
    }

    #[test]
    fn every_form_of_a_key_is_read() {
        for (key, forms) in [
            (
                "cells",
                json!([4, "fresh", "second_life", [{ "q_mobile_c": 7000.0 }]]),
            ),
            (
                "load",
                json!(["thesis", { "uniform": { "low_w": 1.0, "high_w": 2.0 } },
                    { "constant": { "power_w": 8.0 } }]),
            ),
            (
                "load",
                json!([{ "constant_current": { "current_a": 2.0 } }, { "file": "load.csv" }]),
            ),
            (
                "start",
                json!(["full", { "profile_index": [600] }, { "profile_range": [500, 2000] }]),
            ),
            (
                "start",
                json!([{ "state_of_charge": [0.5] }, { "states": [[292.1, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0,
                    1.0]] }]),
            ),
            ("ageing", json!([null, {}, { "r_rate": 2e-6 }])),
        ] {
            for form in forms.as_array().unwrap() {
                let resolved = serde_json::to_value(parse(json!({ key: form })).unwrap()).unwrap();
                assert_eq!(
                    serde_json::to_value(parse(resolved.clone()).unwrap()).unwrap(),
                    resolved
                );
            }
        }
    }

    #[test]
    fn mistakes_are_explained() {
        for (config, expected) in [
            (
                json!({ "cells": "fifth_life" }),
                "a number of fresh cells, `fresh`",
            ),
            (json!({ "cell": 4 }), "unknown field `cell`"),
            (
                json!({ "load": { "constant": { "power": 8 } } }),
                "unknown field `power`",
            ),
            (json!({ "start": "empty" }), "unknown variant `empty`"),
        ] {
            let message = parse(config).unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
        }
        let uneven = BatteryConfig {
            decision_interval_s: 10.0,
            step_s: 3.0,
            ..Default::default()
        };
        assert!(
            uneven
                .steps_per_decision()
                .unwrap_err()
                .to_string()
                .contains("not a whole number of steps")
        );
        let old = Cells::Each(vec![CellParameters::aged(5000.0, 0.2)]);
        let worn_out = BatteryConfig {
            cells: old,
            ageing: Some(AgeingRates::default()),
            ..Default::default()
        };
        assert!(
            worn_out
                .parameters()
                .unwrap_err()
                .to_string()
                .contains("beyond its end of life")
        );
    }

    #[test]
    fn presets_are_configs() {
        for preset in <BatteryConfig as contract::Config>::presets() {
            assert!(parse(preset.values).is_ok(), "{}", preset.name);
        }
    }
}
