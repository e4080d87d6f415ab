//! Fixed shares by the rank of the observed voltage: the heuristic rules of the thesis (table 3.3).
//!
//! The asset with the lowest observed voltage gets `weights[0]`, the one with the highest the last weight.
//! Equal voltages keep the order of the channels. Every decision ranks anew.
//!
//! Table 3.3: rule I `[0.15, 0.25, 0.25, 0.35]`, II `[0.1, 0.2, 0.3, 0.4]`, III `[0.1, 0.2, 0.2, 0.5]`,
//! IV `[0.05, 0.2, 0.35, 0.45]`. The weights of rule IV sum to 1.05 as printed. Applied as they are, the rule
//! lives 0.122 of an equal split in the battery environment (published: 0.120); divided by their sum, it
//! lives 0.194.

use crate::shared::seat;
use contract::{Action, Agent, AgentTraits, Error, Interface, Mode, Observation, Preset, Registry, Rng};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::json;

const NAME: &str = "rank_rule";
/// Largest amount by which shares may sum to less than 1; no environment takes less.
const SUM_TOLERANCE: f64 = 1e-6;

/// Weights by rank.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Shares from the lowest to the highest observed voltage, one per asset, applied as they are.
    #[schemars(extend("x-source" = "thesis, table 3.3, rule I"))]
    pub weights: Vec<f64>,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            weights: vec![0.15, 0.25, 0.25, 0.35],
        }
    }
}

impl contract::Config for Config {
    fn presets() -> Vec<Preset> {
        let rule = |name, about, weights: [f64; 4]| Preset {
            name,
            about,
            values: json!({ "weights": weights }),
        };
        vec![
            rule("rule_1", "thesis, table 3.3, rule I", [0.15, 0.25, 0.25, 0.35]),
            rule("rule_2", "thesis, table 3.3, rule II", [0.1, 0.2, 0.3, 0.4]),
            rule("rule_3", "thesis, table 3.3, rule III", [0.1, 0.2, 0.2, 0.5]),
            rule("rule_4", "thesis, table 3.3, rule IV", [0.05, 0.2, 0.35, 0.45]),
        ]
    }
}

/// Shares by rank of voltage.
#[derive(Debug, Clone)]
pub struct RankRule {
    shares: Vec<f64>,
    voltages: Vec<usize>,
}

/// Registers the agent.
pub(crate) fn register(registry: &mut Registry, version: u32) {
    let about = "fixed shares by the rank of the observed voltage";
    registry.agent(NAME, version, about, AgentTraits::default(), build);
}

/// Builds the rule for one seat that observes one `voltage_..` channel per share.
///
/// # Errors
/// [`Error::Mismatch`] for other seats; [`Error::Config`] for weights that are no shares or differ in number
/// from the assets.
fn build(config: Config, interface: &Interface, _: &mut Rng) -> Result<Box<dyn Agent>, Error> {
    let seat = seat::only_seat(NAME, interface)?;
    let n_assets = seat::simplex(NAME, seat)?.len();
    let channels = seat::observed(NAME, seat)?;
    let suffixes = seat::assets(NAME, channels, "voltage_", n_assets)?;
    let voltages = seat::positions(NAME, channels, "voltage_", &suffixes)?;
    Ok(Box::new(RankRule {
        shares: shares(&config.weights, n_assets)?,
        voltages,
    }))
}

fn shares(weights: &[f64], n_assets: usize) -> Result<Vec<f64>, Error> {
    let total: f64 = weights.iter().sum();
    if weights.len() != n_assets {
        let problem = format!(
            "{} weights for {n_assets} assets; write one per asset",
            weights.len()
        );
        return Err(Error::config("weights", problem));
    }
    if weights.iter().any(|weight| !weight.is_finite() || *weight < 0.0) || total <= 0.0 {
        return Err(Error::config(
            "weights",
            "weights are at least 0 and one is above 0",
        ));
    }
    // The environment judges sums above 1: one of the printed rules has such a sum.
    if total < 1.0 - SUM_TOLERANCE {
        let problem = format!("the weights sum to {total}; write shares that sum to 1");
        return Err(Error::config("weights", problem));
    }
    Ok(weights.to_vec())
}

