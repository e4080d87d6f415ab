//! Ridge regression on binary features, with several answers at once.
//!
//! | symbol | here | shape |
//! |---|---|---|
//! | X | one row of 0 and 1 per sample, as the positions of the ones | `[samples, features]` |
//! | Y | `answers`, centred | `[samples, answers]` |
//! | W | weights, `(X^T X + lambda I)^-1 X^T Y` | `[features, answers]` |
//! | h | leverage of a sample, `x (X^T X + lambda I)^-1 x^T` | `[samples]` |
//!
//! The error of a sample that is left out is `(y - x W) / (1 - h)`, without another fit; the penalty is the one
//! of [`PENALTIES`] with the smallest sum of their squares. Sums run in one order, in plain loops, so that
//! every machine computes the same bits.

/// Penalties lambda that are tried.
const PENALTIES: [f64; 8] = [0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0];

/// Fitted means and weights.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Ridge {
    /// Means of the answers, one number per answer.
    mean: Vec<f64>,
    /// `[features, answers]`.
    weights: Vec<f64>,
    n_answers: usize,
}

impl Ridge {
    /// Fits answers to features; `rows` and `answers` have one entry per sample.
    ///
    /// # Panics
    /// Where there is no sample or a feature is not below `n_features`.
    pub(super) fn fit(rows: &[Vec<usize>], n_features: usize, answers: &[Vec<f64>]) -> Self {
        let n_answers = answers[0].len();
        let mean = means(answers);
        let centred: Vec<Vec<f64>> = answers
            .iter()
            .map(|row| row.iter().zip(&mean).map(|(y, mean)| y - mean).collect())
            .collect();
        let gram = gram(rows, n_features);
        let tried = PENALTIES.map(|penalty| Self::with_penalty(rows, &gram, n_features, &centred, penalty));
        let better =
            |best: (f64, Vec<f64>), other: (f64, Vec<f64>)| if other.0 < best.0 { other } else { best };
        // The list of penalties is not empty, so there is a best one.
        let (_, weights) = tried.into_iter().reduce(better).unwrap_or_default();
        Self {
            mean,
            weights,
            n_answers,
        }
    }

    /// The sum of the squared errors of samples that are left out, each answer scaled by its variance, and the
    /// weights.
    fn with_penalty(
        rows: &[Vec<usize>],
        gram: &[f64],
        n: usize,
        answers: &[Vec<f64>],
        penalty: f64,
    ) -> (f64, Vec<f64>) {
        let n_answers = answers[0].len();
        let mut lower = gram.to_vec();
        (0..n).for_each(|at| lower[at * n + at] += penalty);
        factorise(&mut lower, n);
        let mut weights = vec![0.0; n * n_answers];
        for (row, answer) in rows.iter().zip(answers) {
            for feature in row {
                let sums = &mut weights[feature * n_answers..][..n_answers];
                sums.iter_mut().zip(answer).for_each(|(sum, y)| *sum += y);
            }
        }
        solve(&lower, n, &mut weights, n_answers);
        let mut fitted = Self {
            mean: vec![0.0; n_answers],
            weights,
            n_answers,
        };
        let scale: Vec<f64> = (0..n_answers)
            .map(|at| {
                answers
                    .iter()
                    .map(|row| row[at] * row[at])
                    .sum::<f64>()
                    .max(f64::MIN_POSITIVE)
            })
            .collect();
        let mut error = 0.0;
        for (row, answer) in rows.iter().zip(answers) {
            let leverage = leverage(&lower, n, row);
            for ((found, y), scale) in fitted.predict(row).iter().zip(answer).zip(&scale) {
                let left_out = (y - found) / (1.0 - leverage);
                error += left_out * left_out / scale;
            }
        }
        (error, std::mem::take(&mut fitted.weights))
    }

    /// The answers for the features of one sample.
    pub(super) fn predict(&self, row: &[usize]) -> Vec<f64> {
        let mut sums = self.mean.clone();
        for feature in row {
            let weights = &self.weights[feature * self.n_answers..][..self.n_answers];
            sums.iter_mut()
                .zip(weights)
                .for_each(|(sum, weight)| *sum += weight);
        }
        sums
    }

    /// One answer for the features of one sample.
    pub(super) fn predict_one(&self, row: &[usize], answer: usize) -> f64 {
        let weight = |feature: &usize| self.weights[feature * self.n_answers + answer];
        row.iter()
            .fold(self.mean[answer], |sum, feature| sum + weight(feature))
    }
}

fn means(answers: &[Vec<f64>]) -> Vec<f64> {
    let mut sums = vec![0.0; answers[0].len()];
    for row in answers {
        sums.iter_mut().zip(row).for_each(|(sum, y)| *sum += y);
    }
    sums.into_iter().map(|sum| sum / answers.len() as f64).collect()
}

/// `X^T X`, `[n, n]`.
fn gram(rows: &[Vec<usize>], n: usize) -> Vec<f64> {
    let mut gram = vec![0.0; n * n];
    for row in rows {
        for one in row {
            row.iter().for_each(|other| gram[one * n + other] += 1.0);
        }
    }
    gram
}

