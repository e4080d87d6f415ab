//! The allocation of a UAV's load to the four strings of its pack.
//!
//! | symbol | here | unit |
//! |---|---|---|
//! | e_i | `source_v`: voltage that drives a current through the resistance | V |
//! | R_i | `resistance_ohm` | ohm |
//! | P | `power_w`, power of one cell of each string together | W |
//! | v | the common voltage | V |
//!
//! Water filling loads the strings so that all loaded ones have one voltage v: `sum_i v max(e_i - v, 0) / R_i =
//! P`, the higher one of two such voltages. It is the rule of the agents `water_filling` and
//! `water_filling_true_state`; environments import no agents, so it is computed here in another way, by
//! bisection.

use super::config::Allocator;
use super::string::STRINGS;
use crate::{
    battery::Cell,
    policy_network::{FILE, PolicyNetwork},
};
use arithmetic::double::{exp, ln_1p};
use contract::Error;

/// Measured quantities of a pack.
#[derive(Debug, Clone, Copy)]
pub struct Readings {
    /// Voltage of a cell of each string, V.
    pub voltage_v: [f64; STRINGS],
    /// Current of each string, A.
    pub current_a: [f64; STRINGS],
    /// The coming demand on one cell of each string together, W.
    pub power_w: f64,
}

/// A rule of allocation.
#[derive(Debug, Clone)]
pub enum SharingRule {
    /// Equally.
    Equal,
    /// Water filling on measured voltages and known resistances.
    Known,
    /// Water filling on the true states.
    True,
    /// A learned policy.
    Policy(Box<LearnedPolicy>),
}

/// A policy that was learned in `battery`.
#[derive(Debug, Clone)]
pub struct LearnedPolicy {
    network: PolicyNetwork,
    head: Head,
}

/// Conversion of outputs to shares: the heads of `numerics::policy_file` whose actions lie on a simplex.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Head {
    DirichletMean,
    DirichletMode,
    SoftmaxMean,
}

impl SharingRule {
    /// The rule of an allocation module.
    ///
    /// # Errors
    /// [`Error::Source`] outside a trial, [`Error::File`] and [`Error::Config`] for a policy that cannot be
    /// read.
    pub fn of(allocator: &Allocator) -> Result<Self, Error> {
        match allocator {
            Allocator::WaterFilling => Ok(Self::Known),
            Allocator::Policy(product) => {
                let network = PolicyNetwork::open(KEY, &product.folder()?.join(FILE))?;
                Ok(Self::Policy(Box::new(LearnedPolicy::new(network)?)))
            }
        }
    }

    /// Shares of the strings, which sum to 1. `resistance_ohm` holds the known resistances.
    #[must_use]
    pub fn shares(
        &self,
        readings: &Readings,
        resistance_ohm: &[f64; STRINGS],
        cells: &[Cell; STRINGS],
    ) -> [f64; STRINGS] {
        match self {
            Self::Equal => [1.0 / STRINGS as f64; STRINGS],
            Self::Known => {
                let source_v = std::array::from_fn(|i| {
                    readings.voltage_v[i] + resistance_ohm[i] * readings.current_a[i]
                });
                filled(&source_v, resistance_ohm, readings.power_w)
            }
            Self::True => {
                let source_v = cells.each_ref().map(Cell::effective_voltage_v);
                let true_ohm = cells.each_ref().map(|cell| cell.parameters().r_ohm);
                filled(&source_v, &true_ohm, readings.power_w)
            }
            Self::Policy(policy) => policy.shares(readings),
        }
    }
}

const KEY: &str = "allocation.policy";

