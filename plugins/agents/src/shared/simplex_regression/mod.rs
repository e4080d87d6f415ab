//! Regressions onto a simplex: losses, and the [agent](SimplexRegression) that is the same for
//! every distribution.

mod agent;

pub use agent::{SimplexHead, SimplexRegression, register};

use contract::Updates;
use numerics::dirichlet::LOG_ACTION_FLOOR;
use plan::Expression;
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
pub fn mean_absolute_error<'e>(action: Expression<'e>, targets: Expression<'e>) -> Expression<'e> {
    (action - targets).abs().mean()
}

/// Mean absolute error of each row less that of the batch, `[batch, 1]`.
#[must_use]
pub fn excess_error<'e>(action: Expression<'e>, targets: Expression<'e>) -> Expression<'e> {
    let errors = (action - targets).abs().mean_columns();
    errors - errors.mean()
}

/// Logarithms of shares, with a floor below which a share counts as zero.
#[must_use]
pub fn log_shares(shares: Expression<'_>) -> Expression<'_> {
    shares.clamp(LOG_ACTION_FLOOR.exp(), f64::INFINITY).ln()
}

#[cfg(test)]
mod tests {
    use super::*;
    use plan::{Equations, Processor, State};

    #[test]
    fn errors_by_hand() {
        let equations = Equations::new();
        equations.routine("errors");
        let action = equations.constant([2, 2], &[0.5, 0.5, 1.0, 0.0]);
        let target = equations.constant([2, 2], &[0.25, 0.75, 0.25, 0.75]);
        equations.output("mean", mean_absolute_error(action, target));
        equations.output("excess", excess_error(action, target));
        equations.output("logarithms", log_shares(equations.constant([1, 2], &[1.0, 0.0])));
        let mut processor = Processor::<f32>::new(equations.into_graph());
        processor.run("errors", &mut State::default());
        assert_eq!(processor.entries("mean"), [0.5]);
        assert_eq!(processor.entries("excess"), [-0.25, 0.25]);
        let logarithms = processor.entries("logarithms");
        assert!(logarithms[0] == 0.0 && (f64::from(logarithms[1]) - LOG_ACTION_FLOOR).abs() < 1e-4);
    }
}
