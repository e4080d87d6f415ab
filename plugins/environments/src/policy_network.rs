//! A network that another trial left as `policy.safetensors`, evaluated in plain double precision, so that environments
//! know no tensor library.
//!
//! | symbol | here | shape |
//! |---|---|---|
//! | x | `(input - center) / spread` | `[inputs]` |
//! | W_k, b_k | tensors `policy.layers.<k>.weight` and `.bias` | `[inputs, outputs]`, `[outputs]` |
//! | h | `activation(x W + b)` in hidden layers, `x W + b` in the last one | `[outputs]` |

use engine::Error;
use safetensors::SafeTensors;
use serde::Deserialize;
use std::path::Path;

/// The file's name in the folder of a product.
pub const FILE: &str = "policy.safetensors";

/// The network.
#[derive(Debug, Clone)]
pub struct PolicyNetwork {
    /// What the file says of itself.
    pub header: Header,
    layers: Vec<Layer>,
}

/// What the file says of its inputs and outputs.
#[derive(Debug, Clone, Deserialize)]
pub struct Header {
    /// Names of the observed channels.
    pub inputs: Vec<String>,
    /// What is subtracted from each of them.
    pub center: Vec<f64>,
    /// What they are divided by after that.
    pub spread: Vec<f64>,
    /// Names of the entries of the action.
    pub outputs: Vec<String>,
    /// What is added to each entry at the end; may be absent.
    #[serde(default)]
    pub action_center: Vec<f64>,
    /// What each entry is multiplied by before that; may be absent.
    #[serde(default)]
    pub action_spread: Vec<f64>,
    /// How the last layer becomes an action.
    pub head: String,
    /// Of each hidden layer: `relu`, `leaky_relu` or `tanh`.
    pub activations: Vec<String>,
}

#[derive(Debug, Clone)]
struct Layer {
    /// Row by row, one row for each input.
    weight: Vec<f64>,
    bias: Vec<f64>,
}

impl PolicyNetwork {
    /// Reads a file; `key` is the key of the config that names it.
    ///
    /// # Errors
    /// [`Error::File`] where it is not there, [`Error::Config`] where it is damaged or its layers do not follow each
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
        Ok(Self { header, layers })
    }

    /// What the last layer gives for an observation, before the head.
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

fn activated(activation: &str, x: f64) -> f64 {
    match activation {
        "tanh" => x.tanh(),
        "leaky_relu" if x < 0.0 => 0.01 * x,
        "leaky_relu" => x,
        _ => x.max(0.0),
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
pub(crate) mod tests {
    use super::*;
    use safetensors::tensor::{Dtype, TensorView};
    use serde_json::Value;
    use std::collections::HashMap;

    /// A file with these tensors and this header in a folder.
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
