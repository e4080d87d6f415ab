//! A one-step allocation with a known best answer.
//!
//! The action a lies on the simplex; the reward is the sum of v_i a_i - c |a|^2. For c = 0 the best action is
//! the corner of the largest value, so a policy that cannot reach a corner shows its bias; for c > 0 it is the
//! projection of v / (2c) onto the simplex. The observation is the constant 1.

use crate::simplex;
use contract::{Channel, End, Environment, Error, Metric, PerEpisode, Rng, Seat, Space, Step};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Settings of the `allocation_bandit` environment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct AllocationBanditConfig {
    /// Reward v per unit of each entry; the action has as many entries.
    #[schemars(length(min = 1))]
    pub values: Vec<f64>,
    /// Weight c of the squared length of the action, which is subtracted from the reward.
    #[schemars(range(min = 0.0))]
    pub curvature: f64,
}

impl Default for AllocationBanditConfig {
    fn default() -> Self {
        Self {
            values: vec![1.0, 0.5, 0.0],
            curvature: 0.0,
        }
    }
}

impl contract::Config for AllocationBanditConfig {}

/// The `allocation_bandit` environment.
#[derive(Debug)]
pub struct AllocationBandit {
    config: AllocationBanditConfig,
    best: Vec<f64>,
    seats: Vec<Seat>,
    metrics: Vec<Metric>,
    action: Vec<f64>,
}

/// Builds the environment; registered as `allocation_bandit`.
///
/// # Errors
/// [`Error::Config`] where there are no values.
pub fn build(config: AllocationBanditConfig) -> Result<Box<dyn Environment>, Error> {
    if config.values.is_empty() {
        return Err(Error::config("values", "an allocation needs at least one entry"));
    }
    Ok(Box::new(AllocationBandit::new(config)))
}

impl AllocationBandit {
    fn new(config: AllocationBanditConfig) -> Self {
        let count = config.values.len();
        let seat = Seat {
            name: String::new(),
            observation: Space::Box(vec![Channel::new("constant", "").within(1.0, 1.0)]),
            action: Space::Simplex(shares(count)),
        };
        let regret = Metric::new("regret", "", "reward of the best action less the reward").lower_is_better();
        Self {
            best: best_action(&config),
            seats: vec![seat],
            metrics: vec![regret.per_episode(PerEpisode::Last)],
            action: vec![f64::NAN; count],
            config,
        }
    }
}

fn shares(count: usize) -> Vec<String> {
    (1..=count).map(|number| format!("share_{number}")).collect()
}

fn reward(config: &AllocationBanditConfig, action: &[f64]) -> f64 {
    let value: f64 = config
        .values
        .iter()
        .zip(action)
        .map(|(value, share)| value * share)
        .sum();
    value - config.curvature * action.iter().map(|share| share * share).sum::<f64>()
}

/// The action with the highest reward.
fn best_action(config: &AllocationBanditConfig) -> Vec<f64> {
    if config.curvature > 0.0 {
        let target: Vec<f64> = config
            .values
            .iter()
            .map(|value| value / (2.0 * config.curvature))
            .collect();
        return projection_onto_simplex(&target);
    }
    let best = (0..config.values.len()).fold(0, |best, index| {
        if config.values[index] > config.values[best] {
            index
        } else {
            best
        }
    });
    (0..config.values.len())
        .map(|index| if index == best { 1.0 } else { 0.0 })
        .collect()
}

/// The point of the simplex nearest to `target`: max(target - t, 0) with the t that makes it sum to 1 (Held,
/// Wolfe and Crowder 1974).
fn projection_onto_simplex(target: &[f64]) -> Vec<f64> {
    let mut falling = target.to_vec();
    falling.sort_by(|a, b| b.total_cmp(a));
    let (mut sum, mut threshold) = (0.0, 0.0);
    for (index, value) in falling.iter().enumerate() {
        sum += value;
        let candidate = (sum - 1.0) / (index + 1) as f64;
        if *value > candidate {
            threshold = candidate;
        }
    }
    target.iter().map(|value| (value - threshold).max(0.0)).collect()
}

impl Environment for AllocationBandit {
    fn seats(&self) -> &[Seat] {
        &self.seats
    }

