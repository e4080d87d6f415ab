//! Parameters of any `burn` module as plain numbers on the host: to read, to replace, to average.

use crate::tensor_file::{HostTensor, TensorFile, TensorFileError};
use burn::module::{Module, ModuleMapper, ModuleVisitor, Param};
use burn::tensor::{Tensor, TensorData};

/// One parameter tensor of a module.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// Path inside the module, for example `layers.0.weight`.
    pub name: String,
    /// Length of each dimension.
    pub shape: Vec<usize>,
    /// Entries, the last dimension running fastest.
    pub values: Vec<f32>,
}

/// All parameters of a module, in the order of its fields.
pub fn parameters<M: Module>(module: &M) -> Vec<Parameter> {
    let mut reader = ParameterReader::default();
    module.visit(&mut reader);
    reader.found
}

/// Module with other numbers in its parameters.
///
/// # Errors
/// [`TensorFileError::Shape`] where the parameters do not fit the module one by one.
pub fn with_parameters<M: Module>(module: M, replacement: &[Parameter]) -> Result<M, TensorFileError> {
    let present = parameters(&module);
    let found: Vec<_> = replacement.iter().map(|p| (&p.name, &p.shape)).collect();
    let expected: Vec<_> = present.iter().map(|p| (&p.name, &p.shape)).collect();
    if found != expected {
        return Err(TensorFileError::Shape {
            expected: format!("{expected:?}"),
            found: format!("{found:?}"),
        });
    }
    let mut next = replacement.iter();
    Ok(map_values(module, &mut |values| {
        // There is one replacement per parameter, checked above.
        values.copy_from_slice(&next.next().expect("as many replacements as parameters").values);
    }))
}

/// Moves a Polyak average `target <- (1 - tau) target + tau source`, for modules of one shape.
pub fn soft_update<M: Module>(target: M, source: &M, tau: f64) -> M {
    let source = parameters(source);
    let mut next = source.iter();
    #[allow(clippy::cast_possible_truncation, reason = "parameters are f32")]
    let tau = tau as f32;
    map_values(target, &mut |values| {
        // Target and source are modules of one shape.
        let source = &next.next().expect("target and source of one shape").values;
        values
            .iter_mut()
            .zip(source)
            .for_each(|(t, s)| *t += tau * (s - *t));
    })
}

/// Stores all parameters under `prefix` in a file.
pub fn store<M: Module>(module: &M, prefix: &str, file: &mut TensorFile) {
    for Parameter { name, shape, values } in parameters(module) {
        file.insert(format!("{prefix}.{name}"), HostTensor { shape, values });
    }
}

/// Module with the parameters that [`store`] wrote under `prefix`.
///
/// # Errors
/// [`TensorFileError`] where a parameter is missing or has another shape.
pub fn restore<M: Module>(module: M, prefix: &str, file: &TensorFile) -> Result<M, TensorFileError> {
    let mut numbers = parameters(&module);
    for parameter in &mut numbers {
        let stored = file.get(&format!("{prefix}.{}", parameter.name))?;
        (parameter.shape, parameter.values) = (stored.shape.clone(), stored.values.clone());
    }
    with_parameters(module, &numbers)
}

/// Module after `change` was applied to the numbers of each parameter, in the order of its fields.
pub fn map_values<M: Module>(module: M, change: &mut dyn FnMut(&mut [f32])) -> M {
    module.map(&mut ParameterWriter { change })
}

#[derive(Default)]
struct ParameterReader {
    path: Vec<String>,
    found: Vec<Parameter>,
}

impl ModuleVisitor for ParameterReader {
    fn enter_module(&mut self, name: &str, _: &str) {
        self.path.push(name.into());
    }

    fn exit_module(&mut self, _: &str, _: &str) {
        self.path.pop();
    }

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let (shape, values) = (param.dims().to_vec(), crate::network::values(param.val()));
        self.found.push(Parameter {
            name: self.path.join("."),
            shape,
            values,
        });
    }
}

struct ParameterWriter<'a> {
    change: &'a mut dyn FnMut(&mut [f32]),
}

impl ModuleMapper for ParameterWriter<'_> {
    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        param.map(|tensor| {
            let (shape, device, trained) = (tensor.dims(), tensor.device(), tensor.is_require_grad());
            let mut values = crate::network::values(tensor);
            (self.change)(&mut values);
            let tensor = Tensor::from_data(TensorData::new(values, shape), &device);
            if trained { tensor.require_grad() } else { tensor }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::{Activation, Mlp, device};
    use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};

    fn network(seed: u64) -> Mlp {
        Mlp::new(
            &[2, 3, 1],
            &[Activation::Relu],
            1.0,
            &mut ChaCha8Rng::seed_from_u64(seed),
            &device().autodiff(),
        )
    }

    #[test]
    fn names_are_paths() {
        let names: Vec<_> = parameters(&network(1)).into_iter().map(|p| p.name).collect();
        assert_eq!(
            names,
            [
                "layers.0.weight",
                "layers.0.bias",
                "layers.1.weight",
                "layers.1.bias"
            ]
        );
    }

    #[test]
    fn the_average_moves_by_tau() {
        let (target, source) = (network(1).valid(), network(2));
        let (before, goal) = (parameters(&target), parameters(&source));
        let after = parameters(&soft_update(target, &source.valid(), 0.25));
        let expected = 0.75 * before[0].values[4] + 0.25 * goal[0].values[4];
        assert!((after[0].values[4] - expected).abs() < 1e-6);
    }

    #[test]
    fn stored_parameters_come_back_bit_by_bit_and_stay_trainable() {
        let mut file = TensorFile::default();
        store(&network(1), "policy", &mut file);
        let restored = restore(network(2), "policy", &file).unwrap();
        assert_eq!(parameters(&restored), parameters(&network(1)));
        let gradients = restored
            .forward(crate::network::matrix(vec![1.0, 2.0], 2))
            .sum()
            .backward();
        assert!(!crate::optimizer::gradients(&restored, &mut { gradients })[3].is_empty());
        assert!(restore(network(2), "critic", &file).is_err());
    }
}
