//! A network that another trial left as `policy.safetensors`, evaluated in plain double precision.
//!
//! | symbol | here | shape |
//! |---|---|---|
//! | x | `(input - center) / spread` | `[inputs]` |
//! | W_k, b_k | tensors `policy.layers.<k>.weight` and `.bias` | `[inputs, outputs]`, `[outputs]` |
//! | h | `activation(x W + b)` in hidden layers, `x W + b` in the last one | `[outputs]` |

use arithmetic::double::tanh;
use contract::Error;
use safetensors::{
    SafeTensors,
    tensor::{Dtype, TensorView},
};
use serde::Deserialize;
use std::path::Path;

/// Name of the file in the folder of an artifact.
pub const FILE: &str = "policy.safetensors";

/// A policy of dense layers.
#[derive(Debug, Clone)]
pub struct PolicyNetwork {
    /// Description of inputs, outputs and layers.
    pub header: Header,
    layers: Vec<Layer>,
}

/// The header of the file, which describes inputs, outputs and layers.
#[derive(Debug, Clone, Deserialize)]
pub struct Header {
    /// Names of the observed channels.
    pub inputs: Vec<String>,
    /// Offset that is subtracted from each input.
    pub center: Vec<f64>,
    /// Divisor of each input after that.
    pub spread: Vec<f64>,
    /// Names of the entries of the action.
    pub outputs: Vec<String>,
    /// Offset that is added to each output at the end; may be absent.
    #[serde(default)]
    pub action_center: Vec<f64>,
    /// Factor of each output before that; may be absent.
    #[serde(default)]
    pub action_spread: Vec<f64>,
    /// Name of the function from the last layer to an action.
    pub head: String,
    /// Activation of each hidden layer: `relu`, `leaky_relu` or `tanh`.
    pub activations: Vec<String>,
}

#[derive(Debug, Clone)]
struct Layer {
    /// Weights row by row, one row for each input.
    weight: Vec<f64>,
    bias: Vec<f64>,
}

impl PolicyNetwork {
    /// Reads a file; `key` is the config key that names it.
    ///
    /// # Errors
    /// [`Error::File`] for a missing file, [`Error::Config`] where it is damaged or its layers do not fit each
    /// other.
    pub fn open(key: &str, path: &Path) -> Result<Self, Error> {
        let bytes = std::fs::read(path).map_err(|source| Error::File {
            doing: "read",
            path: path.into(),
            source,
        })?;
        let damaged =
            |problem: &dyn std::fmt::Display| Error::config(key, format!("`{}`: {problem}", path.display()));
        let file = SafeTensors::deserialize(&bytes).map_err(|error| damaged(&error))?;
        let (_, metadata) = SafeTensors::read_metadata(&bytes).map_err(|error| damaged(&error))?;
        let text = metadata.metadata().as_ref().and_then(|it| it.get("header"));
        let header: Header =
            serde_json::from_str(text.map_or("", |text| text)).map_err(|error| damaged(&error))?;
        header.fits().map_err(|problem| damaged(&problem))?;
        let mut width = header.inputs.len();
        let mut layers = Vec::new();
        for layer in 0..=header.activations.len() {
            let read = Layer::read(&file, layer, width).map_err(|problem| damaged(&problem))?;
            width = read.bias.len();
            layers.push(read);
        }
        if width != header.outputs.len() {
            return Err(damaged(
                &"its last layer has another number of outputs than it names",
            ));
        }
        Ok(Self { header, layers })
    }

    /// Output of the last layer for an observation, before the head.
    pub fn outputs(&self, observation: impl Iterator<Item = f64>) -> Vec<f64> {
        let Header { center, spread, .. } = &self.header;
        let scaled = observation.zip(center).zip(spread);
        let mut x: Vec<f64> = scaled
            .map(|((x, center), spread)| (x - center) / spread)
            .collect();
        let hidden = self.header.activations.iter().map(Some).chain([None]);
        for (layer, activation) in self.layers.iter().zip(hidden) {
            x = layer.apply(&x);
            if let Some(activation) = activation {
                x.iter_mut()
                    .for_each(|value| *value = activated(activation, *value));
            }
        }
        x
    }
}

impl Header {
    /// Checks that the header's lists agree; the tensors are checked later.
    fn fits(&self) -> Result<(), String> {
        let n = self.inputs.len();
        if [&self.center, &self.spread].iter().any(|it| it.len() != n) {
            return Err(format!(
                "it names {n} inputs with {} centers and {} spreads",
                self.center.len(),
                self.spread.len()
            ));
        }
        let is_known = |name: &&String| ACTIVATIONS.contains(&name.as_str());
        match self.activations.iter().find(|name| !is_known(name)) {
            Some(other) => Err(format!("its activation `{other}` is not known")),
            None => Ok(()),
        }
    }
}

/// Activations that are implemented here.
const ACTIVATIONS: [&str; 3] = ["relu", "leaky_relu", "tanh"];

fn activated(activation: &str, x: f64) -> f64 {
    match activation {
        "tanh" => tanh(x),
        "leaky_relu" if x < 0.0 => 0.01 * x,
        "leaky_relu" => x,
        _ => x.max(0.0),
    }
}

