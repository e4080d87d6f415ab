//! The builder of a plan: leaves, routines, and the checks when an operation is added.

use crate::operations::Operation;
use crate::updates::Update;
use std::collections::HashMap;

/// Numbers of rows and columns.
pub type Shape = [usize; 2];

/// A matrix of a graph. It is valid for the graph that made it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Value(pub(crate) usize);

/// A list of operations of a graph.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Routine(pub(crate) usize);

/// A number in `f64` that a caller sets between runs, such as a learning rate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Number(pub(crate) usize);

#[derive(Debug, Clone)]
pub(crate) struct Node {
    pub(crate) operation: Operation,
    pub(crate) operands: Vec<Value>,
    pub(crate) shape: Shape,
    /// Routine that computes the value; none for a leaf.
    pub(crate) routine: Option<usize>,
    pub(crate) name: Option<String>,
    /// Whether a caller reads the value after a run.
    pub(crate) is_output: bool,
}

#[derive(Debug, Clone)]
pub(crate) enum Step {
    Compute(Value),
    Update(Update),
}

#[derive(Debug, Clone)]
pub(crate) struct StepList {
    pub(crate) name: String,
    pub(crate) steps: Vec<Step>,
    pub(crate) n_draws: usize,
}

/// Values and routines. Methods that add to it check names and shapes and panic if they do not fit, with the names and
/// both shapes: a graph is written by a programmer, and its shapes are known when it is built.
#[derive(Debug, Clone, Default)]
pub struct Graph {
    pub(crate) nodes: Vec<Node>,
    pub(crate) routines: Vec<StepList>,
    pub(crate) numbers: Vec<(String, f64)>,
    /// Places of the named values.
    names: HashMap<String, usize>,
}

impl Graph {
    /// Creates a graph without values.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// A matrix that a caller writes before a run.
    ///
    /// # Panics
    /// If the name is taken or the shape has no entries.
    #[must_use]
    pub fn input(&mut self, name: &str, shape: Shape) -> Value {
        self.leaf(Operation::Input, name, shape)
    }

    /// The matrix with a name that is kept between runs and changed by updates, a part of a [`State`](crate::State).
    ///
    /// # Panics
    /// If the name belongs to another value or shape, or the shape has no entries.
    #[must_use]
    pub fn parameter(&mut self, name: &str, shape: Shape) -> Value {
        let is_it = |node: &Node| node.operation == Operation::Parameter && node.shape == shape;
        let same = self.named(name).filter(|value| is_it(&self.nodes[value.0]));
        same.unwrap_or_else(|| self.leaf(Operation::Parameter, name, shape))
    }

    /// A matrix with given entries, row by row, rounded to the executor's precision.
    ///
    /// # Panics
    /// If the number of entries is not that of the shape.
    #[must_use]
    pub fn constant(&mut self, shape: Shape, entries: &[f64]) -> Value {
        assert_eq!(
            entries.len(),
            shape[0] * shape[1],
            "{} entries for a constant {shape:?}",
            entries.len()
        );
        self.push(Operation::Constant(entries.to_vec()), Vec::new(), shape, None)
    }

    /// The number with a name that a state may change between runs; it is `first` until then.
    #[must_use]
    pub fn number(&mut self, name: &str, first: f64) -> Number {
        if let Some(at) = self.numbers.iter().position(|(other, _)| other == name) {
            return Number(at);
        }
        self.numbers.push((name.to_owned(), first));
        Number(self.numbers.len() - 1)
    }

    /// Begins a routine: operations added from now on belong to it.
    ///
    /// # Panics
    /// If the name is taken.
    #[must_use]
    pub fn routine(&mut self, name: &str) -> Routine {
        let is_free = self.routines.iter().all(|other| other.name != name);
        assert!(is_free, "two routines named `{name}`");
        self.routines.push(StepList {
            name: name.to_owned(),
            steps: Vec::new(),
            n_draws: 0,
        });
        Routine(self.routines.len() - 1)
    }

