//! The head of a Gaussian policy: outputs of a network with the mean and the logarithm of the standard
//! deviation.
//!
//! | symbol | here | shape |
//! |---|---|---|
//! | mu, ln sigma | the two halves of `head`; ln sigma is clamped to [-20, 2] | `[rows, n]` each |
//! | epsilon | standard normal noise from the caller's stream, drawn on the host | `[rows, n]` |
//! | x = mu + sigma epsilon | the candidate, from which [`crate::squashed`] and [`crate::gaussian_softmax`] compute an action | `[rows, n]` |
//!
//! The limits of ln sigma are those of public code of soft actor-critic (Haarnoja et al. 2018,
//! arXiv:1812.05905).

use burn::Tensor;
use burn::tensor::TensorData;
use rand::RngCore;

use crate::gaussian::{HALF_LN_TWO_PI, standard_normal};

/// Limits of ln sigma.
pub const LOG_SD_LIMITS: [f32; 2] = [-20.0, 2.0];

/// Half `mu` `[rows, n]` of a head `[rows, 2 n]`.
#[must_use]
pub fn mean(head: Tensor<2>) -> Tensor<2> {
    let [n_rows, n_columns] = head.dims();
    head.slice([0..n_rows, 0..n_columns / 2])
}

/// Half `ln sigma` `[rows, n]` of a head `[rows, 2 n]`, clamped to its limits.
#[must_use]
pub fn log_sd(head: Tensor<2>) -> Tensor<2> {
    let [n_rows, n_columns] = head.dims();
    head.slice([0..n_rows, n_columns / 2..n_columns])
        .clamp(LOG_SD_LIMITS[0], LOG_SD_LIMITS[1])
}

/// Both halves of a head, `[rows, n]` each.
#[must_use]
pub fn mean_and_log_sd(head: Tensor<2>) -> (Tensor<2>, Tensor<2>) {
    (mean(head.clone()), log_sd(head))
}

/// Standard deviation `sigma` `[rows, n]` of a head.
#[must_use]
pub fn standard_deviation(head: Tensor<2>) -> Tensor<2> {
    log_sd(head).exp()
}

/// Candidate `x = mean + sd noise` `[rows, n]` and its log density `[rows, 1]`, which depends on `log_sd`
/// alone along the draw.
pub(crate) fn candidate(
    mean: Tensor<2>,
    log_sd: Tensor<2>,
    rng: &mut impl RngCore,
) -> (Tensor<2>, Tensor<2>) {
    assert_eq!(
        mean.dims(),
        log_sd.dims(),
        "means and standard deviations are of one shape"
    );
    let [n_rows, n] = mean.dims();
    let values: Vec<f32> = (0..n_rows * n).map(|_| standard_normal(rng) as f32).collect();
    let noise = Tensor::<2>::from_data(TensorData::new(values, [n_rows, n]), &mean.device());
    let kernel = noise.clone().square() * -0.5 - HALF_LN_TWO_PI;
    let log_density = (kernel - log_sd.clone()).sum_dim(1);
    (mean + log_sd.exp() * noise, log_density)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::{matrix, values};

    #[test]
    fn a_head_is_halved_and_held() {
        let (mean, log_sd) = mean_and_log_sd(matrix(vec![0.5, -30.0, 3.0, 1.0, 5.0, 0.25, -21.0, 2.5], 4));
        assert_eq!(
            (values(mean), values(log_sd)),
            (vec![0.5, -30.0, 5.0, 0.25], vec![2.0, 1.0, -20.0, 2.0])
        );
        assert_eq!(values(standard_deviation(matrix(vec![7.0, 0.0], 2))), [1.0]);
    }
}
