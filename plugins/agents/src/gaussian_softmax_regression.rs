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
use contract::Registry;
use numerics::{
    activation::Activation,
    equations::gaussian_softmax::{candidate_density, mean_action, sample},
    policy_file::Head,
};
use plan::Expression;

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

    fn sample(head: Expression<'_>) -> Expression<'_> {
        sample(head).action
    }

    fn centre(head: Expression<'_>) -> Expression<'_> {
        mean_action(head)
    }

    fn loss<'e>(loss: RegressionLoss, head: Expression<'e>, targets: Expression<'e>) -> Expression<'e> {
        match loss {
            RegressionLoss::ExpectedError => mean_absolute_error(sample(head).action, targets),
            RegressionLoss::LogLikelihood => -candidate_density(head, log_shares(targets)).mean(),
            RegressionLoss::ScoreFunction => {
                let drawn = sample(head.stop_gradient());
                let density = candidate_density(head, drawn.candidate);
                (density * excess_error(drawn.action, targets)).mean()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use numerics::gaussian::HALF_LN_TWO_PI;
    use plan::{Equations, Processor, State};

    #[test]
    fn the_likelihood_by_hand() {
        let equations = Equations::new();
        equations.routine("loss");
        // The candidate of the target is ln 0.5, two standard deviations of 0.5 below the mean of each share.
        let (mean, log_sd) = (0.5f64.ln() + 1.0, 0.5f64.ln());
        let head = equations.constant([1, 4], &[mean, mean, log_sd, log_sd]);
        let targets = equations.constant([1, 2], &[0.5, 0.5]);
        let likelihood = RegressionLoss::LogLikelihood;
        equations.output("loss", GaussianSoftmax::loss(likelihood, head, targets));
        let mut processor = Processor::<f32>::new(equations.into_graph());
        processor.run("loss", &mut State::default());
        let of_a_share = -2.0 + 2f64.ln() - HALF_LN_TWO_PI;
        assert!((processor.number("loss") + 2.0 * of_a_share).abs() < 1e-5);
    }
}
