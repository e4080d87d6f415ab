//! A fleet of engines that wear: the flights and the health of its units. N-CMAPSS has real flights (M. Arias
//! Chao, C. Kulkarni, K. Goebel and O. Fink, "Aircraft engine run-to-failure dataset under real flight
//! conditions for prognostics and diagnostics", Data 6 (2021) 5); here they are synthetic, in the same shape
//! and in the ranges of its sets.
//!
//! Every value is a function of the fleet's seed, the unit and the cycle, so that a trajectory can be entered
//! at any position without the samples before.

use super::config::HealthParameter;
use super::flight::{DrawnFlight, FlightClass, FlightPoint};
use contract::{Rng, random::stream};
use rand::Rng as _;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The units of a fleet and their wear.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Fleet {
    /// Number of units.
    #[schemars(range(min = 1, max = 100_000))]
    pub units: usize,
    /// Number of the first unit: units with other numbers are other engines.
    #[schemars(range(min = 0, max = 1_000_000))]
    pub first_unit: usize,
    /// Seed of all random choices.
    pub seed: u64,
    /// Degradation of the units' health.
    pub degradation: Degradation,
}

/// Degradation of the units' health.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Degradation {
    /// Initial wear, slow linear wear, and from some cycle on a growing abnormal wear, over the life of a unit;
    /// one flight per cycle, of the unit's class.
    Life {
        /// Number of flights of a unit.
        #[schemars(range(min = 1, max = 10_000))]
        cycles: usize,
        /// Number of samples of a flight, evenly spaced.
        #[schemars(range(min = 2, max = 10_000))]
        samples: usize,
    },
    /// Every unit is one fault: an intensity per calibrated parameter, drawn once and constant over a part of
    /// the same flight.
    Faults {
        /// Number of samples of a fault.
        #[schemars(range(min = 2, max = 10_000))]
        samples: usize,
    },
}

impl Default for Fleet {
    fn default() -> Self {
        Self {
            units: 10,
            first_unit: 0,
            seed: 0,
            degradation: Degradation::Life {
                cycles: 75,
                samples: 20,
            },
        }
    }
}

/// The largest relative loss of a healthy life by parameter: the 99.9th percentile of N-CMAPSS where it moves
/// the parameter; a third of that for the fan and the booster, since no engine here survives their losses.
fn largest_loss(parameter: HealthParameter) -> f64 {
    use HealthParameter as P;
    match parameter {
        P::HptEfficiency => 0.0187,
        P::LptEfficiency => 0.0362,
        P::LptFlow => 0.0329,
        P::HpcEfficiency => 0.0255,
        P::HpcFlow | P::FanFlow => 0.04,
        P::FanEfficiency | P::LpcEfficiency => 0.04,
        P::LpcFlow => 0.0153,
        P::HptFlow => 0.02,
    }
}

impl Fleet {
    /// Number of samples in a unit's whole trajectory.
    #[must_use]
    pub(super) fn length(&self) -> usize {
        match self.degradation {
            Degradation::Life { cycles, samples } => cycles * samples,
            Degradation::Faults { samples } => samples,
        }
    }

    /// Number of samples of a flight.
    #[must_use]
    pub(super) fn samples(&self) -> usize {
        match self.degradation {
            Degradation::Life { samples, .. } | Degradation::Faults { samples } => samples,
        }
    }

    /// The samples of the flight in a cycle of a unit.
    pub(super) fn flight(&self, unit: usize, cycle: usize, design_ratio: f64) -> Vec<FlightPoint> {
        let thinned = self.thinned(unit, cycle, design_ratio);
        (0..self.samples()).map(|sample| thinned.at(sample)).collect()
    }

    /// One sample of the flight in a cycle of a unit.
    pub(super) fn point(
        &self,
        unit: usize,
        (cycle, sample): (usize, usize),
        design_ratio: f64,
    ) -> FlightPoint {
        self.thinned(unit, cycle, design_ratio).at(sample)
    }

    fn thinned(&self, unit: usize, cycle: usize, design_ratio: f64) -> SampledFlight {
        let unit = self.first_unit + unit;
        match self.degradation {
            Degradation::Life { samples, .. } => {
                let class = match unit % 3 {
                    0 => FlightClass::Short,
                    1 => FlightClass::Medium,
                    _ => FlightClass::Long,
                };
                SampledFlight {
                    flight: DrawnFlight::of(class, design_ratio, &mut self.stream("flight", unit, cycle)),
                    interval_s: 30.0,
                    samples,
                    part: (0.0, 1.0),
                }
            }
            Degradation::Faults { samples } => {
                // All faults share one unit's flight; each covers a part of it.
                let mut rng = self.stream("flight", 0, 0);
                let begin = 0.8 * self.stream("part", unit, 0).random::<f64>();
                SampledFlight {
                    flight: DrawnFlight::of(FlightClass::Short, design_ratio, &mut rng),
                    interval_s: 10.0,
                    samples,
                    part: (begin, begin + 0.2),
                }
            }
        }
    }

