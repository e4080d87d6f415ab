//! Runs consecutive entrywise operations of one shape as one loop over pieces of [`PIECE`] entries, whose intermediate
//! values stay in a small memory.

use crate::graph::{Graph, Shape, Step, Value};
use crate::memory::Memory;
use crate::operations::{Function, Operation, Pair};
use crate::scalar::{Scalar, combine, map};

/// Number of entries that go through all operations of a loop at a time.
const PIECE: usize = 1024;

/// Place from which an operand is read.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Source {
    /// The result of an earlier operation of the loop.
    Result(usize),
    /// A buffer of the loop's shape.
    Whole(Value),
    /// A buffer that is repeated: its shape is that of the loop with 1 for the rows, the columns or both.
    Repeated(Value, Shape),
}

#[derive(Debug, Clone, Copy)]
pub(crate) enum Entrywise {
    Map(Function, Source),
    Combine(Pair, Source, Source),
}

/// One loop.
#[derive(Debug, Clone)]
pub(crate) struct Loop {
    shape: Shape,
    operations: Vec<Entrywise>,
    values: Vec<Value>,
    /// Operations whose results are read outside of the loop, with their buffers.
    kept: Vec<(usize, Value)>,
}

/// Results of the operations of a loop for one piece, and a repeated operand.
#[derive(Debug, Clone, Default)]
pub(crate) struct Pieces<T> {
    results: Vec<Vec<T>>,
    operand: Vec<T>,
}

impl<T: Scalar> Pieces<T> {
    /// Reserves memory for loops of up to `n` operations.
    pub(crate) fn provide(&mut self, n: usize) {
        let n = n.max(self.results.len());
        self.results.resize(n, vec![T::default(); PIECE]);
        self.operand.resize(PIECE, T::default());
    }

    #[cfg(test)]
    pub(crate) fn capacities(&self) -> Vec<usize> {
        let results = self.results.iter().map(Vec::capacity);
        results
            .chain([self.results.capacity(), self.operand.capacity()])
            .collect()
    }
}

impl Loop {
    /// The loop of an entrywise operation and of those that follow it directly and have its shape.
    pub(crate) fn new(graph: &Graph, first: Value, others: &[&Step]) -> Self {
        let shape = graph.shape(first);
        let entrywise = |step: &&Step| match step {
            Step::Compute(value) if graph.nodes[value.0].operation.is_elementwise() => Some(*value),
            _ => None,
        };
        let others = others.iter().map_while(entrywise);
        let others = others.take_while(|value| graph.shape(*value) == shape);
        let values: Vec<Value> = std::iter::once(first).chain(others).collect();
        let source = |operand: &Value| match values.iter().position(|value| value == operand) {
            Some(at) => Source::Result(at),
            None if graph.shape(*operand) == shape => Source::Whole(*operand),
            None => Source::Repeated(*operand, graph.shape(*operand)),
        };
        let operation = |value: &Value| {
            let node = &graph.nodes[value.0];
            match &node.operation {
                Operation::Map(function) => Some(Entrywise::Map(*function, source(&node.operands[0]))),
                Operation::Combine(pair) => Some(Entrywise::Combine(
                    *pair,
                    source(&node.operands[0]),
                    source(&node.operands[1]),
                )),
                _ => None,
            }
        };
        Self {
            shape,
            operations: values.iter().filter_map(operation).collect(),
            values,
            kept: Vec::new(),
        }
    }

    /// Values that the loop reads from outside.
    pub(crate) fn operands(&self, graph: &Graph) -> Vec<Value> {
        let all = self
            .values
            .iter()
            .flat_map(|value| &graph.nodes[value.0].operands);
        all.copied()
            .filter(|operand| !self.values.contains(operand))
            .collect()
    }

    /// Number of operations.
    pub(crate) fn len(&self) -> usize {
        self.operations.len()
    }

    /// Shape of all results.
    pub(crate) fn shape(&self) -> Shape {
        self.shape
    }

    /// Keeps the results that are read outside of the loop.
    pub(crate) fn keep(&mut self, is_read: impl Fn(Value) -> bool) {
        let values = self.values.iter().copied().enumerate();
        self.kept = values.filter(|(_, value)| is_read(*value)).collect();
    }

    /// Operations whose results are read outside of the loop, with their values.
    pub(crate) fn kept(&self) -> impl Iterator<Item = (usize, Value)> {
        self.kept.iter().copied()
    }

    /// Operations in their order.
    pub(crate) fn operations(&self) -> &[Entrywise] {
        &self.operations
    }

    pub(crate) fn run<T: Scalar>(&self, memory: &mut Memory<T>, pieces: &mut Pieces<T>) {
        let n = self.shape[0] * self.shape[1];
        for start in (0..n).step_by(PIECE) {
            let length = PIECE.min(n - start);
            for (at, operation) in self.operations.iter().enumerate() {
                let (earlier, rest) = pieces.results.split_at_mut(at);
                let result = &mut rest[0][..length];
                let load = |source, target: &mut [T]| self.load(source, start, target, earlier, memory);
                match *operation {
                    Entrywise::Map(function, x) => {
                        load(x, result);
                        map(function, result);
                    }
                    Entrywise::Combine(pair, a, b) => {
                        load(a, result);
                        match b {
                            Source::Result(of) => combine(pair, result, &earlier[of]),
                            Source::Whole(value) => combine(pair, result, &memory.of(value)[start..]),
                            Source::Repeated(..) => {
                                let operand = &mut pieces.operand[..length];
                                load(b, operand);
                                combine(pair, result, operand);
                            }
                        }
                    }
                }
            }
            for (at, value) in &self.kept {
                let target = &mut memory.of_mut(*value)[start..start + length];
                target.copy_from_slice(&pieces.results[*at][..length]);
            }
        }
    }

    /// Copies a piece of an operand.
    fn load<T: Scalar>(
        &self,
        source: Source,
        start: usize,
        target: &mut [T],
        results: &[Vec<T>],
        memory: &Memory<T>,
    ) {
        let n = target.len();
        match source {
            Source::Result(at) => target.copy_from_slice(&results[at][..n]),
            Source::Whole(value) => target.copy_from_slice(&memory.of(value)[start..start + n]),
            Source::Repeated(value, [1, 1]) => target.fill(memory.of(value)[0]),
            Source::Repeated(value, shape) => {
                let (buffer, columns) = (memory.of(value), self.shape[1]);
                let (mut row, mut column, mut rest) = (start / columns, start % columns, target);
                while !rest.is_empty() {
                    let width = rest.len().min(columns - column);
                    let (part, after) = rest.split_at_mut(width);
                    if shape[0] == 1 {
                        part.copy_from_slice(&buffer[column..column + width]);
                    } else {
                        part.fill(buffer[row]);
                    }
                    (row, column, rest) = (row + 1, 0, after);
                }
            }
        }
    }
}
