//! Policies of other programs, read from ONNX files and computed here, a row at a time.

use super::{
    ACTION,
    messages::{Graph, Model, Node, Type, ValueInfo},
    operators::{KNOWN, Settings, computed, is_known},
    tensor::{ElementType, Tensor},
};
use prost::Message;
use std::{collections::BTreeMap, sync::Arc};
use thiserror::Error;

/// Largest accepted file, in bytes; policies are far smaller.
const LARGEST: usize = 1 << 28;

/// Reason why a file cannot be run as a policy.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum OnnxError {
    /// The file holds no model.
    #[error("it is no ONNX model: {problem}")]
    Form {
        /// The fault, as a phrase.
        problem: String,
    },
    /// The file needs unsupported operators.
    #[error("it needs {}, which are not known; known are {}", quoted(unknown), KNOWN.join(", "))]
    Operators {
        /// Names of the operators.
        unknown: Vec<String>,
    },
    /// The network does not take one row of numbers, or has no action as its output.
    #[error("{problem}")]
    Ports {
        /// Inputs or outputs of the file, and the expected ones.
        problem: String,
    },
    /// An operation cannot be computed.
    #[error("the operation `{name}` ({operator}) cannot be computed: {problem}")]
    Node {
        /// Name of the node.
        name: String,
        /// The operator of the node.
        operator: String,
        /// The fault, as a phrase.
        problem: String,
    },
}

fn quoted(names: &[String]) -> String {
    let quoted: Vec<String> = names.iter().map(|name| format!("`{name}`")).collect();
    quoted.join(", ")
}

/// A network read from a file.
#[derive(Debug, Clone)]
pub struct Network {
    nodes: Vec<Operation>,
    /// Constants and weights, by index.
    known: Vec<Option<Arc<Tensor>>>,
    input: Port,
    output: usize,
}

#[derive(Debug, Clone)]
struct Port {
    place: usize,
    kind: ElementType,
    /// Length of a row, if the file states it.
    width: Option<usize>,
    /// Whether a row has a leading dimension for the batch.
    is_batch: bool,
}

#[derive(Debug, Clone)]
struct Operation {
    name: String,
    operator: String,
    settings: Settings,
    /// Indices of its inputs; `None` for one that is left out.
    inputs: Vec<Option<usize>>,
    outputs: Vec<usize>,
}

/// Indices of values by their names.
#[derive(Default)]
struct ValueIndices(BTreeMap<String, usize>);

impl ValueIndices {
    fn of(&mut self, name: &str) -> usize {
        let next = self.0.len();
        *self.0.entry(name.to_owned()).or_insert(next)
    }
}

impl Network {
    /// Reads a network from the bytes of a file.
    ///
    /// # Errors
    /// [`OnnxError`] for bytes that are no model, for unsupported operators, and for inputs and outputs other
    /// than one row of numbers each.
    pub fn read(bytes: &[u8]) -> Result<Self, OnnxError> {
        let form = |problem: String| OnnxError::Form { problem };
        if bytes.len() > LARGEST {
            return Err(form(format!("{} bytes are more than {LARGEST}", bytes.len())));
        }
        let model = Model::decode(bytes).map_err(|error| form(error.to_string()))?;
        let opset = model
            .opset_import
            .iter()
            .find(|it| matches!(it.domain.as_str(), "" | "ai.onnx"));
        let opset = opset
            .ok_or_else(|| form("it names no version of its operators".into()))?
            .version;
        let graph = model.graph.ok_or_else(|| form("it has no graph".into()))?;
        knows_all(&graph)?;
        let (mut places, mut constants) = (ValueIndices::default(), Vec::new());
        for tensor in &graph.initializer {
            let read = Tensor::of(tensor).map_err(|problem| form(format!("`{}`: {problem}", tensor.name)))?;
            constants.push((places.of(&tensor.name), Arc::new(read)));
        }
        let input = input(&graph, &mut places)?;
        let nodes = graph
            .node
            .iter()
            .map(|node| Operation::of(node, opset, &mut places));
        let nodes = nodes.collect::<Result<Vec<_>, OnnxError>>()?;
        let output = places.of(&output(&graph)?.name);
        let mut known = vec![None; places.0.len()];
        for (place, tensor) in constants {
            known[place] = Some(tensor);
        }
        Ok(Self {
            nodes,
            known,
            input,
            output,
        })
    }

    /// Number of entries of an input row, if the file states it.
    #[must_use]
    pub fn width(&self) -> Option<usize> {
        self.input.width
    }

    /// Outputs for one row of numbers.
    ///
    /// # Errors
    /// [`OnnxError::Node`] for an operation that does not accept its inputs.
    pub fn run(&self, row: &[f64]) -> Result<Vec<f64>, OnnxError> {
        let mut values = self.known.clone();
        let shape = if self.input.is_batch {
            vec![1, row.len()]
        } else {
            vec![row.len()]
        };
        values[self.input.place] = Some(Arc::new(Tensor::new(self.input.kind, shape, row.to_vec())));
        for node in &self.nodes {
            let outputs = node.run(&values)?;
            for (place, output) in node.outputs.iter().zip(outputs) {
                values[*place] = Some(Arc::new(output));
            }
        }
        let found = values[self.output].as_ref();
        Ok(found.map_or_else(Vec::new, |output| output.values.clone()))
    }
}

