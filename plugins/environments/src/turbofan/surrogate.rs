//! A surrogate of an engine: a network that was fitted to it by a trial of its own, read from the file that the trial
//! left, and evaluated in plain double precision.
//!
//! The file is a policy of the agent `network_regression` in the environment `turbofan_samples`: observations are the
//! flight condition and the health parameters, actions are the sensors, both in SI units and corrected where the
//! environment says so.
//!
//! | symbol | here | shape |
//! |---|---|---|
//! | x | `(input - center) / spread` | `[inputs]` |
//! | W_k, b_k | tensors `policy.layers.<k>.weight` and `.bias` | `[inputs, outputs]`, `[outputs]` |
//! | h | `max(0, x W + b)` in hidden layers | `[outputs]` |
//! | y | `action_center + action_spread h` | `[sensors]` |

use super::model::FlightCondition;
use super::sensors::Correction;
use engine::{Channel, Error, Product, product::Policy};
use safetensors::SafeTensors;
use serde::Deserialize;
use std::path::Path;

/// The fitted network.
#[derive(Debug, Clone)]
pub(super) struct Surrogate {
    header: Header,
    layers: Vec<Layer>,
    /// Where the output of each wanted sensor stands.
    sensors: Vec<usize>,
    /// True where it was fitted to corrected outputs.
    is_corrected: bool,
}

/// What the file says of its inputs and outputs.
#[derive(Debug, Clone, Deserialize)]
struct Header {
    inputs: Vec<String>,
    center: Vec<f64>,
    spread: Vec<f64>,
    outputs: Vec<String>,
    #[serde(default)]
    action_center: Vec<f64>,
    #[serde(default)]
    action_spread: Vec<f64>,
    head: String,
    activations: Vec<String>,
}

#[derive(Debug, Clone)]
struct Layer {
    /// Row by row, one row for each input.
    weight: Vec<f64>,
    bias: Vec<f64>,
}

const FILE: &str = "policy.safetensors";

fn misfit(problem: impl Into<String>) -> Error {
    Error::config("model.surrogate", problem)
}

impl Surrogate {
    /// The network that a trial left, for these health parameters in this order and these sensors.
    ///
    /// # Errors
    /// [`Error::Source`] outside a trial, [`Error::File`] where the file is not there and [`Error::Config`] where it
    /// is no such network or one of other inputs.
    pub(super) fn read(
        product: &Product<Policy>,
        health: &[&str],
        sensors: &[String],
    ) -> Result<Self, Error> {
        Self::open(&product.folder()?.join(FILE), health, sensors)
    }

    fn open(path: &Path, health: &[&str], sensors: &[String]) -> Result<Self, Error> {
        let bytes = std::fs::read(path).map_err(|source| Error::File {
            doing: "read",
            path: path.into(),
            source,
        })?;
        let damaged = |problem: &dyn std::fmt::Display| misfit(format!("`{}`: {problem}", path.display()));
        let file = SafeTensors::deserialize(&bytes).map_err(|error| damaged(&error))?;
        let (_, metadata) = SafeTensors::read_metadata(&bytes).map_err(|error| damaged(&error))?;
        let text = metadata.metadata().as_ref().and_then(|it| it.get("header"));
        let header: Header =
            serde_json::from_str(text.map_or("", |text| text)).map_err(|error| damaged(&error))?;
        let is_corrected = header.is_corrected(health)?;
        let sensors = header.check(sensors)?;
        let layers = (0..=header.activations.len())
            .map(|layer| Layer::read(&file, layer).ok_or_else(|| damaged(&"a layer is missing")))
            .collect::<Result<Vec<_>, Error>>()?;
        let mut width = header.inputs.len();
        for layer in &layers {
            if layer.weight.len() != width * layer.bias.len() {
                return Err(damaged(&"its layers do not follow each other"));
            }
            width = layer.bias.len();
        }
        if width != header.outputs.len() {
            return Err(damaged(
                &"its last layer has another number of outputs than it names",
            ));
        }
        Ok(Self {
            header,
            layers,
            sensors,
            is_corrected,
        })
    }

    /// What the sensors read, SI.
    pub(super) fn read_sensors(&self, condition: &FlightCondition, theta: &[f64]) -> Vec<f64> {
        if !self.is_corrected {
            return self.outputs(condition, theta);
        }
        let correction = Correction::of(condition);
        let mut read = self.outputs(&correction.corrected(condition), theta);
        for (value, place) in read.iter_mut().zip(&self.sensors) {
            *value *= correction.factor(&self.header.outputs[*place]);
        }
        read
    }

