//! A surrogate of an engine: a network that was fitted to it by another trial, read from the file that the
//! trial left, and evaluated in plain double precision.
//!
//! The file is a policy of the agent `network_regression` in the environment `turbofan_samples`: observations
//! are the flight condition and the health parameters, actions are the sensors, both in SI units and corrected
//! where the environment's config says so.
//!
//! `y = action_center + action_spread h`, with the output h of the network ([`policy_network`](crate::policy_network)).

use super::model::FlightCondition;
use super::sensors::Correction;
use crate::policy_network::{FILE, Header, PolicyNetwork};
use contract::{Artifact, Channel, Error, artifact::Policy};
use std::path::Path;

/// The fitted network.
#[derive(Debug, Clone)]
pub(super) struct Surrogate {
    network: PolicyNetwork,
    /// Position of each requested sensor among the outputs.
    sensors: Vec<usize>,
    /// Whether it was fitted to corrected outputs.
    is_corrected: bool,
}

const KEY: &str = "model.surrogate";

fn misfit(problem: impl Into<String>) -> Error {
    Error::config(KEY, problem)
}

impl Surrogate {
    /// The network that a trial left, for these health parameters in this order and these sensors.
    ///
    /// # Errors
    /// [`Error::Source`] outside a trial, [`Error::File`] for a missing file and [`Error::Config`] for another
    /// kind of network or other inputs.
    pub(super) fn read(
        product: &Artifact<Policy>,
        health: &[&str],
        sensors: &[String],
    ) -> Result<Self, Error> {
        Self::open(&product.folder()?.join(FILE), health, sensors)
    }

    fn open(path: &Path, health: &[&str], sensors: &[String]) -> Result<Self, Error> {
        let network = PolicyNetwork::open(KEY, path)?;
        let is_corrected = is_corrected(&network.header, health)?;
        let sensors = places(&network.header, sensors)?;
        Ok(Self {
            network,
            sensors,
            is_corrected,
        })
    }

    /// Sensor readings, SI.
    pub(super) fn read_sensors(&self, condition: &FlightCondition, theta: &[f64]) -> Vec<f64> {
        if !self.is_corrected {
            return self.outputs(condition, theta);
        }
        let correction = Correction::of(condition);
        let mut read = self.outputs(&correction.corrected(condition), theta);
        for (value, place) in read.iter_mut().zip(&self.sensors) {
            *value *= correction.factor(&self.network.header.outputs[*place]);
        }
        read
    }

    fn outputs(&self, condition: &FlightCondition, theta: &[f64]) -> Vec<f64> {
        let inputs = condition.to_array().into_iter().chain(theta.iter().copied());
        let x = self.network.outputs(inputs);
        let header = &self.network.header;
        let (center, spread) = (&header.action_center, &header.action_spread);
        self.sensors
            .iter()
            .map(|place| center[*place] + spread[*place] * x[*place])
            .collect()
    }
}

/// Whether the network was fitted to corrected outputs; checks that its health parameters are these.
fn is_corrected(header: &Header, health: &[&str]) -> Result<bool, Error> {
    let inputs = |channels: Vec<Channel>| -> Vec<String> {
        let names = channels.into_iter().map(|channel| channel.name);
        names.chain(health.iter().map(ToString::to_string)).collect()
    };
    let (plain, corrected) = (FlightCondition::channels(), FlightCondition::corrected_channels());
    match &header.inputs {
        known if *known == inputs(corrected) => Ok(true),
        known if *known == inputs(plain) => Ok(false),
        other => Err(misfit(format!(
            "it was fitted to [{}], and the health parameters here are [{}]: the keys `calibrated` must be \
             the same",
            other.join(", "),
            health.join(", ")
        ))),
    }
}

