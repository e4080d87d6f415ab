//! Gaussian policies squashed by tanh.
//!
//! | symbol | here | shape |
//! |---|---|---|
//! | mu, ln sigma | the two halves of `head`; ln sigma is clamped to [-20, 2] | `[rows, n]` each |
//! | epsilon | standard normal draws | `[rows, n]` |
//! | x = mu + sigma epsilon | `candidate` | `[rows, n]` |
//! | a = tanh x | `action` | `[rows, n]` |
//! | ln pi(a) = ln N(x; mu, sigma) - sum ln(1 - a^2) | `log_density` | `[rows, 1]` |
//!
//! The limits of ln sigma are those of public code of soft actor-critic (Haarnoja et al. 2018, arXiv:1812.05905). Some
//! of that code adds 1e-6 to `1 - a^2` ([`Correction::Softened`]), which keeps the density of a saturated action
//! bounded. The exact form needs no such number: `ln(1 - tanh(x)^2) = 2 (ln 2 - x - softplus(-2 x))`.

use crate::gaussian::HALF_LN_TWO_PI;
use plan::Expression;

/// Limits of ln sigma.
pub const LOG_SD_LIMITS: [f64; 2] = [-20.0, 2.0];
const SMALL: f64 = 1e-6;
/// Factor of a stored action before the inverse of tanh, which gives an action on the boundary a finite candidate.
const INSIDE: f64 = 0.9999;

/// Derivative of the squashing in a density.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Correction {
    /// `ln(1 - a^2)`.
    Exact,
    /// `ln(1 - a^2 + 1e-6)`.
    Softened,
}

/// A reparameterised draw; gradients flow to its head.
#[derive(Debug, Clone, Copy)]
pub struct Draw<'e> {
    /// Action `tanh(candidate)` `[rows, n]`.
    pub action: Expression<'e>,
    /// Point before the tangent `[rows, n]`.
    pub candidate: Expression<'e>,
    /// Log density of the action `[rows, 1]`.
    pub log_density: Expression<'e>,
}

/// Half `mu` `[rows, n]` of a head `[rows, 2 n]`.
#[must_use]
pub fn mean(head: Expression<'_>) -> Expression<'_> {
    head.columns(0..head.n_columns() / 2)
}

/// Half `ln sigma` `[rows, n]` of a head `[rows, 2 n]`, clamped to its limits.
#[must_use]
pub fn log_sd(head: Expression<'_>) -> Expression<'_> {
    let n = head.n_columns();
    head.columns(n / 2..n).clamp(LOG_SD_LIMITS[0], LOG_SD_LIMITS[1])
}

/// Candidate `x = mu + sigma epsilon` `[rows, n]` and its log density `[rows, 1]`, which depends only on ln sigma along
/// the draw.
#[must_use]
pub fn candidate<'e>(mean: Expression<'e>, log_sd: Expression<'e>) -> (Expression<'e>, Expression<'e>) {
    let noise = mean.equations().normal(mean.shape());
    let log_density = (noise.square() * -0.5 - log_sd - HALF_LN_TWO_PI).sum_columns();
    (mean + log_sd.exp() * noise, log_density)
}

/// Draws one action per row of `head` `[rows, 2 n]`.
#[must_use]
pub fn sample(head: Expression<'_>, correction: Correction) -> Draw<'_> {
    let (candidate, log_density) = candidate(mean(head), log_sd(head));
    Draw {
        action: candidate.tanh(),
        candidate,
        log_density: log_density - log_slope(candidate, correction).sum_columns(),
    }
}

/// Log density `[rows, 1]` of given candidates `[rows, n]`.
#[must_use]
pub fn log_density<'e>(
    head: Expression<'e>,
    candidate: Expression<'e>,
    correction: Correction,
) -> Expression<'e> {
    let (mean, log_sd) = (mean(head), log_sd(head));
    let standardised = (candidate - mean) * (-log_sd).exp();
    let terms = standardised.square() * -0.5 - log_sd - HALF_LN_TWO_PI - log_slope(candidate, correction);
    terms.sum_columns()
}

/// `ln(1 - tanh(x)^2)` of each entry, softened or not.
fn log_slope(x: Expression<'_>, correction: Correction) -> Expression<'_> {
    match correction {
        Correction::Exact => (x + (x * -2.0).softplus() - std::f64::consts::LN_2) * -2.0,
        Correction::Softened => {
            // 1 - tanh(x)^2 computed from e^(-2 |x|): the difference from a rounded tangent near one would have no
            // digits left.
            let e = (x.abs() * -2.0).exp();
            (e * 4.0 / (e + 1.0).square() + SMALL).ln()
        }
    }
}

/// Action `tanh mu` `[rows, n]` of each row of `head`.
#[must_use]
pub fn mean_action(head: Expression<'_>) -> Expression<'_> {
    mean(head).tanh()
}

/// Candidates `atanh(0.9999 a)` of stored actions.
#[must_use]
pub fn candidate_of(action: Expression<'_>) -> Expression<'_> {
    let inside = action * INSIDE;
    ((inside + 1.0) / (1.0 - inside)).ln() * 0.5
}
