//! The score-function policy gradient of a Dirichlet policy on a bandit, compared with the exact gradient.
//! Thesis, section 3.4.2.
//!
//! | symbol | here | meaning |
//! |---|---|---|
//! | alpha | `concentration` | parameters of the policy, one per entry |
//! | A | their sum | |
//! | r(a) | `Reward` | v . a - c a . a |
//! | beta | `entropy_weight` | weight of the entropy, eq. 3.2 |
//! | J | | E r(a) + beta H |
//!
//! The estimate of one sample is (r(a) - beta log pi(a)) grad log pi(a), eq. 3.4 and 3.13. The exact gradient
//! is closed: E a_i = alpha_i / A, E a_i^2 = alpha_i (alpha_i + 1) / (A (A + 1)), and the entropy's gradient
//! is known.
//!
//! `action_sd` sets the sharpness of the policy: it is the standard deviation of the first share, from which
//! A follows.

use crate::shared::{
    gradient_moments::{Moments, Reward, RewardChannels, mean_action, metrics},
    seat,
};
use contract::{
    Action, Agent, AgentTraits, Error, Feed, Interface, Mode, Observation, Recorder, Registry, Rng,
    Transition, Updates,
};
use numerics::dirichlet;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;

const NAME: &str = "dirichlet_gradient";

/// The policy and the objective.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Mean action; equal shares if absent.
    pub mean: Option<Vec<f64>>,
    /// Standard deviation of the first share.
    #[schemars(range(min = 1e-4, max = 0.4))]
    pub action_sd: f64,
    /// Weight beta of the entropy in the objective, eq. 3.2.
    #[schemars(range(min = 0.0, max = 100.0))]
    pub entropy_weight: f64,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            mean: None,
            action_sd: 0.1,
            entropy_weight: 0.1,
        }
    }
}

impl contract::Config for Config {}

/// Gradient estimator for one bandit.
#[derive(Debug)]
pub struct DirichletGradient {
    concentration: Vec<f64>,
    entropy_weight: f64,
    channels: RewardChannels,
    moments: Moments,
}

/// Registers the agent.
pub(crate) fn register(registry: &mut Registry, version: u32) {
    let about = "policy gradient of a Dirichlet policy on a bandit, estimated and exact";
    let traits = AgentTraits::learner([Feed::Decisions], metrics());
    registry.agent(NAME, version, about, traits, build);
}

/// Builds the estimator for an allocation bandit.
///
/// # Errors
/// [`Error::Mismatch`] for other environments, [`Error::Config`] for a mean that is no allocation.
fn build(config: Config, interface: &Interface, _: &mut Rng) -> Result<Box<dyn Agent>, Error> {
    let channels = RewardChannels::find(NAME, interface)?;
    seat::simplex(NAME, seat::only_seat(NAME, interface)?)?;
    let mean = mean_action(config.mean, channels.len())?;
    // Var a_1 = m_1 (1 - m_1) / (A + 1).
    let total = mean[0] * (1.0 - mean[0]) / config.action_sd.powi(2) - 1.0;
    if total <= 0.0 {
        return Err(Error::config(
            "action_sd",
            format!("no Dirichlet distribution with mean {} spreads so far", mean[0]),
        ));
    }
    let concentration = mean.iter().map(|share| share * total).collect();
    Ok(Box::new(DirichletGradient {
        concentration,
        entropy_weight: config.entropy_weight,
        channels,
        moments: Moments::default(),
    }))
}

