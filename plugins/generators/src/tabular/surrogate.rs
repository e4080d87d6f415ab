//! Scores of architectures, fitted to those that searches tried.
//!
//! For each number of cells, one [`Ridge`] predicts both scores and the features of the state from the options
//! of the cells so far: each option is a feature, and so is each pair of options of different choices.
//!
//! A fifth of the architectures is held out to measure the quality of the fit, drawn by a hash of the options,
//! so that all measurements of one architecture are on one side; the final fit uses all of them.

use super::ridge::Ridge;
use crate::search_space::{CellOptions, N_CELLS, all_cells, n_options};
use contract::random::stream;
use rand::Rng as _;
use statistics::rank_correlation;
use std::collections::BTreeMap;

/// One measured architecture: its cells, and both scores and the features after each of them.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct MeasuredArchitecture {
    pub(super) cells: Vec<CellOptions>,
    /// `[cells + 1][2 + features]`, the state before the first cell included.
    pub(super) seen: Vec<Vec<f64>>,
}

/// Quality of the fit on architectures that were held out.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Quality {
    /// Root of the mean squared error of `inception score - weight * Frechet distance` of whole architectures.
    pub(super) error: f64,
    /// Spearman's rank correlation of the same.
    pub(super) rank_correlation: f64,
    /// Architectures that were held out.
    pub(super) held_out: usize,
}

/// The fits for each number of cells.
#[derive(Debug, Clone)]
pub(super) struct Surrogate {
    /// Scores and features before the first cell.
    start: Vec<f64>,
    /// Fits by the number of cells, from 1.
    fits: Vec<Ridge>,
    /// Standard deviation of both scores around the fit, by the number of cells, from 1.
    spread: Vec<[f64; 2]>,
    places: FeaturePositions,
}

impl Surrogate {
    /// Fits the measured architectures.
    ///
    /// # Panics
    /// Where no complete architecture was measured.
    pub(super) fn fit(measured: &[MeasuredArchitecture]) -> Self {
        let places = FeaturePositions::new();
        let (mut fits, mut spread) = (Vec::new(), Vec::new());
        for n_cells in 1..=N_CELLS {
            let of_depth: Vec<&MeasuredArchitecture> =
                measured.iter().filter(|one| one.cells.len() >= n_cells).collect();
            let rows: Vec<Vec<usize>> = of_depth
                .iter()
                .map(|one| places.features(&one.cells[..n_cells]))
                .collect();
            let answers: Vec<Vec<f64>> = of_depth.iter().map(|one| one.seen[n_cells].clone()).collect();
            let fit = Ridge::fit(&rows, places.n_features(n_cells), &answers);
            spread.push([0, 1].map(|score| residual_sd(&fit, &rows, &answers, score)));
            fits.push(fit);
        }
        let starts: Vec<Vec<f64>> = measured.iter().map(|one| one.seen[0].clone()).collect();
        Self {
            start: mean_row(&starts),
            fits,
            spread,
            places,
        }
    }

    /// Both scores and the features after these cells.
    pub(super) fn seen(&self, cells: &[CellOptions]) -> Vec<f64> {
        match cells.len() {
            0 => self.start.clone(),
            n => self.fits[n - 1].predict(&self.places.features(cells)),
        }
    }

    /// Standard deviations of both scores after `n_cells` cells, at least one.
    pub(super) fn spread(&self, n_cells: usize) -> [f64; 2] {
        self.spread[n_cells - 1]
    }

    /// The largest `inception score - weight * Frechet distance` of all architectures, and the architecture.
    pub(super) fn best(&self, weight: f64) -> (f64, [CellOptions; N_CELLS]) {
        let fit = &self.fits[N_CELLS - 1];
        let mut best = (f64::NEG_INFINITY, [[0; 6]; N_CELLS]);
        for first in all_cells(0) {
            for second in all_cells(1) {
                for third in all_cells(2) {
                    let cells = [first, second, third];
                    let row = self.places.features(&cells);
                    let value = fit.predict_one(&row, 0) - weight * fit.predict_one(&row, 1);
                    if value > best.0 {
                        best = (value, cells);
                    }
                }
            }
        }
        best
    }
}

