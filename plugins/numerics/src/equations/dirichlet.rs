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
    /// Logarithm of the action `[rows, n]`; exact where `action` has underflowed, down to its floor.
    pub log_action: Expression<'e>,
}

/// Draws `a ~ Dirichlet(alpha)` for each row of `alpha` `[rows, n]`. A row with a concentration that is not positive and
/// finite becomes NaN.
#[must_use]
pub fn sample(alpha: Expression<'_>) -> Draw<'_> {
    // A point at the floor counts as a constant: the clamp passes no gradient below it.
    let log_action = alpha.log_gamma_draw().log_softmax().clamp(LOG_ACTION_FLOOR, 0.0);
    Draw {
        action: log_action.exp(),
        log_action,
    }
}
