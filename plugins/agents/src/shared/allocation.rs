//! Shares on a simplex: equal ones, random ones, and those in proportion to weights.

use contract::{Action, Error, Rng};
use rand::Rng as _;

/// `n` equal shares, each `1 / n`.
#[must_use]
#[allow(clippy::cast_precision_loss, reason = "a number of assets is far below 2^52")]
pub fn equal_shares(n: usize) -> Vec<f64> {
    vec![1.0 / n as f64; n]
}

/// One draw from `Dirichlet(1, ..., 1)`, `n` shares that sum to 1.
pub fn uniform_shares(n: usize, rng: &mut Rng) -> Vec<f64> {
    // The smallest exponential is kept above zero so that a single asset never divides zero by zero.
    let exponentials: Vec<f64> = (0..n)
        .map(|_| (-(-rng.random::<f64>()).ln_1p()).max(f64::MIN_POSITIVE))
        .collect();
    let total: f64 = exponentials.iter().sum();
    exponentials.into_iter().map(|e| e / total).collect()
}

/// Actions of `n` shares from rows of `n` positive `f32` weights; the shares sum to 1 in double precision.
///
/// # Errors
/// [`Error::NotFinite`] where the weights of a row have no finite positive sum.
pub fn actions(weights: &[f32], n: usize, step: u64) -> Result<Vec<Action>, Error> {
    weights
        .chunks(n)
        .map(|row| Ok(vec![shares(row, step)?]))
        .collect()
}

fn shares(weights: &[f32], step: u64) -> Result<Vec<f64>, Error> {
    let total: f64 = weights.iter().map(|weight| f64::from(*weight)).sum();
    if !total.is_finite() || total <= 0.0 {
        return Err(Error::NotFinite {
            what: "sum of an action's weights".into(),
            step,
            value: total,
        });
    }
    Ok(weights.iter().map(|weight| f64::from(*weight) / total).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_become_shares() {
        assert_eq!(
            actions(&[1.0, 3.0, 2.0, 2.0], 2, 0).unwrap(),
            [[[0.25, 0.75]], [[0.5, 0.5]]]
        );
        assert!(matches!(
            actions(&[f32::NAN, 1.0], 2, 7),
            Err(Error::NotFinite { step: 7, .. })
        ));
        assert!(actions(&[0.0, 0.0], 2, 7).is_err());
        assert_eq!(equal_shares(4), [0.25; 4]);
    }
}
