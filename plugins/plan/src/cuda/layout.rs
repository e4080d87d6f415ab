//! Places of values in a member's memory.

use super::is_of_state;
use crate::graph::{Graph, Shape, Value};
use crate::kernels::Kernel;
use crate::operations::Operation;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// Values begin at multiples of this number of entries, 128 bytes.
const ALIGNMENT: usize = 32;

/// A parameter or a moment.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Leaf {
    /// Name in a state.
    pub name: String,
    /// Rows and columns.
    pub shape: Shape,
    /// Whether it belongs to an optimiser and begins as zeros.
    pub is_moment: bool,
    /// Whether the routine changes it.
    pub is_changed: bool,
}

/// Entries of an input among all inputs of a routine, or of an output among all outputs.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Span {
    /// Name in the plan.
    pub name: String,
    /// First entry.
    pub first: usize,
    /// Number of entries.
    pub length: usize,
}

impl Span {
    /// Its entries among all.
    #[must_use]
    pub fn range(&self) -> std::ops::Range<usize> {
        self.first..self.first + self.length
    }
}

/// Entries of some spans one after the other.
#[must_use]
pub fn size(spans: &[Span]) -> usize {
    spans.last().map_or(0, |last| last.first + last.length)
}

/// Memory of a value or of a partial sum.
#[derive(Debug, Clone, Copy)]
enum Place {
    Tensor(usize),
    Inputs(usize),
    Outputs(usize),
    Values(usize),
    Constants(usize),
}

#[derive(Debug, Clone)]
pub(super) struct Layout {
    pub(super) tensors: Vec<Leaf>,
    pub(super) inputs: Vec<Span>,
    pub(super) outputs: Vec<Span>,
    pub(super) constants: Vec<f32>,
    pub(super) value_size: usize,
    /// Places of the graph's values, then those of partial sums.
    places: Vec<Option<Place>>,
}

impl Layout {
    pub(super) fn new(graph: &Graph, kernels: &[Kernel]) -> Self {
        let mut layout = Self {
            tensors: Vec::new(),
            inputs: Vec::new(),
            outputs: Vec::new(),
            constants: Vec::new(),
            value_size: 0,
            places: vec![None; graph.nodes.len()],
        };
        let used: BTreeSet<Value> = kernels
            .iter()
            .flat_map(|kernel| [kernel.operands(graph), kernel.results()].concat())
            .collect();
        let changed: BTreeSet<Value> = kernels
            .iter()
            .filter(|kernel| matches!(kernel, Kernel::Update(_)))
            .flat_map(Kernel::results)
            .collect();
        let of = |is_wanted: fn(&Graph, Value) -> bool| {
            let wanted = used.iter().copied().filter(move |value| is_wanted(graph, *value));
            wanted.collect::<Vec<Value>>()
        };
        for value in of(|graph, value| is_of_state(&graph.nodes[value.0].operation)) {
            layout.add_tensor(graph, value, changed.contains(&value));
        }
        for value in of(|graph, value| matches!(graph.nodes[value.0].operation, Operation::Constant(_))) {
            layout.add_constant(graph, value);
        }
        for value in of(|graph, value| graph.nodes[value.0].operation == Operation::Input) {
            let span = named(graph, value, size(&layout.inputs));
            layout.places[value.0] = Some(Place::Inputs(span.first));
            layout.inputs.push(span);
        }
        for value in of(|graph, value| graph.nodes[value.0].is_output) {
            let span = named(graph, value, size(&layout.outputs));
            layout.places[value.0] = Some(Place::Outputs(span.first));
            layout.outputs.push(span);
        }
        for value in of(|graph, value| graph.nodes[value.0].routine.is_some()) {
            if layout.places[value.0].is_none() {
                let [rows, columns] = graph.shape(value);
                layout.places[value.0] = Some(Place::Values(layout.reserve(rows * columns)));
            }
        }
        layout
    }

    /// Number of memories.
    pub(super) fn cells(&self) -> usize {
        self.places.len()
    }

    /// Reserves memory for a partial result of entries of `f32`, or of half as many of `f64`; returns its number.
    pub(super) fn add_partial(&mut self, length: usize) -> usize {
        let first = self.reserve(length);
        self.places.push(Some(Place::Values(first)));
        self.places.len() - 1
    }

    /// Address of a memory in a kernel.
    pub(super) fn address(&self, cell: usize) -> String {
        match self.places[cell] {
            Some(Place::Tensor(at)) => format!("(state + p.tensors[{at}])"),
            Some(Place::Inputs(first)) => format!("(inputs + {first})"),
            Some(Place::Outputs(first)) => format!("(outputs + {first})"),
            Some(Place::Values(first)) => format!("(values + {first})"),
            Some(Place::Constants(first)) => format!("(p.constants + {first})"),
            // Every value that a kernel reads or writes has a place.
            None => unreachable!("memory {cell} has no place"),
        }
    }

    fn reserve(&mut self, length: usize) -> usize {
        let first = self.value_size;
        self.value_size += length.next_multiple_of(ALIGNMENT);
        first
    }

    fn add_tensor(&mut self, graph: &Graph, value: Value, is_changed: bool) {
        let node = &graph.nodes[value.0];
        self.places[value.0] = Some(Place::Tensor(self.tensors.len()));
        self.tensors.push(Leaf {
            name: node.name.clone().unwrap_or_default(),
            shape: node.shape,
            is_moment: node.operation == Operation::State,
            is_changed,
        });
    }

    #[allow(clippy::cast_possible_truncation, reason = "constants are rounded to f32")]
    fn add_constant(&mut self, graph: &Graph, value: Value) {
        if let Operation::Constant(entries) = &graph.nodes[value.0].operation {
            self.places[value.0] = Some(Place::Constants(self.constants.len()));
            self.constants.extend(entries.iter().map(|entry| *entry as f32));
        }
    }
}

/// An input or an output that follows others.
fn named(graph: &Graph, value: Value, first: usize) -> Span {
    let node = &graph.nodes[value.0];
    Span {
        name: node.name.clone().unwrap_or_default(),
        first,
        length: node.shape[0] * node.shape[1],
    }
}