/// Positions of the requested sensors among the outputs.
fn places(header: &Header, sensors: &[String]) -> Result<Vec<usize>, Error> {
    let n = header.outputs.len();
    let is_one = header.head == "identity"
        && header.activations.iter().all(|it| it == "relu")
        && [&header.center, &header.spread]
            .iter()
            .all(|it| it.len() == header.inputs.len())
        && [&header.action_center, &header.action_spread]
            .iter()
            .all(|it| it.len() == n);
    if !is_one {
        return Err(misfit(
            "it is no surrogate; fit `network_regression` with rectifiers to `turbofan_samples`",
        ));
    }
    let place = |name: &String| {
        header
            .outputs
            .iter()
            .position(|output| output == name)
            .ok_or_else(|| {
                misfit(format!(
                    "it knows nothing of `{name}`; it gives {}",
                    header.outputs.join(", ")
                ))
            })
    };
    sensors.iter().map(place).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy_network;
    use serde_json::{Value, json};

    fn header() -> Value {
        json!({
            "inputs": ["altitude_m", "mach", "delta_t_k", "turbine_inlet_temperature_k", "lpt_flow"],
            "center": [0.0, 0.6, 0.0, 1500.0, 0.0], "spread": [1e3, 0.2, 10.0, 100.0, 0.02],
            "outputs": ["t30_k", "p50_pa"], "action_center": [700.0, 9e4], "action_spread": [50.0, 1e3],
            "head": "identity", "activations": ["relu"], "sizes": [5, 3, 2], "format": 1,
        })
    }

    /// Three hidden units with only Mach number and health as inputs.
    fn written(header: &Value) -> tempfile::TempDir {
        let tensors: [(&str, Vec<usize>, &[f32]); 4] = [
            (
                "policy.layers.0.weight",
                vec![5, 3],
                &[
                    0.0, 0.0, 0.0, 1.0, -1.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0, 0.0, -4.0,
                ],
            ),
            ("policy.layers.0.bias", vec![3], &[0.0, 0.5, 1.0]),
            (
                "policy.layers.1.weight",
                vec![3, 2],
                &[1.0, 0.0, 0.0, 1.0, 1.0, 1.0],
            ),
            ("policy.layers.1.bias", vec![2], &[0.25, -0.25]),
        ];
        policy_network::tests::written(header, &tensors)
    }

    fn open(header: &Value, health: &[&str], sensors: &[&str]) -> Result<Surrogate, Error> {
        let sensors: Vec<String> = sensors.iter().map(ToString::to_string).collect();
        Surrogate::open(&written(header).path().join(FILE), health, &sensors)
    }

    fn condition() -> FlightCondition {
        FlightCondition::from_array([5000.0, 0.8, 10.0, 1500.0])
    }

    #[test]
    fn a_network_by_hand() {
        let surrogate = open(&header(), &["lpt_flow"], &["p50_pa", "t30_k"]).unwrap();
        // x = (1, -1/2): hidden (1 - 1, -1 + 0.5, 0.5 + 2 + 1) = (0, 0, 3.5), y = (3.75, 3.25).
        let read = surrogate.read_sensors(&condition(), &[-0.01]);
        assert!(
            (read[0] - 93_250.0).abs() < 1e-6 && (read[1] - 887.5).abs() < 1e-9,
            "{read:?}"
        );
    }

    #[test]
    fn corrected_outputs_are_brought_back_to_the_air_of_the_flight() {
        let mut header = header();
        header["inputs"][3] = json!("corrected_turbine_inlet_temperature_k");
        let surrogate = open(&header, &["lpt_flow"], &["p50_pa", "t30_k"]).unwrap();
        let read = surrogate.read_sensors(&condition(), &[-0.01]);
        let air = condition().air();
        let expected = [
            93_250.0 * air.total_pressure / 101_325.0,
            887.5 * air.total_temperature / 288.15,
        ];
        assert!(
            read.iter()
                .zip(expected)
                .all(|(x, y)| (x / y - 1.0).abs() < 1e-12),
            "{read:?}"
        );
    }

    #[test]
    fn a_surrogate_with_other_inputs_is_refused() {
        let of = |header: &Value, health: &[&str], sensors: &[&str]| {
            open(header, health, sensors).unwrap_err().to_string()
        };
        let health = ["lpt_flow"];
        let other = of(&header(), &["hpt_flow"], &["t30_k"]);
        assert!(
            other.contains(
                "turbine_inlet_temperature_k, lpt_flow], and the health parameters here are [hpt_flow]"
            ),
            "{other}"
        );
        let unknown = of(&header(), &health, &["p30_pa"]);
        assert!(
            unknown.contains("nothing of `p30_pa`; it gives t30_k, p50_pa"),
            "{unknown}"
        );
        let mut policy = header();
        policy["head"] = json!("tanh");
        assert!(of(&policy, &health, &["t30_k"]).contains("it is no surrogate"));
        let mut short = header();
        short["activations"] = json!(["relu", "relu"]);
        assert!(of(&short, &health, &["t30_k"]).contains("a layer is missing"));
        let empty = tempfile::tempdir().unwrap();
        let missing = Surrogate::open(&empty.path().join(FILE), &[], &[]).unwrap_err();
        assert!(matches!(missing, Error::File { .. }), "{missing}");
        std::fs::write(empty.path().join(FILE), "no tensors").unwrap();
        let damaged = Surrogate::open(&empty.path().join(FILE), &[], &[]).unwrap_err();
        assert!(damaged.to_string().contains("policy.safetensors"), "{damaged}");
    }
}
