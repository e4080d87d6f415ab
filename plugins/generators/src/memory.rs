//! State of networks beside their parameters, such as singular vectors and running statistics: it is stored,
//! restored, and passed from a copy that made a forward pass to the original.

use burn::module::Module;
use numerics::parameters;
use numerics::tensor_file::{TensorFile, TensorFileError};

/// A layer or network with plain numbers beside its parameters.
pub trait StatefulModule {
    /// All vectors of the state, in an order that depends on the shape of the network only.
    fn state_vectors(&mut self) -> Vec<&mut Vec<f32>>;

    /// Replaces the state by that of a copy with the same shape.
    fn adopt(&mut self, mut copy: Self)
    where
        Self: Sized,
    {
        let pairs = self.state_vectors().into_iter().zip(copy.state_vectors());
        pairs.for_each(|(own, other)| std::mem::swap(own, other));
    }
}

/// Writes parameters and state under `prefix` into a file.
pub fn store<M: Module + StatefulModule>(network: &M, prefix: &str, file: &mut TensorFile) {
    parameters::store(network, prefix, file);
    for (at, numbers) in network.clone().state_vectors().into_iter().enumerate() {
        file.insert_vector(format!("{prefix}.remembered.{at}"), std::mem::take(numbers));
    }
}

/// The network with the parameters and state of [`store`] under `prefix`.
///
/// # Errors
/// [`TensorFileError`] where a tensor is missing or has another shape.
pub fn restore<M: Module + StatefulModule>(
    network: M,
    prefix: &str,
    file: &TensorFile,
) -> Result<M, TensorFileError> {
    let mut network = parameters::restore(network, prefix, file)?;
    for (at, numbers) in network.state_vectors().into_iter().enumerate() {
        let name = format!("{prefix}.remembered.{at}");
        let stored = &file.get(&name)?.values;
        if stored.len() != numbers.len() {
            return Err(TensorFileError::Shape {
                expected: format!("`{name}` of {}", numbers.len()),
                found: stored.len().to_string(),
            });
        }
        numbers.clone_from(stored);
    }
    Ok(network)
}