impl Operation {
    fn of(node: &Node, opset: i64, places: &mut ValueIndices) -> Result<Self, OnnxError> {
        let mut input = |name: &String| (!name.is_empty()).then(|| places.of(name));
        let inputs = node.input.iter().map(&mut input).collect();
        let outputs = node.output.iter().map(|name| places.of(name)).collect();
        let settings = Settings::of(node, opset).map_err(|problem| unfit(node, problem))?;
        Ok(Self {
            name: node.name.clone(),
            operator: node.op_type.clone(),
            settings,
            inputs,
            outputs,
        })
    }

    fn run(&self, values: &[Option<Arc<Tensor>>]) -> Result<Vec<Tensor>, OnnxError> {
        let mut inputs = Vec::with_capacity(self.inputs.len());
        for place in &self.inputs {
            let found = place.map(|place| values[place].as_deref());
            match found {
                None => inputs.push(None),
                Some(Some(tensor)) => inputs.push(Some(tensor)),
                Some(None) => {
                    return Err(self.fails("something that it takes is computed nowhere before it".into()));
                }
            }
        }
        computed(&self.operator, &self.settings, &inputs, self.outputs.len())
            .map_err(|problem| self.fails(problem))
    }

    fn fails(&self, problem: String) -> OnnxError {
        OnnxError::Node {
            name: self.name.clone(),
            operator: self.operator.clone(),
            problem,
        }
    }
}

fn unfit(node: &Node, problem: String) -> OnnxError {
    OnnxError::Node {
        name: node.name.clone(),
        operator: node.op_type.clone(),
        problem,
    }
}

fn knows_all(graph: &Graph) -> Result<(), OnnxError> {
    let whole = |node: &Node| match node.domain.as_str() {
        "" | "ai.onnx" => node.op_type.clone(),
        other => format!("{other}.{}", node.op_type),
    };
    let mut unknown: Vec<String> = graph
        .node
        .iter()
        .map(whole)
        .filter(|name| !is_known(name))
        .collect();
    unknown.sort();
    unknown.dedup();
    if unknown.is_empty() {
        Ok(())
    } else {
        Err(OnnxError::Operators { unknown })
    }
}

/// The only input without a constant: an observation.
fn input(graph: &Graph, places: &mut ValueIndices) -> Result<Port, OnnxError> {
    let is_constant = |port: &&ValueInfo| graph.initializer.iter().any(|it| it.name == port.name);
    let open: Vec<&ValueInfo> = graph.input.iter().filter(|port| !is_constant(port)).collect();
    let [port] = open[..] else {
        let names: Vec<String> = open.iter().map(|port| port.name.clone()).collect();
        let problem = format!(
            "it takes {}: a policy takes one input, the observation",
            if names.is_empty() {
                "nothing".into()
            } else {
                quoted(&names)
            }
        );
        return Err(OnnxError::Ports { problem });
    };
    let wrong = |found: String| OnnxError::Ports {
        problem: format!(
            "its input `{}` {found}: a policy takes `[batch, n]` or `[n]`",
            port.name
        ),
    };
    let declared = port
        .kind
        .as_ref()
        .and_then(|Type { tensor_type }| tensor_type.as_ref());
    let declared = declared.ok_or_else(|| wrong("is no tensor".into()))?;
    let kind = ElementType::of(declared.elem_type)
        .map_err(|problem| wrong(format!("holds none of ours: {problem}")))?;
    let dimensions = declared.shape.as_ref().map_or(&[][..], |shape| &shape.dim);
    let lengths: Vec<Option<usize>> = dimensions
        .iter()
        .map(|it| {
            it.dim_value
                .and_then(|length| usize::try_from(length).ok())
                .filter(|length| *length > 0)
        })
        .collect();
    match lengths[..] {
        [width] => Ok(Port {
            place: places.of(&port.name),
            kind,
            width,
            is_batch: false,
        }),
        [None | Some(1), width] => Ok(Port {
            place: places.of(&port.name),
            kind,
            width,
            is_batch: true,
        }),
        [Some(rows), _] => Err(wrong(format!("takes {rows} rows together"))),
        _ => Err(wrong(format!("has {} dimensions", lengths.len()))),
    }
}

