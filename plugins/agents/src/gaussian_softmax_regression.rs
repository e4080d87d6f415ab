//! Regression onto a simplex with a Gaussian-softmax distribution: the counterpart in the numerical
//! experiment of the thesis (section 3.4.3, fig. 3.2).
//!
//! A network maps observations to the mean and deviation of a Gaussian candidate; softmax makes it a point of
//! the simplex.
//!
//! | paper | here | shape |
//! |---|---|---|
//! | s | `observations` | `[batch, observed]` |
//! | mu, sigma | `mean`, `exp(log_sd)` | `[batch, n_shares]` each |
//! | a | `softmax(u)`, `u ~ N(mu, sigma)` | `[batch, n_shares]` |
//! | target | `targets`, rows sum to 1 | `[batch, n_shares]` |
//!
//! Departures from the thesis, which names the error but not the loss
//! - `expected_error`: mean absolute error of a reparameterised draw, so that the policy is trained as it
//!   acts.
//! - `log_likelihood`: minus the log density of a candidate of the target, `ln target` (its softmax is the
//!   target); as ordinary code has it, the density on the simplex itself is not formed.
//! - `ln sd` is clamped to [-20, 2], as in the usual soft actor-critic.
//!
//! The agent samples in training and takes `softmax(mean)` in evaluation. Metric: `loss`, mean over the calls
//! since the last measurement.

use crate::shared::simplex_regression::{
    self, RegressionLoss, SimplexHead, excess_error, log_shares, mean_absolute_error,
};
use burn::tensor::{Tensor, activation::softmax};
use contract::{Error, Registry, Rng};
use numerics::{
    gaussian::HALF_LN_TWO_PI, gaussian_head::mean_and_log_sd, gaussian_softmax::gaussian_softmax_sample,
    network::Activation, policy_file::Head,
};

/// Registers the agent.
pub(crate) fn register(registry: &mut Registry, version: u32) {
    let about = "regression onto a simplex with a Gaussian-softmax distribution";
    simplex_regression::register::<GaussianSoftmax>(registry, version, about);
}

/// The softmax of a Gaussian candidate; its parameters are the outputs of the network, means and deviations.
#[derive(Debug)]
pub(crate) struct GaussianSoftmax;

impl SimplexHead for GaussianSoftmax {
    const NAME: &'static str = "gaussian_softmax_regression";
    const LAYERS: [Activation; 3] = [Activation::LeakyRelu; 3];
    const OUTPUTS_PER_SHARE: usize = 2;
    const EXPORTED: Head = Head::SoftmaxMean;

    fn parameters(outputs: Tensor<2>, _: u64) -> Result<Tensor<2>, Error> {
        Ok(outputs)
    }

    fn sample(outputs: Tensor<2>, rng: &mut Rng) -> Tensor<2> {
        let (mean, log_sd) = mean_and_log_sd(outputs);
        gaussian_softmax_sample(mean, log_sd, rng).action
    }

    fn centre(outputs: Tensor<2>) -> Tensor<2> {
        softmax(mean_and_log_sd(outputs).0, 1)
    }

    fn loss(loss: RegressionLoss, outputs: Tensor<2>, targets: Tensor<2>, rng: &mut Rng) -> Tensor<1> {
        let (mean, log_sd) = mean_and_log_sd(outputs);
        match loss {
            RegressionLoss::ExpectedError => {
                mean_absolute_error(gaussian_softmax_sample(mean, log_sd, rng).action, targets)
            }
            RegressionLoss::LogLikelihood => log_density(mean, log_sd, log_shares(targets)).mean().neg(),
            RegressionLoss::ScoreFunction => {
                let drawn = gaussian_softmax_sample(mean.clone().inner(), log_sd.clone().inner(), rng);
                let density = log_density(mean, log_sd, Tensor::from_inner(drawn.candidate));
                (density * Tensor::from_inner(excess_error(drawn.action, targets))).mean()
            }
        }
    }
}

/// `ln N(u; mean, sd)`, `[batch, 1]`.
fn log_density(mean: Tensor<2>, log_sd: Tensor<2>, candidate: Tensor<2>) -> Tensor<2> {
    let residual = (candidate - mean) / log_sd.clone().exp();
    (residual.powf_scalar(2.0) * -0.5 - log_sd - HALF_LN_TWO_PI).sum_dim(1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use numerics::network::{matrix, values};

    #[test]
    fn the_density_by_hand() {
        // Two standard deviations of 0.5 above the mean: -2 + ln 2 - ln(2 pi) / 2.
        let ln_sd = matrix(vec![0.5f32.ln()], 1);
        let density = values(log_density(matrix(vec![1.0], 1), ln_sd, matrix(vec![2.0], 1)))[0];
        assert!((f64::from(density) - (-2.0 + 2f64.ln() - HALF_LN_TWO_PI)).abs() < 1e-6);
    }
}
