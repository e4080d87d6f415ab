//! The executor on the processor.
//!
//! A graph is compiled once to kernels with buffers for their results. Second factors of products that are leaves are
//! packed again only after they have changed. A run allocates nothing after the first one of its routine, and one
//! thread executes it.

use crate::fusion::Pieces;
use crate::graph::{Graph, Number, Routine, Shape, Value};
use crate::kernels::{Kernel, compile};
use crate::memory::Memory;
use crate::operations::{Operation, Pair};
use crate::rows::{by_rows, column, largest, place, sum_row, sum_rows};
use crate::scalar::{Factor, Scalar, combine, map};
use crate::updates::Update;

/// Kind of a kernel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Work {
    /// Product or dense layer: whether its factors are transposed, and the number of summands of an entry.
    Product {
        /// Whether each factor is transposed.
        transposed: [bool; 2],
        /// Number of summands of an entry.
        inner: usize,
    },
    /// Number of entrywise operations in one loop.
    Loop(usize),
    /// A sum, or entries moved.
    SumOrMove,
    /// A change of a parameter.
    Update,
}

/// A leaf that is packed as the second factor of products. Computed factors share one memory.
#[derive(Debug, Clone)]
struct Pack<T: Scalar> {
    value: Value,
    is_transposed: bool,
    /// Version of the value that is packed.
    version: Option<u64>,
    packed: T::Packed,
}

/// Buffers and compiled routines of one graph.
#[derive(Debug, Clone)]
pub struct Processor<T: Scalar> {
    pub(crate) graph: Graph,
    kernels: Vec<Vec<Kernel>>,
    pub(crate) memory: Memory<T>,
    packs: Vec<Pack<T>>,
    numbers: Vec<f64>,
    pub(crate) counts: Vec<u64>,
    packed: T::Packed,
    multiplier: T::Multiplier,
    pieces: Pieces<T>,
    chains: Vec<T>,
}

impl<T: Scalar> Processor<T> {
    /// Compiles a graph. Parameters, inputs and states are 0.
    #[must_use]
    pub fn new(graph: &Graph) -> Self {
        let mut memory = Memory::new(graph);
        let routines = 0..graph.routines.len();
        let kernels: Vec<_> = routines
            .map(|routine| compile(graph, routine, &mut memory))
            .collect();
        let mut pieces = Pieces::default();
        for kernel in kernels.iter().flatten() {
            if let Kernel::Loop(entrywise) = kernel {
                pieces.provide(entrywise.len());
            }
        }
        Self {
            graph: graph.clone(),
            kernels,
            memory,
            packs: Vec::new(),
            numbers: graph.numbers.iter().map(|(_, first)| *first).collect(),
            counts: vec![0; graph.counts.len()],
            packed: T::Packed::default(),
            multiplier: T::Multiplier::default(),
            pieces,
            chains: Vec::new(),
        }
    }

    /// Writes a leaf row by row.
    ///
    /// # Panics
    /// Where the value is computed or the number of entries is not that of its shape.
    pub fn write(&mut self, value: Value, entries: &[T]) {
        self.check_leaf(value);
        let n = self.memory.of(value).len();
        assert_eq!(
            entries.len(),
            n,
            "{} entries for {}",
            entries.len(),
            self.graph.shown(value)
        );
        self.memory.of_mut(value).copy_from_slice(entries);
    }

    /// Entries of a leaf row by row, to be written in place.
    ///
    /// # Panics
    /// Where the value is computed.
    pub fn entries_mut(&mut self, value: Value) -> &mut [T] {
        self.check_leaf(value);
        self.memory.of_mut(value)
    }

    fn check_leaf(&self, value: Value) {
        let is_leaf = self.graph.nodes[value.0].routine.is_none();
        assert!(is_leaf, "{} is computed", self.graph.shown(value));
    }

    /// Entries of a leaf or an output row by row; those of an output are of the last run, 0 before it.
    ///
    /// # Panics
    /// Where the value is neither.
    #[must_use]
    pub fn entries(&self, value: Value) -> &[T] {
        let node = &self.graph.nodes[value.0];
        let is_kept = node.routine.is_none() || node.is_output;
        assert!(is_kept, "{} is no output", self.graph.shown(value));
        self.memory.of(value)
    }

