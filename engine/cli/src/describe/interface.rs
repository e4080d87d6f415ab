//! Observations and actions of an environment's seats, and its trace, in few lines: channels whose names differ only in
//! a number are shown together.

use contract::{Channel, Interface, Seat, Space};
use serde::{Serialize, Serializer};

/// Channels whose names differ only in numbers.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Channels {
    /// The first name.
    pub first: String,
    /// The last name; the first one where there is one channel.
    pub last: String,
    /// Number of channels.
    pub count: usize,
    /// SI unit; empty where there is none.
    pub unit: String,
    /// Smallest value; null where there is no limit.
    #[serde(serialize_with = "rounded")]
    pub low: Option<f64>,
    /// Largest value; null where there is no limit.
    #[serde(serialize_with = "rounded")]
    pub high: Option<f64>,
}

/// A space in words and data.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SpaceFacts {
    /// `box`, `simplex`, `discrete` or `choices`.
    pub kind: &'static str,
    /// Entries of a vector.
    pub entries: usize,
    /// Channels of a box, and the entries of a simplex.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub channels: Vec<Channels>,
    /// The options of a choice, or of each choice if there are several at once.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub options: Vec<ChoiceOptions>,
}

/// Options of one choice.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ChoiceOptions {
    /// Names of the choices; empty if there is only one choice.
    pub choice: String,
    /// The names of the options.
    pub among: Vec<String>,
}

/// Seats with the same observations and actions.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SeatFacts {
    /// Their names; one empty name for the only seat of an environment.
    pub names: Vec<String>,
    /// Channels that each of them observes.
    pub observes: SpaceFacts,
    /// Channels of each one's action.
    pub does: SpaceFacts,
}

/// Seats in order, with equal ones together.
pub(super) fn seats(interface: &Interface) -> Vec<SeatFacts> {
    let mut all: Vec<SeatFacts> = Vec::new();
    for Seat {
        name,
        observation,
        action,
    } in &interface.seats
    {
        let (observes, does) = (space(observation), space(action));
        match all
            .iter_mut()
            .find(|it| it.observes == observes && it.does == does)
        {
            Some(alike) => alike.names.push(name.clone()),
            None => all.push(SeatFacts {
                names: vec![name.clone()],
                observes,
                does,
            }),
        }
    }
    all
}

fn space(space: &Space) -> SpaceFacts {
    let options = |choice: &str, among: &[String]| ChoiceOptions {
        choice: choice.into(),
        among: among.to_vec(),
    };
    let (kind, channels, options) = match space {
        Space::Box(list) => ("box", channels(list), Vec::new()),
        Space::Simplex(names) => ("simplex", channels(&shares(names)), Vec::new()),
        Space::Discrete(names) => ("discrete", Vec::new(), vec![options("", names)]),
        Space::Choices(choices) => {
            let each = choices.iter().map(|it| options(&it.name, &it.options));
            ("choices", Vec::new(), each.collect())
        }
    };
    SpaceFacts {
        kind,
        entries: space.len(),
        channels,
        options,
    }
}

fn shares(names: &[String]) -> Vec<Channel> {
    names
        .iter()
        .map(|name| Channel::new(name, "").within(0.0, 1.0))
        .collect()
}

/// Channels in the order of their first names, with numbered ones together.
pub(super) fn channels(list: &[Channel]) -> Vec<Channels> {
    let mut all: Vec<Channels> = Vec::new();
    for channel in list {
        let limit = |value: f64| Some(value).filter(|value| value.is_finite());
        let one = Channels {
            first: channel.name.clone(),
            last: channel.name.clone(),
            count: 1,
            unit: channel.unit.clone(),
            low: limit(channel.low),
            high: limit(channel.high),
        };
        match all.iter_mut().find(|group| is_alike(group, &one)) {
            Some(group) => {
                group.last.clone_from(&one.first);
                group.count += 1;
            }
            None => all.push(one),
        }
    }
    all
}

fn is_alike(group: &Channels, one: &Channels) -> bool {
    let is_numbered = group.first.contains(|letter: char| letter.is_ascii_digit());
    is_numbered
        && stem(&group.first) == stem(&one.first)
        && (&group.unit, group.low, group.high) == (&one.unit, one.low, one.high)
}

/// A name without its numbers.
fn stem(name: &str) -> String {
    name.split(|letter: char| letter.is_ascii_digit())
        .filter(|part| !part.is_empty())
        .collect::<Vec<_>>()
        .join("#")
}

/// Limits rounded to four digits, so that rounding errors of computed limits are not shown.
pub(super) fn short(value: f64) -> f64 {
    format!("{value:.3e}").parse().unwrap_or(value)
}

#[expect(clippy::ref_option, reason = "serde passes a reference")]
fn rounded<S: Serializer>(value: &Option<f64>, serializer: S) -> Result<S::Ok, S::Error> {
    value.map(short).serialize(serializer)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbered_channels_stand_together() {
        let volt = |name: &str| Channel::new(name, "V").within(0.0, 5.0);
        let list = [
            volt("voltage_1"),
            Channel::new("current_1", "A"),
            volt("voltage_2"),
            volt("voltage_10"),
            Channel::new("demand", "W"),
            Channel::new("demand", "W"),
        ];
        let found = channels(&list);
        let shown: Vec<(&str, &str, usize)> = found
            .iter()
            .map(|it| (it.first.as_str(), it.last.as_str(), it.count))
            .collect();
        assert_eq!(
            shown,
            [
                ("voltage_1", "voltage_10", 3),
                ("current_1", "current_1", 1),
                ("demand", "demand", 1),
                ("demand", "demand", 1)
            ]
        );
        assert_eq!((found[0].low, found[1].low), (Some(0.0), None));
    }

    #[test]
    fn limits_have_four_digits() {
        assert_eq!(
            [short(0.123_456), short(-12_345.6), short(0.0)],
            [0.1235, -12350.0, 0.0]
        );
    }
}
