//! Compares a dataset with an environment: the first difference between the spaces of their seats.

use crate::{Channel, Interface, Seat, Space};

/// A difference between two interfaces.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Difference {
    /// Name of the property that differs.
    pub(super) what: String,
    /// Description of it in the dataset.
    pub(super) found: String,
    /// Its value in the environment.
    pub(super) expected: String,
}

/// The first difference; `None` if decisions of one are also decisions of the other.
pub(super) fn difference(found: &Interface, expected: &Interface) -> Option<Difference> {
    let (seats, here) = (found.seats.len(), expected.seats.len());
    if seats != here {
        return differ("the number of seats", seats, here);
    }
    let of_seats = found
        .seats
        .iter()
        .zip(&expected.seats)
        .find_map(|(found, expected)| of_seats(found, expected));
    // The full state is kept only of several seats.
    of_seats.or_else(|| {
        let of = |interface: &Interface| Space::Box(interface.state.clone());
        (seats > 1).then(|| of_spaces("full state", &of(found), &of(expected), &unit))?
    })
}

fn of_seats(found: &Seat, expected: &Seat) -> Option<Difference> {
    of_spaces("observation", &found.observation, &expected.observation, &unit)
        .or_else(|| of_spaces("action", &found.action, &expected.action, &unit_and_limits))
}

/// A property of a channel, besides its name, that must be the same in both.
type Quality = dyn Fn(&Channel) -> String;

fn unit(channel: &Channel) -> String {
    if channel.unit.is_empty() {
        "without unit".into()
    } else {
        format!("in {}", channel.unit)
    }
}

fn unit_and_limits(channel: &Channel) -> String {
    format!("{} within {} and {}", unit(channel), channel.low, channel.high)
}

fn of_spaces(what: &str, found: &Space, expected: &Space, quality: &Quality) -> Option<Difference> {
    if kind(found) != kind(expected) {
        return differ(format!("the {what}"), kind(found), kind(expected));
    }
    let (entries, here) = (entries(found, quality), entries(expected, quality));
    let pair = (1..)
        .zip(entries.iter().zip(&here))
        .find(|(_, (found, expected))| found != expected);
    match pair {
        Some((number, (found, expected))) => differ(format!("entry {number} of the {what}"), found, expected),
        None if entries.len() != here.len() => {
            differ(format!("the length of the {what}"), entries.len(), here.len())
        }
        None => None,
    }
}

fn entries(space: &Space, quality: &Quality) -> Vec<String> {
    match space {
        Space::Box(channels) => channels
            .iter()
            .map(|channel| format!("`{}` {}", channel.name, quality(channel)))
            .collect(),
        Space::Simplex(names) | Space::Discrete(names) => {
            names.iter().map(|name| format!("`{name}`")).collect()
        }
        Space::Choices(_) => space.names().iter().map(|name| format!("`{name}`")).collect(),
    }
}

fn kind(space: &Space) -> &'static str {
    match space {
        Space::Box(_) => "a box",
        Space::Simplex(_) => "a simplex",
        Space::Discrete(_) => "a choice",
        Space::Choices(_) => "a set of choices",
    }
}

fn differ(what: impl Into<String>, found: impl ToString, expected: impl ToString) -> Option<Difference> {
    Some(Difference {
        what: what.into(),
        found: found.to_string(),
        expected: expected.to_string(),
    })
}
