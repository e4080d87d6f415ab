//! Config of the `inspection_planning` environment.

use super::crack_growth::{CrackGrowth, N_AGES};
use contract::{DataFile, Error, Preset};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::sync::Arc;

/// Largest number of components of a system.
const MOST_COMPONENTS: usize = 100;

/// Growth of cracks within a year.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Growth {
    /// The Paris law, whose table is computed by quadrature.
    #[default]
    ParisLaw,
    /// The Paris law with this multiple of the cycles in a year. For environments that differ from the one in
    /// which a policy was learned; beliefs use the same growth.
    Accelerated(#[schemars(range(min = 0.0, max = 100.0))] f64),
    /// A table: columns `rate` (years without a repair), `from` and `to` (bins from 0) and `p`; rows without
    /// `rate` and `from` are the initial sizes.
    File(DataFile),
}

/// Settings of the `inspection_planning` environment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct InspectionPlanningConfig {
    /// Components n of the system; each has a seat.
    #[schemars(range(min = 1, max = 100), extend("x-source" = "Leroy et al. 2023: 3, 5, 10, 50, 100"))]
    pub components: usize,
    /// Number k of components that must work, or the system has failed; all but one if absent.
    #[schemars(range(min = 1, max = 100), extend("x-source" = "Leroy et al. 2023: 2, 4, 9, 48, 95"))]
    pub required: Option<usize>,
    /// Whether a common factor makes initial crack sizes alike, so that an inspection is informative about all
    /// components.
    pub correlated: bool,
    /// Whether a step with an inspection or a repair costs an additional 5, while an inspection costs 0.2
    /// instead of 1.
    pub campaign: bool,
    /// Steps of an episode.
    #[schemars(range(min = 1, max = 30), extend("x-unit" = "yr", "x-source" = "Leroy et al. 2023"))]
    pub horizon: usize,
    /// Discount factor of costs per year; it is part of the reward, so that returns are plain sums.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "Leroy et al. 2023"))]
    pub discount: f64,
    /// Growth of cracks.
    pub crack_growth: Growth,
}

impl Default for InspectionPlanningConfig {
    fn default() -> Self {
        Self {
            components: 5,
            required: None,
            correlated: false,
            campaign: false,
            horizon: 30,
            discount: 0.95,
            crack_growth: Growth::default(),
        }
    }
}

impl contract::Config for InspectionPlanningConfig {
    fn presets() -> Vec<Preset> {
        let preset = |name, about, components, required| Preset {
            name,
            about,
            values: json!({ "components": components, "required": required }),
        };
        vec![
            preset("2_of_3", "two of three components must work", 3, 2),
            preset("4_of_5", "four of five (the defaults)", 5, 4),
            preset("9_of_10", "nine of ten", 10, 9),
            preset("48_of_50", "48 of 50", 50, 48),
            preset("95_of_100", "95 of 100", 100, 95),
        ]
    }
}

impl InspectionPlanningConfig {
    /// Number of components that must work.
    #[must_use]
    pub fn n_required(&self) -> usize {
        self.required.unwrap_or((self.components - 1).max(1))
    }

    /// Checks the numbers.
    ///
    /// # Errors
    /// [`Error::Config`] for a number outside its range.
    pub fn check(&self) -> Result<(), Error> {
        let within = |key: &str, value: usize, most: usize| match value {
            value if (1..=most).contains(&value) => Ok(()),
            _ => Err(Error::config(key, format!("{value} is not in 1 to {most}"))),
        };
        within("components", self.components, MOST_COMPONENTS)?;
        within("horizon", self.horizon, N_AGES)?;
        if let Growth::Accelerated(times) = self.crack_growth
            && !(0.0..=100.0).contains(&times)
        {
            let problem = format!("{times} is not in 0 to 100");
            return Err(Error::config("crack_growth.accelerated", problem));
        }
        if !(0.0..=1.0).contains(&self.discount) {
            return Err(Error::config(
                "discount",
                format!("{} is not in 0 to 1", self.discount),
            ));
        }
        match self.required {
            Some(required) if !(1..=self.components).contains(&required) => {
                let problem = format!("{required} of {} components cannot be required", self.components);
                Err(Error::config("required", problem))
            }
            _ => Ok(()),
        }
    }

    /// The table of crack growth.
    ///
    /// # Errors
    /// Errors of [`CrackGrowth::of_file`].
    pub fn growth(&self) -> Result<Arc<CrackGrowth>, Error> {
        match &self.crack_growth {
            Growth::ParisLaw => Ok(CrackGrowth::of_paris_law()),
            Growth::Accelerated(times) => Ok(CrackGrowth::accelerated(*times)),
            Growth::File(file) => CrackGrowth::of_file(file),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn impossible_configs_are_refused() {
        for (values, text) in [
            (json!({ "components": 0 }), "`components`: 0 is not in 1 to 100"),
            (json!({ "horizon": 31 }), "`horizon`: 31 is not in 1 to 30"),
            (
                json!({ "required": 6 }),
                "`required`: 6 of 5 components cannot be required",
            ),
            (json!({ "required": 0 }), "`required`: 0 of 5"),
            (
                json!({ "crack_growth": { "accelerated": -1.0 } }),
                "`crack_growth.accelerated`: -1 is not in 0 to 100",
            ),
            (json!({ "discount": 1.5 }), "`discount`: 1.5 is not in 0 to 1"),
        ] {
            let config: InspectionPlanningConfig = serde_json::from_value(values).unwrap();
            let refusal = config.check().unwrap_err().to_string();
            assert!(refusal.contains(text), "{refusal}");
        }
    }

    #[test]
    fn all_but_one_are_required_where_nothing_is_said() {
        let of = |components| {
            InspectionPlanningConfig {
                components,
                ..Default::default()
            }
            .n_required()
        };
        assert_eq!((of(1), of(2), of(5)), (1, 1, 4));
    }
}
