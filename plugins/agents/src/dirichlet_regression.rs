//! Regression onto a simplex with a Dirichlet distribution: the numerical experiment of the thesis (section
//! 3.4.3, fig. 3.2).
//!
//! A network maps observations to concentrations. The target, a point of the simplex, is the full state of
//! the environment.
//!
//! | paper | here | shape |
//! |---|---|---|
//! | s | `observations` | `[batch, observed]` |
//! | alpha | `softplus(network) + 1` | `[batch, n_shares]` |
//! | a | a draw from `Dirichlet(alpha)` | `[batch, n_shares]` |
//! | target | `targets`, rows sum to 1 | `[batch, n_shares]` |
//!
//! Departures from the thesis, which names the error but not the loss
//! - `expected_error`: mean absolute error of a reparameterised draw, so that the policy is trained as it
//!   acts.
//! - `log_likelihood`: minus the log density of the target.
//! - `score_function`: the policy gradient of equation 3.4 with the error of a draw as the cost, less its
//!   mean over the batch.
//! - The third hidden layer has leaky rectifiers; the text names the activations of the first two.
//!
//! The agent samples in training and takes the mean `alpha / sum(alpha)` in evaluation. Metric: `loss`, mean
//! over the calls since the last measurement.

use crate::shared::{
    checkpoint::finite,
    simplex_regression::{self, RegressionLoss, SimplexHead, excess_error, log_shares, mean_absolute_error},
    targets::mean,
};
use burn::tensor::Tensor;
use contract::{Error, Registry, Rng};
use numerics::{
    dirichlet_policy::{log_density, sample},
    network::{Activation, softplus},
    policy_file::Head,
};

/// Registers the agent.
pub(crate) fn register(registry: &mut Registry, version: u32) {
    let about = "regression onto a simplex with a Dirichlet distribution";
    simplex_regression::register::<Dirichlet>(registry, version, about);
}

/// A Dirichlet distribution; its parameters are the concentrations.
#[derive(Debug)]
pub(crate) struct Dirichlet;

impl SimplexHead for Dirichlet {
    const NAME: &'static str = "dirichlet_regression";
    const LAYERS: [Activation; 3] = [Activation::LeakyRelu, Activation::Tanh, Activation::LeakyRelu];
    const OUTPUTS_PER_SHARE: usize = 1;
    const EXPORTED: Head = Head::DirichletMean;

    /// `alpha = softplus(f(s)) + 1`.
    fn parameters(outputs: Tensor<2>, n_examples: u64) -> Result<Tensor<2>, Error> {
        let alpha = softplus(outputs) + 1.0;
        finite("concentration", n_examples, mean(alpha.clone()))?;
        Ok(alpha)
    }

    fn sample(alpha: Tensor<2>, rng: &mut Rng) -> Tensor<2> {
        sample(alpha, rng).action
    }

    fn centre(alpha: Tensor<2>) -> Tensor<2> {
        alpha
    }

    fn loss(loss: RegressionLoss, alpha: Tensor<2>, targets: Tensor<2>, rng: &mut Rng) -> Tensor<1> {
        match loss {
            RegressionLoss::ExpectedError => mean_absolute_error(sample(alpha, rng).action, targets),
            RegressionLoss::LogLikelihood => log_density(alpha, log_shares(targets)).mean().neg(),
            RegressionLoss::ScoreFunction => {
                let drawn = sample(alpha.clone().inner(), rng);
                let density = log_density(alpha, Tensor::from_inner(drawn.log_action));
                (density * Tensor::from_inner(excess_error(drawn.action, targets))).mean()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use contract::random::stream;
    use numerics::network::{matrix, values};

    #[test]
    fn the_likelihood_is_that_of_the_target() {
        let (outputs, target) = (matrix(vec![0.3, -0.2, 1.1], 3), [0.5f32, 0.3, 0.2]);
        let alpha = Dirichlet::parameters(outputs, 0).unwrap();
        let targets = matrix(target.to_vec(), 3);
        let likelihood = RegressionLoss::LogLikelihood;
        let loss = Dirichlet::loss(likelihood, alpha.clone(), targets, &mut stream(&["x"]));
        let alpha: Vec<f64> = values(alpha).into_iter().map(f64::from).collect();
        let expected = -numerics::dirichlet::log_density(&alpha, &target.map(|a| f64::from(a).ln()));
        assert!((f64::from(values(loss)[0]) - expected).abs() < 1e-5);
    }
}