impl LearnedPolicy {
    fn new(network: PolicyNetwork) -> Result<Self, Error> {
        let named = |name: &'static str| (1..=STRINGS).map(move |i| format!("{name}_{i}"));
        let inputs: Vec<String> = named("voltage")
            .chain(named("current"))
            .chain(["power_demand_w".into()])
            .collect();
        if network.header.inputs != inputs || network.header.outputs.len() != STRINGS {
            let seen = network.header.inputs.join(", ");
            let problem = format!("it is no policy of `battery` with {STRINGS} cells: it sees [{seen}]");
            return Err(Error::config(KEY, problem));
        }
        let head = match network.header.head.as_str() {
            "dirichlet_mean" => Head::DirichletMean,
            "dirichlet_mode" => Head::DirichletMode,
            "softmax_mean" => Head::SoftmaxMean,
            other => {
                return Err(Error::config(KEY, format!("its head `{other}` gives no shares")));
            }
        };
        Ok(Self { network, head })
    }

    fn shares(&self, readings: &Readings) -> [f64; STRINGS] {
        let seen = readings.voltage_v.into_iter().chain(readings.current_a);
        let x = self.network.outputs(seen.chain([readings.power_w]));
        let most = x.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let softplus = |x: f64| x.max(0.0) + ln_1p(exp(-x.abs()));
        let weights: [f64; STRINGS] = std::array::from_fn(|i| match self.head {
            Head::DirichletMean => softplus(x[i]) + 1.0,
            Head::DirichletMode => softplus(x[i]),
            Head::SoftmaxMean => exp(x[i] - most),
        });
        let sum: f64 = weights.iter().sum();
        weights.map(|weight| weight / sum)
    }
}

/// Shares that bring all loaded strings to one voltage; where no voltage meets the demand, those at the voltage
/// of the greatest power.
#[must_use]
pub fn filled(source_v: &[f64; STRINGS], resistance_ohm: &[f64; STRINGS], power_w: f64) -> [f64; STRINGS] {
    let currents = |v: f64| -> [f64; STRINGS] {
        std::array::from_fn(|i| (source_v[i] - v).max(0.0) / resistance_ohm[i])
    };
    let delivered_w = |v: f64| v * currents(v).iter().sum::<f64>();
    let highest_v = source_v.iter().copied().fold(0.0, f64::max);
    // The power falls with the voltage above its maximum, which is never below half the highest source of the
    // strings loaded there.
    let (mut low_v, mut high_v) = (greatest_at(source_v, resistance_ohm), highest_v);
    for _ in 0..48 {
        let middle_v = 0.5 * (low_v + high_v);
        if delivered_w(middle_v) >= power_w {
            low_v = middle_v;
        } else {
            high_v = middle_v;
        }
    }
    let flowing = currents(low_v);
    let sum: f64 = flowing.iter().sum();
    if sum > 0.0 && sum.is_finite() {
        flowing.map(|current| current / sum)
    } else {
        [1.0 / STRINGS as f64; STRINGS]
    }
}