/// Quality of a fit to four fifths of the architectures, on the others; the default where fewer than three are
/// held out.
pub(super) fn quality(measured: &[MeasuredArchitecture], weight: f64) -> Quality {
    let (held_out, fitted): (Vec<MeasuredArchitecture>, Vec<MeasuredArchitecture>) =
        measured.iter().cloned().partition(is_held_out);
    let whole = |one: &&MeasuredArchitecture| one.cells.len() == N_CELLS;
    if !fitted.iter().any(|one| one.cells.len() == N_CELLS) {
        return Quality::default();
    }
    let fit = Surrogate::fit(&fitted);
    let value = |seen: &[f64]| seen[0] - weight * seen[1];
    // An architecture that was measured several times counts with its mean.
    let mut by_cells: BTreeMap<&[CellOptions], Vec<f64>> = BTreeMap::new();
    for one in held_out.iter().filter(whole) {
        by_cells
            .entry(&one.cells)
            .or_default()
            .push(value(&one.seen[N_CELLS]));
    }
    let pairs: Vec<(f64, f64)> = by_cells
        .iter()
        .map(|(cells, values)| {
            (
                values.iter().sum::<f64>() / values.len() as f64,
                value(&fit.seen(cells)),
            )
        })
        .collect();
    if pairs.len() < 3 {
        return Quality::default();
    }
    let squares = pairs
        .iter()
        .map(|(found, told)| (found - told).powi(2))
        .sum::<f64>();
    Quality {
        error: (squares / pairs.len() as f64).sqrt(),
        rank_correlation: rank_correlation(&pairs).unwrap_or(0.0),
        held_out: pairs.len(),
    }
}

fn is_held_out(one: &MeasuredArchitecture) -> bool {
    stream(&["held out", &format!("{:?}", one.cells)]).random::<f64>() < 0.2
}

fn residual_sd(fit: &Ridge, rows: &[Vec<usize>], answers: &[Vec<f64>], score: usize) -> f64 {
    let squares = rows
        .iter()
        .zip(answers)
        .map(|(row, answer)| (answer[score] - fit.predict_one(row, score)).powi(2));
    (squares.sum::<f64>() / rows.len() as f64).sqrt()
}

fn mean_row(rows: &[Vec<f64>]) -> Vec<f64> {
    let mut sums = vec![0.0; rows[0].len()];
    for row in rows {
        sums.iter_mut().zip(row).for_each(|(sum, value)| *sum += value);
    }
    sums.into_iter().map(|sum| sum / rows.len() as f64).collect()
}

/// Positions of options and pairs of options among the features.
#[derive(Debug, Clone)]
struct FeaturePositions {
    /// The first option of each choice, choice after choice and cell after cell, and one past the last.
    options: Vec<usize>,
    /// The first pair of each choice with each earlier one.
    pairs: Vec<Vec<usize>>,
    /// Number of features, by the number of cells, from 1.
    n_features: Vec<usize>,
}

impl FeaturePositions {
    fn new() -> Self {
        let sizes: Vec<usize> = (0..N_CELLS).flat_map(n_options).collect();
        let mut places = Self {
            options: Vec::new(),
            pairs: Vec::new(),
            n_features: Vec::new(),
        };
        // Options and pairs of earlier cells stand before those of later ones, so that fits of few cells use
        // few features.
        let mut next = 0;
        for (choice, size) in sizes.iter().enumerate() {
            places.options.push(next);
            next += size;
            let mut of_choice = Vec::with_capacity(choice);
            for other in &sizes[..choice] {
                of_choice.push(next);
                next += size * other;
            }
            places.pairs.push(of_choice);
            if (choice + 1).is_multiple_of(6) {
                places.n_features.push(next);
            }
        }
        places
    }

    fn n_features(&self, n_cells: usize) -> usize {
        self.n_features[n_cells - 1]
    }

