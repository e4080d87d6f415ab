//! Policies as ONNX files for runtimes that are independent of this program, and the reading and running of those of
//! other programs ([`Network`]).
//!
//! A file is one graph from `observation` `[batch, n]` to `action` `[batch, m]`, both `float32`, in the
//! operators of opset 17 (IR version 8). Its properties have the names of the channels and the owner of the
//! policy.
//!
//! Everything is computed in `float32`, as the networks are. Scaling of inputs and outputs is given in `f64`:
//! - `(x - center) / spread` subtracts the centre in two parts, its `float32` and the remainder, so that no digit is
//!   lost if a channel varies little around a large value; the spread is its `float32`.
//! - `softplus(x) = max(x, 0) + 2 artanh(t / (2 + t))` with `t = e^-|x|`, which equals `ln(1 + t)` to the last digits
//!   even if `t` is small, in operators that need no `log1p`.
//!
//! For the same `float32` observation, as an environment shows it, the actions of a runtime and of
//! [`Policy::act`](crate::policy_file::Policy::act) differ by less than 1e-6 of the action's scale;
//! `tests/portable_policies.rs` checks two runtimes.

mod heads;
mod layers;
mod layouts;
mod messages;
#[cfg(test)]
mod operator_tests;
mod operators;
mod read;
mod sums;
mod tensor;
#[cfg(test)]
mod tests;

pub use heads::with_first_outputs;
pub use layers::{Dense, dense_layers};
pub use read::{Network, OnnxError};

use crate::activation::Activation;
use messages::{
    Attribute, Dimension, FLOAT, Graph as GraphMessage, INT64, Model, Node, OperatorSet, Property, Shape,
    Tensor, TensorType, Type, ValueInfo,
};
use prost::Message;

/// Version of the operators.
pub const OPSET: i64 = 17;
/// Version of the file format, that of ONNX 1.12.
const IR_VERSION: i64 = 8;
/// Name of the input of a policy.
pub const OBSERVATION: &str = "observation";
/// Name of the output of a policy.
pub const ACTION: &str = "action";

/// An input or output of an operation, by its name in the graph.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Value(String);

/// A graph that is being built.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Graph {
    message: GraphMessage,
}

/// A setting of an operation.
#[derive(Debug, Clone, PartialEq)]
pub enum Setting {
    /// A real number.
    Float(f32),
    /// An integer.
    Int(i64),
    /// Several integers.
    Ints(Vec<i64>),
}

impl Graph {
    /// Creates a graph with the input `observation` `[batch, n_observed]`; returns that input too.
    #[must_use]
    pub fn of_observation(n_observed: usize) -> (Self, Value) {
        let mut graph = Self::default();
        graph.message.name = "policy".into();
        graph.message.input.push(port(OBSERVATION, n_observed));
        (graph, Value(OBSERVATION.into()))
    }

    /// Adds a constant of a shape, the last dimension running fastest.
    ///
    /// # Panics
    /// If the number of entries is not the product of the shape.
    pub fn constant(&mut self, name: &str, shape: &[usize], values: &[f32]) -> Value {
        assert_eq!(
            shape.iter().product::<usize>(),
            values.len(),
            "entries of {name} {shape:?}"
        );
        let bytes = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.tensor(name, FLOAT, shape, bytes)
    }

    /// Adds a constant of integers, such as positions, with a shape.
    ///
    /// # Panics
    /// If the number of entries is not the product of the shape.
    pub fn positions(&mut self, name: &str, shape: &[usize], values: &[usize]) -> Value {
        assert_eq!(
            shape.iter().product::<usize>(),
            values.len(),
            "entries of {name} {shape:?}"
        );
        let bytes = values
            .iter()
            .flat_map(|value| whole(*value).to_le_bytes())
            .collect();
        self.tensor(name, INT64, shape, bytes)
    }

    fn tensor(&mut self, name: &str, data_type: i32, shape: &[usize], raw_data: Vec<u8>) -> Value {
        let name = self.free(name);
        self.message.initializer.push(Tensor {
            dims: shape.iter().copied().map(whole).collect(),
            data_type,
            name: name.clone(),
            raw_data,
            ..Tensor::default()
        });
        Value(name)
    }

