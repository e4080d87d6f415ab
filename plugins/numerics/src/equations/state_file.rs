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

/// Restores the state that [`store`] wrote, and replaces the optimisers of `state` by its own.
///
/// # Errors
/// [`TensorFileError`] if a parameter is missing or has another shape; the state is then unchanged.
pub fn restore(state: &mut State<f32>, file: &TensorFile) -> Result<(), TensorFileError> {
    let counts = serde_json::from_value(file.header[COUNTS].clone());
    let counts: std::collections::BTreeMap<String, u64> =
        counts.map_err(|_| TensorFileError::Missing { name: COUNTS.into() })?;
    let mut restored = state.clone();
    restored.forget_optimisers();
    let names: Vec<_> = restored
        .tensors()
        .map(|(name, shape, _)| (name.to_owned(), shape))
        .collect();
    for (name, shape) in &names {
        let stored = file.get(&format!("{PREFIX}{name}"))?;
        insert(&mut restored, name, *shape, stored)?;
    }
    for parameter in counts.keys() {
        let shape = restored.tensor(parameter).map(|(shape, _)| shape);
        let shape = shape.ok_or_else(|| TensorFileError::Missing {
            name: parameter.clone(),
        })?;
        for moment in ["first", "second"] {
            let name = format!("{parameter}.{moment}");
            let stored = file.get(&format!("{PREFIX}{name}"))?;
            insert(&mut restored, &name, shape, stored)?;
        }
    }
    restored.set_counts(counts);
    *state = restored;
    Ok(())
}

/// Restores the parameters of a network from the tensors `PREFIX.layers.k.weight` and `.bias` of a policy file; its
/// optimiser is not changed.
///
/// # Errors
/// [`TensorFileError`] if a parameter is missing or has another shape; the state is then unchanged.
pub fn restore_network(
    network: &Network,
    prefix: &str,
    state: &mut State<f32>,
    file: &TensorFile,
) -> Result<(), TensorFileError> {
    let mut restored = state.clone();
    for name in network.parameter_names() {
        let own = state.tensor(&name).map(|(shape, _)| shape);
        let shape = own.ok_or_else(|| TensorFileError::Missing { name: name.clone() })?;
        let rest = name.strip_prefix(network.name()).unwrap_or_default();
        insert(&mut restored, &name, shape, file.get(&format!("{prefix}{rest}"))?)?;
    }
    *state = restored;
    Ok(())
}

/// Stores the parameters of a network as `PREFIX.layers.k.weight` and `.bias`, biases as vectors.
///
/// # Panics
/// If the state lacks a parameter.
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
/// If the state lacks it.
pub fn store_vector(name: &str, state: &State<f32>, file: &mut TensorFile) {
    file.insert_vector(name, state.entries(name).to_vec());
}

/// Restores a parameter of one row with `n` entries from the tensor of its name.
///
/// # Errors
/// [`TensorFileError`] if the tensor is missing or has another shape.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::activation::Activation;
    use plan::{Descent, Equations, Processor};
    use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};

    fn network() -> Network {
        Network::new("policy", &[2, 3, 1], &[Activation::Tanh])
    }

    fn state(seed: u64) -> State<f32> {
        let mut state = State::default();
        network().initialise(1.0, &mut state, &mut ChaCha8Rng::seed_from_u64(seed));
        state
    }

    /// Takes steps of Adam against the sum of squares of the outputs.
    fn train(state: &mut State<f32>, n_steps: usize) {
        let equations = Equations::new();
        let x = equations.constant([2, 2], &[0.5, -1.0, 2.0, 0.1]);
        equations.routine("update");
        let loss = network().apply(x).square().mean();
        let descent = Descent::adam("rate", 0.01, None);
        equations.descend(loss, &network().parameters(&equations), &descent);
        let mut processor = Processor::<f32>::new(equations.into_graph());
        (0..n_steps).for_each(|_| processor.run("update", state));
    }

    fn stored(state: &State<f32>) -> TensorFile {
        let mut file = TensorFile::default();
        store(state, &mut file);
        file
    }

    #[test]
    fn a_restored_state_continues_to_the_same_bits() {
        let mut one = state(1);
        train(&mut one, 5);
        // A state that has learned longer, one that has not learned, and back before the first step.
        for n_steps in [0, 9] {
            let mut other = state(2);
            train(&mut other, n_steps);
            restore(&mut other, &stored(&one)).unwrap();
            let mut expected = one.clone();
            train(&mut expected, 3);
            train(&mut other, 3);
            assert_eq!(stored(&other), stored(&expected));
        }
        let first = stored(&state(1));
        restore(&mut one, &first).unwrap();
        assert_eq!(stored(&one), first);
    }

    #[test]
    fn a_file_that_does_not_fit_changes_nothing() {
        let mut own = state(1);
        train(&mut own, 2);
        let before = stored(&own);
        let mut file = stored(&state(2));
        let wide = HostTensor {
            shape: vec![1, 2],
            values: vec![0.0; 2],
        };
        file.insert("state.policy.layers.1.bias", wide.clone());
        assert!(restore(&mut own, &file).is_err());
        let mut policy = TensorFile::default();
        store_network(&network(), "policy", &state(2), &mut policy);
        policy.insert("policy.layers.1.bias", wide);
        assert!(restore_network(&network(), "policy", &mut own, &policy).is_err());
        assert_eq!(stored(&own), before);
    }
}
