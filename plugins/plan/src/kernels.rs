//! The kernels of a routine: its steps in order, with consecutive entrywise operations of one shape as one loop, and
//! the buffers that they need.

use crate::fusion::Loop;
use crate::graph::{Graph, Step, Value};
use crate::memory::Memory;
use crate::scalar::Scalar;
use crate::updates::Update;

#[derive(Debug, Clone)]
pub(crate) enum Kernel {
    Loop(Loop),
    /// An operation with a buffer of its own, which it shares with none of its operands.
    Single(Value),
    Update(Update),
}

impl Kernel {
    /// Values that it reads.
    pub(crate) fn operands(&self, graph: &Graph) -> Vec<Value> {
        match self {
            Kernel::Loop(entrywise) => entrywise.operands(graph),
            Kernel::Single(value) => graph.nodes[value.0].operands.clone(),
            Kernel::Update(update) => update.operands(),
        }
    }

    /// Values that it writes.
    pub(crate) fn results(&self) -> Vec<Value> {
        match self {
            Kernel::Loop(entrywise) => entrywise.kept().map(|(_, value)| value).collect(),
            Kernel::Single(value) => vec![*value],
            Kernel::Update(update) => [vec![update.target()], update.moments()].concat(),
        }
    }
}

/// Kernels of a routine, with buffers for their results.
pub(crate) fn compile<T: Scalar>(graph: &Graph, routine: usize, memory: &mut Memory<T>) -> Vec<Kernel> {
    let kernels = kernels(graph, routine);
    let readers = last_readers(graph, &kernels);
    memory.begin();
    for (at, kernel) in kernels.iter().enumerate() {
        let mut last = kernel.operands(graph);
        last.retain(|operand| readers[operand.0] == Some(at));
        if let Kernel::Single(value) = kernel {
            memory.provide(*value, graph.shape(*value));
        }
        last.iter().for_each(|operand| memory.release(*operand));
        // A loop reads a piece before it writes one, so results may replace operands of the same length; repeated
        // operands are shorter.
        if let Kernel::Loop(entrywise) = kernel {
            let kept = entrywise.kept();
            kept.for_each(|(_, value)| memory.provide(value, graph.shape(value)));
        }
    }
    kernels
}

/// Kernels of a routine.
pub(crate) fn kernels(graph: &Graph, routine: usize) -> Vec<Kernel> {
    let steps = graph.live_steps(routine);
    let (mut kernels, mut rest) = (Vec::new(), &steps[..]);
    while let Some((first, mut others)) = rest.split_first() {
        kernels.push(match first {
            Step::Compute(value) if graph.nodes[value.0].operation.is_elementwise() => {
                let entrywise = Loop::new(graph, *value, others);
                others = &others[entrywise.len() - 1..];
                Kernel::Loop(entrywise)
            }
            Step::Compute(value) => Kernel::Single(*value),
            Step::Update(update) => Kernel::Update(update.clone()),
        });
        rest = others;
    }
    let readers = last_readers(graph, &kernels);
    for kernel in &mut kernels {
        if let Kernel::Loop(entrywise) = kernel {
            entrywise.keep(|value| readers[value.0].is_some() || graph.nodes[value.0].is_output);
        }
    }
    kernels
}

/// The last kernel that reads each value.
fn last_readers(graph: &Graph, kernels: &[Kernel]) -> Vec<Option<usize>> {
    let mut readers = vec![None; graph.nodes.len()];
    for (at, kernel) in kernels.iter().enumerate() {
        for operand in kernel.operands(graph) {
            readers[operand.0] = Some(at);
        }
    }
    readers
}
