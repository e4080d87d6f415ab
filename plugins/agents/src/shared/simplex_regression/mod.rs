//! Regressions onto a simplex: losses, examples, and the [agent](SimplexRegression) that is the same for
//! every distribution.

mod agent;

pub use agent::{SimplexHead, SimplexRegression, register};

use super::scaling::Scaling;
use burn::tensor::Tensor;
use contract::{Transition, Updates};
use numerics::{dirichlet::LOG_ACTION_FLOOR, network::matrix};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Loss of a regression onto the simplex.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum RegressionLoss {
    /// Mean absolute error of a reparameterised draw against the target.
    #[default]
    ExpectedError,
    /// Minus the log likelihood of the target.
    LogLikelihood,
    /// Mean absolute error of a draw, by the score-function policy gradient (thesis, eq. 3.4 and 3.7): the
    /// draw is not differentiated; its log density is weighted with its error less the mean error of the
    /// batch.
    ScoreFunction,
}

/// Amount of training so far.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Progress {
    /// Number of examples.
    pub n_examples: u64,
    /// Number of batches; each is one update.
    pub n_updates: u64,
}

impl Progress {
    /// Declared updates of the agent.
    #[must_use]
    pub fn updates(self) -> Updates {
        Updates {
            made: self.n_updates,
            first_after: 1,
        }
    }
}

/// Mean over rows and shares of `|action - target|`.
#[must_use]
pub fn mean_absolute_error(action: Tensor<2>, targets: Tensor<2>) -> Tensor<1> {
    (action - targets).abs().mean()
}

/// Mean absolute error of each row less that of the batch, `[batch, 1]`, without gradients.
#[must_use]
pub fn excess_error(action: Tensor<2>, targets: Tensor<2>) -> Tensor<2> {
    let errors = (action - targets).abs().mean_dim(1);
    let batch = errors.clone().mean_dim(0);
    errors - batch
}

/// Logarithms of shares, with a floor below which a share counts as zero.
#[must_use]
pub fn log_shares(shares: Tensor<2>) -> Tensor<2> {
    shares.clamp_min(LOG_ACTION_FLOOR.exp()).log()
}

/// Scaled observations and targets of a batch of transitions.
#[must_use]
#[allow(clippy::cast_possible_truncation, reason = "networks compute in f32")]
pub fn examples(transitions: &[Transition], scaling: &Scaling) -> (Tensor<2>, Tensor<2>) {
    let seen = transitions
        .iter()
        .flat_map(|transition| scaling.apply(&transition.observation.seats[0]))
        .collect();
    let targets = transitions
        .iter()
        .flat_map(|transition| &transition.observation.state)
        .map(|x| *x as f32)
        .collect();
    let n_shares = transitions
        .first()
        .map_or(1, |transition| transition.observation.state.len());
    (matrix(seen, scaling.n_channels()), matrix(targets, n_shares))
}

#[cfg(test)]
mod tests {
    use super::*;
    use numerics::network::values;

    #[test]
    fn errors_by_hand() {
        let (action, target) = (
            matrix(vec![0.5, 0.5, 1.0, 0.0], 2),
            matrix(vec![0.25, 0.75, 0.25, 0.75], 2),
        );
        assert_eq!(values(mean_absolute_error(action.clone(), target.clone())), [0.5]);
        assert_eq!(values(excess_error(action, target)), [-0.25, 0.25]);
        assert_eq!(values(log_shares(matrix(vec![1.0], 1))), [0.0]);
        assert!((f64::from(values(log_shares(matrix(vec![0.0], 1)))[0]) - LOG_ACTION_FLOOR).abs() < 1e-4);
    }
}
