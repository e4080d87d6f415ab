//! Importance of searched keys: the loss in a forest's forecasts of settings that it has not seen when the values of
//! one key are taken from other settings (Breiman 2001, section 10, with held-out settings instead of the out-of-bag
//! ones).

use contract::{Error, random};
use rand::Rng as _;
use smartcore::{
    ensemble::random_forest_regressor::{RandomForestRegressor, RandomForestRegressorParameters},
    error::Failed,
    linalg::basic::matrix::DenseMatrix,
};

/// Smallest number of settings for which importances are computed.
pub const FEWEST: usize = 10;
/// Number of trees of a forest.
pub const TREES: usize = 100;
/// Number of parts of the settings; each part is forecast from the others.
const FOLDS: usize = 5;

/// Importance of keys, estimated by a forest.
#[derive(Debug, Clone, PartialEq)]
pub struct Importance {
    /// For each key, the mean and the standard deviation over exchanges of the lost explanation, as a share of the
    /// variance of the values.
    pub keys: Vec<(f64, f64)>,
    /// Share of the variance of unseen settings that the forest explains; below 0 if it forecasts worse than their
    /// mean.
    pub explained: f64,
}

/// The importance of each key for `values`, one for each of `settings` `[setting][key]`, by at least two exchanges of
/// the values of each key; `name` names the stream of random numbers. `None` with fewer than [`FEWEST`] settings, or if
/// all values are the same.
///
/// # Errors
/// [`Error::Render`] if the forest cannot be fitted.
pub fn importance(
    settings: &[Vec<f64>],
    values: &[f64],
    exchanges: usize,
    name: &str,
) -> Result<Option<Importance>, Error> {
    let n = values.len();
    #[allow(clippy::cast_precision_loss, reason = "a number of settings")]
    let mean = values.iter().sum::<f64>() / n as f64;
    let spread: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
    let keys = settings.first().map_or(0, Vec::len);
    if n < FEWEST || spread <= 0.0 {
        return Ok(None);
    }
    let mut rng = random::stream(&["importance of searched keys", name]);
    let order = shuffled(n, &mut rng);
    let (mut plain, mut exchanged) = (0.0, vec![vec![0.0; exchanges]; keys]);
    for fold in 0..FOLDS {
        let is_held_out = |place: &usize| place % FOLDS == fold;
        let (held_out, known): (Vec<usize>, Vec<usize>) = (0..n).partition(is_held_out);
        let of = |places: &[usize]| places.iter().map(|place| order[*place]).collect::<Vec<_>>();
        let (held_out, known) = (of(&held_out), of(&known));
        let forest = Forest::fit(settings, values, &known).map_err(refused)?;
        let rows: Vec<Vec<f64>> = held_out.iter().map(|at| settings[*at].clone()).collect();
        let truth: Vec<f64> = held_out.iter().map(|at| values[*at]).collect();
        plain += forest.squared_error(&rows, &truth).map_err(refused)?;
        for (key, losses) in exchanged.iter_mut().enumerate() {
            for loss in losses {
                let mut rows = rows.clone();
                for row in &mut rows {
                    row[key] = settings[rng.random_range(0..n)][key];
                }
                *loss += forest.squared_error(&rows, &truth).map_err(refused)?;
            }
        }
    }
    let share = |losses: &Vec<f64>| {
        mean_and_deviation(
            &losses
                .iter()
                .map(|loss| (loss - plain) / spread)
                .collect::<Vec<_>>(),
        )
    };
    Ok(Some(Importance {
        keys: exchanged.iter().map(share).collect(),
        explained: 1.0 - plain / spread,
    }))
}

struct Forest(RandomForestRegressor<f64, f64, DenseMatrix<f64>, Vec<f64>>);

impl Forest {
    fn fit(settings: &[Vec<f64>], values: &[f64], places: &[usize]) -> Result<Self, Failed> {
        let rows: Vec<Vec<f64>> = places.iter().map(|at| settings[*at].clone()).collect();
        let values: Vec<f64> = places.iter().map(|at| values[*at]).collect();
        let parameters = RandomForestRegressorParameters::default()
            .with_n_trees(TREES)
            .with_m(rows[0].len().div_ceil(3))
            .with_seed(0);
        RandomForestRegressor::fit(&DenseMatrix::from_2d_vec(&rows)?, &values, parameters).map(Self)
    }

    /// Sum of the squared errors of the forecasts of `rows`.
    fn squared_error(&self, rows: &Vec<Vec<f64>>, truth: &[f64]) -> Result<f64, Failed> {
        let forecast = self.0.predict(&DenseMatrix::from_2d_vec(rows)?)?;
        Ok(forecast
            .iter()
            .zip(truth)
            .map(|(forecast, value)| (forecast - value).powi(2))
            .sum())
    }
}

/// The places below `n` in a random order (Fisher and Yates).
fn shuffled(n: usize, rng: &mut random::Rng) -> Vec<usize> {
    let mut order: Vec<usize> = (0..n).collect();
    for last in (1..n).rev() {
        order.swap(last, rng.random_range(0..=last));
    }
    order
}

#[allow(clippy::cast_precision_loss, reason = "a number of exchanges")]
fn mean_and_deviation(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
    (mean, (squares / (n - 1.0)).sqrt())
}

fn refused(error: Failed) -> Error {
    Error::Render {
        what: "figure".into(),
        problem: format!("no forest can be fitted to the settings: {error}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Settings of three keys: the first matters most, the second less, the third not at all.
    fn made() -> (Vec<Vec<f64>>, Vec<f64>) {
        let mut rng = random::stream(&["settings"]);
        let settings: Vec<Vec<f64>> = (0..80)
            .map(|_| (0..3).map(|_| rng.random_range(0.0..1.0)).collect())
            .collect();
        let values = settings
            .iter()
            .map(|it| 4.0 * it[0] + (6.0 * it[1]).sin())
            .collect();
        (settings, values)
    }

    #[test]
    fn keys_are_ranked_by_what_they_do_and_chance_is_nothing() {
        let (settings, values) = made();
        let found = importance(&settings, &values, 20, "a").unwrap().unwrap();
        let [first, second, third] = [0, 1, 2].map(|key| found.keys[key].0);
        assert!(
            first > 2.0 * second && second > 0.05 && third.abs() < 0.05,
            "{found:?}"
        );
        assert!(
            found.explained > 0.6 && found.keys.iter().all(|(_, deviation)| *deviation < 0.5),
            "{found:?}"
        );
        assert_eq!(importance(&settings, &values, 20, "a").unwrap().unwrap(), found);
    }

    #[test]
    fn of_noise_nothing_is_explained_and_too_little_says_nothing() {
        let (settings, _) = made();
        let mut rng = random::stream(&["noise"]);
        let noise: Vec<f64> = settings.iter().map(|_| rng.random_range(0.0..1.0)).collect();
        assert!(importance(&settings, &noise, 20, "a").unwrap().unwrap().explained < 0.2);
        assert_eq!(importance(&settings[..9], &noise[..9], 20, "a").unwrap(), None);
        assert_eq!(importance(&settings, &[1.0; 80], 20, "a").unwrap(), None);
    }
}
