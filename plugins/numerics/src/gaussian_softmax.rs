//! Gaussian policies mapped to the simplex by softmax, on burn tensors; differentiable in mean and `log_sd`,
//! which [`crate::gaussian_head`] computes from the output of a network.
//!
//! [`crate::gaussian`] has the same densities in `f64` and explains the difference between the density of a
//! candidate and that of its softmax.

use burn::Tensor;
use burn::tensor::activation::{log_softmax, softmax};
use rand::RngCore;

use crate::gaussian::HALF_LN_TWO_PI;
use crate::gaussian_head::candidate;

/// A reparameterised draw of a Gaussian-softmax policy.
#[derive(Debug, Clone)]
pub struct GaussianSoftmaxSample {
    /// Point before the softmax `[batch, n]`.
    pub candidate: Tensor<2>,
    /// Action `softmax(candidate)` `[batch, n]`.
    pub action: Tensor<2>,
    /// Log density of the **candidate** `[batch, 1]`, which ordinary code takes for that of the action.
    pub log_density: Tensor<2>,
}

/// Draws `softmax(x)`, `x ~ N(mean, exp(log_sd))`, for each row; `mean` and `log_sd` are `[batch, n]`.
///
/// # Panics
/// If the two shapes differ.
pub fn gaussian_softmax_sample(
    mean: Tensor<2>,
    log_sd: Tensor<2>,
    rng: &mut impl RngCore,
) -> GaussianSoftmaxSample {
    let (candidate, log_density) = candidate(mean, log_sd, rng);
    GaussianSoftmaxSample {
        action: softmax(candidate.clone(), 1),
        candidate,
        log_density,
    }
}

/// True log density `[batch, 1]` of `softmax(candidate)` on the simplex: the common shift is integrated out.
///
/// See [`crate::gaussian::softmax_log_density`] for the equation; all three arguments are `[batch, n]` and
/// differentiable.
#[must_use]
pub fn gaussian_softmax_log_density(mean: Tensor<2>, log_sd: Tensor<2>, candidate: Tensor<2>) -> Tensor<2> {
    let coordinates = mean.dims()[1] as f64;
    let log_action = log_softmax(candidate, 1);
    let weights = (log_sd.clone() * -2.0).exp();
    let total = weights.clone().sum_dim(1);
    let residuals = log_action.clone() - mean;
    let centre = (weights.clone() * residuals.clone()).sum_dim(1) / total.clone();
    let spread = (weights * (residuals - centre).square()).sum_dim(1);
    let parts = log_sd.sum_dim(1) + (total.log() + spread) * 0.5 + log_action.sum_dim(1);
    (parts + (coordinates - 1.0) * HALF_LN_TWO_PI).neg()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gaussian;
    use burn::tensor::Device;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    const MEAN: [[f32; 3]; 2] = [[0.5, -1.0, 0.2], [3.0, 0.0, -0.4]];
    const LOG_SD: [[f32; 3]; 2] = [[-0.5, 0.3, -1.0], [0.0, -2.0, 0.4]];

    fn rng() -> ChaCha8Rng {
        ChaCha8Rng::seed_from_u64(4)
    }

    fn doubles(tensor: Tensor<2>) -> Vec<f64> {
        tensor.into_data().iter::<f64>().collect()
    }

    fn assert_close(got: &[f64], want: &[f64], tolerance: f64) {
        for (got_one, want_one) in got.iter().zip(want) {
            assert!(
                (got_one - want_one).abs() <= tolerance * want_one.abs().max(1.0),
                "{got:?}, not {want:?}"
            );
        }
    }

    /// Density of each row by the host's function, at the candidates that the stream draws.
    fn host(density: fn(&[f64], &[f64], &[f64]) -> f64) -> Vec<f64> {
        let mut rng = rng();
        let row = |(mean, log_sd): (&[f32; 3], &[f32; 3])| {
            let (mean, log_sd) = (mean.map(f64::from), log_sd.map(f64::from));
            let candidate = gaussian::sample(&mean, &log_sd, &mut rng);
            density(&mean, &log_sd, &candidate)
        };
        MEAN.iter().zip(&LOG_SD).map(row).collect()
    }

    fn inputs(device: &Device) -> (Tensor<2>, Tensor<2>) {
        (Tensor::from_data(MEAN, device), Tensor::from_data(LOG_SD, device))
    }

    /// Compares the gradient of the summed loss in mean and `log_sd` with central differences on plain
    /// tensors.
    fn check_gradient(loss: impl Fn(Tensor<2>, Tensor<2>) -> Tensor<2>) {
        let (mean, log_sd) = inputs(&Device::default().autodiff());
        let (mean, log_sd) = (mean.require_grad(), log_sd.require_grad());
        let gradients = loss(mean.clone(), log_sd.clone()).sum().backward();
        // The density of a drawn candidate does not depend on the mean: burn has no gradient there.
        let of = |input: Tensor<2>| input.grad(&gradients).map_or_else(|| vec![0.0; 6], doubles);
        let got = [of(mean), of(log_sd)].concat();
        let at = |index: usize, step: f32| {
            let mut points = [MEAN, LOG_SD];
            points[index / 6][index % 6 / 3][index % 3] += step;
            let [mean, log_sd] = points.map(|point| Tensor::<2>::from_data(point, &Device::default()));
            doubles(loss(mean, log_sd)).iter().sum::<f64>()
        };
        let want: Vec<f64> = (0..12)
            .map(|index| (at(index, 0.01) - at(index, -0.01)) / 0.02)
            .collect();
        assert_close(&got, &want, 2e-3);
    }

    #[test]
    fn densities_match_the_host() {
        let (mean, log_sd) = inputs(&Device::default());
        let softmax = gaussian_softmax_sample(mean.clone(), log_sd.clone(), &mut rng());
        assert_close(&doubles(softmax.log_density), &host(gaussian::log_density), 1e-5);
        let of_action: fn(&[f64], &[f64], &[f64]) -> f64 = |mean, log_sd, candidate| {
            gaussian::softmax_log_density(mean, log_sd, &gaussian::log_softmax(candidate))
        };
        let got = gaussian_softmax_log_density(mean, log_sd, softmax.candidate);
        assert_close(&doubles(got), &host(of_action), 1e-5);
        assert_close(&doubles(softmax.action.sum_dim(1)), &[1.0, 1.0], 1e-6);
    }

    #[test]
    fn gradients_are_those_of_differences() {
        let weights = |like: &Tensor<2>| Tensor::<2>::from_data([[1.0, -2.0, 0.5]], &like.device());
        check_gradient(|mean, log_sd| gaussian_softmax_sample(mean, log_sd, &mut rng()).log_density);
        check_gradient(|mean, log_sd| {
            weights(&mean) * gaussian_softmax_sample(mean, log_sd, &mut rng()).action
        });
        check_gradient(|mean, log_sd| {
            let candidate = gaussian_softmax_sample(mean.clone(), log_sd.clone(), &mut rng()).candidate;
            gaussian_softmax_log_density(mean, log_sd, candidate)
        });
    }
}
