//! What networks remember beside their parameters, such as singular vectors and running statistics: to store
//! it, to restore it, and to hand it from a copy that made a pass to the original.

use burn::module::Module;
use numerics::parameters;
use numerics::tensor_file::{TensorFile, TensorFileError};

/// A layer or network with plain numbers beside its parameters.
pub trait Remembering {
    /// All of them, in an order that the shape of the network alone decides.
    fn remembered(&mut self) -> Vec<&mut Vec<f32>>;

    /// Takes what a copy of the same shape remembers in the place of its own.
    fn adopt(&mut self, mut copy: Self)
    where
        Self: Sized,
    {
        let pairs = self.remembered().into_iter().zip(copy.remembered());
        pairs.for_each(|(own, other)| std::mem::swap(own, other));
    }
}

/// Puts parameters and memory under `prefix` into a file.
pub fn store<M: Module + Remembering>(network: &M, prefix: &str, file: &mut TensorFile) {
    parameters::store(network, prefix, file);
    for (at, numbers) in network.clone().remembered().into_iter().enumerate() {
        file.insert_vector(format!("{prefix}.remembered.{at}"), std::mem::take(numbers));
    }
}

/// The network with what [`store`] put under `prefix`.
///
/// # Errors
/// [`TensorFileError`] where something is missing or has another shape.
pub fn restore<M: Module + Remembering>(
    network: M,
    prefix: &str,
    file: &TensorFile,
) -> Result<M, TensorFileError> {
    let mut network = parameters::restore(network, prefix, file)?;
    for (at, numbers) in network.remembered().into_iter().enumerate() {
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
