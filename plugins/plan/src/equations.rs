//! Equations with Rust's operators, in which learners are written.
//!
//! ```ignore
//! let equations = Equations::new();
//! let x = equations.input("x", [4, 2]);
//! equations.routine("loss");
//! let loss = (x * 2.0 - 1.0).square().mean();
//! equations.output("loss", loss);
//! let processor = Processor::<f32>::new(equations.into_graph());
//! ```

use crate::extension::Extension;
use crate::graph::{Graph, Routine, Shape, Value};
use crate::operations::Activation;
use crate::updates::Optimiser;
use std::cell::RefCell;
use std::ops::{Add, Div, Mul, Neg, Range, Sub};

/// A graph that is being written.
#[derive(Debug, Default)]
pub struct Equations(RefCell<Graph>);

/// A value in an equation. Its methods and operators add operations to the graph, and panic like those of [`Graph`]. A
/// quotient by a constant is the product with its rounded inverse.
#[derive(Debug, Clone, Copy)]
pub struct Expression<'e> {
    equations: &'e Equations,
    value: Value,
}

/// Optimiser of a group of parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Descent<'a> {
    /// Name of the learning rate, which [`State::set_number`](crate::State::set_number) changes.
    pub rate: &'a str,
    /// First learning rate.
    pub first_rate: f64,
    /// Decay rates of the two moments.
    pub betas: [f64; 2],
    /// Largest Euclidean norm of the gradient over all parameters of the group.
    pub largest_norm: Option<f64>,
}

impl<'a> Descent<'a> {
    /// Adam with a learning rate, the decay rates of Kingma and Ba 2015, and a largest norm.
    #[must_use]
    pub fn adam(rate: &'a str, first_rate: f64, largest_norm: Option<f64>) -> Self {
        Self {
            rate,
            first_rate,
            betas: [0.9, 0.999],
            largest_norm,
        }
    }
}

impl Equations {
    /// Begins a graph.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// The graph that was written.
    #[must_use]
    pub fn into_graph(self) -> Graph {
        self.0.into_inner()
    }

