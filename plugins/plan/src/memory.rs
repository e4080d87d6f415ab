//! Buffers of values. Leaves and outputs have their own. Other values share those of the same length whose values are
//! no longer read, so that a routine uses as little of the cache as possible.

use crate::graph::{Graph, Shape, Value};
use crate::operations::Operation;
use crate::scalar::Scalar;
use crate::tensor::Tensor;

#[derive(Debug, Clone)]
pub(crate) struct Memory<T> {
    buffers: Vec<Vec<T>>,
    /// Place of each value's buffer; a value without one has a place beyond the end.
    places: Vec<usize>,
    /// Places of buffers that no longer hold a value; the one that was read last is at the end.
    free: Vec<usize>,
    /// Places of buffers that may be shared.
    shared: Vec<usize>,
}

impl<T: Scalar> Memory<T> {
    /// Memory for inputs and outputs, with the entries of constants.
    pub(crate) fn new(graph: &Graph) -> Self {
        let mut memory = Self {
            buffers: Vec::new(),
            places: vec![usize::MAX; graph.nodes.len()],
            free: Vec::new(),
            shared: Vec::new(),
        };
        for (node, place) in graph.nodes.iter().zip(&mut memory.places) {
            let n = node.shape[0] * node.shape[1];
            let entries = match &node.operation {
                Operation::Constant(entries) => entries.iter().map(|entry| T::of(*entry)).collect(),
                // The entries of a state are in the state itself.
                Operation::Parameter | Operation::State => Vec::new(),
                _ if node.routine.is_none() || node.is_output => vec![T::default(); n],
                _ => continue,
            };
            *place = memory.buffers.len();
            memory.buffers.push(entries);
        }
        memory
    }

    /// Begins a routine, whose values may use all shared buffers.
    pub(crate) fn begin(&mut self) {
        self.free.clone_from(&self.shared);
    }

    /// Gives a value a buffer, if it has none of its own.
    pub(crate) fn provide(&mut self, value: Value, [rows, columns]: Shape) {
        let n = rows * columns;
        if self.places[value.0] != usize::MAX {
            return;
        }
        let fitting = self
            .free
            .iter()
            .rposition(|place| self.buffers[*place].len() == n);
        self.places[value.0] = fitting.map_or_else(
            || {
                self.buffers.push(vec![T::default(); n]);
                self.shared.push(self.buffers.len() - 1);
                self.buffers.len() - 1
            },
            |at| self.free.remove(at),
        );
    }

    /// Frees the buffer of a value that is no longer read, if it is shared.
    pub(crate) fn release(&mut self, value: Value) {
        let place = self.places[value.0];
        if self.shared.contains(&place) && !self.free.contains(&place) {
            self.free.push(place);
        }
    }

    /// Whether two values have the same buffer.
    pub(crate) fn is_same(&self, values: [Value; 2]) -> bool {
        let [one, other] = values.map(|value| self.places[value.0]);
        one == other
    }

    pub(crate) fn of(&self, value: Value) -> &[T] {
        &self.buffers[self.places[value.0]]
    }

    pub(crate) fn of_mut(&mut self, value: Value) -> &mut [T] {
        &mut self.buffers[self.places[value.0]]
    }

    /// Takes the buffer of a value out, so that it can change while others are read; [`Memory::put`] returns it.
    pub(crate) fn take(&mut self, value: Value) -> Vec<T> {
        std::mem::take(&mut self.buffers[self.places[value.0]])
    }

    pub(crate) fn put(&mut self, value: Value, buffer: Vec<T>) {
        self.buffers[self.places[value.0]] = buffer;
    }

    /// Exchanges a value's entries with those of a tensor of a state.
    pub(crate) fn exchange(&mut self, value: Value, tensor: &mut Tensor<T>) {
        std::mem::swap(&mut self.buffers[self.places[value.0]], tensor.buffer());
    }

    #[cfg(test)]
    pub(crate) fn capacities(&self) -> Vec<usize> {
        self.buffers.iter().map(Vec::capacity).collect()
    }
}
