//! The executor on the processor.
//!
//! A graph is compiled once: one buffer for each value that is read outside of the loop that computes it, loops of
//! entrywise operations ([`crate::fusion`]), and packed second factors of products, which are packed again only after
//! their value has changed. A run allocates nothing after the first one of its routine. A processor with one thread
//! runs a routine; nothing is shared.

use crate::fusion::{Loop, Pieces};
use crate::graph::{Graph, Number, Routine, Shape, Step, Value};
use crate::operations::{Operation, Pair};
use crate::scalar::{Factor, Scalar, combine, map, sum_row, sum_rows};
use crate::updates::Update;

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

#[derive(Debug, Clone)]
enum Kernel {
    Loop(Loop),
    /// An operation, and the place of its packed second factor if it is a product.
    Single(Value, Option<usize>),
    Update(Update),
}

/// Kind of a kernel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Work {
    /// Product or dense layer: whether its factors are transposed, and the number of summands of an entry.
    Product {
        /// Whether each factor is transposed.
        transposed: [bool; 2],
        /// Number of summands of an entry.
        inner: usize,
        /// Whether bias and activation follow.
        is_dense: bool,
    },
    /// Number of entrywise operations in one loop.
    Loop(usize),
    /// A sum, or entries moved.
    SumOrMove,
    /// A change of a parameter.
    Update,
}

/// A packed second factor.
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
    graph: Graph,
    kernels: Vec<Vec<Kernel>>,
    buffers: Vec<Vec<T>>,
    /// How often each buffer was written.
    versions: Vec<u64>,
    packs: Vec<Pack<T>>,
    numbers: Vec<f64>,
    counts: Vec<u64>,
    multiplier: T::Multiplier,
    pieces: Pieces<T>,
    chains: Vec<T>,
}

impl<T: Scalar> Processor<T> {
    /// Compiles a graph. Parameters, inputs and states are 0.
    #[must_use]
    pub fn new(graph: &Graph) -> Self {
        let mut processor = Self {
            graph: graph.clone(),
            kernels: Vec::new(),
            buffers: vec![Vec::new(); graph.nodes.len()],
            versions: vec![0; graph.nodes.len()],
            packs: Vec::new(),
            numbers: graph.numbers.iter().map(|(_, first)| *first).collect(),
            counts: vec![0; graph.counts.len()],
            multiplier: T::Multiplier::default(),
            pieces: Pieces::default(),
            chains: Vec::new(),
        };
        for (node, buffer) in graph.nodes.iter().zip(&mut processor.buffers) {
            match &node.operation {
                Operation::Constant(entries) => buffer.extend(entries.iter().map(|entry| T::of(*entry))),
                _ if node.routine.is_none() => buffer.resize(node.shape[0] * node.shape[1], T::default()),
                _ => {}
            }
        }
        for routine in 0..graph.routines.len() {
            let kernels = processor.compile(graph, routine);
            processor.kernels.push(kernels);
        }
        processor
    }

    /// Kernels of a routine in the order of its steps, with buffers for their results.
    fn compile(&mut self, graph: &Graph, routine: usize) -> Vec<Kernel> {
        let (steps, mut kernels) = (graph.live_steps(routine), Vec::new());
        let mut at = 0;
        // The kernel that computes each value, and whether another one reads it.
        let mut is_read: Vec<bool> = graph.nodes.iter().map(|node| node.is_output).collect();
        while at < steps.len() {
            let kernel = Loop::of_first(graph, &steps[at..]);
            let end = at + kernel.as_ref().map_or(1, Loop::len);
            for step in &steps[at..end] {
                let operands = match step {
                    Step::Compute(value) => graph.nodes[value.0].operands.clone(),
                    Step::Update(update) => update.operands(),
                };
                let is_inside = |operand: &Value| {
                    let computes = |step: &&Step| matches!(step, Step::Compute(value) if value == operand);
                    steps[at..end].iter().any(computes)
                };
                for operand in operands.iter().filter(|operand| !is_inside(operand)) {
                    is_read[operand.0] = true;
                }
            }
            kernels.push(match (kernel, steps[at]) {
                (Some(kernel), _) => Kernel::Loop(kernel),
                (None, Step::Compute(value)) => Kernel::Single(*value, self.pack_of(graph, *value)),
                (None, Step::Update(update)) => Kernel::Update(update.clone()),
            });
            at = end;
        }
        for kernel in &mut kernels {
            if let Kernel::Loop(entrywise) = kernel {
                entrywise.keep(|value| is_read[value.0]);
                self.pieces.provide(entrywise.len());
                entrywise.kept().for_each(|value| self.provide(value));
            } else if let Kernel::Single(value, _) = kernel {
                self.provide(*value);
            }
        }
        kernels
    }

