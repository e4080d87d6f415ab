//! An environment as Python describes it: its seats, and the order of their numbers in shared memory.

use contract::{Channel, Choice, Error, Seat, Space, choice};
use serde::Deserialize;
use std::path::PathBuf;

/// Largest accepted excess of an entry of an action over -1 and 1, since squashing functions in single precision may
/// round to slightly more.
const ROUNDING: f64 = 1e-6;

/// The first answer of a server of environments: its shared memory, seats and metrics.
#[derive(Debug, Deserialize)]
pub struct EnvironmentDescription {
    /// Path of the shared memory.
    pub memory: PathBuf,
    /// Whether the path is a file on a disk, which is removed once it is open.
    pub remove: bool,
    seats: Vec<SeatForm>,
    state: Vec<BoxEntry>,
    /// Names of the metrics in an answer, in order.
    pub metrics: Vec<String>,
}

#[derive(Debug, Deserialize)]
struct SeatForm {
    name: String,
    observation: SpaceForm,
    action: SpaceForm,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "snake_case")]
enum SpaceForm {
    Box(Vec<BoxEntry>),
    Choices(Vec<Choice>),
}

/// An entry of a box; `None` for an absent limit.
#[derive(Debug, Deserialize)]
struct BoxEntry {
    name: String,
    low: Option<f64>,
    high: Option<f64>,
}

impl EnvironmentDescription {
    /// The seats as agents see them.
    pub fn seats(&self) -> Vec<Seat> {
        let seat = |form: &SeatForm| Seat {
            name: form.name.clone(),
            observation: observed(&form.observation),
            action: acted(&form.action),
        };
        self.seats.iter().map(seat).collect()
    }

    /// Channels of the full state.
    pub fn state(&self) -> Vec<Channel> {
        self.state.iter().map(channel).collect()
    }
}

fn observed(form: &SpaceForm) -> Space {
    match form {
        SpaceForm::Box(entries) => Space::Box(entries.iter().map(channel).collect()),
        SpaceForm::Choices(choices) => Space::Choices(choices.clone()),
    }
}

/// The typical value of an entry between two limits is their middle, and its typical deviation is half their distance.
fn channel(entry: &BoxEntry) -> Channel {
    let channel = Channel::new(&entry.name, "").within(
        entry.low.unwrap_or(f64::NEG_INFINITY),
        entry.high.unwrap_or(f64::INFINITY),
    );
    match (entry.low, entry.high) {
        (Some(low), Some(high)) if high > low => channel.typical((low + high) / 2.0, (high - low) / 2.0),
        (Some(low), Some(high)) => channel.typical((low + high) / 2.0, 1.0),
        _ => channel,
    }
}

/// Agents act between -1 and 1. The largest of several such numbers selects an option.
fn acted(form: &SpaceForm) -> Space {
    match form {
        SpaceForm::Box(entries) => {
            let unit = |entry: &BoxEntry| {
                let channel = Channel::new(&entry.name, "").within(-1.0, 1.0);
                match (entry.low, entry.high) {
                    (Some(low), Some(high)) => channel.standing_for(low, high),
                    _ => channel,
                }
            };
            Space::Box(entries.iter().map(unit).collect())
        }
        SpaceForm::Choices(choices) => Space::Choices(choices.clone()),
    }
}

/// Number of numbers of a seat's action that are sent to Python.
pub fn n_asked(seat: &Seat) -> usize {
    match &seat.action {
        Space::Choices(choices) => choices.len(),
        space => space.len(),
    }
}

/// Writes the numbers of an action in Python's form: entries between -1 and 1, the index of an option.
///
/// # Errors
/// [`Error::Action`] for a wrong number of entries, and for an entry outside -1 and 1.
pub fn asked(seat: &Seat, action: &[f64], numbers: &mut Vec<f64>) -> Result<(), Error> {
    if let Space::Choices(choices) = &seat.action {
        let taken = choice::taken(choices, action)?;
        #[allow(clippy::cast_precision_loss, reason = "nobody names 2^52 options")]
        numbers.extend(taken.into_iter().map(|option| option as f64));
        return Ok(());
    }
    if action.len() != seat.action.len() {
        let problem = format!("{} entries in place of {}", action.len(), seat.action.len());
        return Err(Error::Action { problem });
    }
    let is_outside = |value: &f64| value.is_nan() || value.abs() > 1.0 + ROUNDING;
    if let Some(entry) = action.iter().position(is_outside) {
        let place = [&seat.name, &seat.action.names()[entry]]
            .map(String::as_str)
            .join(".");
        let problem = format!(
            "{} is {}, outside [-1, 1]",
            place.trim_start_matches('.'),
            action[entry]
        );
        return Err(Error::Action { problem });
    }
    numbers.extend(action.iter().map(|value| value.clamp(-1.0, 1.0)));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn face() -> EnvironmentDescription {
        let entry = |name: &str, low: Option<f64>, high: Option<f64>| json!({ "name": name, "low": low, "high": high });
        let box_seat = json!({
            "name": "",
            "observation": { "box": [entry("angle", Some(-1.0), Some(3.0)), entry("speed", None, Some(2.0)),
                entry("fixed", Some(2.0), Some(2.0))] },
            "action": { "box": [entry("torque", Some(-2.0), Some(2.0))] },
        });
        let choosing = json!({
            "name": "second",
            "observation": { "box": [] },
            "action": { "choices": [{ "name": "action", "options": ["0", "1", "2"] }] },
        });
        serde_json::from_value(
            json!({ "memory": "/proc/1/fd/3", "remove": false, "seats": [box_seat, choosing], "state": [],
                "metrics": [] }),
        )
        .unwrap()
    }

    #[test]
    fn entries_within_limits_are_scaled_by_them_and_others_are_left() {
        let seats = face().seats();
        let Space::Box(channels) = &seats[0].observation else {
            panic!("{seats:?}")
        };
        let scales: Vec<(f64, f64)> = channels.iter().map(|it| (it.center, it.spread)).collect();
        assert_eq!(scales, [(1.0, 2.0), (0.0, 1.0), (2.0, 1.0)]);
        assert_eq!((channels[1].low, channels[1].high), (f64::NEG_INFINITY, 2.0));
    }

    #[test]
    fn actions_pass_as_entries_within_one_and_as_indices() {
        let seats = face().seats();
        let pass = |seat: usize, action: &[f64]| {
            let mut numbers = Vec::new();
            asked(&seats[seat], action, &mut numbers).map(|()| numbers)
        };
        assert_eq!(pass(0, &[1.0 + 1e-7]).unwrap(), [1.0]);
        assert_eq!(pass(1, &[-1.0, 0.5, 0.1]).unwrap(), [1.0]);
        assert_eq!([n_asked(&seats[0]), n_asked(&seats[1])], [1, 1]);
        for (seat, action) in [(0, vec![1.1]), (0, vec![f64::NAN]), (0, vec![]), (1, vec![0.0])] {
            assert!(
                matches!(pass(seat, &action), Err(Error::Action { .. })),
                "{action:?}"
            );
        }
        let problem = pass(0, &[-3.0]).unwrap_err().to_string();
        assert!(problem.contains("torque is -3, outside [-1, 1]"), "{problem}");
    }
}
