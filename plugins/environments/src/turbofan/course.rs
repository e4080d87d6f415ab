//! What units go through, sample by sample: made up, or recorded.

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
    /// Those of a fleet, whose sensors its engine has to read.
    MadeUp(MadeUp),
    /// Those of a file, with what the sensors read.
    Recorded(Arc<Recording>),
}

/// The fleet's part.
#[derive(Debug)]
pub(super) struct MadeUp {
    pub fleet: Fleet,
    pub calibrated: Vec<HealthParameter>,
    /// Ratio of turbine inlet and ambient total temperature at the engine's design point.
    pub design_ratio: f64,
}

impl Course {
    pub(super) fn n_units(&self) -> usize {
        match self {
            Self::MadeUp(it) => it.fleet.units,
            Self::Recorded(recording) => recording.n_units(),
        }
    }

    /// The number by which a unit is known.
    pub(super) fn number(&self, unit: usize) -> u64 {
        match self {
            Self::MadeUp(it) => (it.fleet.first_unit + unit) as u64,
            Self::Recorded(recording) => recording.number(unit).into(),
        }
    }

    /// Samples of a unit.
    pub(super) fn length(&self, unit: usize) -> usize {
        match self {
            Self::MadeUp(it) => it.fleet.length(),
            Self::Recorded(recording) => recording.length(unit),
        }
    }

    /// A unit and a place in its life, where every place of every life is equally likely.
    pub(super) fn draw(&self, rng: &mut Rng) -> (usize, usize) {
        let total = (0..self.n_units()).map(|unit| self.length(unit)).sum();
        let (mut unit, mut place) = (0, rng.random_range(0..total));
        while place >= self.length(unit) {
            place -= self.length(unit);
            unit += 1;
        }
        (unit, place)
    }

    /// A sample of a unit; nothing is read of one that is made up.
    pub(super) fn sample(&self, unit: usize, at: usize) -> Sample {
        match self {
            Self::MadeUp(it) => it.sample(unit, at),
            Self::Recorded(recording) => recording.sample(unit, at).clone(),
        }
    }
}

impl MadeUp {
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
