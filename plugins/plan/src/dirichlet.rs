//! Functions of the concentrations `alpha` of a Dirichlet distribution, with sums over a row in `f64` in the order of
//! its entries.

use crate::operations::RowFunction;
use crate::scalar::Scalar;
use arithmetic::gamma::{digamma, ln_gamma, trigamma};

/// The function of a row of concentrations, and of a row of logarithms if it reads them.
pub(crate) fn row<T: Scalar>(
    function: RowFunction,
    rows: [&[T]; 2],
    result: &mut [T],
    [alpha, log_point, slope]: &mut [Vec<f64>; 3],
) {
    for (wide, row) in [&mut *alpha, log_point].into_iter().zip(rows) {
        wide.clear();
        wide.extend(row.iter().map(|entry| entry.wide()));
    }
    let total: f64 = alpha.iter().sum();
    slope.clear();
    match function {
        RowFunction::DirichletDensity => {
            let terms = alpha.iter().zip(&*log_point);
            let kernel: f64 = terms.map(|(alpha, log)| (alpha - 1.0) * log).sum();
            slope.push(kernel - log_beta(alpha, total));
        }
        RowFunction::DirichletScore => {
            let of_total = digamma(total);
            let terms = alpha.iter().zip(&*log_point);
            slope.extend(terms.map(|(alpha, log)| of_total - digamma(*alpha) + log));
        }
        RowFunction::DirichletEntropy => {
            let excess: f64 = alpha.iter().map(|alpha| alpha - 1.0).sum();
            let own: f64 = alpha.iter().map(|alpha| (alpha - 1.0) * digamma(*alpha)).sum();
            slope.push(log_beta(alpha, total) + excess * digamma(total) - own);
        }
        RowFunction::DirichletEntropySlope => {
            let excess: f64 = alpha.iter().map(|alpha| alpha - 1.0).sum();
            let of_total = excess * trigamma(total);
            slope.extend(
                alpha
                    .iter()
                    .map(|alpha| of_total - (alpha - 1.0) * trigamma(*alpha)),
            );
        }
    }
    for (x, wide) in result.iter_mut().zip(slope) {
        *x = T::of(*wide);
    }
}

/// `sum ln Gamma(alpha_i) - ln Gamma(A)`.
fn log_beta(alpha: &[f64], total: f64) -> f64 {
    alpha.iter().map(|alpha| ln_gamma(*alpha)).sum::<f64>() - ln_gamma(total)
}