    fn expression(&self, value: Value) -> Expression<'_> {
        Expression {
            equations: self,
            value,
        }
    }

    fn add_with(&self, add: impl FnOnce(&mut Graph) -> Value) -> Expression<'_> {
        let value = add(&mut self.0.borrow_mut());
        self.expression(value)
    }

    /// A matrix that a caller writes before a run.
    #[must_use]
    pub fn input(&self, name: &str, shape: Shape) -> Expression<'_> {
        self.add_with(|graph| graph.input(name, shape))
    }

    /// The parameter with a name.
    #[must_use]
    pub fn parameter(&self, name: &str, shape: Shape) -> Expression<'_> {
        self.add_with(|graph| graph.parameter(name, shape))
    }

    /// A matrix with given entries, row by row.
    #[must_use]
    pub fn constant(&self, shape: Shape, entries: &[f64]) -> Expression<'_> {
        self.add_with(|graph| graph.constant(shape, entries))
    }

    /// Standard normal numbers.
    #[must_use]
    pub fn normal(&self, shape: Shape) -> Expression<'_> {
        self.add_with(|graph| graph.normal(shape))
    }

    /// Uniform numbers strictly between 0 and 1.
    #[must_use]
    pub fn uniform(&self, shape: Shape) -> Expression<'_> {
        self.add_with(|graph| graph.uniform(shape))
    }

    /// Begins a routine: operations added from now on belong to it.
    pub fn routine(&self, name: &str) -> Routine {
        self.0.borrow_mut().routine(name)
    }

    /// Names a computed value, which can be read after a run.
    pub fn output(&self, name: &str, x: Expression<'_>) {
        self.0.borrow_mut().output(name, x.value);
    }

    /// Matrices of equal rows side by side.
    #[must_use]
    pub fn join<'e>(&'e self, parts: &[Expression<'e>]) -> Expression<'e> {
        let values: Vec<Value> = parts.iter().map(|part| part.value).collect();
        self.add_with(|graph| graph.join(&values))
    }

    /// Result of an operation that another crate computes.
    #[must_use]
    pub fn apply<'e>(
        &'e self,
        extension: impl Extension + 'static,
        operands: &[Expression<'e>],
    ) -> Expression<'e> {
        let values: Vec<Value> = operands.iter().map(|operand| operand.value).collect();
        self.add_with(|graph| graph.apply(extension, &values))
    }

    /// Gradients of a loss `[1, 1]`, one per wanted value.
    #[must_use]
    pub fn gradients<'e>(&'e self, loss: Expression<'e>, wanted: &[Expression<'e>]) -> Vec<Expression<'e>> {
        let wanted: Vec<Value> = wanted.iter().map(|it| it.value).collect();
        let found = self.0.borrow_mut().gradients(loss.value, &wanted);
        found.into_iter().map(|value| self.expression(value)).collect()
    }

    /// One step of an optimiser against the gradient of a loss in a group of parameters.
    pub fn descend(&self, loss: Expression<'_>, parameters: &[Expression<'_>], descent: &Descent<'_>) {
        let wanted: Vec<Value> = parameters.iter().map(|it| it.value).collect();
        let gradients = self.0.borrow_mut().gradients(loss.value, &wanted);
        let gradients: Vec<_> = gradients
            .into_iter()
            .map(|value| self.expression(value))
            .collect();
        self.step_against(&gradients, parameters, descent);
    }

    /// One step of an optimiser against given gradients, one per parameter.
    pub fn step_against(
        &self,
        gradients: &[Expression<'_>],
        parameters: &[Expression<'_>],
        descent: &Descent<'_>,
    ) {
        assert_eq!(gradients.len(), parameters.len(), "gradients and parameters");
        let mut graph = self.0.borrow_mut();
        let gradients: Vec<Value> = gradients.iter().map(|it| it.value).collect();
        let gradients = match descent.largest_norm {
            Some(largest) => graph.clip_norm(&gradients, largest),
            None => gradients,
        };
        let learning_rate = graph.number(descent.rate, descent.first_rate);
        for (parameter, gradient) in parameters.iter().zip(gradients) {
            let betas = descent.betas;
            graph.adam(parameter.value, gradient, Optimiser { learning_rate, betas });
        }
    }

    /// Moves parameters towards others: `target <- target + tau (source - target)`.
    pub fn follow(&self, targets: &[Expression<'_>], sources: &[Expression<'_>], tau: f64) {
        assert_eq!(
            targets.len(),
            sources.len(),
            "parameters that follow, and that are followed"
        );
        for (target, source) in targets.iter().zip(sources) {
            self.0.borrow_mut().follow(target.value, source.value, tau);
        }
    }

    /// Copies a value to a parameter.
    pub fn assign(&self, target: Expression<'_>, source: Expression<'_>) {
        self.0.borrow_mut().assign(target.value, source.value);
    }
}

macro_rules! functions {
    ($($(#[$text:meta])* $name:ident($($argument:ident: $type:ty),*);)*) => {
        impl<'e> Expression<'e> {
            $($(#[$text])*
            #[must_use]
            pub fn $name(self $(, $argument: $type)*) -> Expression<'e> {
                self.equations.add_with(|graph| graph.$name(self.value $(, $argument)*))
            })*
        }
    };
}

functions! {
    /// `max(x, 0)`.
    relu();
    /// Hyperbolic tangent.
    tanh();
    /// `e^x`.
    exp();
    /// Natural logarithm.
    ln();
    /// `ln(1 + x)`.
    ln_1p();
    /// `ln(1 + e^x)`.
    softplus();
    /// `1 / (1 + e^-x)`.
    sigmoid();
    /// `|x|`.
    abs();
    /// `x^2`.
    square();
    /// Square root.
    sqrt();
    /// `x` within two limits, otherwise the nearer limit.
    clamp(low: f64, high: f64);
    /// `ln Gamma(x)`.
    ln_gamma();
    /// Derivative of `ln Gamma`.
    digamma();
    /// `x`, through which no gradient passes.
    stop_gradient();
    /// Sum of each column over the rows, `[1, columns]`.
    sum_rows();
    /// Sum of each row over the columns, `[rows, 1]`.
    sum_columns();
    /// Sum of all entries, `[1, 1]`.
    sum();
    /// Mean of all entries, `[1, 1]`.
    mean();
    /// Mean of each column, `[1, columns]`.
    mean_rows();
    /// Mean of each row, `[rows, 1]`.
    mean_columns();
    /// Columns of a range.
    columns(range: Range<usize>);
    /// Softmax of each row.
    softmax();
    /// Logarithm of the softmax of each row.
    log_softmax();
    /// Largest entry of each row, `[rows, 1]`, without a gradient.
    largest_of_columns();
    /// Column of the largest entry of each row, the first one of equals, `[rows, 1]`, without a gradient.
    place_of_largest();
    /// Entry of each row with a rank in ascending order, 0 for the smallest one, `[rows, 1]`, without a gradient.
    ranked(rank: usize);
    /// The same entries in another shape.
    reshape(shape: Shape);
    /// Each row a number of times, one after the other.
    repeat_rows(times: usize);
    /// Sums of consecutive rows.
    sum_groups(size: usize);
    /// `ln x` of `x ~ Gamma(shape, 1)` for each shape.
    log_gamma_draw();
    /// Differential entropy `[rows, 1]` of Dirichlet distributions with these concentrations.
    dirichlet_entropy();
}

impl<'e> Expression<'e> {
    /// The equations to which it belongs.
    #[must_use]
    pub fn equations(self) -> &'e Equations {
        self.equations
    }

    /// Numbers of rows and columns.
    #[must_use]
    pub fn shape(self) -> Shape {
        self.equations.0.borrow().shape(self.value)
    }

    /// Number of rows.
    #[must_use]
    pub fn n_rows(self) -> usize {
        self.shape()[0]
    }

    /// Number of columns.
    #[must_use]
    pub fn n_columns(self) -> usize {
        self.shape()[1]
    }

    fn with(self, other: Self, add: impl FnOnce(&mut Graph, Value, Value) -> Value) -> Self {
        self.equations
            .add_with(|graph| add(graph, self.value, other.value))
    }

    /// The smaller number; its gradient passes to `self` if both are equal.
    #[must_use]
    pub fn min(self, other: Self) -> Self {
        self.with(other, Graph::min)
    }

    /// The larger number; its gradient passes to `self` if both are equal.
    #[must_use]
    pub fn max(self, other: Self) -> Self {
        self.with(other, Graph::max)
    }

    /// Dense layer `f(x weight + bias)`.
    #[must_use]
    pub fn dense(self, weight: Self, bias: Self, activation: Activation) -> Self {
        let (weight, bias) = (weight.value, bias.value);
        self.equations
            .add_with(|graph| graph.dense(self.value, weight, bias, activation))
    }

    /// Product of two factors, each of which may be transposed first.
    #[must_use]
    pub fn product(self, other: Self, transposed: [bool; 2]) -> Self {
        self.with(other, |graph, a, b| graph.product(a, b, transposed))
    }

    /// Entry of each row in the column that `index` `[rows, 1]` names.
    #[must_use]
    pub fn gather(self, index: Self) -> Self {
        self.with(index, Graph::gather)
    }

    /// Log density `[rows, 1]` of points with the logarithms `log_points` under Dirichlet distributions with these
    /// concentrations.
    #[must_use]
    pub fn dirichlet_density(self, log_points: Self) -> Self {
        self.with(log_points, Graph::dirichlet_density)
    }
}

macro_rules! operators {
    ($($trait:ident $method:ident $pair:ident, |$graph:ident, $x:ident, $c:ident| $constant:expr, $turned:expr;)*) => {
        $(impl<'e> $trait for Expression<'e> {
            type Output = Expression<'e>;

            fn $method(self, other: Self) -> Self {
                self.with(other, Graph::$pair)
            }
        }

        impl<'e> $trait<f64> for Expression<'e> {
            type Output = Expression<'e>;

            fn $method(self, $c: f64) -> Expression<'e> {
                let $x = self.value;
                self.equations.add_with(|$graph| $constant)
            }
        }

        impl<'e> $trait<Expression<'e>> for f64 {
            type Output = Expression<'e>;

            fn $method(self, other: Expression<'e>) -> Expression<'e> {
                let ($x, $c) = (other.value, self);
                other.equations.add_with(|$graph| $turned)
            }
        })*
    };
}

operators! {
    Add add add, |graph, x, c| graph.shift(x, c), graph.shift(x, c);
    Sub sub sub, |graph, x, c| graph.shift(x, -c), { let x = graph.neg(x); graph.shift(x, c) };
    Mul mul mul, |graph, x, c| graph.scale(x, c), graph.scale(x, c);
    Div div div, |graph, x, c| graph.scale(x, 1.0 / c), { let c = graph.constant([1, 1], &[c]); graph.div(c, x) };
}

impl<'e> Neg for Expression<'e> {
    type Output = Expression<'e>;

    fn neg(self) -> Expression<'e> {
        self.equations.add_with(|graph| graph.neg(self.value))
    }
}