    /// Adds an operator of the opset; returns its output.
    pub fn node(&mut self, operator: &str, inputs: &[&Value], settings: &[(&str, Setting)]) -> Value {
        let output = self.free(&operator.to_lowercase());
        self.add(operator, inputs, settings, output.clone());
        Value(output)
    }

    fn add(&mut self, operator: &str, inputs: &[&Value], settings: &[(&str, Setting)], output: String) {
        self.message.node.push(Node {
            input: inputs.iter().map(|value| value.0.clone()).collect(),
            name: output.clone(),
            output: vec![output],
            op_type: operator.into(),
            attribute: settings
                .iter()
                .map(|(name, setting)| attribute(name, setting))
                .collect(),
            domain: String::new(),
        });
    }

    /// `name`, or a name that begins with it and is free in the graph.
    fn free(&self, name: &str) -> String {
        let taken = |name: &str| {
            let graph = &self.message;
            graph.initializer.iter().any(|it| it.name == name)
                || graph.node.iter().any(|it| it.name == name)
                || [OBSERVATION, ACTION].contains(&name)
        };
        let numbered = (2..).map(|number| format!("{name}_{number}"));
        // There are more numbers than names in a graph.
        let mut candidates = std::iter::once(name.to_owned()).chain(numbered);
        candidates.find(|name| !taken(name)).expect("a free name")
    }

    /// Completes the graph: its output `action` `[batch, n_acted]` is `value`.
    #[must_use]
    pub fn acting(mut self, value: &Value, n_acted: usize) -> Self {
        self.add("Identity", &[value], &[], ACTION.into());
        self.message.output.push(port(ACTION, n_acted));
        self
    }

    /// Bytes of the file, with properties by name.
    #[must_use]
    pub fn to_bytes(&self, properties: &[(String, String)]) -> Vec<u8> {
        let property = |(key, value): &(String, String)| Property {
            key: key.clone(),
            value: value.clone(),
        };
        let model = Model {
            ir_version: IR_VERSION,
            producer_name: "regimen".into(),
            graph: Some(self.message.clone()),
            opset_import: vec![OperatorSet {
                domain: String::new(),
                version: OPSET,
            }],
            metadata_props: properties.iter().map(property).collect(),
        };
        model.encode_to_vec()
    }

    /// Adds an activation, entry by entry.
    pub fn activation(&mut self, x: &Value, activation: Activation) -> Value {
        match activation {
            Activation::Relu => self.node("Relu", &[x], &[]),
            Activation::LeakyRelu => self.node(
                "LeakyRelu",
                &[x],
                &[("alpha", Setting::Float(crate::activation::LEAKY))],
            ),
            Activation::Tanh => self.node("Tanh", &[x], &[]),
        }
    }
}

fn port(name: &str, width: usize) -> ValueInfo {
    let batch = Dimension {
        dim_param: Some("batch".into()),
        dim_value: None,
    };
    let width = Dimension {
        dim_value: Some(whole(width)),
        dim_param: None,
    };
    let tensor_type = TensorType {
        elem_type: FLOAT,
        shape: Some(Shape {
            dim: vec![batch, width],
        }),
    };
    ValueInfo {
        name: name.into(),
        kind: Some(Type {
            tensor_type: Some(tensor_type),
        }),
    }
}

fn attribute(name: &str, setting: &Setting) -> Attribute {
    let mut attribute = Attribute {
        name: name.into(),
        ..Attribute::default()
    };
    match setting {
        Setting::Float(value) => (attribute.kind, attribute.f) = (1, Some(*value)),
        Setting::Int(value) => (attribute.kind, attribute.i) = (2, Some(*value)),
        Setting::Ints(values) => (attribute.kind, attribute.ints) = (7, values.clone()),
    }
    attribute
}

fn whole(number: usize) -> i64 {
    // Lengths and positions in memory are far below 2^63.
    i64::try_from(number).expect("a length below 2^63")
}
