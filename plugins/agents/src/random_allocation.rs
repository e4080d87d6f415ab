//! Shares drawn uniformly from the simplex at every decision: the least informed policy, a floor for
//! comparisons.
//!
//! Uniform on the simplex is `Dirichlet(1, ..., 1)`: `a_i = e_i / sum_j e_j` with `e_i = -ln(1 - u_i)`
//! exponential, `u_i` uniform in `[0, 1)`. The agent draws in both modes, learns nothing and records nothing.

use crate::shared::{allocation::uniform_shares, seat};
use contract::{Action, Agent, AgentTraits, Error, Interface, Mode, Observation, Registry, Rng};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

const NAME: &str = "random_allocation";

/// No parameters.
#[derive(Debug, Clone, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {}

impl contract::Config for Config {}

/// Uniformly random shares for every seat.
#[derive(Debug, Clone)]
pub struct RandomAllocation {
    n_shares: Vec<usize>,
}

/// Registers the agent.
pub(crate) fn register(registry: &mut Registry, version: u32) {
    let about = "shares drawn uniformly from the simplex";
    registry.agent(NAME, version, about, AgentTraits::default(), build);
}

/// Builds the policy for any number of seats that act on simplexes.
///
/// # Errors
/// [`Error::Mismatch`] where a seat's action is not on a simplex.
fn build(_: Config, interface: &Interface, _: &mut Rng) -> Result<Box<dyn Agent>, Error> {
    let n_shares = interface
        .seats
        .iter()
        .map(|seat| Ok(seat::simplex(NAME, seat)?.len()));
    Ok(Box::new(RandomAllocation {
        n_shares: n_shares.collect::<Result<_, Error>>()?,
    }))
}

impl Agent for RandomAllocation {
    fn act(&mut self, observations: &[Observation], _: Mode, rng: &mut Rng) -> Result<Vec<Action>, Error> {
        let mut draw = |_| self.n_shares.iter().map(|&n| uniform_shares(n, rng)).collect();
        Ok(observations.iter().map(&mut draw).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shared::seat::tests::allocation;

    #[test]
    fn shares_sum_to_one_and_have_the_moments_of_a_uniform_simplex() {
        let mut rng = contract::random::stream(&["uniform"]);
        let mut agent = build(Config {}, &allocation(&["voltage_1"], &[], 4), &mut rng).unwrap();
        let actions = agent
            .act(&vec![Observation::default(); 20_000], Mode::Train, &mut rng)
            .unwrap();
        assert!(
            actions
                .iter()
                .all(|action| (action[0].iter().sum::<f64>() - 1.0).abs() < 1e-12)
        );
        let mean = |power: i32| actions.iter().map(|action| action[0][1].powi(power)).sum::<f64>() / 20_000.0;
        // Dirichlet(1,1,1,1): E[a] = 1/4, E[a^2] = 2/20.
        assert!((mean(1) - 0.25).abs() < 0.005 && (mean(2) - 0.1).abs() < 0.004);
    }
}
