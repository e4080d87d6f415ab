//! Gaussian policies on burn tensors: squashed by tanh, or mapped to the simplex by softmax. Differentiable in mean and `log_sd`.
//!
//! Noise comes from the caller's stream, drawn on the host. [`crate::gaussian`] holds the same densities in `f64` and says what
//! separates the density of a candidate from that of its softmax.

use burn::Tensor;
use burn::tensor::TensorData;
use burn::tensor::activation::{log_softmax, softmax, softplus};
use rand::RngCore;

use crate::gaussian::{HALF_LN_TWO_PI, standard_normal};

/// A reparameterised draw of a Gaussian-softmax policy.
#[derive(Debug, Clone)]
pub struct GaussianSoftmaxSample {
    /// The point before the softmax `[batch, n]`.
    pub candidate: Tensor<2>,
    /// `softmax(candidate)` `[batch, n]`.
    pub action: Tensor<2>,
    /// The log density of the **candidate** `[batch, 1]`, which ordinary code takes for that of the action.
    pub log_density: Tensor<2>,
}

/// A reparameterised draw of a tanh-squashed Gaussian policy.
#[derive(Debug, Clone)]
pub struct SquashedGaussianSample {
    /// `tanh(mean + sd noise)` `[batch, n]`.
    pub action: Tensor<2>,
    /// The log density of the action on the cube `[batch, 1]`.
    pub log_density: Tensor<2>,
}

/// Draws `softmax(x)`, `x ~ N(mean, exp(log_sd))`, for each row; `mean` and `log_sd` are `[batch, n]`.
pub fn gaussian_softmax_sample(mean: Tensor<2>, log_sd: Tensor<2>, rng: &mut impl RngCore) -> GaussianSoftmaxSample {
    let (candidate, log_density) = candidate(mean, log_sd, rng);
    GaussianSoftmaxSample { action: softmax(candidate.clone(), 1), candidate, log_density }
}

/// Draws `tanh(x)`, `x ~ N(mean, exp(log_sd))`, for each row; `mean` and `log_sd` are `[batch, n]`.
pub fn squashed_gaussian_sample(mean: Tensor<2>, log_sd: Tensor<2>, rng: &mut impl RngCore) -> SquashedGaussianSample {
    let (candidate, log_density) = candidate(mean, log_sd, rng);
    // ln(1 - tanh(x)^2) = 2 (ln 2 - x - softplus(-2 x)) stays finite where tanh rounds to one.
    let log_derivative = (candidate.clone() + softplus(candidate.clone() * -2.0, 1.0) - std::f64::consts::LN_2) * -2.0;
    SquashedGaussianSample { action: candidate.tanh(), log_density: log_density - log_derivative.sum_dim(1) }
}

/// The true log density `[batch, 1]` of `softmax(candidate)` on the simplex: the common shift is integrated out.
///
/// See [`crate::gaussian::softmax_log_density`] for the equation; all three arguments are `[batch, n]` and differentiable.
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

/// `x = mean + sd noise` `[batch, n]` and its log density `[batch, 1]`, which along the draw depends on `log_sd` alone.
fn candidate(mean: Tensor<2>, log_sd: Tensor<2>, rng: &mut impl RngCore) -> (Tensor<2>, Tensor<2>) {
    assert_eq!(mean.dims(), log_sd.dims(), "means and standard deviations are of one shape");
    let [batch, coordinates] = mean.dims();
    let values: Vec<f32> = (0..batch * coordinates).map(|_| standard_normal(rng) as f32).collect();
    let noise = Tensor::<2>::from_data(TensorData::new(values, [batch, coordinates]), &mean.device());
    let kernel = noise.clone().square() * -0.5 - HALF_LN_TWO_PI;
    let log_density = (kernel - log_sd.clone()).sum_dim(1);
    (mean + log_sd.exp() * noise, log_density)
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
            assert!((got_one - want_one).abs() <= tolerance * want_one.abs().max(1.0), "{got:?}, not {want:?}");
        }
    }

    /// The density of each row by the host's function, at the candidates that the stream draws.
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

    /// The gradient of the summed loss in mean and `log_sd`, and central differences on plain tensors.
    fn check_gradient(loss: impl Fn(Tensor<2>, Tensor<2>) -> Tensor<2>) {
        let (mean, log_sd) = inputs(&Device::default().autodiff());
        let (mean, log_sd) = (mean.require_grad(), log_sd.require_grad());
        let gradients = loss(mean.clone(), log_sd.clone()).sum().backward();
        let got = [doubles(mean.grad(&gradients).unwrap()), doubles(log_sd.grad(&gradients).unwrap())].concat();
        let at = |index: usize, step: f32| {
            let mut points = [MEAN, LOG_SD];
            points[index / 6][index % 6 / 3][index % 3] += step;
            let [mean, log_sd] = points.map(|point| Tensor::<2>::from_data(point, &Device::default()));
            doubles(loss(mean, log_sd)).iter().sum::<f64>()
        };
        let want: Vec<f64> = (0..12).map(|index| (at(index, 0.01) - at(index, -0.01)) / 0.02).collect();
        assert_close(&got, &want, 2e-3);
    }

    #[test]
    fn densities_match_the_host() {
        let (mean, log_sd) = inputs(&Device::default());
        let squashed = squashed_gaussian_sample(mean.clone(), log_sd.clone(), &mut rng());
        assert_close(&doubles(squashed.log_density), &host(gaussian::squashed_log_density), 1e-5);
        let softmax = gaussian_softmax_sample(mean.clone(), log_sd.clone(), &mut rng());
        assert_close(&doubles(softmax.log_density), &host(gaussian::log_density), 1e-5);
        let of_action: fn(&[f64], &[f64], &[f64]) -> f64 =
            |mean, log_sd, candidate| gaussian::softmax_log_density(mean, log_sd, &gaussian::log_softmax(candidate));
        let got = gaussian_softmax_log_density(mean, log_sd, softmax.candidate);
        assert_close(&doubles(got), &host(of_action), 1e-5);
        assert_close(&doubles(softmax.action.sum_dim(1)), &[1.0, 1.0], 1e-6);
    }

    #[test]
    fn gradients_are_those_of_differences() {
        let weights = |like: &Tensor<2>| Tensor::<2>::from_data([[1.0, -2.0, 0.5]], &like.device());
        check_gradient(|mean, log_sd| squashed_gaussian_sample(mean, log_sd, &mut rng()).log_density);
        check_gradient(|mean, log_sd| gaussian_softmax_sample(mean, log_sd, &mut rng()).log_density);
        check_gradient(|mean, log_sd| weights(&mean) * squashed_gaussian_sample(mean, log_sd, &mut rng()).action);
        check_gradient(|mean, log_sd| weights(&mean) * gaussian_softmax_sample(mean, log_sd, &mut rng()).action);
        check_gradient(|mean, log_sd| {
            let candidate = gaussian_softmax_sample(mean.clone(), log_sd.clone(), &mut rng()).candidate;
            gaussian_softmax_log_density(mean, log_sd, candidate)
        });
    }

    #[test]
    fn squashed_density_is_finite_far_out() {
        let mean = Tensor::<2>::from_data([[60.0, -60.0]], &Device::default());
        let sample = squashed_gaussian_sample(mean.clone(), mean * 0.0 - 3.0, &mut rng());
        assert!(doubles(sample.log_density).iter().all(|value| value.is_finite()));
    }
}
