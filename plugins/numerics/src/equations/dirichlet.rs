//! Dirichlet policies.
//!
//! | symbol | here | shape |
//! |---|---|---|
//! | alpha | concentrations, all positive | `[rows, n]` |
//! | ln g | logarithms of gamma draws, whose gradient is that of the draw at a fixed probability | `[rows, n]` |
//! | ln a = ln g - ln sum g | `log_action`, not below [`LOG_ACTION_FLOOR`] | `[rows, n]` |
//! | a | `action` | `[rows, n]` |

use crate::dirichlet::LOG_ACTION_FLOOR;
use plan::Expression;

/// A reparameterised draw; gradients flow to the concentrations.
#[derive(Debug, Clone, Copy)]
pub struct Draw<'e> {
    /// Allocation `[rows, n]`, each row a point of the simplex.
    pub action: Expression<'e>,
    /// Logarithm of the action `[rows, n]`; exact even if `action` has underflowed, down to its floor.
    pub log_action: Expression<'e>,
}

/// Draws `a ~ Dirichlet(alpha)` for each row of `alpha` `[rows, n]`. A row with a concentration that is not
/// positive and finite becomes NaN.
#[must_use]
pub fn sample(alpha: Expression<'_>) -> Draw<'_> {
    // A point at the floor counts as a constant: the clamp passes no gradient below it.
    let log_action = alpha.log_gamma_draw().log_softmax().clamp(LOG_ACTION_FLOOR, 0.0);
    Draw {
        action: log_action.exp(),
        log_action,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dirichlet::{LOG_ACTION_FLOOR, entropy_gradient, log_density, log_density_gradient};
    use crate::gamma::log_gamma_slope;
    use plan::{Equations, Processor, State, differences::largest_error};

    const ALPHA: [f64; 6] = [0.7, 3.0, 12.0, 150.0, 2.2, 1.0];
    const WEIGHTS: [f64; 6] = [1.0, -2.0, 0.5, 0.3, 1.5, -1.0];

    fn state(alpha: &[f64]) -> State<f64> {
        let mut state = State::default();
        state.insert("alpha", [alpha.len() / 3, 3], alpha.to_vec());
        state
    }

    /// Outputs of equations of concentrations.
    fn outputs<const N: usize>(
        names: [&str; N],
        alpha: &[f64],
        write: impl for<'e> FnOnce(&'e Equations, Expression<'e>),
    ) -> [Vec<f64>; N] {
        let equations = Equations::new();
        let parameter = equations.parameter("alpha", [alpha.len() / 3, 3]);
        equations.routine("run");
        write(&equations, parameter);
        let mut processor = Processor::<f64>::new(equations.into_graph());
        processor.run_seeded("run", &mut state(alpha), 21);
        names.map(|name| processor.entries(name).to_vec())
    }

    fn assert_close(got: &[f64], want: &[f64], tolerance: f64) {
        let close = |(got, want): (&f64, &f64)| (got - want).abs() <= tolerance * want.abs().max(0.1);
        assert!(got.iter().zip(want).all(close), "{got:?}, not {want:?}");
    }

    #[test]
    fn a_draw_is_a_point_of_the_simplex_of_its_gamma_draws() {
        let [gammas] = outputs(["gammas"], &ALPHA, |equations, alpha| {
            equations.output("gammas", alpha.log_gamma_draw());
        });
        let [action, log_action] = outputs(["action", "log_action"], &ALPHA, |equations, alpha| {
            let drawn = sample(alpha);
            equations.output("action", drawn.action);
            equations.output("log_action", drawn.log_action);
        });
        for row in 0..2 {
            let of = |numbers: &[f64]| numbers[3 * row..3 * row + 3].to_vec();
            let total: f64 = of(&gammas).iter().map(|log| log.exp()).sum();
            let shares: Vec<f64> = of(&gammas).iter().map(|log| log.exp() / total).collect();
            assert_close(&of(&action), &shares, 1e-9);
            let logarithms: Vec<f64> = shares.iter().map(|share| share.ln()).collect();
            assert_close(&of(&log_action), &logarithms, 1e-9);
        }
    }

    #[test]
    fn a_share_at_the_floor_is_a_constant_and_a_bad_concentration_is_seen() {
        let alpha = [1e-5, 1.0, 1.0, 2.0, 1.0, f64::NAN];
        let [log_action, gradient] = outputs(["log_action", "gradient"], &alpha, |equations, parameter| {
            let drawn = sample(parameter);
            equations.output("log_action", drawn.log_action);
            let loss = drawn.log_action.columns(0..1).sum();
            equations.output("gradient", equations.gradients(loss, &[parameter])[0]);
        });
        assert_eq!(log_action[0], LOG_ACTION_FLOOR);
        assert_eq!(gradient[..3], [0.0; 3]);
        assert!(log_action[3..].iter().all(|log| log.is_nan()));
    }

    #[test]
    fn the_gradient_of_a_draw_is_the_implicit_one() {
        let [gammas] = outputs(["gammas"], &ALPHA, |equations, alpha| {
            equations.output("gammas", alpha.log_gamma_draw());
        });
        let [action, gradient] = outputs(["action", "gradient"], &ALPHA, |equations, alpha| {
            let action = sample(alpha).action;
            equations.output("action", action);
            let loss = (action * equations.constant([2, 3], &WEIGHTS)).sum();
            equations.output("gradient", equations.gradients(loss, &[alpha])[0]);
        });
        // d a_i / d alpha_j = a_i (delta_ij - a_j) slope_j.
        let want: Vec<f64> = (0..6)
            .map(|at| {
                let row = at / 3 * 3..at / 3 * 3 + 3;
                let mean: f64 = row.map(|i| action[i] * WEIGHTS[i]).sum();
                log_gamma_slope(ALPHA[at], gammas[at]) * action[at] * (WEIGHTS[at] - mean)
            })
            .collect();
        assert_close(&gradient, &want, 1e-9);
    }

    #[test]
    #[allow(
        clippy::redundant_closure_for_method_calls,
        reason = "the method has a lifetime that the function's type does not name"
    )]
    fn densities_and_entropies_have_the_gradients_of_their_differences() {
        let points = [0.2_f64, 0.3, 0.5, 0.9, 0.04, 0.06].map(f64::ln);
        let error = |write: for<'e> fn(Expression<'e>, Expression<'e>) -> Expression<'e>, wanted: &str| {
            let equations = Equations::new();
            let alpha = equations.parameter("alpha", [2, 3]);
            let log_points = equations.parameter("points", [2, 3]);
            equations.routine("loss");
            equations.output("loss", write(alpha, log_points).sum());
            let mut state = state(&ALPHA);
            state.insert("points", [2, 3], points.to_vec());
            largest_error(
                equations.into_graph(),
                ["loss", "loss"],
                &[wanted],
                &state,
                &[],
                3,
            )
        };
        for wanted in ["alpha", "points"] {
            assert!(error(|alpha, points| alpha.dirichlet_density(points), wanted) < 1e-6);
        }
        assert!(error(|alpha, _| alpha.dirichlet_entropy(), "alpha") < 1e-6);
        let [densities, gradient] = outputs(["densities", "gradient"], &ALPHA, |equations, alpha| {
            let densities = alpha.dirichlet_density(equations.constant([2, 3], &points));
            equations.output("densities", densities);
            equations.output("gradient", equations.gradients(densities.sum(), &[alpha])[0]);
        });
        let rows = || ALPHA.chunks(3).zip(points.chunks(3));
        let host: Vec<f64> = rows().map(|(alpha, points)| log_density(alpha, points)).collect();
        assert_close(&densities, &host, 1e-9);
        let host = rows().map(|(alpha, points)| log_density_gradient(alpha, points));
        assert_close(&gradient, &host.collect::<Vec<_>>().concat(), 1e-9);
    }

    /// The entropy is minus the mean log density. Minus the log density of draws, differentiated through both of its
    /// arguments, therefore has the entropy's gradient as its mean.
    #[test]
    fn the_pathwise_gradient_of_the_log_density_is_the_entropys() {
        let alpha = [2.0, 0.8, 4.0];
        let [gradient] = outputs(["gradient"], &alpha, |equations, parameter| {
            let repeated = parameter.repeat_rows(20_000);
            let loss = -repeated.dirichlet_density(sample(repeated).log_action).mean();
            equations.output("gradient", equations.gradients(loss, &[parameter])[0]);
        });
        let want = entropy_gradient(&alpha);
        assert!(
            gradient
                .iter()
                .zip(&want)
                .all(|(got, want)| (got - want).abs() < 0.02),
            "{gradient:?}, not {want:?}"
        );
    }
}
