//! Policies of agents with opponent models as graphs, one per seat. A graph contains the opponent models
//! where the policy is conditioned on their predictions.
//!
//! A seat acts by `tanh mu` of its policy. The input of the policy tells the algorithm: the seat's own
//! observation alone, or beside it the actions `tanh mu` that its opponent models predict from the same
//! observation.

use crate::shared::policy_forms::{error, header, misfit, portable as policy_of, tensors};
use contract::{Error, policy_form::PortablePolicy};
use numerics::{
    activation::Activation,
    onnx::{Graph, Setting, Value, dense_layers, with_first_outputs},
    policy_file::Head,
    tensor_file::TensorFile,
};
use serde::Deserialize;
use std::path::Path;

/// Header of the policy file, as far as acting needs it.
#[derive(Debug, Clone, PartialEq, Deserialize)]
struct Header {
    seats: Vec<Seat>,
    activation: Activation,
    input_normalisation: bool,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
struct Seat {
    name: String,
    inputs: Vec<String>,
    outputs: Vec<String>,
    policy_sizes: Vec<usize>,
}

/// Graphs of the policies of all seats; `None` where the file in `dir` is of another form.
///
/// # Errors
/// [`Error::File`] or [`Error::Checkpoint`] where the file is missing or damaged.
pub(crate) fn portable(dir: &Path) -> Result<Option<Vec<PortablePolicy>>, Error> {
    let file = tensors(dir)?;
    if file.header.get("seats").is_none() {
        return Ok(None);
    }
    let game = Game {
        header: header(&file.header)?,
        file,
    };
    let seats = game.header.seats.iter().enumerate();
    seats
        .map(|(at, seat)| game.policy(at, seat))
        .collect::<Result<_, _>>()
        .map(Some)
}

struct Game {
    header: Header,
    file: TensorFile,
}

impl Game {
    fn policy(&self, at: usize, seat: &Seat) -> Result<PortablePolicy, Error> {
        let n_seen = seat.inputs.len();
        let (mut graph, observation) = Graph::of_observation(n_seen);
        let mut seen = (observation, n_seen);
        if seat.policy_sizes.first() != Some(&n_seen) {
            seen = self.beside_predictions(&mut graph, at, &seen)?;
        }
        let (action, n) = self.mean_action(&mut graph, &format!("seat_{at}.policy"), &seen)?;
        if n != seat.outputs.len() {
            let named = seat.outputs.len();
            return Err(misfit(format!(
                "seat `{}` acts with {n} entries and names {named}",
                seat.name
            )));
        }
        let (name, inputs, outputs) = (seat.name.clone(), seat.inputs.clone(), seat.outputs.clone());
        Ok(policy_of(
            name,
            inputs,
            outputs,
            Head::Tanh,
            graph.acting(&action, n),
        ))
    }

    /// The observation, followed by the predictions of all opponent models.
    fn beside_predictions(&self, graph: &mut Graph, at: usize, x: &Columns) -> Result<Columns, Error> {
        let mut all = vec![x.clone()];
        for other in 1..self.header.seats.len() {
            let name = format!("seat_{at}.opponent_{}", other - 1);
            all.push(self.mean_action(graph, &name, x)?);
        }
        let parts: Vec<&Value> = all.iter().map(|(value, _)| value).collect();
        let joined = graph.node("Concat", &parts, &[("axis", Setting::Int(1))]);
        Ok((joined, all.iter().map(|(_, n)| n).sum()))
    }

    /// `tanh mu` of the Gaussian stored under `name`.
    fn mean_action(&self, graph: &mut Graph, name: &str, x: &Columns) -> Result<Columns, Error> {
        let layers = dense_layers(&self.file, &format!("{name}.mlp")).map_err(error)?;
        let (n_seen, n_heads) = match (layers.first(), layers.last()) {
            (Some(first), Some(last)) => (first.shape[0], last.shape[1]),
            _ => return Err(misfit(format!("`{name}` has no layers"))),
        };
        if n_seen != x.1 {
            return Err(misfit(format!(
                "`{name}` sees {n_seen} entries, and there are {}",
                x.1
            )));
        }
        let activations = vec![self.header.activation; layers.len() - 1];
        let mut x = x.0.clone();
        if self.header.input_normalisation {
            x = graph.normalised_by_moments(&x, &self.file, name).map_err(error)?;
        }
        let mean = graph.network(&x, &with_first_outputs(layers, n_heads / 2), &activations);
        Ok((graph.head(&mean, Head::Tanh), n_heads / 2))
    }
}

/// A value `[batch, n]` in the graph, and `n`.
type Columns = (Value, usize);
