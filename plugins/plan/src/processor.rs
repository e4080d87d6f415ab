//! The executor on the processor.
//!
//! A graph is compiled once to kernels with buffers for their results. A run allocates nothing after the first one of its
//! routine, and one thread executes it.

use crate::bound::{Bound, bound};
use crate::elsewhere::Elsewhere;
use crate::executor;
use crate::extension::MOST_OPERANDS;
use crate::fusion::Pieces;
use crate::graph::{Graph, Routine, Shape, Value};
use crate::kernels::{Gated, Kernel, compile};
use crate::memory::Memory;
use crate::operations::{Activation, Function, Operation, RowFunction};
use crate::rows::{by_rows, column, largest, place, place_of_largest, ranked, sum_row, sum_rows};
use crate::scalar::{Factor, Scalar, map};
use crate::state::State;
use crate::updates::Update;
use crate::{dirichlet, draws};
use arithmetic::epilogue::Epilogue;

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
    /// An operation of another crate.
    Extension,
    /// A sum, or entries moved.
    SumOrMove,
    /// A change of a parameter.
    Update,
}

/// Buffers and compiled routines of one graph.
#[derive(Debug, Clone)]
pub struct Processor<T: Scalar> {
    graph: Graph,
    kernels: Vec<Vec<Kernel>>,
    bound: Vec<Vec<Bound>>,
    memory: Memory<T>,
    multiplier: T::Multiplier,
    pieces: Pieces<T>,
    chains: Vec<T>,
    wide: [Vec<f64>; 3],
    /// Intermediate numbers of extensions.
    extended: Vec<f32>,
    /// Routines as kernels, filled once another executor was in use.
    elsewhere: Elsewhere,
}

impl<T: Scalar> Processor<T> {
    /// Compiles a graph. Inputs are 0.
    #[must_use]
    pub fn new(graph: Graph) -> Self {
        let mut memory = Memory::new(&graph);
        let routines = 0..graph.routines.len();
        let kernels: Vec<_> = routines
            .clone()
            .map(|routine| compile(&graph, routine, &mut memory))
            .collect();
        let mut pieces = Pieces::default();
        for kernel in kernels.iter().flatten() {
            if let Kernel::Loop(entrywise) = kernel {
                pieces.provide(entrywise.len());
            }
        }
        let bound = routines.map(|routine| bound(&graph, routine)).collect();
        Self {
            graph,
            kernels,
            bound,
            memory,
            multiplier: T::Multiplier::default(),
            pieces,
            chains: Vec::new(),
            wide: Default::default(),
            extended: Vec::new(),
            elsewhere: Elsewhere::default(),
        }
    }

    /// The graph that is executed.
    #[must_use]
    pub fn graph(&self) -> &Graph {
        &self.graph
    }

    fn named(&self, name: &str) -> Value {
        let value = self.graph.named(name);
        value.unwrap_or_else(|| panic!("the plan has no value `{name}`"))
    }

    /// Writes an input row by row.
    ///
    /// # Panics
    /// If no input has the name, or the number of entries is not that of its shape.
    pub fn write(&mut self, input: &str, entries: &[T]) {
        let own = self.input(input);
        assert_eq!(entries.len(), own.len(), "entries of the input `{input}`");
        own.copy_from_slice(entries);
    }

    /// Entries of an input row by row, to be written in place.
    ///
    /// # Panics
    /// If no input has the name.
    pub fn input(&mut self, input: &str) -> &mut [T] {
        let value = self.named(input);
        let is_input = self.graph.nodes[value.0].operation == Operation::Input;
        assert!(is_input, "{} is no input", self.graph.shown(value));
        self.memory.of_mut(value)
    }

    /// Entries of an input or an output row by row; those of an output are from the last run, and 0 before it.
    ///
    /// # Panics
    /// If no input or output has the name.
    #[must_use]
    pub fn entries(&self, name: &str) -> &[T] {
        let value = self.named(name);
        let node = &self.graph.nodes[value.0];
        let is_kept = node.operation == Operation::Input || node.is_output;
        assert!(is_kept, "{} is no output", self.graph.shown(value));
        self.memory.of(value)
    }

    /// The only number of an output `[1, 1]`, read like [`Processor::entries`].
    #[must_use]
    pub fn number(&self, output: &str) -> f64 {
        let entries = self.entries(output);
        assert_eq!(entries.len(), 1, "numbers of `{output}`");
        entries[0].wide()
    }