    fn outputs(&self, condition: &FlightCondition, theta: &[f64]) -> Vec<f64> {
        let inputs = condition.to_array().into_iter().chain(theta.iter().copied());
        let scaled = inputs.zip(&self.header.center).zip(&self.header.spread);
        let mut x: Vec<f64> = scaled
            .map(|((x, center), spread)| (x - center) / spread)
            .collect();
        let last = self.layers.len() - 1;
        for (place, layer) in self.layers.iter().enumerate() {
            x = layer.apply(&x);
            if place < last {
                x.iter_mut().for_each(|value| *value = value.max(0.0));
            }
        }
        let (center, spread) = (&self.header.action_center, &self.header.action_spread);
        self.sensors
            .iter()
            .map(|place| center[*place] + spread[*place] * x[*place])
            .collect()
    }
}

impl Header {
    /// Whether it was fitted to corrected outputs, of these health parameters.
    fn is_corrected(&self, health: &[&str]) -> Result<bool, Error> {
        let inputs = |channels: Vec<Channel>| -> Vec<String> {
            let names = channels.into_iter().map(|channel| channel.name);
            names.chain(health.iter().map(ToString::to_string)).collect()
        };
        let (plain, corrected) = (FlightCondition::channels(), FlightCondition::corrected_channels());
        match &self.inputs {
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

    /// Places of the wanted sensors.
    fn check(&self, sensors: &[String]) -> Result<Vec<usize>, Error> {
        let n = self.outputs.len();
        let is_one = self.head == "identity"
            && self.activations.iter().all(|it| it == "relu")
            && [&self.center, &self.spread]
                .iter()
                .all(|it| it.len() == self.inputs.len())
            && [&self.action_center, &self.action_spread]
                .iter()
                .all(|it| it.len() == n);
        if !is_one {
            return Err(misfit(
                "it is no surrogate; fit `network_regression` with rectifiers to `turbofan_samples`",
            ));
        }
        let place = |name: &String| {
            self.outputs
                .iter()
                .position(|output| output == name)
                .ok_or_else(|| {
                    misfit(format!(
                        "it knows nothing of `{name}`; it gives {}",
                        self.outputs.join(", ")
                    ))
                })
        };
        sensors.iter().map(place).collect()
    }
}

impl Layer {
    fn read(file: &SafeTensors<'_>, layer: usize) -> Option<Self> {
        let numbers = |what: &str| {
            let tensor = file.tensor(&format!("policy.layers.{layer}.{what}")).ok()?;
            let number = |bytes: &[u8]| Some(f64::from(f32::from_le_bytes(bytes.try_into().ok()?)));
            tensor.data().chunks(4).map(number).collect::<Option<Vec<f64>>>()
        };
        Some(Self {
            weight: numbers("weight")?,
            bias: numbers("bias")?,
        })
    }

    fn apply(&self, x: &[f64]) -> Vec<f64> {
        let mut sums = self.bias.clone();
        for (value, row) in x.iter().zip(self.weight.chunks(self.bias.len())) {
            // Half of what rectifiers give is 0.
            if *value != 0.0 {
                sums.iter_mut()
                    .zip(row)
                    .for_each(|(sum, weight)| *sum += value * weight);
            }
        }
        sums
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use safetensors::tensor::{Dtype, TensorView};
    use serde_json::{Value, json};
    use std::collections::HashMap;

    fn header() -> Value {
        json!({
            "inputs": ["altitude_m", "mach", "delta_t_k", "turbine_inlet_temperature_k", "lpt_flow"],
            "center": [0.0, 0.6, 0.0, 1500.0, 0.0], "spread": [1e3, 0.2, 10.0, 100.0, 0.02],
            "outputs": ["t30_k", "p50_pa"], "action_center": [700.0, 9e4], "action_spread": [50.0, 1e3],
            "head": "identity", "activations": ["relu"], "sizes": [5, 3, 2], "format": 1,
        })
    }

    /// Three units see Mach number and health alone.
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
        let bytes = tensors.map(|(name, shape, values)| {
            (
                name,
                shape,
                values.iter().flat_map(|it| it.to_le_bytes()).collect::<Vec<u8>>(),
            )
        });
        let views = bytes
            .iter()
            .map(|(name, shape, data)| (*name, TensorView::new(Dtype::F32, shape.clone(), data).unwrap()));
        let metadata = HashMap::from([("header".to_string(), header.to_string())]);
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(
            folder.path().join(FILE),
            safetensors::serialize(views, Some(metadata)).unwrap(),
        )
        .unwrap();
        folder
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
    fn what_is_no_surrogate_of_these_inputs_is_refused() {
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
