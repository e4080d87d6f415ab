//! The check of an action with entries in [-1, 1], shared by all environments.

use contract::Error;

/// Largest excess of an entry over the limits that is accepted: squashing functions in single precision round
/// to just beyond 1.
const ROUNDING: f64 = 1e-6;

/// Treatment of an entry beyond that.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LimitExcess {
    /// The action is refused with an error.
    Refused,
    /// The entry is replaced by the limit.
    Clipped,
}

/// Checks that there is one action per seat.
///
/// # Errors
/// [`Error::Action`] with both numbers.
pub fn check_seats(actions: &[Vec<f64>], seats: usize) -> Result<(), Error> {
    if actions.len() == seats {
        return Ok(());
    }
    Err(Error::Action {
        problem: format!("{} seats in place of {seats}", actions.len()),
    })
}

/// The action of seat `agent_<agent>`, with the entries `names`, within [-1, 1].
///
/// # Errors
/// [`Error::Action`] for a wrong number of entries, for `NaN`, and for an entry beyond the limits unless it is
/// clipped.
pub fn checked<const N: usize>(
    action: &[f64],
    agent: usize,
    names: [&str; N],
    beyond: LimitExcess,
) -> Result<[f64; N], Error> {
    let Ok(mut entries) = <[f64; N]>::try_from(action) else {
        return Err(Error::Action {
            problem: format!("agent_{agent}: {} entries in place of {N}", action.len()),
        });
    };
    for (entry, name) in entries.iter_mut().zip(names) {
        let allowed = entry.abs() <= 1.0 + ROUNDING || beyond == LimitExcess::Clipped && !entry.is_nan();
        if !allowed {
            return Err(Error::Action {
                problem: format!("agent_{agent}.{name} is {entry}, outside [-1, 1]"),
            });
        }
        *entry = entry.clamp(-1.0, 1.0);
    }
    Ok(entries)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_inside_stay_and_others_are_refused_or_clipped() {
        let check = |action: &[f64], beyond| checked(action, 3, ["x", "y"], beyond);
        assert_eq!(check(&[0.3, -1.0], LimitExcess::Refused).unwrap(), [0.3, -1.0]);
        assert_eq!(
            check(&[1.0 + 1e-7, -1.0 - 1e-7], LimitExcess::Refused).unwrap(),
            [1.0, -1.0]
        );
        assert_eq!(
            check(&[9.0, f64::NEG_INFINITY], LimitExcess::Clipped).unwrap(),
            [1.0, -1.0]
        );
        assert!(
            check(&[0.0, 1.1], LimitExcess::Refused)
                .unwrap_err()
                .to_string()
                .contains("agent_3.y is 1.1, outside [-1, 1]")
        );
        assert!(
            check(&[0.0], LimitExcess::Clipped)
                .unwrap_err()
                .to_string()
                .contains("1 entries in place of 2")
        );
        assert!(check(&[0.0, f64::NAN], LimitExcess::Clipped).is_err());
        assert!(check_seats(&[vec![0.0]], 2).is_err());
    }
}