    /// Executes a routine that draws nothing.
    ///
    /// # Panics
    /// If the graph has no such routine or it draws, the state lacks a parameter or has another shape of it, or an
    /// index of a gather is no whole number or too large.
    pub fn run(&mut self, routine: &str, state: &mut State<T>) {
        let of = self.routine(routine);
        let draws = self.graph.routines[of.0].n_draws;
        assert_eq!(draws, 0, "`{routine}` draws numbers and needs a seed");
        self.run_observed(of, state, 0, |_, _| {});
    }

    /// Executes a routine whose draws depend on a seed.
    ///
    /// # Panics
    /// In the cases of [`Processor::run`].
    pub fn run_seeded(&mut self, routine: &str, state: &mut State<T>, seed: u64) {
        self.run_observed(self.routine(routine), state, seed, |_, _| {});
    }

    fn routine(&self, name: &str) -> Routine {
        let routine = self.graph.routine_named(name);
        routine.unwrap_or_else(|| panic!("the plan has no routine `{name}`"))
    }

    /// Executes a routine and calls `after` at the end of each kernel with the shape of its result, to measure times.
    ///
    /// # Panics
    /// In the cases of [`Processor::run`].
    pub fn run_observed(
        &mut self,
        routine: Routine,
        state: &mut State<T>,
        seed: u64,
        mut after: impl FnMut(Work, Shape),
    ) {
        for bound in &mut self.bound[routine.0] {
            if !state.is_at(bound.place, &bound.name, bound.shape) {
                bound.place = state.place(&bound.name, bound.shape, bound.is_moment);
            }
        }
        if let Some(executor) = executor::current()
            && self
                .elsewhere
                .run(&executor, &self.graph, routine, &mut self.memory, state, seed)
        {
            return;
        }
        for bound in &self.bound[routine.0] {
            self.memory.exchange(bound.value, state.at_mut(bound.place));
        }
        let kernels = std::mem::take(&mut self.kernels[routine.0]);
        for kernel in &kernels {
            match kernel {
                Kernel::Loop(entrywise) => {
                    entrywise.run(&mut self.memory, &mut self.pieces);
                    after(Work::Loop(entrywise.len()), entrywise.shape());
                }
                Kernel::Single(value) => {
                    self.compute(*value, seed);
                    after(self.work(*value), self.graph.shape(*value));
                }
                Kernel::Gated(gated) => {
                    self.multiply_gated(gated);
                    after(self.work(gated.product), self.graph.shape(gated.product));
                }
                Kernel::Update(update) => {
                    self.update(update, state);
                    after(Work::Update, self.graph.shape(update.target()));
                }
            }
        }
        self.kernels[routine.0] = kernels;
        for bound in &self.bound[routine.0] {
            self.memory.exchange(bound.value, state.at_mut(bound.place));
        }
    }

    fn work(&self, value: Value) -> Work {
        let node = &self.graph.nodes[value.0];
        let first = node.operands.first().map_or([0; 2], |it| self.graph.shape(*it));
        let product = |transposed: [bool; 2]| Work::Product {
            transposed,
            inner: node.operation.n_terms(first),
        };
        match node.operation {
            Operation::Product { transposed } => product(transposed),
            Operation::Dense(_) => product([false; 2]),
            Operation::Extension(_) => Work::Extension,
            _ => Work::SumOrMove,
        }
    }

    fn compute(&mut self, value: Value, seed: u64) {
        let mut result = self.memory.take(value);
        match self.graph.nodes[value.0].operation {
            Operation::Normal { index } => draws::normal(seed, index, &mut result),
            Operation::Uniform { index } => draws::uniform(seed, index, &mut result),
            Operation::LogGamma { index } => {
                draws::log_gamma(seed, index, self.operand(value, 0), &mut result);
            }
            Operation::LogGammaSlope => {
                draws::log_gamma_slope(self.operand(value, 0), self.operand(value, 1), &mut result);
            }
            Operation::Rows(function) => self.compute_rows(function, value, &mut result),
            Operation::Dense(activation) => self.multiply_dense(value, activation, &mut result),
            Operation::Extension(_) => self.extend(value, &mut result),
            Operation::Product { .. } => self.multiply(value, &mut result, |_| Epilogue::None),
            _ => self.move_or_sum(value, &mut result),
        }
        self.memory.put(value, result);
    }

    fn operand(&self, value: Value, at: usize) -> &[T] {
        self.memory.of(self.graph.nodes[value.0].operands[at])
    }

    fn compute_rows(&mut self, function: RowFunction, value: Value, result: &mut [T]) {
        let operands = &self.graph.nodes[value.0].operands;
        let parts = [operands[0], *operands.get(1).unwrap_or(&operands[0])];
        let (n, width) = (self.graph.shape(parts[0])[1], self.graph.shape(value)[1]);
        let [alpha, log_point] = parts.map(|part| self.memory.of(part));
        let rows = result.chunks_exact_mut(width);
        let rows = rows.zip(alpha.chunks_exact(n)).zip(log_point.chunks_exact(n));
        for ((result, alpha), log_point) in rows {
            dirichlet::row(function, [alpha, log_point], result, &mut self.wide);
        }
    }

