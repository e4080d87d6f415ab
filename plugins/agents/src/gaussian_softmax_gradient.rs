//! The score-function policy gradient of a Gaussian-softmax policy on a bandit, compared with the exact
//! gradient. Thesis, section 3.4.1.
//!
//! | symbol | here | meaning |
//! |---|---|---|
//! | x ~ N(mu, sigma^2 I) | `candidate` | output that a network would have |
//! | a = softmax(x) | action | eq. 3.3 |
//! | pi_theta(x) | `gaussian::log_density` | density that ordinary reinforcement learning code takes for the policy's, eq. 3.7 |
//! | pi(a) | `gaussian::softmax_log_density` | the density of the action, marginal over the common shift, eq. 3.5 |
//! | J | | E r(a) - beta E ln pi(a), eq. 3.2 |
//!
//! The estimate of one sample is (r(a) - beta ln pi_theta(x)) grad_mu ln pi_theta(x). For beta = 0 its mean
//! is the exact gradient: a candidate's score is an unbiased estimator of the gradient of any expected
//! reward. The bias of section 3.4.1 enters with the entropy, for which the candidate's density stands in for
//! the action's: the candidate's entropy does not depend on mu, the action's does. `density:
//! action_as_candidate` is the variant of the thesis that puts the action into the candidate's density.
//!
//! The exact gradient comes from the tensor-product Gauss-Hermite rule over x and central differences in mu.
//!
//! `action_sd` sets the sharpness of the policy, as for the Dirichlet policy: sigma is the one that gives the
//! first share this deviation.

use crate::shared::{
    gradient_moments::{Moments, Reward, RewardChannels, mean_action, metrics},
    seat,
};
use contract::{
    Action, Agent, AgentTraits, Error, Feed, Interface, Mode, Observation, Recorder, Registry, Rng,
    Transition, Updates,
};
use numerics::{gauss_hermite::gauss_hermite, gaussian};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::{cell::OnceCell, path::Path};

const NAME: &str = "gaussian_softmax_gradient";
/// Nodes of the quadrature in each dimension; 40^3 points leave an error far below that of any feasible
/// number of samples.
const NODES: usize = 40;

/// The policy, the objective and the estimator.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Softmax of the candidate's mean; equal shares if absent.
    pub mean: Option<Vec<f64>>,
    /// Standard deviation of the first share.
    #[schemars(range(min = 1e-4, max = 0.4))]
    pub action_sd: f64,
    /// Weight beta of the entropy in the objective, eq. 3.2.
    #[schemars(range(min = 0.0, max = 100.0))]
    pub entropy_weight: f64,
    /// Density that the estimator differentiates.
    pub density: Density,
}

/// Density that the estimator differentiates.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Density {
    /// The candidate's density, eq. 3.7.
    Candidate,
    /// The candidate's density, evaluated at the action.
    ActionAsCandidate,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            mean: None,
            action_sd: 0.1,
            entropy_weight: 0.1,
            density: Density::Candidate,
        }
    }
}

impl contract::Config for Config {}

/// Gradient estimator for one bandit.
#[derive(Debug)]
pub struct GaussianSoftmaxGradient {
    mean: Vec<f64>,
    /// Sigma with the deviation of the config, computed on first use: finding it takes longer than building
    /// everything else.
    sd: OnceCell<f64>,
    config: Config,
    channels: RewardChannels,
    /// Candidates of the last batch, in the order of its actions; the softmax cannot be inverted.
    candidates: Vec<Vec<f64>>,
    exact: Option<(Reward, Vec<f64>)>,
    moments: Moments,
}

/// Registers the agent.
pub(crate) fn register(registry: &mut Registry, version: u32) {
    let about = "policy gradient of a Gaussian-softmax policy on a bandit, estimated and exact";
    let traits = AgentTraits::learner([Feed::Decisions], metrics());
    registry.agent(NAME, version, about, traits, build);
}

/// Builds the estimator for an allocation bandit.
///
/// # Errors
/// [`Error::Mismatch`] for other environments; [`Error::Config`] for a mean or a deviation that no such
/// policy has.
fn build(config: Config, interface: &Interface, _: &mut Rng) -> Result<Box<dyn Agent>, Error> {
    let channels = RewardChannels::find(NAME, interface)?;
    seat::simplex(NAME, seat::only_seat(NAME, interface)?)?;
    if channels.len() != 3 {
        return Err(Error::Mismatch {
            agent: NAME,
            problem: "its quadrature is for three shares".into(),
        });
    }
    let mean: Vec<f64> = mean_action(config.mean.clone(), channels.len())?
        .into_iter()
        .map(f64::ln)
        .collect();
    check_deviation(&mean, config.action_sd)?;
    Ok(Box::new(GaussianSoftmaxGradient {
        mean,
        sd: OnceCell::new(),
        config,
        channels,
        candidates: Vec::new(),
        exact: None,
        moments: Moments::default(),
    }))
}

/// Largest sigma of the bisection.
const LARGEST_SD: f64 = 3.0;

/// Refuses a deviation of the first share that no sigma reaches.
fn check_deviation(mean: &[f64], action_sd: f64) -> Result<(), Error> {
    let most = deviation(mean, LARGEST_SD, &gauss_hermite(NODES));
    if most < action_sd {
        let problem = format!("at most {most:.3} with this mean");
        return Err(Error::config("action_sd", problem));
    }
    Ok(())
}