    fn provide(&mut self, value: Value) {
        let [rows, columns] = self.graph.shape(value);
        self.buffers[value.0].resize(rows * columns, T::default());
    }

    /// Place of the packed second factor of a product.
    fn pack_of(&mut self, graph: &Graph, value: Value) -> Option<usize> {
        let node = &graph.nodes[value.0];
        let is_transposed = match node.operation {
            Operation::Dense(_) => false,
            Operation::Product { transposed } => transposed[1],
            _ => return None,
        };
        let factor = node.operands[1];
        let is_it = |pack: &Pack<T>| pack.value == factor && pack.is_transposed == is_transposed;
        self.packs.iter().position(is_it).or_else(|| {
            self.packs.push(Pack {
                value: factor,
                is_transposed,
                version: None,
                packed: T::Packed::default(),
            });
            Some(self.packs.len() - 1)
        })
    }

    /// Writes a leaf row by row.
    ///
    /// # Panics
    /// Where the value is computed or the number of entries is not that of its shape.
    pub fn write(&mut self, value: Value, entries: &[T]) {
        let shown = self.graph.shown(value);
        let buffer = self.entries_mut(value);
        assert_eq!(
            entries.len(),
            buffer.len(),
            "{} entries for {shown}",
            entries.len()
        );
        buffer.copy_from_slice(entries);
    }

    /// Entries of a leaf row by row, to be written in place.
    ///
    /// # Panics
    /// Where the value is computed.
    pub fn entries_mut(&mut self, value: Value) -> &mut [T] {
        let is_leaf = self.graph.nodes[value.0].routine.is_none();
        assert!(is_leaf, "{} is computed", self.graph.shown(value));
        self.versions[value.0] += 1;
        &mut self.buffers[value.0]
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
        &self.buffers[value.0]
    }

    /// Changes a number for the following runs.
    pub fn set_number(&mut self, number: Number, to: f64) {
        self.numbers[number.0] = to;
    }

