//! The equivariant policy as a graph for other runtimes.
//!
//! The encoder reads an asset's own channels beside shared ones: the means over the assets and the common
//! channels. A layer over both is the sum of a layer over each, so nothing is repeated for every asset: `x_i
//! W = own_i W_own + shared W_shared`. The same holds for the head, which reads an asset's features beside
//! their mean.
//!
//! | symbol | here | shape |
//! |---|---|---|
//! | own | each asset's own channels | `[batch, assets, blocks]` |
//! | shared | their means and the common channels | `[batch, 1, blocks + common]` |
//! | h | outputs of the encoder | `[batch, assets, width]` |

use crate::shared::policy_forms::{error, header, misfit, portable as policy_of, tensors};
use contract::{Error, policy_form::PortablePolicy};
use numerics::{
    activation::Activation,
    onnx::{Dense, Graph, Setting, Value, dense_layers},
    policy_file::Head,
    tensor_file::TensorFile,
};
use serde::Deserialize;
use std::path::Path;

/// Header of the policy file.
#[derive(Debug, Clone, PartialEq, Deserialize)]
struct Header {
    n_assets: usize,
    blocks: Vec<usize>,
    common: Vec<usize>,
    inputs: Vec<String>,
    center: Vec<f64>,
    spread: Vec<f64>,
    outputs: Vec<String>,
    head: Head,
}

/// Graph of the policy; `None` where the file in `dir` is of another form.
///
/// # Errors
/// [`Error::File`] or [`Error::Checkpoint`] where the file is missing or damaged.
pub(super) fn portable(dir: &Path) -> Result<Option<Vec<PortablePolicy>>, Error> {
    let file = tensors(dir)?;
    if file.header["architecture"] != "equivariant" {
        return Ok(None);
    }
    let header: Header = header(&file.header)?;
    header.check()?;
    let graph = header.graph(&file)?;
    let Header {
        inputs,
        outputs,
        head,
        ..
    } = header;
    Ok(Some(vec![policy_of(String::new(), inputs, outputs, head, graph)]))
}

impl Header {
    fn check(&self) -> Result<(), Error> {
        let n = self.inputs.len();
        let inside = |first: &usize, length: usize| first.checked_add(length).is_some_and(|end| end <= n);
        let whole = self.n_assets > 0
            && !self.blocks.is_empty()
            && self.blocks.iter().all(|first| inside(first, self.n_assets))
            && self.common.iter().all(|channel| inside(channel, 1))
            && [self.center.len(), self.spread.len()] == [n; 2]
            && self.outputs.len() == self.n_assets;
        if whole {
            return Ok(());
        }
        Err(misfit(format!(
            "{} assets with blocks at {:?} and the channels {:?} of none, of {n} inputs and {} outputs",
            self.n_assets,
            self.blocks,
            self.common,
            self.outputs.len()
        )))
    }

    fn graph(&self, file: &TensorFile) -> Result<Graph, Error> {
        let (mut graph, observation) = Graph::of_observation(self.inputs.len());
        let x = graph.scaled(&observation, &self.center, &self.spread);
        let own = self.own(&mut graph, &x);
        let means = mean_over_assets(&mut graph, &own);
        let shared = self.beside_common(&mut graph, &means, &x);
        let n_blocks = self.blocks.len();
        let n_features = 2 * n_blocks + self.common.len();
        // Rows of the weight: mean and own channel of each block in turn, then the common channels.
        let own_rows = (0..n_blocks).map(|block| 2 * block + 1).collect();
        let shared_rows = (0..n_blocks)
            .map(|block| 2 * block)
            .chain(2 * n_blocks..n_features)
            .collect();
        let encoder = two_layers(file, "encoder", n_features)?;
        let h = apply(&mut graph, &encoder, [(&own, own_rows), (&shared, shared_rows)]);
        let width = encoder[1].shape[1];
        let pooled = mean_over_assets(&mut graph, &h);
        let head = two_layers(file, "head", 2 * width)?;
        if head[1].shape[1] != 1 {
            return Err(misfit(format!(
                "the head gives {} numbers for an asset",
                head[1].shape[1]
            )));
        }
        let halves = [
            (&h, (0..width).collect()),
            (&pooled, (width..2 * width).collect()),
        ];
        let of_assets = apply(&mut graph, &head, halves);
        let last = graph.positions("last", &[1], &[2]);
        let outputs = graph.node("Squeeze", &[&of_assets, &last], &[]);
        let action = graph.head(&outputs, self.head);
        Ok(graph.acting(&action, self.n_assets))
    }

    fn own(&self, graph: &mut Graph, x: &Value) -> Value {
        let places = (0..self.n_assets).flat_map(|asset| self.blocks.iter().map(move |first| first + asset));
        let shape = [self.n_assets, self.blocks.len()];
        let places = graph.positions("own", &shape, &places.collect::<Vec<_>>());
        graph.node("Gather", &[x, &places], &[("axis", Setting::Int(1))])
    }

    fn beside_common(&self, graph: &mut Graph, means: &Value, x: &Value) -> Value {
        if self.common.is_empty() {
            return means.clone();
        }
        let places = graph.positions("common", &[1, self.common.len()], &self.common);
        let common = graph.node("Gather", &[x, &places], &[("axis", Setting::Int(1))]);
        graph.node("Concat", &[means, &common], &[("axis", Setting::Int(2))])
    }
}

/// Mean over the assets: `[batch, assets, n]` to `[batch, 1, n]`.
fn mean_over_assets(graph: &mut Graph, x: &Value) -> Value {
    let settings = [("axes", Setting::Ints(vec![1])), ("keepdims", Setting::Int(1))];
    graph.node("ReduceMean", &[x], &settings)
}

/// Reads the two layers of a network with `inputs` inputs.
fn two_layers(file: &TensorFile, name: &str, inputs: usize) -> Result<[Dense; 2], Error> {
    let layers = dense_layers(file, name).map_err(error)?;
    let n = layers.len();
    match <[Dense; 2]>::try_from(layers) {
        Ok(layers) if layers[0].shape[0] == inputs => Ok(layers),
        _ => Err(misfit(format!(
            "`{name}` has {n} layers, and not two that begin with {inputs} inputs"
        ))),
    }
}

/// Two layers with a leaky rectifier between them. Each input is multiplied with its own rows of the first
/// weight.
fn apply(graph: &mut Graph, [first, second]: &[Dense; 2], inputs: [(&Value, Vec<usize>); 2]) -> Value {
    let mut sum = bias(graph, first);
    for (x, rows) in inputs {
        let shape = [rows.len(), first.shape[1]];
        let weight = graph.constant(&format!("{}.weight", first.name), &shape, &first.rows(rows));
        let part = graph.node("MatMul", &[x, &weight], &[]);
        sum = graph.node("Add", &[&part, &sum], &[]);
    }
    let hidden = graph.activation(&sum, Activation::LeakyRelu);
    let weight = graph.constant(&format!("{}.weight", second.name), &second.shape, &second.weight);
    let product = graph.node("MatMul", &[&hidden, &weight], &[]);
    let bias = bias(graph, second);
    graph.node("Add", &[&product, &bias], &[])
}

fn bias(graph: &mut Graph, layer: &Dense) -> Value {
    graph.constant(&format!("{}.bias", layer.name), &[layer.shape[1]], &layer.bias)
}
