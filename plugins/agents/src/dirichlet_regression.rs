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

use crate::shared::simplex_regression::{
    self, RegressionLoss, SimplexHead, excess_error, log_shares, mean_absolute_error,
};
use contract::Registry;
use numerics::{activation::Activation, equations::dirichlet::sample, policy_file::Head};
use plan::Expression;

/// Registers the agent.
pub(crate) fn register(registry: &mut Registry, version: u32) {
    let about = "regression onto a simplex with a Dirichlet distribution";
    simplex_regression::register::<Dirichlet>(registry, version, about);
}

/// A Dirichlet distribution; its parameters are the concentrations.
#[derive(Debug)]
pub(crate) struct Dirichlet;

/// `alpha = softplus(f(s)) + 1`.
fn concentrations(head: Expression<'_>) -> Expression<'_> {
    head.softplus() + 1.0
}

impl SimplexHead for Dirichlet {
    const NAME: &'static str = "dirichlet_regression";
    const LAYERS: [Activation; 3] = [Activation::LeakyRelu, Activation::Tanh, Activation::LeakyRelu];
    const OUTPUTS_PER_SHARE: usize = 1;
    const EXPORTED: Head = Head::DirichletMean;

    fn sample(head: Expression<'_>) -> Expression<'_> {
        sample(concentrations(head)).action
    }

    fn centre(head: Expression<'_>) -> Expression<'_> {
        concentrations(head)
    }

    fn loss<'e>(loss: RegressionLoss, head: Expression<'e>, targets: Expression<'e>) -> Expression<'e> {
        let alpha = concentrations(head);
        match loss {
            RegressionLoss::ExpectedError => mean_absolute_error(sample(alpha).action, targets),
            RegressionLoss::LogLikelihood => -alpha.dirichlet_density(log_shares(targets)).mean(),
            RegressionLoss::ScoreFunction => {
                let drawn = sample(alpha.stop_gradient());
                let density = alpha.dirichlet_density(drawn.log_action);
                (density * excess_error(drawn.action, targets)).mean()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plan::{Equations, Processor, State};

    #[test]
    fn the_likelihood_is_that_of_the_target() {
        let (outputs, target) = ([0.3, -0.2, 1.1], [0.5, 0.3, 0.2]);
        let equations = Equations::new();
        equations.routine("loss");
        let (head, targets) = (
            equations.constant([1, 3], &outputs),
            equations.constant([1, 3], &target),
        );
        let likelihood = RegressionLoss::LogLikelihood;
        equations.output("loss", Dirichlet::loss(likelihood, head, targets));
        equations.output("alpha", Dirichlet::centre(head));
        let mut processor = Processor::<f32>::new(equations.into_graph());
        processor.run("loss", &mut State::default());
        let alpha: Vec<f64> = processor.entries("alpha").iter().map(|a| f64::from(*a)).collect();
        let expected = -numerics::dirichlet::log_density(&alpha, &target.map(f64::ln));
        assert!((processor.number("loss") - expected).abs() < 1e-5);
    }
}