    fn extend(&mut self, value: Value, result: &mut [T]) {
        let node = &self.graph.nodes[value.0];
        if let Operation::Extension(extension) = &node.operation {
            let mut operands: [&[T]; MOST_OPERANDS] = [&[]; MOST_OPERANDS];
            for (entries, operand) in operands.iter_mut().zip(&node.operands) {
                *entries = self.memory.of(*operand);
            }
            let operands = &operands[..node.operands.len()];
            T::extend(&*extension.0, operands, result, &mut self.extended);
        }
    }

    /// Factors of a product or a dense layer.
    fn factors(&self, value: Value) -> [Factor<'_, T>; 2] {
        let node = &self.graph.nodes[value.0];
        let transposed = match node.operation {
            Operation::Product { transposed } => transposed,
            _ => [false; 2],
        };
        [0, 1].map(|at| Factor {
            entries: self.operand(value, at),
            shape: self.graph.shape(node.operands[at]),
            is_transposed: transposed[at],
        })
    }

    fn multiply(&mut self, value: Value, result: &mut [T], epilogue: impl FnOnce(&Self) -> Epilogue<T>) {
        let mut multiplier = std::mem::take(&mut self.multiplier);
        T::multiply(&mut multiplier, self.factors(value), result, epilogue(self));
        self.multiplier = multiplier;
    }

    fn multiply_dense(&mut self, value: Value, activation: Activation, result: &mut [T]) {
        let function = activation.function();
        let below = match function {
            Some(Function::Rectify(below)) => below,
            _ => 1.0,
        };
        self.multiply(value, result, |own| Epilogue::Rectified {
            bias: own.operand(value, 2),
            below: T::of(below),
        });
        // A rectifier has been applied.
        if let Some(elementary @ Function::Tanh) = function {
            map(elementary, result);
        }
    }

    fn multiply_gated(&mut self, gated: &Gated) {
        let replaces_gates = self.memory.is_same([gated.of, gated.result]);
        let mut result = self.memory.take(gated.result);
        self.multiply(gated.product, &mut result, |own| Epilogue::Gated {
            of: (!replaces_gates).then(|| own.memory.of(gated.of)),
            below: T::of(gated.below),
        });
        self.memory.put(gated.result, result);
    }

    /// Capacities of all memory.
    #[cfg(test)]
    pub(crate) fn capacities(&self) -> Vec<usize> {
        let own = [self.chains.capacity(), self.extended.capacity()];
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
            Operation::PlaceOfLargest => by_rows(result, x, width, place_of_largest),
            Operation::Ranked { rank } => {
                by_rows(result, x, width, |row| ranked(row, rank, &mut self.chains));
            }
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
            Operation::Reshape => result.copy_from_slice(x),
            Operation::RepeatRows { times } => {
                for (group, row) in result.chunks_exact_mut(times * width).zip(x.chunks_exact(width)) {
                    group
                        .chunks_exact_mut(width)
                        .for_each(|target| target.copy_from_slice(row));
                }
            }
            Operation::SumGroups { size } => {
                for (sums, group) in result.chunks_exact_mut(width).zip(x.chunks_exact(size * width)) {
                    sum_rows(group, sums, &mut self.chains);
                }
            }
            Operation::ClipScale { largest } => result[0] = self.clip_scale(&node.operands, largest),
            ref other => unreachable!("{other} is executed elsewhere"),
        }
    }

    /// 1, or if the joint norm of all values exceeds `largest`, the quotient of both.
    fn clip_scale(&self, values: &[Value], largest: f64) -> T {
        let squares = values.iter().map(|it| T::sum_of_squares(self.memory.of(*it)));
        let norm = squares.fold(0.0, |sum, squares| sum + squares).sqrt();
        T::of(if norm > largest { largest / norm } else { 1.0 })
    }

    fn update(&mut self, update: &Update, state: &mut State<T>) {
        let target = update.target();
        let mut changed = self.memory.take(target);
        match *update {
            Update::Adam {
                gradient,
                moments,
                settings,
                parameter,
            } => {
                let [mut first, mut second] = moments.map(|moment| self.memory.take(moment));
                let (name, first_rate) = &self.graph.numbers[settings.learning_rate.0];
                let rate = state.number(name).unwrap_or(*first_rate);
                let name = self.graph.nodes[parameter.0].name.as_deref().unwrap_or_default();
                let (t, gradient) = (state.count_step(name), self.memory.of(gradient));
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
