//! State that a plan keeps between runs, by its names, for checkpoints and export: parameters, moments and step counts.

use crate::graph::{Shape, Value};
use crate::operations::Operation;
use crate::processor::Processor;
use crate::scalar::Scalar;

/// A state that does not fit a graph.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum StateError {
    /// No parameter, moment or count has this name.
    Missing(String),
    /// A number of entries that is not that of the state's shape.
    Length {
        /// Name of the state.
        name: String,
        /// Shape in the graph.
        shape: Shape,
        /// Number of entries that was given.
        found: usize,
    },
}

impl std::fmt::Display for StateError {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        match self {
            StateError::Missing(name) => write!(f, "the plan has no state `{name}`"),
            StateError::Length { name, shape, found } => {
                write!(f, "{found} entries for the state `{name}` {shape:?}")
            }
        }
    }
}

impl std::error::Error for StateError {}

impl<T: Scalar> Processor<T> {
    /// Name, shape and entries of every parameter and moment, in the order in which they were made.
    pub fn states(&self) -> impl Iterator<Item = (&str, Shape, &[T])> {
        self.graph.nodes.iter().enumerate().filter_map(|(at, node)| {
            let is_state = matches!(node.operation, Operation::Parameter | Operation::State);
            let name = node.name.as_deref().filter(|_| is_state)?;
            Some((name, node.shape, self.memory.of(Value(at))))
        })
    }

    /// Replaces the entries of a parameter or moment.
    ///
    /// # Errors
    /// [`StateError`] where the name or the number of entries does not fit.
    pub fn restore(&mut self, name: &str, entries: &[T]) -> Result<(), StateError> {
        let value = self.graph.named(name).filter(|value| {
            let operation = &self.graph.nodes[value.0].operation;
            matches!(operation, Operation::Parameter | Operation::State)
        });
        let value = value.ok_or_else(|| StateError::Missing(name.to_owned()))?;
        if entries.len() != self.memory.of(value).len() {
            return Err(StateError::Length {
                name: name.to_owned(),
                shape: self.graph.shape(value),
                found: entries.len(),
            });
        }
        self.entries_mut(value).copy_from_slice(entries);
        Ok(())
    }

    /// Name and number of the steps of every optimiser.
    pub fn counts(&self) -> impl Iterator<Item = (&str, u64)> {
        let names = self.graph.counts.iter().map(String::as_str);
        names.zip(self.counts.iter().copied())
    }

    /// Replaces a number of steps.
    ///
    /// # Errors
    /// [`StateError::Missing`] where no optimiser has the name.
    pub fn restore_count(&mut self, name: &str, count: u64) -> Result<(), StateError> {
        let at = self.graph.counts.iter().position(|other| other == name);
        let at = at.ok_or_else(|| StateError::Missing(name.to_owned()))?;
        self.counts[at] = count;
        Ok(())
    }
}