impl RankRule {
    fn allocate(&self, observed: &[f64]) -> Vec<f64> {
        let mut order: Vec<usize> = (0..self.voltages.len()).collect();
        order.sort_by(|&a, &b| observed[self.voltages[a]].total_cmp(&observed[self.voltages[b]]));
        let mut action = vec![0.0; order.len()];
        for (rank, asset) in order.into_iter().enumerate() {
            action[asset] = self.shares[rank];
        }
        action
    }
}

impl Agent for RankRule {
    fn act(&mut self, observations: &[Observation], _: Mode, _: &mut Rng) -> Result<Vec<Action>, Error> {
        Ok(observations
            .iter()
            .map(|observation| vec![self.allocate(&observation.seats[0])])
            .collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shared::seat::tests::allocation;

    const CHANNELS: [&str; 5] = [
        "power_demand_w",
        "voltage_1",
        "voltage_2",
        "voltage_3",
        "voltage_4",
    ];

    fn act(weights: &[f64], observed: [f64; 5]) -> Vec<f64> {
        let mut rng = contract::random::stream(&["rank"]);
        let config = Config {
            weights: weights.to_vec(),
        };
        let mut agent = build(config, &allocation(&CHANNELS, &[], 4), &mut rng).unwrap();
        let observation = Observation {
            seats: vec![observed.to_vec()],
            state: Vec::new(),
        };
        agent
            .act(&[observation], Mode::Evaluate, &mut rng)
            .unwrap()
            .remove(0)
            .remove(0)
    }

    #[test]
    fn the_lowest_voltage_gets_the_first_weight() {
        let action = act(&[0.1, 0.2, 0.3, 0.4], [40.0, 3.7, 3.2, 3.9, 3.5]);
        let expected = [0.3, 0.1, 0.4, 0.2];
        assert!(
            action.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-15),
            "{action:?}"
        );
    }

    #[test]
    fn weights_that_leave_demand_unmet_are_refused() {
        for weights in [
            [0.1, 0.15, 0.15, 0.25],
            [0.0, 0.0, 0.0, 0.0],
            [0.5, 0.6, -0.1, 0.0],
        ] {
            let config = Config {
                weights: weights.to_vec(),
            };
            let mut rng = contract::random::stream(&["rank"]);
            let refused = build(config, &allocation(&CHANNELS, &[], 4), &mut rng);
            assert!(matches!(refused, Err(Error::Config { .. })), "{weights:?}");
        }
    }

    #[test]
    fn equal_voltages_keep_the_order_of_the_channels() {
        let action = act(&[0.1, 0.2, 0.2, 0.5], [40.0, 3.5, 3.5, 3.5, 3.5]);
        assert_eq!(action, [0.1, 0.2, 0.2, 0.5]);
    }

    #[test]
    fn the_printed_weights_of_rule_four_are_applied_as_they_are() {
        let action = act(&[0.05, 0.2, 0.35, 0.45], [40.0, 3.1, 3.2, 3.3, 3.4]);
        assert_eq!(action, [0.05, 0.2, 0.35, 0.45]);
    }

    #[test]
    fn weights_that_do_not_fit_are_refused() {
        let mut rng = contract::random::stream(&["rank"]);
        let interface = allocation(&CHANNELS, &[], 4);
        for weights in [
            vec![1.0],
            vec![-0.1, 0.4, 0.4, 0.3],
            vec![0.0; 4],
            vec![f64::NAN, 1.0, 1.0, 1.0],
        ] {
            assert!(matches!(
                build(Config { weights }, &interface, &mut rng),
                Err(Error::Config { .. })
            ));
        }
    }
}