/// Gradient in alpha of E r(a) + beta H.
///
/// With m_i = alpha_i / A: d(v . m) / d alpha_i = (v_i - v . m) / A. With S = sum_j alpha_j (alpha_j + 1) and
/// D = A (A + 1): d(S / D) / d alpha_i = (2 alpha_i + 1) / D - S (2 A + 1) / D^2.
fn exact(concentration: &[f64], reward: &Reward, entropy_weight: f64) -> Vec<f64> {
    let total: f64 = concentration.iter().sum();
    let mean_reward: f64 = concentration
        .iter()
        .zip(&reward.values)
        .map(|(alpha, value)| value * alpha / total)
        .sum();
    let squares: f64 = concentration.iter().map(|alpha| alpha * (alpha + 1.0)).sum();
    let divisor = total * (total + 1.0);
    let slope = |((alpha, value), entropy): ((&f64, &f64), f64)| {
        let linear = (value - mean_reward) / total;
        let quadratic = (2.0 * alpha + 1.0) / divisor - squares * (2.0 * total + 1.0) / divisor.powi(2);
        linear - reward.curvature * quadratic + entropy_weight * entropy
    };
    concentration
        .iter()
        .zip(&reward.values)
        .zip(dirichlet::entropy_gradient(concentration))
        .map(slope)
        .collect()
}

impl Agent for DirichletGradient {
    fn act(&mut self, observations: &[Observation], _: Mode, rng: &mut Rng) -> Result<Vec<Action>, Error> {
        let draw = |_| {
            vec![
                dirichlet::sample(&self.concentration, rng)
                    .into_iter()
                    .map(f64::exp)
                    .collect(),
            ]
        };
        Ok(observations.iter().map(draw).collect())
    }

    fn learn(&mut self, transitions: &[Transition], _: &mut Rng, record: &mut Recorder) -> Result<(), Error> {
        for transition in transitions {
            let log_action: Vec<f64> = transition.action[0]
                .iter()
                .map(|share| share.max(f64::MIN_POSITIVE).ln())
                .collect();
            let log_density = dirichlet::log_density(&self.concentration, &log_action);
            let weight = transition.rewards[0] - self.entropy_weight * log_density;
            let score = dirichlet::log_density_gradient(&self.concentration, &log_action);
            self.moments
                .add(&score.into_iter().map(|entry| weight * entry).collect::<Vec<_>>());
        }
        if let Some(transition) = transitions.first() {
            let reward = self.channels.read(&transition.observation.state);
            self.moments
                .end_batch(&exact(&self.concentration, &reward, self.entropy_weight), record);
        }
        Ok(())
    }

    fn reads_state(&self) -> bool {
        true
    }

    fn updates(&self) -> Option<Updates> {
        Some(self.moments.updates())
    }

    fn save(&self, dir: &Path) -> Result<(), Error> {
        self.moments.save(NAME, dir)
    }

    fn load(&mut self, dir: &Path) -> Result<(), Error> {
        self.moments.load(NAME, dir, self.concentration.len())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// J in closed form, for numerical differentiation.
    fn objective(concentration: &[f64], reward: &Reward, entropy_weight: f64) -> f64 {
        let total: f64 = concentration.iter().sum();
        let expected: f64 = concentration
            .iter()
            .zip(&reward.values)
            .map(|(alpha, value)| {
                value * alpha / total - reward.curvature * alpha * (alpha + 1.0) / (total * (total + 1.0))
            })
            .sum();
        expected + entropy_weight * dirichlet::entropy(concentration)
    }

    #[test]
    fn the_exact_gradient_agrees_with_finite_differences() {
        let (concentration, reward) = (
            vec![2.0, 3.5, 1.2],
            Reward {
                values: vec![1.0, 0.4, -0.3],
                curvature: 0.7,
            },
        );
        let gradient = exact(&concentration, &reward, 0.3);
        for (entry, slope) in gradient.iter().enumerate() {
            let at = |step: f64| {
                let mut moved = concentration.clone();
                moved[entry] += step;
                objective(&moved, &reward, 0.3)
            };
            let numeric = (at(1e-5) - at(-1e-5)) / 2e-5;
            assert!(
                (slope - numeric).abs() < 1e-8,
                "{entry}: {slope} against {numeric}"
            );
        }
    }
}