/// The voltage of the greatest power: of the parabolas `v (S - G v)` of the strings with the k highest sources,
/// the highest peak within the range of voltages that loads those k.
fn greatest_at(source_v: &[f64; STRINGS], resistance_ohm: &[f64; STRINGS]) -> f64 {
    let mut order: [usize; STRINGS] = std::array::from_fn(|i| i);
    order.sort_by(|a, b| source_v[*b].total_cmp(&source_v[*a]));
    let (mut s, mut g) = (0.0, 0.0);
    let mut best = (0.0, f64::NEG_INFINITY);
    for (k, &i) in order.iter().enumerate() {
        s += source_v[i] / resistance_ohm[i];
        g += 1.0 / resistance_ohm[i];
        let floor_v = order.get(k + 1).map_or(0.0, |&next| source_v[next].max(0.0));
        let peak_v = (s / (2.0 * g)).clamp(floor_v.min(source_v[i]), source_v[i].max(floor_v));
        let peak_w = peak_v * (s - g * peak_v);
        if peak_w > best.1 {
            best = (peak_v, peak_w);
        }
    }
    best.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy_network::tests::written;
    use serde_json::json;

    fn close(a: [f64; STRINGS], b: [f64; STRINGS]) -> bool {
        a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-9)
    }

    /// Level 3 V: currents (4 - 3) / 0.5 = 2 A and (3.5 - 3) / 0.25 = 2 A, twice, 24 W in all.
    #[test]
    fn water_filling_by_hand() {
        let shares = filled(&[4.0, 3.5, 4.0, 3.5], &[0.5, 0.25, 0.5, 0.25], 24.0);
        assert!(close(shares, [0.25; 4]), "{shares:?}");
        // Level 3.6 V: two strings at 0.8 A, 5.76 W; the others lie below it and rest.
        let shares = filled(&[4.0, 3.5, 4.0, 3.5], &[0.5; 4], 5.76);
        assert!(close(shares, [0.5, 0.0, 0.5, 0.0]), "{shares:?}");
        // One level for all: 3 V with 1, 2, 3 and 4 A, 30 W.
        let shares = filled(&[3.1, 3.2, 3.3, 3.4], &[0.1; 4], 30.0);
        assert!(close(shares, [0.1, 0.2, 0.3, 0.4]), "{shares:?}");
    }

    /// Equal strings deliver e^2 / (4 R) each at most, 8 W; the shares stay equal at any demand.
    #[test]
    fn too_much_power_is_shared_at_the_voltage_of_the_greatest() {
        assert!(close(filled(&[4.0; 4], &[0.5; 4], 100.0), [0.25; 4]));
        assert!((greatest_at(&[4.0; 4], &[0.5; 4]) - 2.0).abs() < 1e-12);
        assert_eq!(filled(&[-1.0; 4], &[0.5; 4], 5.0), [0.25; 4]);
    }

    fn header(head: &str, first: &str) -> serde_json::Value {
        let mut inputs: Vec<String> = Vec::new();
        for name in ["voltage", "current"] {
            inputs.extend((1..=4).map(|i| format!("{name}_{i}")));
        }
        inputs.push("power_demand_w".into());
        inputs[0] = first.into();
        json!({
            "inputs": inputs, "center": vec![0.0; 9], "spread": vec![1.0; 9],
            "outputs": ["weight_1", "weight_2", "weight_3", "weight_4"],
            "head": head, "activations": [],
        })
    }

    /// The outputs are the voltages.
    fn policy(head: &str, first: &str) -> Result<LearnedPolicy, Error> {
        let mut weight = [0.0_f32; 36];
        (0..4).for_each(|i| weight[i * 4 + i] = 1.0);
        let tensors = [
            ("policy.layers.0.weight", vec![9, 4], &weight[..]),
            ("policy.layers.0.bias", vec![4], &[0.0; 4][..]),
        ];
        let folder = written(&header(head, first), &tensors);
        LearnedPolicy::new(PolicyNetwork::open(KEY, &folder.path().join(FILE))?)
    }

    #[test]
    fn a_learned_policy_by_hand() {
        // softplus(ln(e^k - 1)) = k.
        let inverse = |k: f64| (k.exp() - 1.0).ln();
        let readings = Readings {
            voltage_v: [inverse(1.0), inverse(2.0), inverse(3.0), inverse(4.0)],
            current_a: [0.0; 4],
            power_w: 40.0,
        };
        let shares = |head: &str| policy(head, "voltage_1").unwrap().shares(&readings);
        let fourteenths = [2.0, 3.0, 4.0, 5.0].map(|k| k / 14.0);
        assert!(close(shares("dirichlet_mean"), fourteenths));
        assert!(close(shares("dirichlet_mode"), [0.1, 0.2, 0.3, 0.4]));
        let odds = readings.voltage_v.map(f64::exp);
        let sum: f64 = odds.iter().sum();
        assert!(close(shares("softmax_mean"), odds.map(|odd| odd / sum)));
    }

    #[test]
    fn a_policy_of_another_environment_is_refused() {
        let text = policy("dirichlet_mean", "temperature").unwrap_err().to_string();
        assert!(
            text.contains("it is no policy of `battery` with 4 cells: it sees [temperature"),
            "{text}"
        );
        let text = policy("argmax", "voltage_1").unwrap_err().to_string();
        assert!(text.contains("its head `argmax` gives no shares"), "{text}");
    }
}