    fn metrics(&self) -> &[Metric] {
        &self.metrics
    }

    fn reset(&mut self, _rng: &mut Rng) -> Result<Vec<Vec<f64>>, Error> {
        self.action.fill(f64::NAN);
        Ok(vec![vec![1.0]])
    }

    fn step(&mut self, actions: &[Vec<f64>], _rng: &mut Rng) -> Result<Step, Error> {
        self.action = simplex::checked(actions, self.config.values.len(), simplex::SUM_TOLERANCE)?;
        let earned = reward(&self.config, &self.action);
        let regret = reward(&self.config, &self.best) - earned;
        let step = Step::new(vec![vec![1.0]], vec![earned], Some(End::Terminated));
        Ok(step.record("regret", regret))
    }

    fn state_channels(&self) -> Vec<Channel> {
        let numbered = |word: &'static str| {
            (1..=self.best.len()).map(move |number| Channel::new(format!("{word}_{number}"), ""))
        };
        numbered("best")
            .map(|channel| channel.within(0.0, 1.0))
            .chain(numbered("value"))
            .chain([Channel::new("curvature", "")])
            .collect()
    }

    fn state(&self) -> Vec<f64> {
        self.best
            .iter()
            .chain(&self.config.values)
            .copied()
            .chain([self.config.curvature])
            .collect()
    }

    fn trace_channels(&self) -> Vec<Channel> {
        shares(self.best.len())
            .into_iter()
            .map(|name| Channel::new(name, ""))
            .collect()
    }

    fn trace(&self) -> Vec<f64> {
        self.action.clone()
    }

    fn snapshot(&self) -> serde_json::Value {
        serde_json::Value::Null
    }

    fn restore(&mut self, _snapshot: &serde_json::Value) -> Result<(), Error> {
        // An episode is one step: between steps nothing is left to restore.
        self.action.fill(f64::NAN);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn bandit(values: &[f64], curvature: f64) -> AllocationBandit {
        AllocationBandit::new(AllocationBanditConfig {
            values: values.to_vec(),
            curvature,
        })
    }

    #[test]
    fn a_linear_reward_is_best_in_a_corner() {
        let mut environment = bandit(&[1.0, 0.5, 0.0], 0.0);
        let mut rng = contract::random::stream(&[]);
        assert_eq!(environment.reset(&mut rng).unwrap(), [[1.0]]);
        let step = environment.step(&[vec![0.2, 0.6, 0.2]], &mut rng).unwrap();
        assert!(
            (step.rewards[0] - 0.5).abs() < 1e-15 && (step.metric("regret").unwrap() - 0.5).abs() < 1e-15
        );
        assert_eq!(step.end, Some(End::Terminated));
        assert_eq!(environment.state(), [1.0, 0.0, 0.0, 1.0, 0.5, 0.0, 0.0]);
        assert!(environment.step(&[vec![0.2, 0.6, 0.3]], &mut rng).is_err());
    }

    /// v = (1, 0.5, 0), c = 0.5: the projection of (1, 0.5, 0) takes 1/4 from the first two.
    #[test]
    fn a_curved_reward_is_best_inside() {
        assert_eq!(bandit(&[1.0, 0.5, 0.0], 0.5).best, [0.75, 0.25, 0.0]);
    }

    #[test]
    fn no_values_are_refused() {
        assert!(
            build(AllocationBanditConfig {
                values: vec![],
                curvature: 0.0
            })
            .is_err()
        );
    }

    proptest! {
        #[test]
        fn regret_is_never_negative(
            values in prop::collection::vec(-2.0_f64..2.0, 3),
            raw in prop::collection::vec(0.001_f64..1.0, 3),
            curvature in 0.0_f64..3.0,
        ) {
            let sum: f64 = raw.iter().sum();
            let action = raw.iter().map(|entry| entry / sum).collect();
            let mut environment = bandit(&values, curvature);
            prop_assert!((environment.best.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            let step = environment.step(&[action], &mut contract::random::stream(&[])).unwrap();
            prop_assert!(step.metric("regret").unwrap() >= -1e-12, "{}", step.metric("regret").unwrap());
        }
    }
}