/// Sigma at which the first share has the deviation `action_sd`, by bisection: the deviation grows with
/// sigma.
fn matching_sd(mean: &[f64], action_sd: f64) -> f64 {
    let rule = gauss_hermite(NODES);
    let (mut low, mut high) = (1e-6, LARGEST_SD);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if deviation(mean, middle, &rule) < action_sd {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

/// Standard deviation of the first share.
fn deviation(mean: &[f64], sd: f64, rule: &[(f64, f64)]) -> f64 {
    let first = expectation(mean, sd, rule, &|action, _| action[0].exp());
    let second = expectation(mean, sd, rule, &|action, _| (2.0 * action[0]).exp());
    (second - first * first).max(0.0).sqrt()
}

/// E f(ln a, x) over x ~ N(mean, sd^2 I) in three dimensions.
fn expectation(mean: &[f64], sd: f64, rule: &[(f64, f64)], f: &dyn Fn(&[f64], &[f64]) -> f64) -> f64 {
    let mut sum = 0.0;
    for (z1, w1) in rule {
        for (z2, w2) in rule {
            for (z3, w3) in rule {
                let x = [mean[0] + sd * z1, mean[1] + sd * z2, mean[2] + sd * z3];
                sum += w1 * w2 * w3 * f(&gaussian::log_softmax(&x), &x);
            }
        }
    }
    sum
}

/// J of the policy with this mean.
fn objective(mean: &[f64], sd: f64, rule: &[(f64, f64)], reward: &Reward, entropy_weight: f64) -> f64 {
    let log_sd = vec![sd.ln(); mean.len()];
    expectation(mean, sd, rule, &|log_action, _| {
        let earned: f64 = log_action
            .iter()
            .zip(&reward.values)
            .map(|(log, value)| value * log.exp() - reward.curvature * (2.0 * log).exp())
            .sum();
        earned - entropy_weight * gaussian::softmax_log_density(mean, &log_sd, log_action)
    })
}

/// Gradient of J in mu, by central differences on fixed nodes.
fn exact(mean: &[f64], sd: f64, reward: &Reward, entropy_weight: f64) -> Vec<f64> {
    let (rule, step) = (gauss_hermite(NODES), 1e-4);
    let at = |entry: usize, shift: f64| {
        let mut moved = mean.to_vec();
        moved[entry] += shift;
        objective(&moved, sd, &rule, reward, entropy_weight)
    };
    (0..mean.len())
        .map(|entry| (at(entry, step) - at(entry, -step)) / (2.0 * step))
        .collect()
}

impl GaussianSoftmaxGradient {
    fn sd(&self) -> f64 {
        *self
            .sd
            .get_or_init(|| matching_sd(&self.mean, self.config.action_sd))
    }

    fn estimate(&self, candidate: &[f64], action: &[f64], reward: f64) -> Vec<f64> {
        let log_sd = vec![self.sd().ln(); self.mean.len()];
        let point = if self.config.density == Density::Candidate {
            candidate
        } else {
            action
        };
        let weight = reward - self.config.entropy_weight * gaussian::log_density(&self.mean, &log_sd, point);
        point
            .iter()
            .zip(&self.mean)
            .map(|(x, mean)| weight * (x - mean) / self.sd().powi(2))
            .collect()
    }
}

impl Agent for GaussianSoftmaxGradient {
    fn act(&mut self, observations: &[Observation], _: Mode, rng: &mut Rng) -> Result<Vec<Action>, Error> {
        let log_sd = vec![self.sd().ln(); self.mean.len()];
        self.candidates = observations
            .iter()
            .map(|_| gaussian::sample(&self.mean, &log_sd, rng))
            .collect();
        Ok(self
            .candidates
            .iter()
            .map(|x| vec![gaussian::log_softmax(x).into_iter().map(f64::exp).collect()])
            .collect())
    }

    fn learn(&mut self, transitions: &[Transition], _: &mut Rng, record: &mut Recorder) -> Result<(), Error> {
        for (transition, candidate) in transitions.iter().zip(&std::mem::take(&mut self.candidates)) {
            self.moments
                .add(&self.estimate(candidate, &transition.action[0], transition.rewards[0]));
        }
        if let Some(transition) = transitions.first() {
            let reward = self.channels.read(&transition.observation.state);
            if self.exact.as_ref().is_none_or(|(known, _)| *known != reward) {
                self.exact = Some((
                    reward.clone(),
                    exact(&self.mean, self.sd(), &reward, self.config.entropy_weight),
                ));
            }
            if let Some((_, exact)) = &self.exact {
                self.moments.end_batch(exact, record);
            }
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
        self.moments.load(NAME, dir, self.mean.len())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// For a small sigma the softmax is linear: E a = softmax(mu), its gradient a_i (v_i - v . a).
    #[test]
    fn the_exact_gradient_of_a_sharp_policy_is_the_softmax_slope() {
        let mean = [0.2f64.ln(), 0.3f64.ln(), 0.5f64.ln()];
        let gradient = exact(
            &mean,
            1e-3,
            &Reward {
                values: vec![1.0, 0.5, 0.0],
                curvature: 0.0,
            },
            0.0,
        );
        let (shares, values) = ([0.2, 0.3, 0.5], [1.0, 0.5, 0.0]);
        for entry in 0..3 {
            let expected = shares[entry] * (values[entry] - 0.35);
            assert!(
                (gradient[entry] - expected).abs() < 1e-5,
                "{entry}: {} against {expected}",
                gradient[entry]
            );
        }
    }

    #[test]
    fn the_deviation_is_that_of_the_config() {
        let mean = [(1.0f64 / 3.0).ln(); 3];
        let sd = matching_sd(&mean, 0.05);
        assert!(check_deviation(&mean, 0.05).is_ok() && check_deviation(&mean, 0.6).is_err());
        // Linearised: sd(a_1) = sigma sqrt(2 / 27).
        assert!((sd - 0.05 / (2.0f64 / 27.0).sqrt()).abs() < 0.01, "{sd}");
    }
}
