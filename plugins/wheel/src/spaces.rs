//! Spaces as Python receives them, and actions as Python returns them.
//!
//! A choice arrives as the position of its option, every other number unchanged. This is the inverse of the conversion
//! in `plugins/python` for environments written in Python.

use contract::{Channel, Error, Metric, Seat, Space};
use pyo3::prelude::*;

/// Name and spaces of a seat.
#[derive(IntoPyObject)]
pub struct SeatForm {
    name: String,
    observation: SpaceForm,
    action: SpaceForm,
}

/// A space: `box`, `simplex`, `discrete` or `choices`.
#[derive(IntoPyObject)]
pub struct SpaceForm {
    kind: &'static str,
    /// One name per number of a vector in the space.
    names: Vec<String>,
    /// Units of a box; its limits, typical values and typical deviations follow.
    units: Vec<String>,
    low: Vec<f64>,
    high: Vec<f64>,
    center: Vec<f64>,
    spread: Vec<f64>,
    /// Name and options of each choice.
    options: Vec<(String, Vec<String>)>,
}

/// Name, unit and direction of a metric.
#[derive(IntoPyObject)]
pub struct MetricForm {
    name: String,
    unit: String,
    about: String,
}

impl From<&Seat> for SeatForm {
    fn from(seat: &Seat) -> Self {
        Self {
            name: seat.name.clone(),
            observation: SpaceForm::from(&seat.observation),
            action: SpaceForm::from(&seat.action),
        }
    }
}

impl From<&Metric> for MetricForm {
    fn from(metric: &Metric) -> Self {
        let Metric {
            name, unit, about, ..
        } = metric.clone();
        Self { name, unit, about }
    }
}

impl SpaceForm {
    /// A box over these channels.
    pub fn of_channels(channels: &[Channel]) -> Self {
        Self {
            units: channels.iter().map(|channel| channel.unit.clone()).collect(),
            low: channels.iter().map(|channel| channel.low).collect(),
            high: channels.iter().map(|channel| channel.high).collect(),
            center: channels.iter().map(|channel| channel.center).collect(),
            spread: channels.iter().map(|channel| channel.spread).collect(),
            names: channels.iter().map(|channel| channel.name.clone()).collect(),
            ..Self::plain("box", Vec::new())
        }
    }

    fn plain(kind: &'static str, names: Vec<String>) -> Self {
        Self {
            kind,
            names,
            units: Vec::new(),
            low: Vec::new(),
            high: Vec::new(),
            center: Vec::new(),
            spread: Vec::new(),
            options: Vec::new(),
        }
    }
}

impl From<&Space> for SpaceForm {
    fn from(space: &Space) -> Self {
        let options = match space {
            Space::Box(channels) => return Self::of_channels(channels),
            Space::Simplex(names) => return Self::plain("simplex", names.clone()),
            Space::Discrete(names) => vec![("choice".into(), names.clone())],
            Space::Choices(choices) => choices
                .iter()
                .map(|choice| (choice.name.clone(), choice.options.clone()))
                .collect(),
        };
        let kind = if matches!(space, Space::Discrete(_)) {
            "discrete"
        } else {
            "choices"
        };
        Self {
            options,
            ..Self::plain(kind, space.names())
        }
    }
}

/// Actions of all seats from the numbers that Python gave, seat after seat.
///
/// # Errors
/// [`Error::Action`] for a number that is no position of an option; other values outside a space are refused by
/// the environment.
pub fn actions(seats: &[Seat], asked: &[f64]) -> Result<Vec<Vec<f64>>, Error> {
    let mut rest = asked;
    let of_seat = |seat: &Seat| {
        let (own, after) = rest.split_at(seat.action.n_asked());
        rest = after;
        seat.action.asked(own)
    };
    seats.iter().map(of_seat).collect()
}
