//! The state of a plan in a file of tensors: every parameter and moment as `state.NAME`, and the steps of the
//! optimisers in the header.

use super::network::Network;
use crate::tensor_file::{HostTensor, TensorFile, TensorFileError};
use plan::State;
use serde_json::json;

const PREFIX: &str = "state.";
const COUNTS: &str = "optimiser_steps";

/// Stores the whole state.
pub fn store(state: &State<f32>, file: &mut TensorFile) {
    for (name, shape, entries) in state.tensors() {
        let tensor = HostTensor {
            shape: shape.to_vec(),
            values: entries.to_vec(),
        };
        file.insert(format!("{PREFIX}{name}"), tensor);
    }
    file.header[COUNTS] = json!(state.counts());
}

/// Restores the state that [`store`] wrote. Moments that `state` does not have yet are added.
///
/// # Errors
/// [`TensorFileError`] where a parameter is missing or has another shape.
pub fn restore(state: &mut State<f32>, file: &TensorFile) -> Result<(), TensorFileError> {
    let counts = serde_json::from_value(file.header[COUNTS].clone());
    let counts: std::collections::BTreeMap<String, u64> =
        counts.map_err(|_| TensorFileError::Missing { name: COUNTS.into() })?;
    let names: Vec<_> = state
        .tensors()
        .map(|(name, shape, _)| (name.to_owned(), shape))
        .collect();
    for (name, shape) in &names {
        let stored = file.get(&format!("{PREFIX}{name}"))?;
        insert(state, name, *shape, stored)?;
    }
    for parameter in counts.keys() {
        let shape = state.tensor(parameter).map(|(shape, _)| shape);
        let shape = shape.ok_or_else(|| TensorFileError::Missing {
            name: parameter.clone(),
        })?;
        for moment in ["first", "second"] {
            let name = format!("{parameter}.{moment}");
            insert(state, &name, shape, file.get(&format!("{PREFIX}{name}"))?)?;
        }
    }
    state.set_counts(counts);
    Ok(())
}

/// Restores the parameters of a network from the tensors `PREFIX.layers.k.weight` and `.bias` of a policy file; its
/// optimiser stays as it is.
///
/// # Errors
/// [`TensorFileError`] where a parameter is missing or has another shape.
pub fn restore_network(
    network: &Network,
    prefix: &str,
    state: &mut State<f32>,
    file: &TensorFile,
) -> Result<(), TensorFileError> {
    for name in network.parameter_names() {
        let own = state.tensor(&name).map(|(shape, _)| shape);
        let shape = own.ok_or_else(|| TensorFileError::Missing { name: name.clone() })?;
        let rest = name.strip_prefix(network.name()).unwrap_or_default();
        insert(state, &name, shape, file.get(&format!("{prefix}{rest}"))?)?;
    }
    Ok(())
}

/// Stores the parameters of a network as `PREFIX.layers.k.weight` and `.bias`, biases as vectors.
///
/// # Panics
/// Where the state lacks a parameter.
pub fn store_network(network: &Network, prefix: &str, state: &State<f32>, file: &mut TensorFile) {
    for (at, name) in network.parameter_names().into_iter().enumerate() {
        let shape = state.tensor(&name).map_or([0, 0], |(shape, _)| shape);
        let is_bias = at % 2 == 1;
        let tensor = HostTensor {
            shape: if is_bias { vec![shape[1]] } else { shape.to_vec() },
            values: state.entries(&name).to_vec(),
        };
        let rest = name.strip_prefix(network.name()).unwrap_or_default();
        file.insert(format!("{prefix}{rest}"), tensor);
    }
}

/// Stores a parameter of one row as a vector, under its name.
///
/// # Panics
/// Where the state lacks it.
pub fn store_vector(name: &str, state: &State<f32>, file: &mut TensorFile) {
    file.insert_vector(name, state.entries(name).to_vec());
}

/// Restores a parameter of one row with `n` entries from the tensor of its name.
///
/// # Errors
/// [`TensorFileError`] where the tensor is missing or has another shape.
pub fn restore_vector(
    name: &str,
    n: usize,
    state: &mut State<f32>,
    file: &TensorFile,
) -> Result<(), TensorFileError> {
    insert(state, name, [1, n], file.get(name)?)
}

/// Takes over a stored tensor; a vector counts as a matrix of one row.
fn insert(
    state: &mut State<f32>,
    name: &str,
    shape: [usize; 2],
    stored: &HostTensor,
) -> Result<(), TensorFileError> {
    let fits = stored.shape == shape || shape[0] == 1 && stored.shape == [shape[1]];
    if !fits {
        return Err(TensorFileError::Shape {
            expected: format!("`{name}` of {shape:?}"),
            found: format!("{:?}", stored.shape),
        });
    }
    state.insert(name, shape, stored.values.clone());
    Ok(())
}