impl Layer {
    /// Reads a layer with `inputs` inputs.
    fn read(file: &SafeTensors<'_>, layer: usize, inputs: usize) -> Result<Self, String> {
        let tensor = |what: &str| {
            let tensor = file.tensor(&format!("policy.layers.{layer}.{what}"));
            let tensor = tensor.map_err(|_| "a layer is missing".to_string())?;
            match tensor.dtype() {
                Dtype::F32 => Ok(tensor),
                other => Err(format!("layer {layer} holds {other:?}, where F32 is read")),
            }
        };
        let (weight, bias) = (tensor("weight")?, tensor("bias")?);
        let outputs = bias.shape().iter().product();
        if weight.shape() != [inputs, outputs] || bias.shape().len() != 1 || outputs == 0 {
            return Err(format!(
                "its layers do not follow each other: layer {layer} of {inputs} inputs has a weight of {:?} and a bias \
                 of {:?}",
                weight.shape(),
                bias.shape()
            ));
        }
        let number = |bytes: &[u8; 4]| f64::from(f32::from_le_bytes(*bytes));
        let numbers = |tensor: &TensorView<'_>| tensor.data().as_chunks().0.iter().map(number).collect();
        Ok(Self {
            weight: numbers(&weight),
            bias: numbers(&bias),
        })
    }

    fn apply(&self, x: &[f64]) -> Vec<f64> {
        let mut sums = self.bias.clone();
        for (value, row) in x.iter().zip(self.weight.chunks(self.bias.len())) {
            // Half of a rectifier's outputs are 0.
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
pub(crate) mod tests {
    use super::*;
    use serde_json::{Value, json};
    use std::collections::HashMap;

    /// Writes a file with these tensors and this header into a folder.
    pub(crate) fn written(header: &Value, tensors: &[(&str, Vec<usize>, &[f32])]) -> tempfile::TempDir {
        let bytes: Vec<(&str, &Vec<usize>, Vec<u8>)> = tensors
            .iter()
            .map(|(name, shape, values)| {
                let bytes = values.iter().flat_map(|it| it.to_le_bytes()).collect();
                (*name, shape, bytes)
            })
            .collect();
        let views = bytes.iter().map(|(name, shape, data)| {
            (
                *name,
                TensorView::new(Dtype::F32, (*shape).clone(), data).unwrap(),
            )
        });
        let metadata = HashMap::from([("header".to_string(), header.to_string())]);
        let folder = tempfile::tempdir().unwrap();
        let text = safetensors::serialize(views, Some(metadata)).unwrap();
        std::fs::write(folder.path().join(FILE), text).unwrap();
        folder
    }

    fn header() -> Value {
        json!({ "inputs": ["a", "b"], "center": [0.5, 1.0], "spread": [1.0, 2.0], "outputs": ["c"],
            "head": "identity", "activations": ["tanh"] })
    }

    /// Two inputs, three hidden units, one output.
    fn example(header: &Value) -> tempfile::TempDir {
        written(
            header,
            &[
                ("policy.layers.0.weight", vec![2, 3], &[0.5; 6]),
                ("policy.layers.0.bias", vec![3], &[0.1; 3]),
                ("policy.layers.1.weight", vec![3, 1], &[2.0; 3]),
                ("policy.layers.1.bias", vec![1], &[0.25]),
            ],
        )
    }

    fn refusal(folder: &tempfile::TempDir) -> String {
        let path = folder.path().join(FILE);
        let text = PolicyNetwork::open("key", &path).unwrap_err().to_string();
        assert!(text.contains(&*path.to_string_lossy()), "{text}");
        text
    }

    #[test]
    fn a_file_that_says_something_else_than_it_holds_is_refused() {
        assert!(PolicyNetwork::open("key", &example(&header()).path().join(FILE)).is_ok());
        for (key, value, problem) in [
            ("center", json!([0.5]), "2 inputs with 1 centers"),
            ("spread", json!([]), "2 inputs with 2 centers and 0 spreads"),
            ("activations", json!(["tanj"]), "`tanj` is not known"),
            ("activations", json!([]), "another number of outputs"),
            ("outputs", json!([]), "another number of outputs"),
        ] {
            let mut changed = header();
            changed[key] = value;
            let text = refusal(&example(&changed));
            assert!(text.contains(problem), "{text}");
        }
        let mut none = header();
        (none["outputs"], none["activations"]) = (json!([]), json!([]));
        let empty: [(&str, Vec<usize>, &[f32]); 2] = [
            ("policy.layers.0.weight", vec![2, 0], &[]),
            ("policy.layers.0.bias", vec![0], &[]),
        ];
        let text = refusal(&written(&none, &empty));
        assert!(text.contains("do not follow each other"), "{text}");
    }

    #[test]
    fn a_file_with_a_changed_bit_is_refused_by_name_or_computes_and_a_cut_one_is_refused() {
        let folder = example(&header());
        let path = folder.path().join(FILE);
        let whole = std::fs::read(&path).unwrap();
        let read = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            PolicyNetwork::open("key", &path)
        };
        for place in 0..whole.len() {
            for bit in 0..8 {
                let mut changed = whole.clone();
                changed[place] ^= 1 << bit;
                match read(&changed) {
                    Ok(network) => {
                        let n = network.outputs([1.0, 2.0].into_iter()).len();
                        assert_eq!(n, network.header.outputs.len(), "bit {bit} of byte {place}");
                    }
                    Err(error) => assert!(error.to_string().contains(FILE), "{error}"),
                }
            }
            let error = read(&whole[..place]).unwrap_err().to_string();
            assert!(error.contains(FILE), "cut at {place}: {error}");
        }
    }

    #[test]
    fn every_activation_by_hand() {
        for (activation, below, above) in [("relu", 0.0, 2.0), ("leaky_relu", -0.01, 2.0)] {
            assert_eq!(
                [activated(activation, -1.0), activated(activation, 2.0)],
                [below, above]
            );
        }
        assert_eq!(activated("tanh", 0.5), 0.5_f64.tanh());
    }
}
