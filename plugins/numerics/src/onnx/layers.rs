//! Layers of networks, and the scaling of inputs and outputs.

use super::{Graph, Value};
use crate::activation::Activation;
use crate::tensor_file::{HostTensor, TensorFile, TensorFileError};

/// A layer `x W + b`.
#[derive(Debug, Clone, PartialEq)]
pub struct Dense {
    /// Prefix of the names of its constants.
    pub name: String,
    /// Numbers of inputs and outputs.
    pub shape: [usize; 2],
    /// Weight W, row by row.
    pub weight: Vec<f32>,
    /// Bias b.
    pub bias: Vec<f32>,
}

/// Reads the layers that a network's module stored as `<prefix>.layers.<k>.weight` and `.bias`.
///
/// # Errors
/// [`TensorFileError`] if there is no layer, if one has no bias, and if shapes do not follow each other.
pub fn dense_layers(file: &TensorFile, prefix: &str) -> Result<Vec<Dense>, TensorFileError> {
    let mut layers: Vec<Dense> = Vec::new();
    while layers.is_empty() || file.get(&weight(prefix, layers.len())).is_ok() {
        let name = format!("{prefix}.layers.{}", layers.len());
        let inputs = layers.last().map(|before| before.shape[1]);
        layers.push(Dense::of(file, name, inputs)?);
    }
    Ok(layers)
}

fn weight(prefix: &str, layer: usize) -> String {
    format!("{prefix}.layers.{layer}.weight")
}

impl Dense {
    fn of(file: &TensorFile, name: String, inputs: Option<usize>) -> Result<Self, TensorFileError> {
        let weight = file.get(&format!("{name}.weight"))?;
        let bias = file.get(&format!("{name}.bias"))?;
        match (weight.shape.as_slice(), bias.shape.as_slice()) {
            (&[rows, columns], &[length])
                if length == columns && inputs.is_none_or(|inputs| inputs == rows) =>
            {
                let (weight, bias) = (weight.values.clone(), bias.values.clone());
                let shape = [rows, columns];
                Ok(Self {
                    name,
                    shape,
                    weight,
                    bias,
                })
            }
            (weight, bias) => Err(TensorFileError::Shape {
                expected: format!("`{name}` with {} inputs, and a bias per output", shown(inputs)),
                found: format!("a weight of {weight:?} and a bias of {bias:?}"),
            }),
        }
    }

    /// Layer with only its first `n` outputs.
    #[must_use]
    pub fn first_outputs(&self, n: usize) -> Self {
        let [rows, columns] = self.shape;
        let n = n.min(columns);
        let weight = self
            .weight
            .chunks(columns.max(1))
            .flat_map(|row| row[..n].to_vec());
        Self {
            name: self.name.clone(),
            shape: [rows, n],
            weight: weight.collect(),
            bias: self.bias[..n].to_vec(),
        }
    }

    /// Rows of the weight at `positions`, concatenated.
    #[must_use]
    pub fn rows(&self, positions: impl IntoIterator<Item = usize>) -> Vec<f32> {
        let columns = self.shape[1];
        let row = |at: usize| self.weight[at * columns..(at + 1) * columns].to_vec();
        positions.into_iter().flat_map(row).collect()
    }
}

fn shown(inputs: Option<usize>) -> String {
    inputs.map_or("any number of".into(), |inputs| inputs.to_string())
}

impl Graph {
    /// Fully connected network `[batch, inputs]` to `[batch, outputs]`, with an activation after each layer
    /// that has one.
    pub fn network(&mut self, x: &Value, layers: &[Dense], activations: &[Activation]) -> Value {
        let mut x = x.clone();
        for (at, layer) in layers.iter().enumerate() {
            x = self.dense(&x, layer);
            if let Some(activation) = activations.get(at) {
                x = self.activation(&x, *activation);
            }
        }
        x
    }