    /// The true health of a unit in a cycle.
    pub(super) fn theta(&self, unit: usize, cycle: usize, calibrated: &[HealthParameter]) -> Vec<f64> {
        let unit = self.first_unit + unit;
        let loss = |parameter: &HealthParameter| {
            let mut rng = self.stream(parameter.name(), unit, 0);
            let largest = largest_loss(*parameter);
            match self.degradation {
                Degradation::Life { cycles, .. } => -largest * worn(cycle as f64 / cycles as f64, &mut rng),
                // Losses of efficiency, and gains or losses of flow by erosion and fouling.
                Degradation::Faults { .. } if parameter.name().ends_with("efficiency") => {
                    -largest * rng.random::<f64>()
                }
                Degradation::Faults { .. } => largest * (2.0 * rng.random::<f64>() - 1.0),
            }
        };
        calibrated.iter().map(loss).collect()
    }

    fn stream(&self, what: &str, unit: usize, cycle: usize) -> Rng {
        let (seed, unit, cycle) = (self.seed.to_string(), unit.to_string(), cycle.to_string());
        stream(&["fleet", what, &seed, &unit, &cycle])
    }
}

/// Wear after a fraction of a life, 0 to 1: up to a tenth at first, up to a fifth more slowly, and from an
/// onset between 40 and 70 % of the life on an abnormal part that grows with the power of 2.
fn worn(part: f64, rng: &mut Rng) -> f64 {
    let mut between = |low: f64, high: f64| low + (high - low) * rng.random::<f64>();
    let (initial, slow, onset) = (between(0.0, 0.1), between(0.1, 0.2), between(0.4, 0.7));
    let abnormal = between(0.5, 0.7);
    let since = ((part - onset) / (1.0 - onset)).max(0.0);
    initial + slow * part + abnormal * since * since
}

/// Evenly spaced samples between two parts of a flight.
struct SampledFlight {
    flight: DrawnFlight,
    /// Time between the points from which samples are taken, s.
    interval_s: f64,
    samples: usize,
    part: (f64, f64),
}

impl SampledFlight {
    fn at(&self, sample: usize) -> FlightPoint {
        let last = (self.flight.n_points(self.interval_s) - 1) as f64;
        let (begin, end) = self.part;
        let place = begin + (end - begin) * sample as f64 / (self.samples - 1).max(1) as f64;
        self.flight.at((place * last).round() * self.interval_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_wear_from_cycle_to_cycle_and_stay_in_range() {
        let fleet = Fleet::default();
        let calibrated = [HealthParameter::HptEfficiency, HealthParameter::LptFlow];
        for unit in 0..fleet.units {
            let of_cycle = |cycle| fleet.theta(unit, cycle, &calibrated);
            assert!((1..75).all(|cycle| of_cycle(cycle)[0] <= of_cycle(cycle - 1)[0]));
            assert!(of_cycle(74)[0] >= -0.0187 && of_cycle(74)[0] < -0.6 * 0.0187 && of_cycle(0)[0] > -0.002);
            assert_ne!(of_cycle(74), fleet.theta((unit + 1) % 10, 74, &calibrated));
        }
        let later = Fleet {
            first_unit: 3,
            ..fleet
        };
        assert_eq!(later.theta(0, 30, &calibrated), fleet.theta(3, 30, &calibrated));
        assert_eq!(later.flight(0, 30, 6.0), fleet.flight(3, 30, 6.0));
    }

    #[test]
    fn faults_differ_and_fly_parts_of_one_flight() {
        let fleet = Fleet {
            units: 1315,
            degradation: Degradation::Faults { samples: 50 },
            ..Fleet::default()
        };
        let calibrated = [HealthParameter::HptEfficiency, HealthParameter::HptFlow];
        let thetas: Vec<_> = (0..1315).map(|unit| fleet.theta(unit, 0, &calibrated)).collect();
        assert!(
            thetas
                .iter()
                .all(|theta| theta[0] <= 0.0 && theta[0] >= -0.0187 && theta[1].abs() <= 0.02)
        );
        assert!(thetas.iter().any(|theta| theta[1] > 0.01) && thetas.iter().any(|theta| theta[1] < -0.01));
        let flight = fleet.flight(7, 0, 6.0);
        assert_eq!((flight.len(), fleet.length()), (50, 50));
        assert_ne!(flight, fleet.flight(8, 0, 6.0));
    }

    #[test]
    fn flights_of_a_life_have_their_first_and_last_point() {
        let fleet = Fleet::default();
        let flight = fleet.flight(2, 5, 6.0);
        assert_eq!(flight.len(), 20);
        assert!(
            flight[0].altitude_m < 3100.0 && flight[19].altitude_m < 3500.0,
            "{flight:?}"
        );
        assert!(flight.iter().all(|point| point.outside().is_none()));
    }
}