/// The only output, or the one called `action`.
fn output(graph: &Graph) -> Result<&ValueInfo, OnnxError> {
    let named = graph.output.iter().find(|port| port.name == ACTION);
    match (&graph.output[..], named) {
        ([only], None) => Ok(only),
        (_, Some(named)) => Ok(named),
        (several, None) => {
            let names: Vec<String> = several.iter().map(|port| port.name.clone()).collect();
            let problem = format!(
                "it gives {}: name the output that acts `{ACTION}`",
                quoted(&names)
            );
            Err(OnnxError::Ports { problem })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{
        super::{Graph, Setting},
        *,
    };

    fn told(bytes: &[u8]) -> String {
        Network::read(bytes).unwrap_err().to_string()
    }

    /// Bytes of the file with its message changed.
    fn changed(change: impl FnOnce(&mut Model)) -> Vec<u8> {
        let (mut graph, observation) = Graph::of_observation(2);
        let action = graph.node("Tanh", &[&observation], &[]);
        let mut model = Model::decode(&*graph.acting(&action, 2).to_bytes(&[])).unwrap();
        change(&mut model);
        model.encode_to_vec()
    }

    fn in_graph(change: impl FnOnce(&mut super::Graph)) -> Vec<u8> {
        changed(|model| change(model.graph.as_mut().unwrap()))
    }

    #[test]
    fn a_row_is_computed_by_itself() {
        let network = Network::read(&changed(|_| {})).unwrap();
        assert_eq!(network.width(), Some(2));
        let tanh = |x: f32| f64::from(f64::from(x).tanh() as f32);
        assert_eq!(network.run(&[0.5, -2.0]).unwrap(), [tanh(0.5), tanh(-2.0)]);
    }

    #[test]
    fn a_file_without_a_policy_is_refused_with_its_contents() {
        assert!(
            told(b"\xff\xff").contains("it is no ONNX model"),
            "{}",
            told(b"\xff\xff")
        );
        assert!(told(b"").contains("names no version of its operators"));
        assert!(told(&changed(|model| model.graph = None)).contains("has no graph"));
        let foreign = in_graph(|graph| graph.node[0].domain = "com.other".into());
        assert!(told(&foreign).contains("it needs `com.other.Tanh`, which are not known; known are Abs"));
        let two = in_graph(|graph| graph.input.push(graph.input[0].clone()));
        assert!(
            told(&two).contains("it takes `observation`, `observation`: a policy takes one"),
            "{}",
            told(&two)
        );
        let nothing = in_graph(|graph| graph.input.clear());
        assert!(told(&nothing).contains("it takes nothing"));
        let outputs = in_graph(|graph| {
            graph.output[0].name = "mean".into();
            graph.output.push(ValueInfo {
                name: "value".into(),
                ..ValueInfo::default()
            });
        });
        assert!(told(&outputs).contains("it gives `mean`, `value`: name the output that acts `action`"));
        let fixed = in_graph(|graph| {
            let kind = graph.input[0]
                .kind
                .as_mut()
                .unwrap()
                .tensor_type
                .as_mut()
                .unwrap();
            kind.shape.as_mut().unwrap().dim[0].dim_value = Some(8);
        });
        assert!(told(&fixed).contains("takes 8 rows together"), "{}", told(&fixed));
        let words = in_graph(|graph| {
            graph.input[0]
                .kind
                .as_mut()
                .unwrap()
                .tensor_type
                .as_mut()
                .unwrap()
                .elem_type = 8;
        });
        assert!(
            told(&words).contains("the kind 8 are not known"),
            "{}",
            told(&words)
        );
        let away = in_graph(|graph| {
            graph.initializer.push(super::super::messages::Tensor {
                data_type: 1,
                data_location: 1,
                ..Default::default()
            });
        });
        assert!(told(&away).contains("lie in another file"), "{}", told(&away));
    }

    #[test]
    fn a_damaged_file_is_refused_or_computed() {
        let (mut graph, observation) = Graph::of_observation(2);
        let weight = graph.constant("weight", &[2, 2], &[0.5; 4]);
        let one = graph.positions("one", &[1], &[1]);
        let layer = graph.node("Gemm", &[&observation, &weight], &[("transB", Setting::Int(1))]);
        let part = graph.node("Gather", &[&layer, &one], &[("axis", Setting::Int(1))]);
        let sum = graph.node("ReduceSum", &[&part, &one], &[("keepdims", Setting::Int(1))]);
        let whole = graph.acting(&sum, 1).to_bytes(&[]);
        for place in 0..whole.len() {
            for bit in 0..8 {
                let mut bytes = whole.clone();
                bytes[place] ^= 1 << bit;
                if let Ok(network) = Network::read(&bytes) {
                    let _ = network.run(&vec![0.5; network.width().unwrap_or(2).min(1000)]);
                }
            }
        }
    }

    #[test]
    fn an_operation_that_cannot_be_computed_is_named() {
        let (mut graph, observation) = Graph::of_observation(2);
        let three = graph.constant("three", &[3], &[1.0; 3]);
        let sum = graph.node("Add", &[&observation, &three], &[]);
        let action = graph.node("Softmax", &[&sum], &[("axis", Setting::Int(1))]);
        let network = Network::read(&graph.acting(&action, 3).to_bytes(&[])).unwrap();
        let told = network.run(&[1.0, 2.0]).unwrap_err().to_string();
        assert!(
            told.contains("the operation `add` (Add) cannot be computed: shapes [1, 2] and [3]"),
            "{told}"
        );
        let unordered = in_graph(|graph| graph.node.reverse());
        let told = Network::read(&unordered)
            .unwrap()
            .run(&[1.0, 2.0])
            .unwrap_err()
            .to_string();
        assert!(told.contains("is computed nowhere before it"), "{told}");
    }
}