    /// Names a computed value, which can be read after a run of its routine.
    ///
    /// # Panics
    /// If the name is taken, or the value is a leaf or already has a name.
    pub fn output(&mut self, name: &str, value: Value) {
        self.check_name(name);
        let shown = self.shown(value);
        self.names.insert(name.to_owned(), value.0);
        let node = &mut self.nodes[value.0];
        assert!(
            node.routine.is_some() && node.name.is_none(),
            "output `{name}`: {shown} is a leaf or has a name"
        );
        (node.name, node.is_output) = (Some(name.to_owned()), true);
    }

    /// The value with a name.
    #[must_use]
    pub fn named(&self, name: &str) -> Option<Value> {
        self.names.get(name).map(|at| Value(*at))
    }

    /// The routine with a name.
    #[must_use]
    pub fn routine_named(&self, name: &str) -> Option<Routine> {
        let found = self.routines.iter().position(|routine| routine.name == name);
        found.map(Routine)
    }

    /// Shape of a value.
    #[must_use]
    pub fn shape(&self, value: Value) -> Shape {
        self.nodes[value.0].shape
    }

    pub(crate) fn leaf(&mut self, operation: Operation, name: &str, shape: Shape) -> Value {
        self.check_name(name);
        assert!(shape[0] > 0 && shape[1] > 0, "`{name}` {shape:?} has no entries");
        let value = self.push(operation, Vec::new(), shape, None);
        self.nodes[value.0].name = Some(name.to_owned());
        self.names.insert(name.to_owned(), value.0);
        value
    }

    /// Place of a further draw in the routine that was begun last.
    pub(crate) fn next_draw(&mut self) -> usize {
        let routine = self.current(&[]);
        self.routines[routine].n_draws += 1;
        self.routines[routine].n_draws
    }

    /// Adds an operation to the routine that was begun last.
    pub(crate) fn compute(&mut self, operation: Operation, operands: Vec<Value>, shape: Shape) -> Value {
        let routine = self.current(&operands);
        let value = self.push(operation, operands, shape, Some(routine));
        self.routines[routine].steps.push(Step::Compute(value));
        value
    }

    pub(crate) fn update(&mut self, update: Update) {
        let routine = self.current(&update.operands());
        self.routines[routine].steps.push(Step::Update(update));
    }

    /// The routine that was begun last, to which all computed operands must belong.
    fn current(&self, operands: &[Value]) -> usize {
        let n_routines = self.routines.len();
        assert!(n_routines > 0, "an operation before the first routine");
        for operand in operands {
            let of = self.nodes[operand.0].routine;
            assert!(
                of.is_none_or(|of| of == n_routines - 1),
                "routine `{}` uses {} of another routine",
                self.routines[n_routines - 1].name,
                self.shown(*operand)
            );
        }
        n_routines - 1
    }

    fn check_name(&self, name: &str) {
        assert!(self.named(name).is_none(), "two values named `{name}`");
    }

    fn push(
        &mut self,
        operation: Operation,
        operands: Vec<Value>,
        shape: Shape,
        routine: Option<usize>,
    ) -> Value {
        assert!(shape[0] > 0 && shape[1] > 0, "a value {shape:?} without entries");
        self.nodes.push(Node {
            operation,
            operands,
            shape,
            routine,
            name: None,
            is_output: false,
        });
        Value(self.nodes.len() - 1)
    }

    /// Steps of a routine whose results are read or that change a parameter, in order.
    pub(crate) fn live_steps(&self, routine: usize) -> Vec<&Step> {
        let mut is_read: Vec<bool> = self.nodes.iter().map(|node| node.is_output).collect();
        let mut live = Vec::new();
        for step in self.routines[routine].steps.iter().rev() {
            let operands = match step {
                Step::Compute(value) if !is_read[value.0] => continue,
                Step::Compute(value) => self.nodes[value.0].operands.clone(),
                Step::Update(update) => update.operands(),
            };
            operands.iter().for_each(|operand| is_read[operand.0] = true);
            live.push(step);
        }
        live.reverse();
        live
    }
}