    /// The features of an architecture.
    fn features(&self, cells: &[CellOptions]) -> Vec<usize> {
        let sizes: Vec<usize> = (0..cells.len()).flat_map(n_options).collect();
        let taken: Vec<usize> = cells.iter().flatten().copied().collect();
        let mut features = Vec::with_capacity(taken.len() * (taken.len() + 1) / 2);
        for choice in (0..taken.len()).filter(|choice| sizes[*choice] > 1) {
            features.push(self.options[choice] + taken[choice]);
            for earlier in (0..choice).filter(|earlier| sizes[*earlier] > 1) {
                let first = self.pairs[choice][earlier];
                features.push(first + taken[earlier] * sizes[choice] + taken[choice]);
            }
        }
        features
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// Scores of a synthetic truth with main effects and one pair, with a little noise; two features of the
    /// state.
    pub(in super::super) fn made_up(count: usize, noise: f64) -> Vec<MeasuredArchitecture> {
        let mut rng = stream(&["made up"]);
        (0..count)
            .map(|_| {
                let cells: Vec<CellOptions> = (0..N_CELLS)
                    .map(|step| n_options(step).map(|size| rng.random_range(0..size as u32) as usize))
                    .collect();
                let seen = (0..=N_CELLS)
                    .map(|n| {
                        let mut scatter = || noise * (rng.random::<f64>() - 0.5);
                        vec![
                            truth(&cells[..n]) + scatter(),
                            50.0 - 10.0 * truth(&cells[..n]) + scatter(),
                            n as f64,
                        ]
                    })
                    .collect();
                MeasuredArchitecture { cells, seen }
            })
            .collect()
    }

    pub(in super::super) fn truth(cells: &[CellOptions]) -> f64 {
        let of_cell = |cell: &CellOptions| 0.3 * cell[1] as f64 - 0.2 * cell[2] as f64 + 0.4 * cell[3] as f64;
        let pair = if cells.len() == 3 && cells[0][0] == 1 && cells[2][5] == 1 {
            0.7
        } else {
            0.0
        };
        cells.iter().map(of_cell).sum::<f64>() + pair
    }

    #[test]
    fn scores_that_are_sums_of_pairs_are_told() {
        let measured = made_up(1200, 0.02);
        let quality = quality(&measured, 0.01);
        assert!(
            quality.held_out > 180 && quality.rank_correlation > 0.98,
            "{quality:?}"
        );
        assert!(quality.error < 0.08, "{quality:?}");
        let fit = Surrogate::fit(&measured);
        let (value, best) = fit.best(0.01);
        // Norm 2, upsampling 0 and a shortcut in every cell, and the pair: 3 * 1 + 0.7; the distance is then 13.
        assert!(
            best.iter().all(|cell| (cell[1], cell[2], cell[3]) == (2, 0, 1)),
            "{best:?}"
        );
        assert_eq!((best[0][0], best[2][5]), (1, 1));
        assert!((value - (3.7 - 0.13)).abs() < 0.08, "{value}");
        let seen = fit.seen(&best);
        assert!((value - (seen[0] - 0.01 * seen[1])).abs() < 1e-12);
        assert!((fit.seen(&best[..2])[2] - 2.0).abs() < 1e-9 && fit.seen(&[])[2].abs() < 1e-12);
        assert!(fit.spread(3)[0] < 0.02);
    }

    #[test]
    fn noise_cannot_be_told() {
        let mut rng = stream(&["noise"]);
        let mut measured = made_up(600, 0.0);
        for one in &mut measured {
            one.seen[N_CELLS][0] = rng.random::<f64>();
            one.seen[N_CELLS][1] = 0.0;
        }
        let quality = quality(&measured, 0.01);
        assert!(quality.rank_correlation.abs() < 0.3, "{quality:?}");
    }

    #[test]
    fn every_feature_has_a_place_of_its_own() {
        let places = FeaturePositions::new();
        let mut seen = std::collections::BTreeSet::new();
        for first in all_cells(0) {
            seen.extend(places.features(&[first]));
        }
        assert!(seen.iter().all(|feature| *feature < places.n_features(1)));
        // Ten options, and 37 pairs of four choices of 2, 3, 3 and 2.
        assert_eq!(seen.len(), 10 + 37);
    }
}
