//! Gaussian policies mapped to the simplex by softmax.
//!
//! | symbol | here | shape |
//! |---|---|---|
//! | mu, ln sigma | the two halves of `head`, as in [`super::squashed`] | `[rows, n]` each |
//! | x ~ N(mu, sigma) | `candidate` | `[rows, n]` |
//! | a = softmax x | `action` | `[rows, n]` |
//! | ln N(x; mu, sigma) | [`candidate_density`] | `[rows, 1]` |
//! | ln pi(a) | [`action_density`] | `[rows, 1]` |
//!
//! [`crate::gaussian`] has the same densities in `f64` and explains the difference between the density of a candidate
//! and that of its softmax.

use super::squashed::{Draw, candidate, log_sd, mean};
use crate::gaussian::HALF_LN_TWO_PI;
use plan::Expression;

/// Draws one action per row of `head` `[rows, 2 n]`. The log density is that of the **candidate**, which common
/// implementations use as that of the action.
#[must_use]
pub fn sample(head: Expression<'_>) -> Draw<'_> {
    let (candidate, log_density) = candidate(mean(head), log_sd(head));
    Draw {
        action: candidate.softmax(),
        candidate,
        log_density,
    }
}

/// Action `softmax mu` `[rows, n]` of each row of `head`.
#[must_use]
pub fn mean_action(head: Expression<'_>) -> Expression<'_> {
    mean(head).softmax()
}

/// Log density `[rows, 1]` of given candidates `[rows, n]`.
#[must_use]
pub fn candidate_density<'e>(head: Expression<'e>, candidate: Expression<'e>) -> Expression<'e> {
    let log_sd = log_sd(head);
    let standardised = (candidate - mean(head)) * (-log_sd).exp();
    (standardised.square() * -0.5 - log_sd - HALF_LN_TWO_PI).sum_columns()
}

/// True log density `[rows, 1]` of the actions of given candidates `[rows, n]` on the simplex: the common shift is
/// integrated out ([`crate::gaussian::softmax_log_density`] has the equation).
#[must_use]
pub fn action_density<'e>(head: Expression<'e>, candidate: Expression<'e>) -> Expression<'e> {
    let (mean, log_sd) = (mean(head), log_sd(head));
    let log_action = candidate.log_softmax();
    let weights = (log_sd * -2.0).exp();
    let total = weights.sum_columns();
    let residuals = log_action - mean;
    let centre = (weights * residuals).sum_columns() / total;
    let spread = (weights * (residuals - centre).square()).sum_columns();
    let parts = log_sd.sum_columns() + (total.ln() + spread) * 0.5 + log_action.sum_columns();
    -(parts + (mean.n_columns() as f64 - 1.0) * HALF_LN_TWO_PI)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gaussian;
    use plan::{Equations, Processor, State, differences::largest_error};

    /// Means, and logarithms of standard deviations, of two rows.
    const HEAD: [f64; 12] = [0.5, -1.0, 0.2, -0.5, 0.3, -1.0, 3.0, 0.0, -0.4, 0.0, -2.0, 0.4];

    fn state() -> State<f64> {
        let mut state = State::default();
        state.insert("head", [2, 6], HEAD.to_vec());
        state
    }

    #[test]
    fn densities_match_the_host() {
        let equations = Equations::new();
        let head = equations.parameter("head", [2, 6]);
        equations.routine("draw");
        let drawn = sample(head);
        equations.output("candidate", drawn.candidate);
        equations.output("action", drawn.action);
        equations.output("along the draw", drawn.log_density);
        equations.output("of the candidate", candidate_density(head, drawn.candidate));
        equations.output("of the action", action_density(head, drawn.candidate));
        let mut processor = Processor::<f64>::new(equations.into_graph());
        processor.run_seeded("draw", &mut state(), 4);
        for (row, head) in HEAD.chunks(6).enumerate() {
            let (mean, log_sd) = head.split_at(3);
            let candidate = &processor.entries("candidate")[3 * row..3 * row + 3];
            let close = |name: &str, want: f64| {
                let got = processor.entries(name)[row];
                assert!((got - want).abs() < 1e-9, "{name}: {got}, not {want}");
            };
            let density = gaussian::log_density(mean, log_sd, candidate);
            close("along the draw", density);
            close("of the candidate", density);
            let log_action = gaussian::log_softmax(candidate);
            close(
                "of the action",
                gaussian::softmax_log_density(mean, log_sd, &log_action),
            );
            let action = &processor.entries("action")[3 * row..3 * row + 3];
            assert!((action.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            assert!(
                action
                    .iter()
                    .zip(log_action)
                    .all(|(a, log)| (a.ln() - log).abs() < 1e-9)
            );
        }
    }

    #[test]
    fn deviations_stay_within_their_limits() {
        let equations = Equations::new();
        equations.routine("halves");
        let head = equations.constant([1, 4], &[1.0, -2.0, 5.0, -30.0]);
        equations.output("mean", mean(head));
        equations.output("log_sd", log_sd(head));
        let mut processor = Processor::<f64>::new(equations.into_graph());
        processor.run("halves", &mut State::default());
        assert_eq!(processor.entries("mean"), [1.0, -2.0]);
        assert_eq!(processor.entries("log_sd"), [2.0, -20.0]);
    }

    #[test]
    fn gradients_are_those_of_differences() {
        let check = |of: for<'e> fn(Expression<'e>, Draw<'e>) -> Expression<'e>| {
            let equations = Equations::new();
            let head = equations.parameter("head", [2, 6]);
            equations.routine("loss");
            equations.output("loss", of(head, sample(head)).sum());
            let error = largest_error(
                equations.into_graph(),
                ["loss", "loss"],
                &["head"],
                &state(),
                &[],
                3,
            );
            assert!(error < 1e-6, "{error:e}");
        };
        check(|_, drawn| drawn.log_density);
        check(|head, drawn| {
            let weights = head.equations().constant([1, 3], &[1.0, -2.0, 0.5]);
            drawn.action * weights
        });
        check(|head, drawn| candidate_density(head, drawn.candidate));
        check(|head, drawn| action_density(head, drawn.candidate));
    }
}
