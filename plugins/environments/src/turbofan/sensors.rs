//! Sensors of an engine: which there are, over which ranges they read, and what may be calibrated from them.

use super::OUTPUTS;
use super::config::{HealthParameter, LARGEST_WEAR};
use super::fleet::Fleet;
use super::model::{FlightCondition, SensorModel};
use engine::{Channel, Error};

/// What is measured by default: the sensors of N-CMAPSS that say something of health.
pub(super) const SENSORS: [&str; 14] = [
    "n1_rpm",
    "n2_rpm",
    "fuel_flow_kg_s",
    "t21_k",
    "t24_k",
    "t30_k",
    "t48_k",
    "t50_k",
    "p15_pa",
    "p21_pa",
    "p24_pa",
    "p30_pa",
    "p45_pa",
    "p50_pa",
];

/// Middle and half width of each sensor over some points of some flights of the fleet, with the smallest and the
/// largest health that flights are seen with. Environments are built often: few points must do.
///
/// # Errors
/// [`Error::Model`] where the engine finds no operating point.
pub(super) fn ranges(
    fleet: &Fleet,
    [low, high]: [f64; 2],
    n_parameters: usize,
    mut engine: SensorModel,
) -> Result<Vec<(f64, f64)>, Error> {
    let mut reads = Vec::new();
    for unit in 0..fleet.units.min(3) {
        let flight = fleet.flight(unit, 0, engine.design_ratio());
        for point in (0..4).map(|corner| &flight[corner * (flight.len() - 1) / 3]) {
            for theta in [low.max(-0.02), high.min(0.01)] {
                reads.push(engine.read(&FlightCondition::of(point), &vec![theta; n_parameters])?);
            }
        }
    }
    let range = |sensor: usize| {
        let values = || reads.iter().map(|read| read[sensor]);
        let (low, high) = (
            values().fold(f64::INFINITY, f64::min),
            values().fold(f64::NEG_INFINITY, f64::max),
        );
        ((low + high) / 2.0, ((high - low) / 2.0).max(1e-9 * high.abs()))
    };
    Ok((0..reads[0].len()).map(range).collect())
}

/// Channels of sensors with their ranges.
pub(super) fn sensor_channels(prefix: &str, sensors: &[String], ranges: &[(f64, f64)]) -> Vec<Channel> {
    let unit = |name: &str| {
        let known = OUTPUTS.iter().find(|(output, _)| *output == name);
        known.map_or("", |(_, unit)| unit)
    };
    let channel = |(name, (middle, half)): (&String, &(f64, f64))| {
        Channel::new(format!("{prefix}{name}"), unit(name)).typical(*middle, *half)
    };
    sensors.iter().zip(ranges).map(channel).collect()
}

/// Refuses parameters that are named twice and a range of theta outside of what engines are made for.
pub(super) fn check(calibrated: &[HealthParameter], [low, high]: [f64; 2]) -> Result<(), Error> {
    for (place, parameter) in calibrated.iter().enumerate() {
        if calibrated[..place].contains(parameter) {
            let problem = format!("`{}` is calibrated twice", parameter.name());
            return Err(Error::config("calibrated", problem));
        }
    }
    if !(-LARGEST_WEAR..LARGEST_WEAR).contains(&low) || low >= high || high > LARGEST_WEAR {
        let problem = format!("[{low}, {high}] is no range inside [-{LARGEST_WEAR}, {LARGEST_WEAR}]");
        return Err(Error::config("theta_range", problem));
    }
    Ok(())
}
