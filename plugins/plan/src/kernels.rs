//! The kernels of a routine: its steps in order, with consecutive entrywise operations of one shape as one loop, and
//! the buffers that they need.

use crate::fusion::{Entrywise, Loop, Source};
use crate::graph::{Graph, Step, Value};
use crate::memory::Memory;
use crate::operations::{Function, Operation, Pair};
use crate::scalar::Scalar;
use crate::updates::Update;
use arithmetic::tiles::is_written_once;

#[derive(Debug, Clone)]
pub(crate) enum Kernel {
    Loop(Loop),
    /// An operation with a buffer of its own, which it shares with none of its operands.
    Single(Value),
    /// A product whose only reader multiplies it with the slope of a rectifier.
    Gated(Gated),
    Update(Update),
}

/// A product, each entry multiplied by the slope of a rectifier.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Gated {
    pub(crate) product: Value,
    /// Results of the rectifier.
    pub(crate) of: Value,
    /// Slope of the rectifier at 0 and below.
    pub(crate) below: f64,
    pub(crate) result: Value,
}

impl Gated {
    /// Whether the result may have the buffer of the gates, if nothing else reads them.
    fn can_replace_gates(&self, graph: &Graph) -> bool {
        let node = &graph.nodes[self.product.0];
        let n_terms = node.operation.n_terms(graph.shape(node.operands[0]));
        !node.operands.contains(&self.of) && is_written_once(n_terms, node.shape[1])
    }
}

impl Kernel {
    /// Values that it reads.
    pub(crate) fn operands(&self, graph: &Graph) -> Vec<Value> {
        match self {
            Kernel::Loop(entrywise) => entrywise.operands(graph),
            Kernel::Single(value) => graph.nodes[value.0].operands.clone(),
            Kernel::Gated(gated) => [&graph.nodes[gated.product.0].operands[..], &[gated.of]].concat(),
            Kernel::Update(update) => update.operands(),
        }
    }

    /// Values that it writes.
    pub(crate) fn results(&self) -> Vec<Value> {
        match self {
            Kernel::Loop(entrywise) => entrywise.kept().map(|(_, value)| value).collect(),
            Kernel::Single(value) => vec![*value],
            Kernel::Gated(gated) => vec![gated.result],
            Kernel::Update(update) => [vec![update.target()], update.moments()].concat(),
        }
    }
}

/// Kernels of a routine, with buffers for their results.
pub(crate) fn compile<T: Scalar>(graph: &Graph, routine: usize, memory: &mut Memory<T>) -> Vec<Kernel> {
    let kernels = with_gates(graph, kernels(graph, routine));
    let readers = last_readers(graph, &kernels);
    memory.begin();
    for (at, kernel) in kernels.iter().enumerate() {
        let mut last = kernel.operands(graph);
        last.retain(|operand| readers[operand.0] == Some(at));
        if let Kernel::Gated(gated) = kernel
            && gated.can_replace_gates(graph)
            && let Some(place) = last.iter().position(|operand| *operand == gated.of)
        {
            memory.release(last.swap_remove(place));
        }
        if let Kernel::Single(result) | Kernel::Gated(Gated { result, .. }) = kernel {
            memory.provide(*result, graph.shape(*result));
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

/// Kernels in which a product and the loop that multiplies it with the slope of a rectifier are one.
fn with_gates(graph: &Graph, kernels: Vec<Kernel>) -> Vec<Kernel> {
    let mut gates = vec![None; graph.nodes.len()];
    let mut counts = vec![0; graph.nodes.len()];
    for kernel in &kernels {
        kernel
            .operands(graph)
            .iter()
            .for_each(|operand| counts[operand.0] += 1);
        if let Some(gated) = gate(graph, kernel) {
            gates[gated.product.0] = Some(gated);
        }
    }
    let is_joined = |gated: &Gated| counts[gated.product.0] == 1 && !graph.nodes[gated.product.0].is_output;
    let joined = |kernel: Kernel| match kernel {
        Kernel::Single(product) => Some(match gates[product.0].filter(is_joined) {
            Some(gated) => Kernel::Gated(gated),
            None => kernel,
        }),
        Kernel::Loop(_) if gate(graph, &kernel).is_some_and(|gated| is_joined(&gated)) => None,
        _ => Some(kernel),
    };
    kernels.into_iter().filter_map(joined).collect()
}

/// A loop that only multiplies a product with the slope of a rectifier, whose result is computed before the product.
fn gate(graph: &Graph, kernel: &Kernel) -> Option<Gated> {
    let Kernel::Loop(entrywise) = kernel else {
        return None;
    };
    let [
        Entrywise::Map(Function::RectifierSlope(below), Source::Whole(of)),
        Entrywise::Combine(Pair::Multiply, Source::Whole(product), Source::Result(0)),
    ] = *entrywise.operations()
    else {
        return None;
    };
    let mut kept = entrywise.kept();
    let (Some((1, result)), None) = (kept.next(), kept.next()) else {
        return None;
    };
    let is_product = matches!(graph.nodes[product.0].operation, Operation::Product { .. });
    let is_computed = graph.nodes[of.0].routine.is_some() && of < product;
    (is_product && is_computed).then_some(Gated {
        product,
        of,
        below,
        result,
    })
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