    /// Changes a number for the following runs.
    pub fn set_number(&mut self, number: Number, to: f64) {
        self.numbers[number.0] = to;
    }

    /// Executes a routine.
    ///
    /// # Panics
    /// Where an index of a gather is no whole number or too large.
    pub fn run(&mut self, routine: Routine) {
        self.run_observed(routine, |_, _| {});
    }

    /// Executes a routine and calls `after` at the end of each kernel with the shape of its result, for a measurement
    /// of times.
    ///
    /// # Panics
    /// As [`Processor::run`].
    pub fn run_observed(&mut self, routine: Routine, mut after: impl FnMut(Work, Shape)) {
        let kernels = std::mem::take(&mut self.kernels[routine.0]);
        for kernel in &kernels {
            match kernel {
                Kernel::Loop(entrywise) => {
                    entrywise.run(&mut self.memory, &mut self.pieces);
                    after(Work::Loop(entrywise.len()), entrywise.shape());
                }
                Kernel::Single(value) => {
                    self.compute(*value);
                    let node = &self.graph.nodes[value.0];
                    let [rows, columns] = self.graph.shape(node.operands[0]);
                    let product = |transposed: [bool; 2]| Work::Product {
                        transposed,
                        inner: if transposed[0] { rows } else { columns },
                    };
                    let work = match node.operation {
                        Operation::Product { transposed } => product(transposed),
                        Operation::Dense(_) => product([false; 2]),
                        _ => Work::SumOrMove,
                    };
                    after(work, node.shape);
                }
                Kernel::Update(update) => {
                    self.update(update);
                    after(Work::Update, self.graph.shape(update.target()));
                }
            }
        }
        self.kernels[routine.0] = kernels;
    }

    fn compute(&mut self, value: Value) {
        let mut result = self.memory.take(value);
        match self.graph.nodes[value.0].operation {
            Operation::Dense(_) => self.multiply(value, false, &mut result),
            Operation::Product { transposed } => self.multiply(value, transposed[1], &mut result),
            _ => self.move_or_sum(value, &mut result),
        }
        self.memory.put(value, result);
    }

