//! Config of the environment, with its channels and metrics.

use crate::{
    turbofan::engine::EngineName,
    turbofan::{
        config::HealthParameter,
        fleet::Fleet,
        model::{FlightCondition, Model},
        recorded::RecordedFlights,
        sensors::{SENSORS, sensor_channels},
    },
};
use contract::{Channel, Metric, PerEpisode, Seat, Space};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Cost of an error of the outputs; e is the Euclidean norm of the scaled errors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Cost {
    /// The mean of the squared errors, as in the thesis.
    MeanSquared,
    /// e, and ten times as much above 0.01, as in the released code.
    #[default]
    Kinked,
}

/// The part of a trajectory that an episode covers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Trajectory {
    /// A piece of this number of samples from any unit's life, from anywhere; the end of a life is followed by
    /// its beginning.
    Piece(#[schemars(range(min = 1, max = 100_000))] usize),
    /// The whole trajectory of a unit; a measurement takes the units in their order.
    Units,
}

/// Settings of the `turbofan_calibration` environment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CalibrationConfig {
    /// The engine whose sensors are tracked.
    pub engine: EngineName,
    /// The model whose outputs follow the actions.
    pub model: Model,
    /// The health parameters that actions set and that wear.
    #[schemars(length(min = 1, max = 10))]
    pub calibrated: Vec<HealthParameter>,
    /// The sensors, by names of the outputs of `turbofan`.
    #[schemars(length(min = 1, max = 25))]
    pub sensors: Vec<String>,
    /// Smallest and largest health parameter of an action.
    #[schemars(inner(range(min = -0.1, max = 0.1)))]
    pub theta_range: [f64; 2],
    /// The engines and their wear.
    pub fleet: Fleet,
    /// Recorded flights instead of the fleet. The engine then serves as the model, unless a surrogate does.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub recorded: Option<RecordedFlights>,
    /// The part of a trajectory that an episode covers.
    pub trajectory: Trajectory,
    /// Cost of an error of the outputs.
    pub cost: Cost,
    /// Factor of the model's outputs, for a biased model.
    #[schemars(range(min = 0.5, max = 2.0), extend("x-source" = "thesis, table 2.4: 1.02"))]
    pub model_bias: f64,
    /// Standard deviation of the random factor of each of the model's outputs.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "thesis, table 2.4: 0.1"))]
    pub model_noise: f64,
    /// Signal-to-noise ratio of the sensors, null for none: noise of -20 log10 (sd / value) dB.
    #[schemars(range(min = 0.0, max = 200.0), extend("x-unit" = "dB", "x-source" = "thesis, table 2.5: 70"))]
    pub sensor_snr_db: Option<f64>,
}

impl Default for CalibrationConfig {
    fn default() -> Self {
        Self {
            engine: EngineName::Hbtf,
            model: Model::Engine,
            calibrated: vec![HealthParameter::HptEfficiency],
            sensors: SENSORS.map(String::from).to_vec(),
            theta_range: [-0.03, 0.01],
            fleet: Fleet::default(),
            recorded: None,
            trajectory: Trajectory::Piece(512),
            cost: Cost::default(),
            model_bias: 1.0,
            model_noise: 0.0,
            sensor_snr_db: None,
        }
    }
}

impl contract::Config for CalibrationConfig {}

pub(super) fn seat(config: &CalibrationConfig, ranges: &[(f64, f64)]) -> Seat {
    let sensors = |prefix| sensor_channels(prefix, &config.sensors, ranges);
    let action = |parameter: &HealthParameter| Channel::new(parameter.name(), "").within(-1.0, 1.0);
    let observed = [sensors("model_"), FlightCondition::channels(), sensors("target_")].concat();
    Seat {
        name: String::new(),
        observation: Space::Box(observed),
        action: Space::Box(config.calibrated.iter().map(action).collect()),
    }
}

/// Name of the metric with the squared error of one parameter.
pub(super) fn squared_error(parameter: &HealthParameter) -> String {
    format!("{}_squared_error", parameter.name())
}

pub(super) fn metrics(calibrated: &[HealthParameter]) -> Vec<Metric> {
    let last = |name: &str, about: &str| {
        Metric::new(name, "", about)
            .lower_is_better()
            .per_episode(PerEpisode::Last)
    };
    let mut metrics = vec![
        last(
            "theta_rmse",
            "root of the mean squared error of the health parameters",
        ),
        last(
            "output_rmse",
            "root of the mean squared error of the outputs, scaled to [-1, 1]",
        ),
    ];
    let of_one = |parameter: &HealthParameter| {
        Metric::new(&squared_error(parameter), "", "squared error of this parameter")
            .lower_is_better()
            .per_episode(PerEpisode::Mean)
    };
    metrics.extend(calibrated.iter().map(of_one));
    metrics
}