/// The lower Cholesky factor of a positive matrix, in place; entries above the diagonal stay.
fn factorise(matrix: &mut [f64], n: usize) {
    for row in 0..n {
        for column in 0..=row {
            let (before, own) = matrix.split_at(row * n);
            let earlier = if column == row {
                &own[..column]
            } else {
                &before[column * n..][..column]
            };
            let dot: f64 = own[..column].iter().zip(earlier).map(|(a, b)| a * b).sum();
            let rest = own[column] - dot;
            matrix[row * n + column] = if row == column {
                rest.sqrt()
            } else {
                rest / matrix[column * n + column]
            };
        }
    }
}

/// Solves `L L^T Z = B` for `B` `[n, m]`, in place.
fn solve(lower: &[f64], n: usize, right: &mut [f64], m: usize) {
    let subtract = |right: &mut [f64], from: usize, what: usize, factor: f64| {
        for at in 0..m {
            right[from * m + at] -= factor * right[what * m + at];
        }
    };
    let divide = |right: &mut [f64], row: usize| {
        right[row * m..][..m]
            .iter_mut()
            .for_each(|z| *z /= lower[row * n + row]);
    };
    for row in 0..n {
        (0..row).for_each(|before| subtract(right, row, before, lower[row * n + before]));
        divide(right, row);
    }
    for row in (0..n).rev() {
        (row + 1..n).for_each(|after| subtract(right, row, after, lower[after * n + row]));
        divide(right, row);
    }
}

/// `x (L L^T)^-1 x^T` of a row with ones at these positions: the square of `L^-1 x^T`.
fn leverage(lower: &[f64], n: usize, row: &[usize]) -> f64 {
    let first = row.iter().copied().min().unwrap_or(n);
    let mut solved = vec![0.0; n];
    for at in first..n {
        let of_row = &lower[at * n..][..at];
        let dot: f64 = of_row[first..]
            .iter()
            .zip(&solved[first..at])
            .map(|(l, z)| l * z)
            .sum();
        let one = f64::from(u8::from(row.contains(&at)));
        solved[at] = (one - dot) / lower[at * n + at];
    }
    solved.iter().map(|z| z * z).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DMatrix;

    /// Two blocks of three features, one of each block in every sample.
    fn rows() -> Vec<Vec<usize>> {
        (0..9)
            .cycle()
            .take(40)
            .map(|at| vec![at % 3, 3 + at / 3])
            .collect()
    }

    fn answers() -> Vec<Vec<f64>> {
        let effect = [0.0, 1.0, -2.0, 0.5, 0.0, 3.0];
        let noise = |at: usize| ((at as f64 + 0.3) * 12.9898).sin() * 0.1;
        rows()
            .iter()
            .enumerate()
            .map(|(at, row)| {
                vec![
                    row.iter().map(|feature| effect[*feature]).sum::<f64>() + noise(at),
                    -1.0,
                ]
            })
            .collect()
    }

    #[test]
    fn effects_are_recovered_and_a_constant_stays_one() {
        let fit = Ridge::fit(&rows(), 6, &answers());
        for (row, expected) in [(vec![0, 3], 0.5), (vec![2, 5], 1.0), (vec![1, 4], 1.0)] {
            let found = fit.predict(&row);
            assert!((found[0] - expected).abs() < 0.12, "{row:?}: {found:?}");
            assert!((found[1] + 1.0).abs() < 1e-12);
            assert_eq!(fit.predict_one(&row, 0), found[0]);
        }
    }

    #[test]
    fn the_solution_is_that_of_the_normal_equations() {
        let (n, penalty) = (6, 3.0);
        let centred: Vec<Vec<f64>> = {
            let (answers, mean) = (answers(), means(&answers()));
            answers
                .iter()
                .map(|row| vec![row[0] - mean[0], row[1] - mean[1]])
                .collect()
        };
        let (_, weights) = Ridge::with_penalty(&rows(), &gram(&rows(), n), n, &centred, penalty);
        let x = DMatrix::from_fn(40, n, |sample, feature| {
            f64::from(u8::from(rows()[sample].contains(&feature)))
        });
        let y = DMatrix::from_fn(40, 2, |sample, answer| centred[sample][answer]);
        let expected = (x.transpose() * &x + DMatrix::identity(n, n) * penalty)
            .lu()
            .solve(&(x.transpose() * y))
            .unwrap();
        for feature in 0..n {
            for answer in 0..2 {
                assert!((weights[feature * 2 + answer] - expected[(feature, answer)]).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn the_error_of_a_sample_left_out_is_that_of_a_fit_without_it() {
        let (n, penalty, left_out) = (6, 1.0, 7);
        let one: Vec<Vec<f64>> = answers().iter().map(|row| vec![row[0]]).collect();
        let (all, y) = (rows(), one);
        let (_, weights) = Ridge::with_penalty(&all, &gram(&all, n), n, &y, penalty);
        let fit = |weights: Vec<f64>| Ridge {
            mean: vec![0.0],
            weights,
            n_answers: 1,
        };
        let mut lower = gram(&all, n);
        (0..n).for_each(|at| lower[at * n + at] += penalty);
        factorise(&mut lower, n);
        let leverage = leverage(&lower, n, &all[left_out]);
        let quick = (y[left_out][0] - fit(weights).predict(&all[left_out])[0]) / (1.0 - leverage);
        let (mut rows, mut others) = (all.clone(), y.clone());
        rows.remove(left_out);
        others.remove(left_out);
        let (_, weights) = Ridge::with_penalty(&rows, &gram(&rows, n), n, &others, penalty);
        let slow = y[left_out][0] - fit(weights).predict(&all[left_out])[0];
        assert!((quick - slow).abs() < 1e-12, "{quick} {slow}");
    }
}
