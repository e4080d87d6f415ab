//! Flights and health of units, sample by sample: simulated or recorded.

use super::config::HealthParameter;
use super::fleet::Fleet;
use super::model::FlightCondition;
use super::recorded::{Recording, Sample};
use contract::Rng;
use rand::Rng as _;
use std::sync::Arc;

/// Flights and health of units. Units are counted from 0, whatever their numbers are.
#[derive(Debug)]
pub(super) enum Course {
    /// A fleet's; the sensors have to be computed with its engine.
    Synthetic(SyntheticCourse),
    /// A file's, with the sensor readings.
    Recorded(Arc<Recording>),
}

/// Flights and health of a fleet, computed from its seed.
#[derive(Debug)]
pub(super) struct SyntheticCourse {
    pub fleet: Fleet,
    pub calibrated: Vec<HealthParameter>,
    /// Ratio of turbine inlet and ambient total temperature at the engine's design point.
    pub design_ratio: f64,
}

impl Course {
    pub(super) fn n_units(&self) -> usize {
        match self {
            Self::Synthetic(it) => it.fleet.units,
            Self::Recorded(recording) => recording.n_units(),
        }
    }

    /// The number by which a unit is known.
    pub(super) fn number(&self, unit: usize) -> u64 {
        match self {
            Self::Synthetic(it) => (it.fleet.first_unit + unit) as u64,
            Self::Recorded(recording) => recording.number(unit).into(),
        }
    }

    /// Number of samples of a unit.
    pub(super) fn length(&self, unit: usize) -> usize {
        match self {
            Self::Synthetic(it) => it.fleet.length(),
            Self::Recorded(recording) => recording.length(unit),
        }
    }

    /// A unit and a position in its life, where every position in every life is equally likely.
    pub(super) fn draw(&self, rng: &mut Rng) -> (usize, usize) {
        let total = (0..self.n_units()).map(|unit| self.length(unit)).sum();
        let (mut unit, mut place) = (0, rng.random_range(0..total));
        while place >= self.length(unit) {
            place -= self.length(unit);
            unit += 1;
        }
        (unit, place)
    }

    /// A sample of a unit; without sensor readings for a fleet.
    pub(super) fn sample(&self, unit: usize, at: usize) -> Sample {
        match self {
            Self::Synthetic(it) => it.sample(unit, at),
            Self::Recorded(recording) => recording.sample(unit, at).clone(),
        }
    }
}

impl SyntheticCourse {
    fn sample(&self, unit: usize, at: usize) -> Sample {
        let samples = self.fleet.samples();
        let place = (at / samples, at % samples);
        Sample {
            condition: FlightCondition::of(&self.fleet.point(unit, place, self.design_ratio)),
            theta: self.fleet.theta(unit, place.0, &self.calibrated),
            read: None,
        }
    }
}
