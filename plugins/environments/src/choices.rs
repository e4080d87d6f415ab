//! The check of an action among named choices, shared by all environments.

use contract::{Error, Seat, Space};

/// The position of the choice that each seat takes.
///
/// # Errors
/// [`Error::Action`] for a wrong number of seats, and for an entry that is not the position of a choice.
pub fn taken(seats: &[Seat], actions: &[Vec<f64>]) -> Result<Vec<usize>, Error> {
    crate::unit_box::check_seats(actions, seats.len())?;
    seats
        .iter()
        .zip(actions)
        .map(|(seat, action)| one(seat, action))
        .collect()
}

fn one(seat: &Seat, action: &[f64]) -> Result<usize, Error> {
    let Space::Discrete(names) = &seat.action else {
        return Err(refused(seat, "it takes no choices".into()));
    };
    let [entry] = action else {
        return Err(refused(seat, format!("{} entries in place of one", action.len())));
    };
    #[allow(clippy::cast_precision_loss, reason = "nobody names 2^52 choices")]
    let found = (0..names.len()).find(|position| (*position as f64 - entry).abs() < f64::EPSILON);
    found.ok_or_else(|| {
        refused(
            seat,
            format!(
                "{entry} is no choice; there are 0 to {}: {}",
                names.len() - 1,
                names.join(", ")
            ),
        )
    })
}

fn refused(seat: &Seat, problem: String) -> Error {
    Error::Action {
        problem: format!("{}: {problem}", seat.name),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_are_taken_and_anything_else_is_refused() {
        let seat = |name: &str| Seat {
            name: name.into(),
            observation: Space::Box(Vec::new()),
            action: Space::Discrete(vec!["rest".into(), "act".into()]),
        };
        let seats = [seat("one"), seat("two")];
        let taken = |first: &[f64], second: &[f64]| super::taken(&seats, &[first.to_vec(), second.to_vec()]);
        assert_eq!(taken(&[1.0], &[0.0]).unwrap(), [1, 0]);
        for (second, text) in [
            (&[2.0][..], "two: 2 is no choice; there are 0 to 1: rest, act"),
            (&[0.5], "two: 0.5 is no choice"),
            (&[f64::NAN], "two: NaN is no choice"),
            (&[0.0, 1.0], "two: 2 entries in place of one"),
        ] {
            let problem = taken(&[0.0], second).unwrap_err().to_string();
            assert!(problem.contains(text), "{problem}");
        }
        assert!(super::taken(&seats, &[vec![0.0]]).is_err());
    }
}
