//! Config of the `turbofan` environment.

use super::cycle::{Health, Wear};
use super::engine::EngineName;
use super::flight::Flight;
use contract::Error;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Largest relative change of a component's efficiency or flow by wear.
pub(super) const LARGEST_WEAR: f64 = 0.1;

/// A health parameter: a relative change of the efficiency or the flow of a rotating component.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum HealthParameter {
    /// Efficiency of the fan.
    FanEfficiency,
    /// Flow of the fan.
    FanFlow,
    /// Efficiency of the low-pressure compressor.
    LpcEfficiency,
    /// Flow of the low-pressure compressor.
    LpcFlow,
    /// Efficiency of the high-pressure compressor.
    HpcEfficiency,
    /// Flow of the high-pressure compressor.
    HpcFlow,
    /// Efficiency of the high-pressure turbine.
    HptEfficiency,
    /// Flow of the high-pressure turbine.
    HptFlow,
    /// Efficiency of the low-pressure turbine.
    LptEfficiency,
    /// Flow of the low-pressure turbine.
    LptFlow,
}

impl HealthParameter {
    /// The parameter's name in studies and files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::FanEfficiency => "fan_efficiency",
            Self::FanFlow => "fan_flow",
            Self::LpcEfficiency => "lpc_efficiency",
            Self::LpcFlow => "lpc_flow",
            Self::HpcEfficiency => "hpc_efficiency",
            Self::HpcFlow => "hpc_flow",
            Self::HptEfficiency => "hpt_efficiency",
            Self::HptFlow => "hpt_flow",
            Self::LptEfficiency => "lpt_efficiency",
            Self::LptFlow => "lpt_flow",
        }
    }

    pub(super) fn set(self, health: &mut Health, value: f64) {
        let part: &mut Wear = match self {
            Self::FanEfficiency | Self::FanFlow => &mut health.fan,
            Self::LpcEfficiency | Self::LpcFlow => &mut health.lpc,
            Self::HpcEfficiency | Self::HpcFlow => &mut health.hpc,
            Self::HptEfficiency | Self::HptFlow => &mut health.hpt,
            Self::LptEfficiency | Self::LptFlow => &mut health.lpt,
        };
        match self {
            Self::FanEfficiency
            | Self::LpcEfficiency
            | Self::HpcEfficiency
            | Self::HptEfficiency
            | Self::LptEfficiency => part.efficiency = value,
            _ => part.flow = value,
        }
    }
}

/// Whether the shafts are in balance.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Dynamics {
    /// Each point by itself, with shafts that do not accelerate.
    #[default]
    Steady,
    /// The shafts keep their speed from point to point and accelerate by the surplus power.
    Transient,
}

/// Settings of the `turbofan` environment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TurbofanConfig {
    /// The engine.
    pub engine: EngineName,
    /// Whether points are steady or follow each other.
    pub dynamics: Dynamics,
    /// The health parameters that actions set, in this order.
    #[schemars(length(min = 1, max = 10))]
    pub calibrated: Vec<HealthParameter>,
    /// Health parameters with fixed values; all others are 0, which is healthy.
    pub health: BTreeMap<HealthParameter, f64>,
    /// The flight conditions and the held quantity, point by point.
    pub flight: Flight,
    /// Time between two points of a transient.
    #[schemars(range(min = 0.01, max = 3600.0), extend("x-unit" = "s"))]
    pub interval_s: f64,
    /// Longest step of the shafts' speeds in a transient.
    #[schemars(range(min = 1e-4, max = 1.0), extend("x-unit" = "s", "x-source" = "AGTF30: 0.015"))]
    pub step_s: f64,
}

impl Default for TurbofanConfig {
    fn default() -> Self {
        use HealthParameter::{HptEfficiency, HptFlow, LptEfficiency, LptFlow};
        Self {
            engine: EngineName::default(),
            dynamics: Dynamics::default(),
            calibrated: vec![HptEfficiency, HptFlow, LptEfficiency, LptFlow],
            health: BTreeMap::new(),
            flight: Flight::default(),
            interval_s: 1.0,
            step_s: 0.015,
        }
    }
}

impl contract::Config for TurbofanConfig {}

impl TurbofanConfig {
    /// The configured health.
    ///
    /// # Errors
    /// [`Error::Config`] where a parameter is calibrated twice, both fixed and calibrated, or out of range.
    pub(super) fn given_health(&self) -> Result<Health, Error> {
        check_calibrated(&self.calibrated)?;
        let mut health = Health::default();
        for (parameter, value) in &self.health {
            let key = format!("health.{}", parameter.name());
            if self.calibrated.contains(parameter) {
                return Err(Error::config(key, "it is calibrated, so that actions set it"));
            }
            if value.abs() > LARGEST_WEAR {
                let problem = format!("{value} is not from -{LARGEST_WEAR} to {LARGEST_WEAR}");
                return Err(Error::config(key, problem));
            }
            parameter.set(&mut health, *value);
        }
        Ok(health)
    }
}

/// Refuses parameters that are named twice.
pub(super) fn check_calibrated(calibrated: &[HealthParameter]) -> Result<(), Error> {
    for (place, parameter) in calibrated.iter().enumerate() {
        if calibrated[..place].contains(parameter) {
            let problem = format!("`{}` is calibrated twice", parameter.name());
            return Err(Error::config("calibrated", problem));
        }
    }
    Ok(())
}
