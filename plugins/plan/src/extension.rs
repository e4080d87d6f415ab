//! Operations that other crates compute.

use crate::graph::{Graph, Shape, Value};
use crate::operations::Operation;
use std::fmt::Debug;
use std::sync::Arc;

/// Largest number of operands of an extension.
pub const MOST_OPERANDS: usize = 8;

/// An operation that another crate computes, in `f32`.
///
/// Its result must depend only on its operands, and not on the processor. An executor in `f64` converts operands to
/// `f32` and the result back.
pub trait Extension: Debug + Send + Sync {
    /// Name in a listing of the plan.
    fn name(&self) -> String;

    /// Shape of the result; `None` if operands of these shapes do not fit.
    fn shape(&self, operands: &[Shape]) -> Option<Shape>;

    /// Floating-point operations of one run.
    fn flops(&self, operands: &[Shape], result: Shape) -> u64;

    /// Computes the complete result, whose entries are arbitrary before. `memory` is for intermediate numbers, has
    /// arbitrary content, which any extension of the executor may have left, and may be resized.
    fn compute(&self, operands: &[&[f32]], result: &mut [f32], memory: &mut Vec<f32>);

    /// Whether the result has a gradient with respect to an operand. Other operands count as constants.
    fn passes(&self, operand: usize) -> bool {
        let _ = operand;
        true
    }

    /// Adds the operations that compute the gradient with respect to each needed operand; none for the others.
    fn gradients(&self, graph: &mut Graph, backward: &Backward<'_>) -> Vec<Option<Value>>;
}

/// Values from which the gradients with respect to the operands of an extension are computed.
#[derive(Debug, Clone, Copy)]
pub struct Backward<'a> {
    /// Operands.
    pub operands: &'a [Value],
    /// Result.
    pub result: Value,
    /// Gradient with respect to the result.
    pub upstream: Value,
    /// Whether the gradient with respect to each operand is needed.
    pub is_needed: &'a [bool],
}

/// An extension in a graph. It equals only its own copies.
#[derive(Debug, Clone)]
pub(crate) struct Shared(pub(crate) Arc<dyn Extension>);

impl PartialEq for Shared {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

impl Graph {
    /// Result of an extension.
    ///
    /// # Panics
    /// If the operands do not fit, are none, or are more than [`MOST_OPERANDS`].
    #[must_use]
    pub fn apply(&mut self, extension: impl Extension + 'static, operands: &[Value]) -> Value {
        let shapes: Vec<Shape> = operands.iter().map(|operand| self.shape(*operand)).collect();
        let shape = extension.shape(&shapes);
        let shape = shape.filter(|_| (1..=MOST_OPERANDS).contains(&operands.len()));
        let shape = shape.unwrap_or_else(|| {
            let shown: Vec<String> = operands.iter().map(|operand| self.shown(*operand)).collect();
            panic!("{} of {}", extension.name(), shown.join(", "))
        });
        let operation = Operation::Extension(Shared(Arc::new(extension)));
        self.compute(operation, operands.to_vec(), shape)
    }

    /// Gradients with respect to those operands of an extension that depend on a wanted value.
    pub(crate) fn through_extension(
        &mut self,
        extension: &Shared,
        operands: &[Value],
        [result, upstream]: [Value; 2],
        depends: &[bool],
    ) -> Vec<(Value, Value)> {
        let needed = operands.iter().enumerate();
        let is_needed: Vec<bool> = needed
            .map(|(at, operand)| depends[operand.0] && extension.0.passes(at))
            .collect();
        let backward = Backward {
            operands,
            result,
            upstream,
            is_needed: &is_needed,
        };
        let found = extension.0.gradients(self, &backward);
        let name = extension.0.name();
        assert_eq!(
            found.len(),
            operands.len(),
            "gradients of {name}, one per operand"
        );
        let mut parts = Vec::new();
        for ((gradient, operand), is_needed) in found.into_iter().zip(operands).zip(is_needed) {
            if is_needed {
                let gradient =
                    gradient.unwrap_or_else(|| panic!("{name} has no gradient in {}", self.shown(*operand)));
                let shapes = [gradient, *operand].map(|value| self.shape(value));
                assert_eq!(
                    shapes[0],
                    shapes[1],
                    "the gradient of {name} in {}",
                    self.shown(*operand)
                );
                parts.push((*operand, gradient));
            }
        }
        parts
    }
}