    /// Name, shape and entries of every parameter and moment, in the order in which they were made.
    pub fn states(&self) -> impl Iterator<Item = (&str, Shape, &[T])> {
        let nodes = self.graph.nodes.iter().zip(&self.buffers);
        nodes.filter_map(|(node, buffer)| {
            let is_state = matches!(node.operation, Operation::Parameter | Operation::State);
            let name = node.name.as_deref().filter(|_| is_state)?;
            Some((name, node.shape, buffer.as_slice()))
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
        if entries.len() != self.buffers[value.0].len() {
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
                    entrywise.run(&mut self.buffers, &mut self.pieces);
                    for value in entrywise.kept() {
                        self.versions[value.0] += 1;
                    }
                    after(Work::Loop(entrywise.len()), entrywise.shape());
                }
                Kernel::Single(value, pack) => {
                    self.compute(*value, *pack);
                    let node = &self.graph.nodes[value.0];
                    let [rows, columns] = self.graph.shape(node.operands[0]);
                    let work = match node.operation {
                        Operation::Product { transposed } => Work::Product {
                            transposed,
                            inner: if transposed[0] { rows } else { columns },
                            is_dense: false,
                        },
                        Operation::Dense(_) => Work::Product {
                            transposed: [false; 2],
                            inner: columns,
                            is_dense: true,
                        },
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

    fn compute(&mut self, value: Value, pack: Option<usize>) {
        let mut result = std::mem::take(&mut self.buffers[value.0]);
        if let Some(pack) = pack {
            self.multiply(value, pack, &mut result);
        } else {
            self.move_or_sum(value, &mut result);
        }
        self.buffers[value.0] = result;
        self.versions[value.0] += 1;
    }

    fn factor(&self, value: Value, is_transposed: bool) -> Factor<'_, T> {
        Factor {
            entries: &self.buffers[value.0],
            shape: self.graph.shape(value),
            is_transposed,
        }
    }

    /// A product or a dense layer; its second factor is packed if it has changed.
    fn multiply(&mut self, value: Value, pack: usize, result: &mut [T]) {
        let Pack {
            value: b,
            is_transposed,
            version,
            ..
        } = self.packs[pack];
        let mut packed = std::mem::take(&mut self.packs[pack].packed);
        let newest = Some(self.versions[b.0]);
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
            let (bias, function) = (&self.buffers[node.operands[2].0], activation.function());
            T::multiply(&mut memory, a, &packed, result, &mut |first, entries| {
                combine(Pair::Add, entries, &bias[first..]);
                if let Some(function) = function {
                    map(function, entries);
                }
            });
        } else {
            T::multiply(&mut memory, a, &packed, result, &mut |_, _| {});
        }
        self.multiplier = memory;
        (self.packs[pack].packed, self.packs[pack].version) = (packed, newest);
    }

    /// Capacities of all memory.
    #[cfg(test)]
    pub(crate) fn capacities(&self) -> Vec<usize> {
        let buffers = self.buffers.iter().chain([&self.chains]).map(Vec::capacity);
        buffers.chain(self.pieces.capacities()).collect()
    }

    fn move_or_sum(&mut self, value: Value, result: &mut [T]) {
        let node = &self.graph.nodes[value.0];
        // Operations without operands are leaves, which no kernel computes.
        let x = &self.buffers[node.operands[0].0];
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
                    place(result, columns, first, &self.buffers[operand.0], width);
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
                let index = &self.buffers[node.operands[1].0];
                for ((target, row), index) in result.iter_mut().zip(x.chunks_exact(width)).zip(index) {
                    *target = row[column(*index, width)];
                }
            }
            Operation::Scatter => {
                result.fill(T::default());
                let index = &self.buffers[node.operands[1].0];
                for ((row, x), index) in result.chunks_exact_mut(columns).zip(x).zip(index) {
                    row[column(*index, columns)] = *x;
                }
            }
            Operation::ClipScale { largest } => {
                let squares = node
                    .operands
                    .iter()
                    .map(|it| T::sum_of_squares(&self.buffers[it.0]));
                let norm = squares.fold(0.0, |sum, squares| sum + squares).sqrt();
                result[0] = T::of(if norm > largest { largest / norm } else { 1.0 });
            }
            ref other => unreachable!("{other} is executed elsewhere"),
        }
    }

    fn update(&mut self, update: &Update) {
        let target = update.target();
        let mut changed = std::mem::take(&mut self.buffers[target.0]);
        match *update {
            Update::Adam {
                gradient,
                moments,
                count,
                settings,
                ..
            } => {
                let [mut first, mut second] =
                    moments.map(|moment| std::mem::take(&mut self.buffers[moment.0]));
                self.counts[count] += 1;
                let rate = self.numbers[settings.learning_rate.0];
                let (t, gradient) = (self.counts[count], &self.buffers[gradient.0]);
                let both: [&mut [T]; 2] = [&mut first, &mut second];
                T::descend(t, rate, settings.betas, &mut changed, gradient, both);
                for (moment, buffer) in moments.into_iter().zip([first, second]) {
                    self.buffers[moment.0] = buffer;
                    self.versions[moment.0] += 1;
                }
            }
            Update::Follow { source, tau, .. } => {
                T::follow(&mut changed, &self.buffers[source.0], T::of(tau));
            }
            Update::Assign { source, .. } => changed.copy_from_slice(&self.buffers[source.0]),
        }
        self.buffers[target.0] = changed;
        self.versions[target.0] += 1;
    }
}

/// One number for each row.
fn by_rows<T: Scalar>(result: &mut [T], x: &[T], width: usize, function: impl Fn(&[T]) -> T) {
    for (result, row) in result.iter_mut().zip(x.chunks_exact(width)) {
        *result = function(row);
    }
}

/// Largest number of a row; a NaN where one is.
#[allow(clippy::eq_op, reason = "a NaN differs from itself")]
fn largest<T: Scalar>(row: &[T]) -> T {
    let larger = |a: T, b: T| if b > a || b != b { b } else { a };
    row.iter().copied().reduce(larger).unwrap_or_default()
}

/// Copies rows of `width` entries to rows of `columns` entries, from column `first` on.
fn place<T: Scalar>(result: &mut [T], columns: usize, first: usize, x: &[T], width: usize) {
    for (target, row) in result.chunks_exact_mut(columns).zip(x.chunks_exact(width)) {
        target[first..first + width].copy_from_slice(row);
    }
}

/// Column that a number names.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "checked below"
)]
fn column<T: Scalar>(index: T, columns: usize) -> usize {
    let (index, at) = (index.wide(), index.wide() as usize);
    assert!(
        index == at as f64 && at < columns,
        "index {index} of {columns} columns"
    );
    at
}