    fn factor(&self, value: Value, is_transposed: bool) -> Factor<'_, T> {
        Factor {
            entries: self.memory.of(value),
            shape: self.graph.shape(value),
            is_transposed,
        }
    }

    /// Place of the pack of a second factor that is a leaf. Others change in every run.
    fn pack_of(&mut self, value: Value, is_transposed: bool) -> Option<usize> {
        if self.graph.nodes[value.0].routine.is_some() {
            return None;
        }
        let is_it = |pack: &Pack<T>| pack.value == value && pack.is_transposed == is_transposed;
        self.packs.iter().position(is_it).or_else(|| {
            self.packs.push(Pack {
                value,
                is_transposed,
                version: None,
                packed: T::Packed::default(),
            });
            Some(self.packs.len() - 1)
        })
    }

    /// A product or a dense layer.
    fn multiply(&mut self, value: Value, is_transposed: bool, result: &mut [T]) {
        let b = self.graph.nodes[value.0].operands[1];
        let place = self.pack_of(b, is_transposed);
        let (newest, mut version) = (Some(self.memory.version(b)), None);
        if let Some(pack) = place.map(|at| &mut self.packs[at]) {
            // The common memory holds the pack while it is read.
            std::mem::swap(&mut self.packed, &mut pack.packed);
            version = std::mem::replace(&mut pack.version, newest);
        }
        let mut packed = std::mem::take(&mut self.packed);
        if version != newest {
            T::pack(&mut packed, self.factor(b, is_transposed));
        }
        let mut memory = std::mem::take(&mut self.multiplier);
        let node = &self.graph.nodes[value.0];
        let is_turned = matches!(
            node.operation,
            Operation::Product {
                transposed: [true, _]
            }
        );
        let a = self.factor(node.operands[0], is_turned);
        if let Operation::Dense(activation) = node.operation {
            let (bias, function) = (self.memory.of(node.operands[2]), activation.function());
            T::multiply(&mut memory, a, &packed, result, &mut |rows| {
                for row in rows.chunks_exact_mut(bias.len()) {
                    combine(Pair::Add, row, bias);
                }
                if let Some(function) = function {
                    map(function, rows);
                }
            });
        } else {
            T::multiply(&mut memory, a, &packed, result, &mut |_| {});
        }
        self.multiplier = memory;
        self.packed = packed;
        if let Some(at) = place {
            std::mem::swap(&mut self.packed, &mut self.packs[at].packed);
        }
    }

    /// Capacities of all memory.
    #[cfg(test)]
    pub(crate) fn capacities(&self) -> Vec<usize> {
        let own = [self.chains.capacity(), self.packs.capacity()];
        [self.memory.capacities(), self.pieces.capacities(), own.to_vec()].concat()
    }

    fn move_or_sum(&mut self, value: Value, result: &mut [T]) {
        let node = &self.graph.nodes[value.0];
        // Operations without operands are leaves, which no kernel computes.
        let x = self.memory.of(node.operands[0]);
        let [width, columns] = [self.graph.shape(node.operands[0])[1], node.shape[1]];
        match node.operation {
            Operation::SumRows => sum_rows(x, result, &mut self.chains),
            Operation::Sum => result[0] = T::sum(x),
            Operation::SumColumns => by_rows(result, x, width, sum_row),
            Operation::LargestOfColumns => by_rows(result, x, width, largest),
            Operation::Join => {
                let mut first = 0;
                for operand in &node.operands {
                    let width = self.graph.shape(*operand)[1];
                    place(result, columns, first, self.memory.of(*operand), width);
                    first += width;
                }
            }
            Operation::Columns { first } => {
                for (target, row) in result.chunks_exact_mut(columns).zip(x.chunks_exact(width)) {
                    target.copy_from_slice(&row[first..first + columns]);
                }
            }
            Operation::Place { first } => {
                result.fill(T::default());
                place(result, columns, first, x, width);
            }
            Operation::Gather => {
                let index = self.memory.of(node.operands[1]);
                for ((target, row), index) in result.iter_mut().zip(x.chunks_exact(width)).zip(index) {
                    *target = row[column(*index, width)];
                }
            }
            Operation::Scatter => {
                result.fill(T::default());
                let index = self.memory.of(node.operands[1]);
                for ((row, x), index) in result.chunks_exact_mut(columns).zip(x).zip(index) {
                    row[column(*index, columns)] = *x;
                }
            }
            Operation::ClipScale { largest } => {
                let squares = node
                    .operands
                    .iter()
                    .map(|it| T::sum_of_squares(self.memory.of(*it)));
                let norm = squares.fold(0.0, |sum, squares| sum + squares).sqrt();
                result[0] = T::of(if norm > largest { largest / norm } else { 1.0 });
            }
            ref other => unreachable!("{other} is executed elsewhere"),
        }
    }

    fn update(&mut self, update: &Update) {
        let target = update.target();
        let mut changed = self.memory.take(target);
        match *update {
            Update::Adam {
                gradient,
                moments,
                count,
                settings,
                ..
            } => {
                let [mut first, mut second] = moments.map(|moment| self.memory.take(moment));
                self.counts[count] += 1;
                let rate = self.numbers[settings.learning_rate.0];
                let (t, gradient) = (self.counts[count], self.memory.of(gradient));
                let both: [&mut [T]; 2] = [&mut first, &mut second];
                T::descend(t, rate, settings.betas, &mut changed, gradient, both);
                for (moment, buffer) in moments.into_iter().zip([first, second]) {
                    self.memory.put(moment, buffer);
                }
            }
            Update::Follow { source, tau, .. } => {
                T::follow(&mut changed, self.memory.of(source), T::of(tau));
            }
            Update::Assign { source, .. } => changed.copy_from_slice(self.memory.of(source)),
        }
        self.memory.put(target, changed);
    }
}
