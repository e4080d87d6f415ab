//! The check of an action on a simplex, shared by all environments.

use contract::Error;

/// Largest distance of an entry below zero.
const ENTRY_TOLERANCE: f64 = 1e-9;
/// Largest distance of the sum of the entries below one, and above it by default.
pub const SUM_TOLERANCE: f64 = 1e-6;

/// The action of the only seat, with rounding errors below zero set to zero.
///
/// # Errors
/// [`Error::Action`] unless there is one seat with `entries` non-negative entries whose sum is 1, or at most
/// `excess` above it.
pub fn checked(actions: &[Vec<f64>], entries: usize, excess: f64) -> Result<Vec<f64>, Error> {
    let problem = |problem: String| Error::Action { problem };
    let [action] = actions else {
        return Err(problem(format!("{} seats in place of one", actions.len())));
    };
    if action.len() != entries {
        return Err(problem(format!("{} entries in place of {entries}", action.len())));
    }
    // Written so that NaN is refused as well.
    if let Some(index) = action
        .iter()
        .position(|entry| entry.is_nan() || *entry < -ENTRY_TOLERANCE)
    {
        return Err(problem(format!(
            "entry {} is {}, below 0",
            index + 1,
            action[index]
        )));
    }
    let sum: f64 = action.iter().sum();
    if sum < 1.0 - SUM_TOLERANCE || sum > 1.0 + excess {
        return Err(problem(format!("the entries sum to {sum}, not to 1")));
    }
    Ok(action.iter().map(|entry| entry.max(0.0)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn an_action_outside_the_simplex_is_refused() {
        for action in [
            vec![0.5, 0.6],
            vec![1.1, -0.1],
            vec![f64::NAN, 1.0],
            vec![1.0],
            vec![f64::INFINITY, 0.0],
        ] {
            assert!(matches!(
                checked(&[action], 2, SUM_TOLERANCE),
                Err(Error::Action { .. })
            ));
        }
        assert!(checked(&[], 2, SUM_TOLERANCE).is_err());
        assert_eq!(
            checked(&[vec![1.0, -1e-10]], 2, SUM_TOLERANCE).unwrap(),
            [1.0, 0.0]
        );
    }

    #[test]
    fn more_than_the_whole_may_be_let_through_and_less_may_not() {
        let passes = |entry: f64| checked(&[vec![0.5, entry]], 2, 0.05).is_ok();
        assert!(passes(0.5 + 0.049) && !passes(0.5 + 0.051) && !passes(0.5 - 0.001));
    }

    proptest! {
        #[test]
        fn exactly_the_simplex_is_let_through(raw in prop::collection::vec(0.01_f64..1.0, 1..9),
            scale in 0.5_f64..1.5) {
            let sum: f64 = raw.iter().sum();
            let action: Vec<f64> = raw.iter().map(|entry| entry / sum).collect();
            prop_assert_eq!(&checked(std::slice::from_ref(&action), action.len(), SUM_TOLERANCE).unwrap(),
                &action);
            let scaled: Vec<f64> = action.iter().map(|entry| entry * scale).collect();
            prop_assert_eq!(checked(&[scaled], action.len(), SUM_TOLERANCE).is_ok(),
                (scale - 1.0).abs() <= 1e-6);
        }
    }
}