    fn dense(&mut self, x: &Value, layer: &Dense) -> Value {
        let weight = self.constant(&format!("{}.weight", layer.name), &layer.shape, &layer.weight);
        let bias = self.constant(&format!("{}.bias", layer.name), &[layer.shape[1]], &layer.bias);
        self.node("Gemm", &[x, &weight, &bias], &[])
    }

    /// Scaled input `(x - center) / spread`, channel by channel; adds no node if that changes nothing.
    pub fn scaled(&mut self, x: &Value, center: &[f64], spread: &[f64]) -> Value {
        let mut x = x.clone();
        let (near, rest): (Vec<f32>, Vec<f32>) = center.iter().map(|center| in_two_parts(*center)).unzip();
        for (name, part) in [("center", near), ("center.rest", rest)] {
            if part.iter().any(|center| *center != 0.0) {
                let part = self.constant(name, &[part.len()], &part);
                x = self.node("Sub", &[&x, &part], &[]);
            }
        }
        if spread.iter().any(|spread| *spread != 1.0) {
            let spread: Vec<f32> = spread.iter().map(|spread| single(*spread)).collect();
            let spread = self.constant("spread", &[spread.len()], &spread);
            x = self.node("Div", &[&x, &spread], &[]);
        }
        x
    }

    /// Output in units `x spread + center`, entry by entry; an empty `center` or `spread` changes nothing.
    pub fn in_units(&mut self, x: &Value, center: &[f64], spread: &[f64]) -> Value {
        let mut x = x.clone();
        for (operator, name, numbers) in [("Mul", "action_spread", spread), ("Add", "action_center", center)]
        {
            if !numbers.is_empty() {
                let numbers: Vec<f32> = numbers.iter().map(|number| single(*number)).collect();
                let numbers = self.constant(name, &[numbers.len()], &numbers);
                x = self.node(operator, &[&x, &numbers], &[]);
            }
        }
        x
    }

    /// Learned scale and shift of inputs that running moments normalise, as one `x factor + shift`.
    ///
    /// # Errors
    /// [`TensorFileError`] if a tensor is missing or of another length than the others.
    pub fn normalised_by_moments(
        &mut self,
        x: &Value,
        file: &TensorFile,
        prefix: &str,
    ) -> Result<Value, TensorFileError> {
        let get = |name: &str| file.get(&format!("{prefix}.{name}"));
        let (mean, variance) = (get("running_mean")?, get("running_variance")?);
        let (weight, bias) = (get("norm.weight")?, get("norm.bias")?);
        let all = [mean, variance, weight, bias];
        if all.iter().any(|tensor| tensor.values.len() != mean.values.len()) {
            let found = all.map(|tensor| tensor.values.len());
            let expected =
                format!("mean, variance, scale and shift of the inputs of `{prefix}`, of one length");
            return Err(TensorFileError::Shape {
                expected,
                found: format!("{found:?}"),
            });
        }
        let factor: Vec<f32> = variance
            .values
            .iter()
            .zip(&weight.values)
            .map(|(variance, weight)| {
                1.0 / (variance + crate::equations::input_norm::EPSILON).sqrt() * weight
            })
            .collect();
        let mut row = |name: &str, HostTensor { values, .. }: &HostTensor| {
            self.constant(&format!("{prefix}.{name}"), &[values.len()], values)
        };
        let (mean, bias) = (row("mean", mean), row("norm.bias", bias));
        let factor = self.constant(&format!("{prefix}.factor"), &[factor.len()], &factor);
        let moved = self.node("Sub", &[x, &mean], &[]);
        let scaled = self.node("Mul", &[&moved, &factor], &[]);
        Ok(self.node("Add", &[&scaled, &bias], &[]))
    }
}

/// Two numbers of single precision with the sum `number`.
fn in_two_parts(number: f64) -> (f32, f32) {
    let near = single(number);
    (near, single(number - f64::from(near)))
}

/// Nearest finite number of single precision: the spread of a hidden channel exceeds that precision.
#[allow(clippy::cast_possible_truncation, reason = "rounding is what is asked for")]
fn single(number: f64) -> f32 {
    (number as f32).clamp(f32::MIN, f32::MAX)
}
