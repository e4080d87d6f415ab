//! Parts of a state that a routine reads or changes.

use crate::graph::{Graph, Shape, Step, Value};
use crate::operations::Operation;
use std::collections::BTreeSet;

/// A part of a state that a routine reads or changes.
#[derive(Debug, Clone)]
pub(crate) struct Bound {
    pub(crate) value: Value,
    pub(crate) name: String,
    pub(crate) shape: Shape,
    pub(crate) is_moment: bool,
    /// Place in the state of the last run.
    pub(crate) place: usize,
}

/// Parts of a state that the steps of a routine use.
pub(crate) fn bound(graph: &Graph, routine: usize) -> Vec<Bound> {
    let mut used = BTreeSet::new();
    for step in graph.live_steps(routine) {
        match step {
            Step::Compute(value) => used.extend(&graph.nodes[value.0].operands),
            Step::Update(update) => {
                used.extend([update.operands(), update.moments()].concat());
            }
        }
    }
    let of = |value: &Value| {
        let node = &graph.nodes[value.0];
        let is_moment = node.operation == Operation::State;
        (is_moment || node.operation == Operation::Parameter).then(|| Bound {
            value: *value,
            name: node.name.clone().unwrap_or_default(),
            shape: node.shape,
            is_moment,
            place: usize::MAX,
        })
    };
    used.iter().filter_map(of).collect()
}
