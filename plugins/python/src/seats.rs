//! Seats in the form that an agent in Python gets, and the numbers of its actions.

use contract::{Action, Channel, Error, Seat, Space, choice};
use serde_json::{Value, json};

/// Names and spaces of the seats, in order.
pub fn described(seats: &[Seat]) -> Value {
    let seat = |seat: &Seat| {
        json!({
            "name": seat.name,
            "observation": observed(&seat.observation),
            "action": acted(&seat.action),
        })
    };
    seats.iter().map(seat).collect()
}

fn observed(space: &Space) -> Value {
    let limits: Vec<(Option<f64>, Option<f64>)> = match space {
        Space::Box(channels) => channels.iter().map(limits).collect(),
        Space::Simplex(names) => vec![(Some(0.0), Some(1.0)); names.len()],
        #[allow(clippy::cast_precision_loss, reason = "nobody names 2^52 options")]
        Space::Discrete(names) => vec![(Some(0.0), Some(names.len() as f64 - 1.0))],
        Space::Choices(_) => vec![(Some(-1.0), Some(1.0)); space.len()],
    };
    json!({ "names": space.names(), "limits": limits })
}

/// Limits of a channel; `None` for an infinite one, which JSON cannot write.
fn limits(channel: &Channel) -> (Option<f64>, Option<f64>) {
    let finite = |limit: f64| limit.is_finite().then_some(limit);
    (finite(channel.low), finite(channel.high))
}

fn acted(space: &Space) -> Value {
    match space {
        Space::Box(channels) => {
            let own = channels.iter().map(|channel| channel.own_limits);
            let limits: Vec<_> = channels.iter().map(limits).collect();
            json!({ "kind": "box", "names": space.names(), "limits": limits, "own": own.collect::<Vec<_>>() })
        }
        Space::Simplex(names) => json!({ "kind": "simplex", "names": names }),
        Space::Discrete(options) => {
            json!({ "kind": "choices", "choices": [{ "name": "choice", "options": options }] })
        }
        Space::Choices(choices) => json!({ "kind": "choices", "choices": choices }),
    }
}

/// Writes the numbers of an action in Python's form; a choice becomes the position of its option.
///
/// # Errors
/// [`Error::Action`] for an action outside the spaces of these seats.
pub fn asked(seats: &[Seat], action: &[Vec<f64>], numbers: &mut Vec<f64>) -> Result<(), Error> {
    for (seat, own) in seats.iter().zip(action) {
        match &seat.action {
            #[allow(clippy::cast_precision_loss, reason = "nobody names 2^52 options")]
            Space::Choices(choices) => {
                numbers.extend(choice::taken(choices, own)?.into_iter().map(|at| at as f64));
            }
            _ => numbers.extend(own),
        }
    }
    Ok(())
}

/// Reads an action from Python's numbers; the inner error is the position and value of a number that is not
/// finite.
///
/// # Errors
/// [`Error::Action`] for an action outside the spaces of these seats.
pub fn action(seats: &[Seat], mut numbers: &[f64]) -> Result<Result<Action, (String, f64)>, Error> {
    let mut action = Action::new();
    for seat in seats {
        let (own, rest) = numbers.split_at(seat.action.n_asked());
        if let Some(value) = own.iter().find(|value| !value.is_finite()) {
            let of = if seat.name.is_empty() { "" } else { " of seat " };
            return Ok(Err((format!("the action{of}{}", seat.name), *value)));
        }
        action.push(seat.action.asked(own)?);
        numbers = rest;
    }
    Ok(Ok(action))
}

/// Count of numbers of an action, all seats together.
pub fn n_asked(seats: &[Seat]) -> usize {
    seats.iter().map(|seat| seat.action.n_asked()).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use contract::choice::Choice;

    fn seats() -> Vec<Seat> {
        let of = |name: &str, action: Space| Seat {
            name: name.into(),
            observation: Space::Box(vec![Channel::new("level", "m").within(0.0, f64::INFINITY)]),
            action,
        };
        let torque = Channel::new("torque", "N m")
            .within(-1.0, 1.0)
            .standing_for(-2.0, 2.0);
        vec![
            of("one", Space::Box(vec![torque])),
            of("two", Space::Discrete(vec!["rest".into(), "act".into()])),
            of(
                "three",
                Space::Choices(vec![
                    Choice::new("a", &["x", "y", "z"]),
                    Choice::new("b", &["u", "v"]),
                ]),
            ),
            of("four", Space::Simplex(vec!["first".into(), "second".into()])),
        ]
    }

    #[test]
    fn seats_are_told_with_the_limits_of_the_environment_itself() {
        let described = described(&seats());
        assert_eq!(
            described[0]["observation"],
            json!({ "names": ["level"], "limits": [[0.0, null]] })
        );
        assert_eq!(described[0]["action"]["own"], json!([[-2.0, 2.0]]));
        assert_eq!(
            described[1]["action"]["choices"][0]["options"],
            json!(["rest", "act"])
        );
        assert_eq!(described[3]["action"]["kind"], "simplex");
    }

    #[test]
    fn actions_come_back_as_they_pass() {
        let seats = seats();
        let given = vec![
            vec![0.25],
            vec![1.0],
            vec![-1.0, -1.0, 1.0, 1.0, -1.0],
            vec![0.5, 0.5],
        ];
        let mut numbers = Vec::new();
        asked(&seats, &given, &mut numbers).unwrap();
        assert_eq!(numbers, [0.25, 1.0, 2.0, 0.0, 0.5, 0.5]);
        assert_eq!(
            (n_asked(&seats), action(&seats, &numbers).unwrap()),
            (6, Ok(given))
        );
        numbers[1] = f64::NAN;
        let (what, value) = action(&seats, &numbers).unwrap().unwrap_err();
        assert!(what == "the action of seat two" && value.is_nan());
    }
}
